"""Where the error of the mesh comes from: what each element, along each of its axes, adds to a change by refinement.

Let φ and ψ be a right and a left mode on the mesh, written as displacements on the refined mesh, r = Q(λ)φ and
ρ = Q(λ)ᴴψ their residuals there, and P as in `Refined`. To first order, refining the mesh changes the eigenvalue by
ρᴴP⁻¹r / (ψᴴQ′(λ)φ) and an onset at which two modes meet by ρᴴP⁻¹r / (ψᴴ∂Q/∂p φ), p being the parameter. ρ is
orthogonal to all functions of the mesh itself. So only that part of z = P⁻¹r counts which the mesh cannot represent,
and ρᴴz is a sum over the functions that refinement adds, one for each new node. The summand of a node is divided
equally among the elements around it.

In a hexahedron each new function is a product of three functions of one coordinate. If it is new along one axis only,
its summand is an error of the mesh along this axis; if it is new along two or three axes, it is divided equally among
them. A tetrahedron has no such axes, and its summands stay whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse as sp

from ..fem.spaces import DisplacementSpace
from .two_level import reference_coordinates

_AT_ONCE = 4_000_000  # numbers that are worked on at once: elements are taken in blocks, to save memory
_ROUNDED = 1e-9  # values of shape functions that differ by less are equal, up to rounding


@dataclass(frozen=True)
class Lattice:
    """The nodes of the refined mesh in each element of the mesh itself.

    Attributes
    ----------
    nodes : (m, l) int
        Numbers, in the refined mesh, of the l nodes in each of the m elements: in hexahedra ordered by their place in
        the element, in tetrahedra ascending.
    transform : (l, l) float
        Turns values at the l nodes into coefficients of the functions of the mesh itself and of the new functions.
    axes : (l, a) float
        The part of a node's summand that belongs to each axis. A row adds up to 1 for a node of a new function and is
        zero for a node that the mesh itself has.
    sharing : (N,) int
        Number of elements of the mesh itself that each node of the refined mesh belongs to.
    """

    nodes: np.ndarray
    transform: np.ndarray
    axes: np.ndarray
    sharing: np.ndarray


def lattice_of(coarse: DisplacementSpace, fine: DisplacementSpace) -> Lattice:
    """Return the nodes of the refined mesh in each element of the mesh itself."""
    elements = coarse.mesh.nelements
    children = np.asarray(fine.dofs.element_dofs).T.reshape(elements, -1)
    if _is_hexahedral(coarse):
        n = 2 * coarse.order + 1
        parent = np.repeat(np.arange(elements), children.shape[1])
        X = reference_coordinates(coarse, parent, fine.coordinates[children.ravel()].T)
        place = np.rint((n - 1) * X).astype(int)
        nodes = np.empty((elements, n**3), int)
        nodes[parent, (place[0] * n + place[1]) * n + place[2]] = children.ravel()
        transform, axes = _hexahedron(coarse.order)
    else:
        # The eight children of an element share nodes; each is taken once. All elements have equally many.
        ordered = np.sort(children, axis=1)
        once = np.diff(ordered, axis=1, prepend=-1) > 0
        nodes = ordered[once].reshape(elements, -1)
        transform, axes = np.eye(nodes.shape[1]), np.ones((nodes.shape[1], 1))
    return Lattice(nodes, transform, axes, np.bincount(nodes.ravel(), minlength=fine.nodes))


def _is_hexahedral(space: DisplacementSpace) -> bool:
    return len(space.mesh.elem.refdom.p.T) == 8


@cache
def _hexahedron(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return `transform` (l, l) and `axes` (l, 3) of a `Lattice` of hexahedra, with l = (2 order + 1)³."""
    n = 2 * order + 1
    t = np.arange(n) / (n - 1)
    along = np.eye(n)
    # Along one axis the nodes of the mesh itself are at the even places. The coefficient of the new function at an odd
    # place is the value there, less the value that the functions of the mesh itself have there.
    for i in range(1, n, 2):
        if order == 1:
            along[i, ::2] -= [1 - t[i], t[i]]
        else:
            along[i, ::2] -= [(1 - t[i]) * (1 - 2 * t[i]), 4 * t[i] * (1 - t[i]), t[i] * (2 * t[i] - 1)]
    odd = np.arange(n) % 2 == 1
    new = np.stack([g.ravel() for g in np.meshgrid(odd, odd, odd, indexing="ij")], axis=1).astype(float)
    return np.kron(np.kron(along, along), along), new / np.maximum(new.sum(axis=1, keepdims=True), 1)


def shares(
    coarse: DisplacementSpace, fine: DisplacementSpace, E: sp.csr_array, residual: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Split ρᴴz, for k pairs of columns ρ and z, into parts by element of the mesh itself and by axis.

    Parameters
    ----------
    coarse, fine : DisplacementSpace
        Spaces on the mesh itself and on the refined one.
    E : (n_fine, n_coarse) sparse
        The prolongation from the first to the second.
    residual : (n_fine, k) float or complex
        The columns ρ, orthogonal to all functions of the mesh itself.
    z : (n_fine, k) float or complex
        The columns z.

    Returns
    -------
    (k, m, a) float or complex
        For the m elements and their axes, a = 3 for hexahedra and 1 for tetrahedra. The parts of a pair add up to ρᴴz,
        as far as ρ is orthogonal to the functions of the mesh itself.
    """
    lattice = lattice_of(coarse, fine)
    if not _is_hexahedral(coarse):
        # In a tetrahedron the function of the refined mesh at a new node is the new function. What is left of z without
        # the function of the mesh itself that equals z at its nodes is zero there, so only new nodes have coefficients.
        z = z - E @ _at_own_nodes(E, z)
    primal, dual = _nodal(fine.nodal_map, z), _nodal(fine.nodal_inverse.T, residual.conj())
    k, (m, count) = z.shape[1], lattice.nodes.shape
    step = max(1, _AT_ONCE // (3 * count * k))
    parts = [slice(i, i + step) for i in range(0, m, step)]
    back = np.linalg.inv(lattice.transform)
    work = np.zeros_like(dual)  # ρ applied to the function of each node
    for part in parts:
        nodes = lattice.nodes[part]
        local = dual[nodes] / lattice.sharing[nodes][:, :, None]
        turned = (back.T @ local).reshape(-1, 3 * k)
        gather = sp.csr_array((np.ones(nodes.size), (nodes.ravel(), np.arange(nodes.size))), (fine.nodes, nodes.size))
        work += gather @ turned
    found = np.zeros((k, m, lattice.axes.shape[1]), np.result_type(dual, primal))
    for part in parts:
        nodes = lattice.nodes[part]
        product = work[nodes] * (lattice.transform @ primal[nodes]) / lattice.sharing[nodes][:, :, None]
        summed = product.reshape(*nodes.shape, 3, k).sum(axis=2)
        found[:, part] = np.einsum("elk,la->kea", summed, lattice.axes)
    return found


def _nodal(map_: sp.csr_array, columns: np.ndarray) -> np.ndarray:
    """Return (N, 3 k) the vectors at nodes, displacements or forces, that `map_` makes of k columns of unknowns."""
    return np.asarray(map_ @ columns).reshape(-1, 3 * columns.shape[1])


def _at_own_nodes(E: sp.csr_array, z: np.ndarray) -> np.ndarray:
    """Return (n_coarse, k) the values of z, columns on the refined mesh, at the nodes that the mesh itself has too."""
    E = sp.csr_array(E)
    largest = sp.csr_array((np.where(np.abs(E.data) > _ROUNDED, E.data, 0.0), E.indices, E.indptr), E.shape)
    largest.eliminate_zeros()
    rows = np.flatnonzero(np.diff(largest.indptr) == 1)
    first = largest.indptr[rows]
    own = np.abs(largest.data[first] - 1) < _ROUNDED
    found = np.zeros((E.shape[1], z.shape[1]), z.dtype)
    found[largest.indices[first[own]]] = z[rows[own]]
    return found
