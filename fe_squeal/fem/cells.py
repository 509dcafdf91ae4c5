"""From reference cells to the mesh."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import skfem


def shape_functions(element: skfem.Element, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the shape functions of an element at reference points (d, q), and their derivatives there.

    The same few rules are asked for again, by each body and surface of a scene, so that what was found last is kept.

    Returns
    -------
    N : (j, q) float, not to be written to
    dN : (j, d, q) float, not to be written to
    """
    kind: Any = type(element)
    return _shape_functions(kind, X.shape, np.asarray(X, float).tobytes())


@lru_cache(maxsize=16)
def _shape_functions(kind: Any, shape: tuple[int, int], data: bytes) -> tuple[np.ndarray, np.ndarray]:
    element, X = kind(), np.frombuffer(data).reshape(shape)
    found = [element.lbasis(X, j) for j in range(len(element.doflocs))]
    N, dN = np.zeros((len(found), X.shape[1])), np.zeros((len(found), *X.shape))
    for j, (value, slope) in enumerate(found):  # some of them are plain numbers
        N[j] = value
        for axis in range(len(X)):
            dN[j, axis] = slope[axis]
    N.flags.writeable = dN.flags.writeable = False
    return N, dN


def cell_points(
    mesh: skfem.Mesh, elements: np.ndarray, X: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return where the same reference points (3, q) are in elements (e,) int, and the map there.

    Returns
    -------
    x : (e, 3, q) float, m
    inverse : (e, 3, 3, q) float, 1/m
        inverse[e, i, c] = ∂X_i/∂x_c.
    determinant : (e, q) float, m^3
        Of ∂x/∂X.
    """
    N, dN = shape_functions(mesh.elem(), X)
    nodes = mesh.doflocs[:, mesh.dofs.element_dofs[:, elements]].T  # (e, n, 3)
    first = nodes[:, :1]
    local = np.swapaxes(nodes - first, 1, 2)  # differences, since far from the origin coordinates lack digits
    a, b, c = np.moveaxis(local[:, None] @ np.moveaxis(dN, 1, 0), 1, 0)  # ∂x/∂X_i, each (e, 3, q)
    rows = np.stack([np.cross(b, c, axis=1), np.cross(c, a, axis=1), np.cross(a, b, axis=1)], axis=1)
    determinant = np.einsum("ecq,ecq->eq", a, rows[:, 0])
    return local @ N + np.swapaxes(first, 1, 2), rows / determinant[:, None, None], determinant


def geometry_map(mesh: skfem.Mesh, elements: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and Jacobians of reference points, one point per element.

    Parameters
    ----------
    elements : (k,) int
    X : (3, k) float
        Reference coordinates.

    Returns
    -------
    x : (3, k) float, m
    J : (3, 3, k) float, m
        J[i, j] = ∂x_i/∂X_j.
    """
    nodes = mesh.dofs.element_dofs[:, elements]
    places = np.asarray(mesh.elem.doflocs)
    if mesh.elem.refdom is skfem.refdom.RefHex and len(places) in (8, 27):
        return _tensor_map(places, mesh.doflocs[:, nodes], X)
    element = mesh.elem()
    x, J = np.zeros((3, X.shape[1])), np.zeros((3, 3, X.shape[1]))
    for i, node in enumerate(nodes):
        phi, dphi = element.lbasis(X, i)
        x += mesh.doflocs[:, node] * phi
        J += mesh.doflocs[:, node][:, None] * np.asarray(dphi)[None]
    return x, J


def _tensor_map(places: np.ndarray, points: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and Jacobians in hexahedra, whose functions are products of one along each axis.

    Parameters
    ----------
    places : (n, 3) float
        Reference coordinates of the nodes.
    points : (3, n, k) float, m
        Places of the nodes.
    X : (3, k) float
    """
    order = 1 if len(places) == 8 else 2
    place = np.rint(order * places).astype(int)
    lattice = np.empty((3, *(order + 1,) * 3, X.shape[1]))
    lattice[:, place[:, 0], place[:, 1], place[:, 2]] = points
    if order == 1:
        N = np.stack([1 - X, X])
        dN = np.stack([-np.ones_like(X), np.ones_like(X)])
    else:
        N = np.stack([(1 - X) * (1 - 2 * X), 4 * X * (1 - X), X * (2 * X - 1)])
        dN = np.stack([4 * X - 3, 4 - 8 * X, 4 * X - 1])

    def contract(values: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Sum over the last axis of the lattice."""
        return np.asarray(sum(values[..., j, :] * along[j] for j in range(order + 1)))

    z, dz = (contract(lattice, of[:, 2]) for of in (N, dN))
    yz, dyz, ydz = contract(z, N[:, 1]), contract(z, dN[:, 1]), contract(dz, N[:, 1])
    J = np.stack([contract(yz, dN[:, 0]), contract(dyz, N[:, 0]), contract(ydz, N[:, 0])], axis=1)
    return contract(yz, N[:, 0]), J
