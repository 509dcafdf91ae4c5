"""From a mesh to the refined one: prolongation, and places of points in their elements."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import with_short_indices
from ..errors import NotConvergedError
from ..fem.cells import geometry_map
from ..fem.contact import interpolation
from ..fem.spaces import DisplacementSpace

_NEWTON = 30  # Newton steps, at most, to find a point in its element
# The Newton iteration ends with a step of reference coordinates (an element is 1 long) below the rounding of the
# point's coordinates, of which _ROUNDED times the machine's unit is allowed, but never below _FOUND, nor ever above
# _NEAR.
_FOUND, _NEAR = 1e-12, 1e-6
_ROUNDED = 32.0
_ASTRAY = 1e-3  # of an element: a point that is farther from where it is likely to be is looked for from the middle
_POINTS = 4096  # that are found at once: what their elements' maps take then stays in the processor's cache


def prolongation(coarse: DisplacementSpace, fine: DisplacementSpace) -> sp.csr_array:
    """Return the (n_fine, n_coarse) sparse operator that writes a displacement on a mesh as one on the refined mesh.

    Parameters
    ----------
    coarse : DisplacementSpace
        On the mesh.
    fine : DisplacementSpace
        On the mesh that `fe_squeal.mesh.refining.refine` makes of that of `coarse`, with the same order, supports and
        ties.

    Raises
    ------
    NotConvergedError
        The formulation is the mixed one, whose bubbles are not functions of the refined mesh; or an element is so
        distorted that a node of the refined mesh is not found in it.
    """
    if coarse.bubbles is not None:
        raise NotConvergedError(
            'formulation = "mixed" adds functions between elements that a refined mesh does not have; hexahedra of'
            " order 2 do without"
        )
    children = nodes_of_children(coarse, fine)
    any_place = np.empty(fine.nodes, int)  # each node has one in every element around it, and any of these will do
    any_place[children.ravel()] = np.arange(children.size)
    parent, place = np.divmod(any_place, children.shape[1])
    near = places_in_first(coarse, fine)[:, place]
    values = interpolation(coarse, parent, reference_coordinates(coarse, parent, fine.coordinates.T, near))
    nodal = sp.csr_array(sp.kron(values, sp.eye_array(3), format="csr"))
    if coarse.ties or fine.ties:
        return with_short_indices(sp.csr_array(fine.nodal_inverse @ nodal @ coarse.nodal_map))
    return with_short_indices(sp.csr_array(nodal[fine.free][:, coarse.free]))


def nodes_of_children(coarse: DisplacementSpace, fine: DisplacementSpace) -> np.ndarray:
    """Return (m, 8 k) int the k nodes of the eight children of each of the m elements, as numbers in the fine mesh."""
    return np.asarray(fine.dofs.element_dofs).T.reshape(coarse.mesh.nelements, -1)


def places_in_first(coarse: DisplacementSpace, fine: DisplacementSpace) -> np.ndarray:
    """Return (3, 8 k) the reference coordinates, in the first element, of the nodes of its children.

    As a rule other elements are cut alike, so that from there Newton's method has nothing to do but to confirm it.
    """
    nodes = nodes_of_children(coarse, fine)[0]
    return reference_coordinates(coarse, np.zeros(len(nodes), int), fine.coordinates[nodes].T)


def reference_coordinates(
    space: DisplacementSpace, elements: np.ndarray, x: np.ndarray, near: np.ndarray | None = None
) -> np.ndarray:
    """Return the reference coordinates (3, k) of points in their elements, by Newton's method.

    Parameters
    ----------
    space : DisplacementSpace
    elements : (k,) int
        The element that each point lies in.
    x : (3, k) float, m
        The points.
    near : (3, k) float, optional
        Where the points are likely to be. From there, where that is right, and else from the middle of the element,
        the iteration starts.

    Raises
    ------
    NotConvergedError
        The iteration does not settle: an element is too distorted.
    """
    found, size = np.empty_like(x), np.abs(x).max(initial=0.0)
    for start in range(0, len(elements), _POINTS):
        own = slice(start, start + _POINTS)
        found[:, own] = _located(space, elements[own], x[:, own], None if near is None else near[:, own], size)
    return found


def _located(
    space: DisplacementSpace, elements: np.ndarray, x: np.ndarray, near: np.ndarray | None, size: float
) -> np.ndarray:
    """Return what `reference_coordinates` does; `size` is the largest coordinate of any point."""
    middle = np.asarray(space.mesh.elem().doflocs).mean(axis=0)[:, None]
    X = np.repeat(middle, len(elements), axis=1) if near is None else near
    for i in range(_NEWTON):
        at, J = geometry_map(space.mesh, elements, X)
        inverse = np.linalg.inv(J.transpose(2, 0, 1))
        step = (inverse @ (x - at).T[:, :, None])[:, :, 0].T
        X = X + step
        if i == 0 and near is not None and (astray := np.abs(step).max(axis=0) > _ASTRAY).any():
            X[:, astray] = middle
            continue
        # x is known to ε|x| only, so the reference coordinates are known to ε|x||J⁻¹| only: less well in thin elements.
        rounding = _ROUNDED * np.finfo(float).eps * size * np.abs(inverse).max(axis=(1, 2))
        if (np.abs(step) <= np.clip(rounding, _FOUND, _NEAR)).all():
            return X
    raise NotConvergedError("a node of the refined mesh was not found in its element: an element is too distorted")
