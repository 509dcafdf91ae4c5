"""Where the error of the mesh comes from: what each element, along each of its directions, adds to a change.

With φ and ψ the right and left mode on the mesh, lifted to the refined one, r = Q(λ)φ and ρ = Q(λ)ᴴψ there, and P as in
`Refined`, refining the mesh changes an eigenvalue by ρᴴP⁻¹r / (ψᴴQ′(λ)φ), an onset at which two modes meet by
ρᴴP⁻¹r / (ψᴴ∂Q/∂p φ), both up to products of two such changes. ρ vanishes on all functions of the mesh itself. So of
z = P⁻¹r only what the mesh cannot represent counts, and ρᴴz is a sum over the functions that refinement adds, one for
each new node. That of a node belongs to the elements around it in equal parts.

In a hexahedron the new functions are products of one function along each axis. A function that is new along one axis
alone is the error of the mesh along this axis; one that is new along two or three belongs to these in equal parts. In a
tetrahedron there are no axes to tell apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse as sp

from ..fem.spaces import DisplacementSpace
from .two_level import reference_coordinates

_AT_ONCE = 4_000_000  # numbers in a block of elements
_ROUNDED = 1e-9  # of values of shape functions


@dataclass(frozen=True)
class Lattice:
    """The nodes of the refined mesh in each element of the mesh itself.

    Attributes
    ----------
    nodes : (m, l) int
        Of the refined mesh: in hexahedra by their place, in tetrahedra in any order.
    transform : (l, l) float
        From values at the nodes to the coefficients of the functions of the mesh itself and of those that are new.
    axes : (l, a) float
        Which part of a node's function belongs to each axis of the element: ones in all for a new function, else zero.
    sharing : (N,) int
        How many elements of the mesh itself a node of the refined mesh belongs to.
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
        # Every element has as many nodes of its own: each once, in the order of their numbers.
        ordered = np.sort(children, axis=1)
        once = np.diff(ordered, axis=1, prepend=-1) > 0
        nodes = ordered[once].reshape(elements, -1)
        transform, axes = np.eye(nodes.shape[1]), np.ones((nodes.shape[1], 1))
    return Lattice(nodes, transform, axes, np.bincount(nodes.ravel(), minlength=fine.nodes))


def _is_hexahedral(space: DisplacementSpace) -> bool:
    return len(space.mesh.elem.refdom.p.T) == 8


@cache
def _hexahedron(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the transform (l, l) and the parts of the axes (l, 3) for l = (2 order + 1)³ nodes."""
    n = 2 * order + 1
    t = np.arange(n) / (n - 1)
    along = np.eye(n)
    for i in range(1, n, 2):  # less what the mesh itself has there between its own nodes, which are at even places
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
    """Return the parts (k, m, a) of ρᴴz for columns ρ and z (n_fine, k): by element of the mesh itself and its axes.

    Parameters
    ----------
    coarse, fine : DisplacementSpace
        Of the mesh and of the refined one.
    E : (n_fine, n_coarse) sparse
        The prolongation between them.
    residual, z : (n_fine, k) float or complex
        ρ, which vanishes on the functions of the mesh itself, and z.

    Returns
    -------
    (k, m, a)
        a is three for hexahedra, one for tetrahedra. The sum over elements and axes is ρᴴz, as far as ρ does vanish on
        the functions of the mesh itself.
    """
    lattice = lattice_of(coarse, fine)
    if not _is_hexahedral(coarse):  # new functions are those of the refined mesh, at new nodes
        z = z - E @ _at_own_nodes(E, z)
    primal, dual = _nodal(fine.nodal_map, z), _nodal(fine.nodal_inverse.T, residual.conj())
    k, (m, count) = z.shape[1], lattice.nodes.shape
    step = max(1, _AT_ONCE // (3 * count * k))
    parts = [slice(i, i + step) for i in range(0, m, step)]
    back = np.linalg.inv(lattice.transform)
    work = np.zeros_like(dual)  # of the residual with each function
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
    """Return the displacements at nodes, or forces there, (N, 3 k) of columns of unknowns."""
    return np.asarray(map_ @ columns).reshape(-1, 3 * columns.shape[1])


def _at_own_nodes(E: sp.csr_array, z: np.ndarray) -> np.ndarray:
    """Return (n_coarse, k) the values of columns of the refined mesh at nodes that the mesh itself has, too."""
    E = sp.csr_array(E)
    largest = sp.csr_array((E.data * (np.abs(E.data) > _ROUNDED), E.indices, E.indptr), E.shape)
    largest.eliminate_zeros()
    rows = np.flatnonzero(np.diff(largest.indptr) == 1)
    first = largest.indptr[rows]
    own = np.abs(largest.data[first] - 1) < _ROUNDED
    found = np.zeros((E.shape[1], z.shape[1]), z.dtype)
    found[largest.indices[first[own]]] = z[rows[own]]
    return found
