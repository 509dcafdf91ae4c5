"""Points of integration on facets, with what is known there of their elements, and composite quadrature."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import skfem
from skfem.mapping import MappingAffine
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from ..errors import MeshError
from .cells import geometry_map, shape_functions

_ROUNDING = 4.0  # roundings of a coordinate, over the size of the element, that remain at each point
_FIBONACCI = 377, 610  # two neighbours in the sequence of these numbers; the larger one is the number of points
_LARGEST = 1e-6  # part of the size of an element: a larger error would show in results


@dataclass(frozen=True)
class FacetPoints:
    """Points of integration on facets.

    Attributes
    ----------
    elements : (f,) int
        The element of each facet; of a facet between two elements the first one.
    points : (f, q, 3) float, m
    areas : (f, q) float, m^2
        Weights of the points.
    normals : (f, q, 3) float
        Unit normals, out of the element.
    values : (f, j, q) float
        Values of the element's shape functions.
    """

    elements: np.ndarray
    points: np.ndarray
    areas: np.ndarray
    normals: np.ndarray
    values: np.ndarray


def facet_points(
    mesh: skfem.Mesh, element: skfem.Element, facets: np.ndarray, quadrature: tuple[np.ndarray, np.ndarray]
) -> FacetPoints:
    """Return the points of a quadrature on facets.

    Where a point lies in its element follows from which face of the reference element the facet is. So all shape
    functions are evaluated once for each of these faces, and nothing is solved for the coordinates in the element,
    which takes long, and does not converge in elements that are distorted or far from the origin.

    Parameters
    ----------
    mesh : skfem.Mesh
        Tetrahedra or hexahedra, straight or curved.
    element : skfem.Element
        The scalar element whose functions are evaluated.
    facets : (f,) int
    quadrature : ((2, q), (q,)) float
        Points and weights on the reference facet.

    Raises
    ------
    MeshError
        So far from the origin, rounding hides the shape of the elements.
    """
    require_digits(mesh, facets)
    X, W = quadrature
    refdom, elements = mesh.refdom, mesh.f2t[0, facets]
    face = np.argmax(mesh.t2f[:, elements] == facets, axis=0)  # which face of its element each facet is
    flat, slopes = shape_functions(skfem.ElementTriP1() if mesh.brefdom is RefTri else skfem.ElementQuad1(), X)
    corners = refdom.p[:, refdom.facets]  # (3, faces, corners)
    Y, tangents = corners @ flat, np.einsum("rki,iaq->kraq", corners, slopes)  # of all faces of the reference element
    shape = (-1, *Y.shape[1:])  # (functions, faces, points)
    N, dN = shape_functions(mesh.elem(), Y.reshape(3, -1))
    geometry, slopes = N.reshape(shape), dN.reshape(len(N), *Y.shape)
    along = np.einsum("nrkq,kraq->kanq", slopes, tangents)  # derivatives of the map along the facet
    outward = np.einsum("nrkq,rk->knq", slopes, corners.mean(axis=2) - refdom.p.mean(axis=1)[:, None])
    values = np.moveaxis(shape_functions(element, Y.reshape(3, -1))[0].reshape(shape), 1, 0)
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs[:, elements]].T  # (f, n, 3)
    first = nodes[:, :1]
    local = np.swapaxes(nodes - first, 1, 2)  # differences, since far from the origin coordinates lack digits
    x, out = (local @ of[face] for of in (np.moveaxis(geometry, 1, 0), outward))  # (f, 3, q)
    a, b = np.moveaxis(local[:, None] @ along[face], 1, 0)
    normals = np.cross(a, b, axis=1)
    size = np.linalg.norm(normals, axis=1)
    normals *= (np.sign(np.einsum("fcq,fcq->fq", normals, out)) / np.where(size > 0, size, 1.0))[:, None]
    return FacetPoints(elements, np.swapaxes(x, 1, 2) + first, size * W, np.swapaxes(normals, 1, 2), values[face])


def facet_corners(mesh: skfem.Mesh, facets: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Return the corners of facets in cyclic order as numbers of nodes, (f, 4) int; triangles repeat the last one.

    Parameters
    ----------
    facets : (f,) int
    elements : (f,) int
        An element of each facet.
    """
    local = np.argmax(mesh.t2f[:, elements] == facets, axis=0)
    order = np.array([[c[0], c[1], c[2], c[-1]] for c in mesh.refdom.facets])[local]
    return np.asarray(mesh.t.T[elements[:, None], order])


@dataclass(frozen=True)
class FacetEdges:
    """The edges of some facets, each edge once for each of the facets that it belongs to.

    Attributes
    ----------
    nodes : (e, 2) int
        Corners at the ends, in ascending order.
    facet : (e,) int
        Which of the facets, from 0.
    normals : (e, 3) float
        Unit normals of the facet at the middle of the edge, out of its element.
    inwards : (e, 3) float
        From the middle of the edge into the facet, along the facet; of any length.
    """

    nodes: np.ndarray
    facet: np.ndarray
    normals: np.ndarray
    inwards: np.ndarray


def facet_edges(mesh: skfem.Mesh, facets: np.ndarray) -> FacetEdges:
    """Return the edges of facets (f,) int; normals are those of the curved facets. Of an inner facet, its first side.

    Parameters
    ----------
    facets : (f,) int
        At least one.
    """
    cells = mesh.f2t[0, facets]
    local = (mesh.t2f[:, cells] == facets).argmax(axis=0)
    reference = mesh.elem.refdom
    places = np.asarray(reference.p, float)
    rows = []
    for k, corners in enumerate(reference.facets):
        own = np.flatnonzero(local == k)
        normal = np.cross(*(places[:, corners[i]] - places[:, corners[0]] for i in (1, 2)))
        middle = places[:, corners].mean(axis=1)
        normal = normal * np.sign(normal @ (middle - places.mean(axis=1)))
        for ends in ([e for e in reference.edges if set(e) <= set(corners)] if len(own) else ()):
            at = places[:, ends].mean(axis=1)
            _, J = geometry_map(mesh, cells[own], np.repeat(at[:, None], len(own), axis=1))
            J = J.transpose(2, 0, 1)
            outward = np.linalg.solve(J.transpose(0, 2, 1), np.broadcast_to(normal[:, None], (len(own), 3, 1)))[..., 0]
            outward /= np.linalg.norm(outward, axis=1, keepdims=True)
            rows.append((np.sort(mesh.t[ends][:, cells[own]].T, axis=1), own, outward, J @ (middle - at)))
    return FacetEdges(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def require_digits(mesh: skfem.Mesh, facets: np.ndarray) -> None:
    """Raise MeshError if elements at facets (f,) int are so far from the origin that rounding hides their shape.

    With coordinates of size x, places in an element of size h are known to ε x/h only. Straight tetrahedra are left
    out: theirs are convex however their corners are rounded.
    """
    if isinstance(mesh.mapping(), MappingAffine):
        return
    corners = mesh.p[:, mesh.t[:, mesh.f2t[0, facets]]]
    pairs = combinations(range(corners.shape[1]), 2)
    lengths = np.array([np.linalg.norm(corners[:, i] - corners[:, j], axis=0) for i, j in pairs])
    size = float(lengths[lengths > 0].min(initial=np.inf))  # edges of collapsed cells have the length 0
    reach = float(np.abs(corners).max(initial=0.0))
    if _ROUNDING * np.finfo(float).eps * reach / size > _LARGEST:
        raise MeshError(
            f"elements of {size:.3g} m have nodes at {reach:.3g} m from the origin, where rounding hides their shape;"
            " expected elements that are less distorted, or a mesh nearer to the origin"
        )


def subdivided_quadrature(refdom: type, order: int, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a composite rule on the reference triangle or square, cut into parts² equal pieces.

    Returns
    -------
    X : (2, q), W : (q,)
    """
    X, W = get_quadrature(refdom, order)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(parts), np.arange(parts), indexing="ij"))
    if refdom is not RefTri:
        pieces = [(np.array([a, b]), 1.0) for a, b in zip(i, j, strict=True)]
    else:
        # Upright triangles from their lower left corner, and those upside down from their upper right one.
        pieces = [(np.array([a, b]), 1.0) for a, b in zip(i, j, strict=True) if a + b < parts]
        pieces += [(np.array([a + 1, b + 1]), -1.0) for a, b in zip(i, j, strict=True) if a + b < parts - 1]
    points = [(corner[:, None] + sign * X) / parts for corner, sign in pieces]
    return np.concatenate(points, axis=1), np.tile(W / parts**2, len(pieces))


def scattered_quadrature(refdom: type) -> tuple[np.ndarray, np.ndarray]:
    """Return a rule of equal weights on the reference triangle or square for integrands that vanish beyond a line.

    Its points, a Fibonacci lattice, stand in no rows, so that they tell which part of the facet lies before any line:
    to 2e-3 in the mean of all lines, and to 1e-3 where the line runs along an edge of the square.

    Returns
    -------
    X : (2, q), W : (q,)
    """
    step, count = _FIBONACCI
    i = np.arange(count)
    X = (np.stack([i, i * step % count]) + 0.5) / count
    if refdom is not RefTri:
        return X, np.full(count, 1 / count)
    return np.where(X.sum(axis=0) > 1, 1 - X, X), np.full(count, 0.5 / count)  # one half of the square on the other
