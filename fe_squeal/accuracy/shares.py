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
from .prolongation import nodes_of_children, places_in_first, reference_coordinates

_COLUMNS = 16  # of a block that is split at once, to save memory
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
    children = nodes_of_children(coarse, fine)
    if _is_hexahedral(coarse):
        n = 2 * coarse.order + 1
        parent = np.repeat(np.arange(elements), children.shape[1])
        near = np.tile(places_in_first(coarse, fine), elements)
        X = reference_coordinates(coarse, parent, fine.coordinates[children.ravel()].T, near)
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
    own = np.linalg.inv(np.vander(t[::2], increasing=True))
    along[1::2, ::2] -= np.vander(t[1::2], order + 1, increasing=True) @ own
    odd = np.arange(n) % 2 == 1
    new = np.stack([g.ravel() for g in np.meshgrid(odd, odd, odd, indexing="ij")], axis=1).astype(float)
    return np.kron(np.kron(along, along), along), new / np.maximum(new.sum(axis=1, keepdims=True), 1)


class Hierarchy:
    """How a function on the refined mesh divides into one of the mesh itself and what each new node adds.

    Both maps are sparse: values at the nodes of the refined mesh to the coefficients of the functions of `Lattice`, and
    forces there to the work that they do on these functions. A product of the two belongs to a node, and through it to
    the elements around.

    Parameters
    ----------
    coarse, fine : DisplacementSpace
        Of the mesh and of the refined one.
    E : (n_fine, n_coarse) sparse
        The prolongation between them.

    Attributes
    ----------
    elements : (m a, N) sparse
        From what belongs to the N nodes of the refined mesh to what belongs to the m elements and their a axes.
    """

    def __init__(self, coarse: DisplacementSpace, fine: DisplacementSpace, E: sp.csr_array) -> None:
        lattice = lattice_of(coarse, fine)
        self._fine, self._E = fine, E
        self._hexahedral = _is_hexahedral(coarse)
        m, count = lattice.nodes.shape
        self.axes = lattice.axes.shape[1]
        nodes = lattice.nodes.ravel()
        weights = lattice.axes[np.tile(np.arange(count), m)] / lattice.sharing[nodes][:, None]
        rows = np.repeat(np.arange(m), count)[:, None] * self.axes + np.arange(self.axes)
        columns = np.broadcast_to(nodes[:, None], rows.shape)
        shape = (m * self.axes, fine.nodes)
        self.elements = sp.csr_array((weights.ravel(), (rows.ravel(), columns.ravel())), shape)
        if self._hexahedral:
            self._transform = _at_nodes(lattice, lattice.transform)
            self._back = sp.csr_array(_at_nodes(lattice, np.linalg.inv(lattice.transform)).T)

    def at_nodes(self, residual: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the parts (N, k) of ρᴴz that belong to the nodes of the refined mesh.

        Parameters
        ----------
        residual, z : (n_fine, k) float or complex
            ρ, which vanishes on the functions of the mesh itself, and z.
        """
        found = np.empty((self._fine.nodes, z.shape[1]), np.result_type(residual, z))
        for start in range(0, z.shape[1], _COLUMNS):
            block = slice(start, start + _COLUMNS)
            own, dual = z[:, block], _nodal(self._fine.nodal_inverse.T, residual[:, block].conj())
            if self._hexahedral:
                hierarchical, work = self._transform @ _nodal(self._fine.nodal_map, own), self._back @ dual
            else:  # the new functions are those of the refined mesh, at new nodes
                own = own - self._E @ _at_own_nodes(self._E, own)
                hierarchical, work = _nodal(self._fine.nodal_map, own), dual
            found[:, block] = (work * hierarchical).reshape(self._fine.nodes, 3, -1).sum(axis=1)
        return found

    def shares(self, residual: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the parts (k, m, a) of ρᴴz for columns ρ and z (n_fine, k): by element of the mesh and its axes.

        a is three for hexahedra, one for tetrahedra. The sum over elements and axes is ρᴴz, as far as ρ does vanish on
        the functions of the mesh itself.
        """
        parts = self.elements @ self.at_nodes(residual, z)
        return np.ascontiguousarray(parts.T).reshape(z.shape[1], -1, self.axes)


def _at_nodes(lattice: Lattice, local: np.ndarray) -> sp.csr_array:
    """Return (N, N) sparse what a map (l, l) inside elements does at nodes.

    It does the same at a node in every element around it, so that each row is taken from one of them.
    """
    count = lattice.nodes.shape[1]
    nodes, first = np.unique(lattice.nodes.ravel(), return_index=True)
    rows = sp.csr_array(np.where(np.abs(local) > _ROUNDED, local, 0.0))[first % count].tocoo()
    columns = lattice.nodes[(first // count)[rows.row], rows.col]
    return sp.csr_array((rows.data, (nodes[rows.row], columns)), shape=(len(nodes), len(nodes)))


def _nodal(map_: sp.csr_array, columns: np.ndarray) -> np.ndarray:
    """Return (N, 3 k) the vectors at nodes, displacements or forces, that `map_` makes of k columns of unknowns."""
    return np.asarray(map_ @ columns).reshape(-1, 3 * columns.shape[1])


def _at_own_nodes(E: sp.csr_array, z: np.ndarray) -> np.ndarray:
    """Return (n_coarse, k) the values of z, columns on the refined mesh, at the nodes that the mesh itself has too."""
    largest = sp.csr_array(E, copy=True)
    largest.data[np.abs(largest.data) <= _ROUNDED] = 0.0
    largest.eliminate_zeros()  # which moves the indices, too
    rows = np.flatnonzero(np.diff(largest.indptr) == 1)
    first = largest.indptr[rows]
    own = np.abs(largest.data[first] - 1) < _ROUNDED
    found = np.zeros((E.shape[1], z.shape[1]), z.dtype)
    found[largest.indices[first[own]]] = z[rows[own]]
    return found
