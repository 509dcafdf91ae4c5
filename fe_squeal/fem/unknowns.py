"""The unknowns of a displacement space: supports, ties and bubbles, and what maps nodes to unknowns and back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.assembly import Dofs
from skfem.refdom import RefTet

from ..eigen.linear.spread_matrix import Partition
from .bubbles import Bubbles
from .cubic import CubicDofs, ElementHex3
from .row_order import unknowns_along_bodies
from .ties import Tie

ELEMENTS = {
    (True, 1): skfem.ElementTetP1,
    (True, 2): skfem.ElementTetP2,
    (False, 1): skfem.ElementHex1,
    (False, 2): skfem.ElementHex2,
    (False, 3): ElementHex3,
}
_CANCELLED = 1e-12  # part of Σ|products|: thousands of rounded products that cancel leave less than that


@dataclass(frozen=True)
class Unknowns:
    """The unknowns of continuous piecewise polynomial displacements on a mesh.

    The unknowns are, in this order: the displacements of nodes that are neither held nor tied (3 j + c is component c
    at node j), the unknowns of the ties, and those of the bubbles between elements of the mixed formulation, which
    vanish at all nodes.

    Attributes
    ----------
    mesh : skfem.Mesh
        Tetrahedra or hexahedra, straight or curved.
    order : int
        1, 2, or, of hexahedra, 3.
    fixed : (3 nodes,) bool
        Displacements that supports hold at zero; they are not unknowns.
    bubbles : Bubbles or None
    ties : tuple of Tie
        Nodes that follow reference points, or these them; no node is in two.
    """

    mesh: skfem.Mesh
    order: int
    fixed: np.ndarray
    bubbles: Bubbles | None = None
    ties: tuple[Tie, ...] = ()

    @cached_property
    def element(self) -> skfem.Element:
        """The scalar nodal element."""
        return ELEMENTS[self.mesh.refdom is RefTet, self.order]()

    @cached_property
    def dofs(self) -> Dofs:
        """Numbering of the nodes."""
        return CubicDofs(self.mesh) if self.order == 3 else Dofs(self.mesh, self.element)

    @property
    def nodes(self) -> int:
        """Number of displacement nodes."""
        return int(self.dofs.N)

    @property
    def functions(self) -> int:
        """Number of scalar shape functions: of the nodes, and the bubbles behind them."""
        return self.nodes + (self.bubbles.functions if self.bubbles is not None else 0)

    @cached_property
    def free(self) -> np.ndarray:
        """Positions of the displacements that are unknowns themselves, among all 3*nodes, int."""
        free = ~self.fixed
        for tie in self.ties:
            free[_rows(tie.nodes)] = False
        return np.flatnonzero(free)

    @property
    def nodal_unknowns(self) -> int:
        """Number of unknowns that nodal displacements follow from."""
        return len(self.free) + sum(tie.block.shape[1] for tie in self.ties)

    @property
    def unknowns(self) -> int:
        """Number of unknowns n."""
        return self.nodal_unknowns + (self.bubbles.unknowns if self.bubbles is not None else 0)

    @cached_property
    def nodal_map(self) -> sp.csr_array:
        """(3 nodes, nodal unknowns): nodal displacements from the unknowns."""
        columns, shape = np.arange(len(self.free)), (3 * self.nodes, self.nodal_unknowns)
        parts = [sp.coo_array((np.ones(len(columns)), (self.free, columns)), shape=shape)]
        for tie, at in zip(self.ties, self._starts, strict=True):
            block = sp.coo_array(tie.block)
            place = (_rows(tie.nodes)[block.coords[0]], at + block.coords[1])
            parts.append(sp.coo_array((block.data, place), shape=parts[0].shape))
        return sp.csr_array(sum(parts[1:], parts[0].tocsr()))

    @cached_property
    def nodal_inverse(self) -> sp.csr_array:
        """(nodal unknowns, 3 nodes): the unknowns from nodal displacements that supports and ties allow."""
        columns, shape = np.arange(len(self.free)), (self.nodal_unknowns, 3 * self.nodes)
        parts = [sp.coo_array((np.ones(len(columns)), (columns, self.free)), shape=shape)]
        for tie, at in zip(self.ties, self._starts, strict=True):
            block = sp.coo_array(tie.inverse)
            place = (at + block.coords[0], _rows(tie.nodes)[block.coords[1]])
            parts.append(sp.coo_array((block.data, place), shape=parts[0].shape))
        return sp.csr_array(sum(parts[1:], parts[0].tocsr()))

    def reference(self, tie: Tie) -> sp.csr_array:
        """Return the operator (6 or 3, n) that gives translation (m) and rotation (rad) of a reference."""
        at = self._starts[self.ties.index(tie)]
        block = sp.coo_array(tie.freedoms)
        shape = (block.shape[0], self.unknowns)
        return sp.csr_array((block.data, (block.coords[0], at + block.coords[1])), shape=shape)

    @property
    def _starts(self) -> list[int]:
        """The first unknown of each tie."""
        sizes = [tie.block.shape[1] for tie in self.ties]
        return [len(self.free) + sum(sizes[:i]) for i in range(len(sizes))]

    @cached_property
    def prolongation(self) -> sp.csr_array:
        """(3 functions, n): amplitudes of all shape functions along x, y and z from the unknowns."""
        if self.bubbles is None:
            return self.nodal_map
        return sp.csr_array(sp.block_diag([self.nodal_map, self.bubbles.directions]))

    @property
    def selects(self) -> bool:
        """Whether every unknown is the displacement of one node, and no node follows others."""
        return self.bubbles is None and not self.ties

    @cached_property
    def moving(self) -> np.ndarray:
        """Numbers of the functions that may move in some direction, int."""
        if not self.selects:
            return np.arange(self.functions)
        return np.flatnonzero(~self.fixed.reshape(-1, 3).all(axis=1))

    def restricted(self, A: sp.csr_array, functions: np.ndarray | None = None) -> sp.csr_array:
        """Return the (n, n) matrix of a form on the unknowns from that (3 m, 3 m) on m functions.

        Parameters
        ----------
        functions : (m,) int or None
            None for all; else `moving`.
        """
        if self.selects:
            free = self.free if functions is None else 3 * np.searchsorted(functions, self.free // 3) + self.free % 3
            return A if len(free) == A.shape[0] else sp.csr_array(A[free][:, free])
        P = self.prolongation
        return sp.csr_array(P.T @ A @ P) - self._rounding(A)

    def operator(self, A: sp.csr_array) -> sp.csr_array:
        """Return the (n, n) matrix of an operator on the unknowns from that (3 functions, 3 functions) on all of them.

        Unlike a form it gives displacements: from those that ties allow others that they allow, A P = P B. What it
        gives at supports drops out.
        """
        inverse = self.nodal_inverse
        if self.bubbles is not None:  # the unit vectors of whose unknowns are orthonormal columns
            inverse = sp.csr_array(sp.block_diag([inverse, self.bubbles.directions.T]))
        return sp.csr_array(inverse @ A @ self.prolongation)

    def _rounding(self, A: sp.csr_array) -> sp.csr_array:
        """Return the part of a form that is rounding alone: the stiffness of elements all of whose nodes are rigid.

        In exact arithmetic it is zero. It is removed, since a rigid body may have no other stiffness, beside which
        rounding would be small.
        """
        columns = [np.arange(0)]
        for tie, at in zip(self.ties, self._starts, strict=True):
            columns.append(at + np.arange(tie.block.shape[1] if tie.rigid else 0))
        some = np.concatenate(columns)
        S = self.prolongation[:, some]
        own = (S.T @ A @ S).toarray()
        bound = (abs(S).T @ (abs(A) @ abs(S))).toarray()
        i, j = np.nonzero((np.abs(own) < _CANCELLED * bound) & (own != 0))
        return sp.csr_array((own[i, j], (some[i], some[j])), shape=(self.unknowns, self.unknowns))

    @cached_property
    def partition(self) -> Partition:
        """Which process has the rows of which unknowns: those of elements that are neighbours."""
        functions, bubbles = [np.asarray(self.dofs.element_dofs)], self.bubbles
        if bubbles is not None:
            functions.append(self.nodes + bubbles.functions_of(self.mesh, np.arange(self.mesh.nelements)))
        return Partition.by(unknowns_along_bodies(self.mesh, functions, self.prolongation))

    def expand(self, u: np.ndarray) -> np.ndarray:
        """Return nodal displacements (nodes, 3) of a vector of unknowns (n,)."""
        if self.ties:
            return np.asarray(self.nodal_map @ u[: self.nodal_unknowns]).reshape(-1, 3)
        full = np.zeros(3 * self.nodes, dtype=u.dtype)
        full[self.free] = u[: len(self.free)]
        return full.reshape(-1, 3)

    def gather(self, nodal: np.ndarray) -> np.ndarray:
        """Return the unknowns (n,) of nodal displacements (nodes, 3), bubbles at rest; held displacements drop out.

        Where there are ties, these have to allow the displacements.
        """
        u = np.zeros(self.unknowns, dtype=nodal.dtype)
        u[: self.nodal_unknowns] = self.nodal_inverse @ nodal.ravel() if self.ties else nodal.ravel()[self.free]
        return u

    def loads(self, forces: np.ndarray) -> np.ndarray:
        """Return the forces on the unknowns (n,) that do the same work as nodal forces (nodes, 3)."""
        f = np.zeros(self.unknowns, dtype=forces.dtype)
        f[: self.nodal_unknowns] = self.nodal_map.T @ forces.ravel() if self.ties else forces.ravel()[self.free]
        return f

    def amplitudes(self, u: np.ndarray) -> np.ndarray:
        """Return those of all shape functions, (functions, 3), of a vector of unknowns (n,)."""
        return np.asarray(self.prolongation @ u).reshape(-1, 3)


def _rows(nodes: np.ndarray) -> np.ndarray:
    """Return the positions of the nodes' displacements among all."""
    return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()
