"""The kernel of a stiffness matrix, found from its entries alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..errors import NotConvergedError
from .linear.choice import factorize
from .linear.factor import Factor, LinearSolver
from .linear.spread_matrix import sizes_times
from .multiple import ROUNDING
from .pencil import Pencil

_CANCELLED = 8 * ROUNDING  # a force in Kz this small beside the parts of its sum is zero but for rounding
_LEAST = 1e-3  # times the largest entry of a motion: smaller entries count as this large in the size of a sum
_DENSE = 400  # unknowns up to which a singular value decomposition is cheapest
_SHIFT = 1e-9  # times the largest ratio of stiffness to mass: nearer to zero than any elastic mode
_SEED, _BLOCK, _STEPS, _MOST = 20251122, 8, 4, 200
_REGULAR = 1e-6  # a matrix is surely regular if its smallest singular value is above this times its largest one


def null_columns(B: np.ndarray, least: float) -> np.ndarray:
    """Return orthonormal V (k, m) with ‖B V‖ ≤ least, for B (n, k)."""
    if not B.shape[1]:
        return np.zeros((0, 0))
    _, s, Vh = la.svd(B, full_matrices=len(B) < B.shape[1])
    s = np.append(s, np.zeros(B.shape[1] - len(s)))
    return np.asarray(Vh[s <= least].conj().T)


def amplitudes(Z: np.ndarray, d: np.ndarray | None = None) -> np.ndarray:
    """Return the sizes of the entries of Z (n, k), at least a share of the largest of their column.

    An entry that should be zero holds rounding of the larger ones. Measured by that rounding, sums with it would look
    as if nothing cancelled in them.

    Parameters
    ----------
    d : (n,), optional
        Units of the unknowns, in which entries are compared.
    """
    units = np.ones((len(Z), 1)) if d is None else d[:, None]
    size = np.abs(Z / units)
    return np.asarray(units * (size + _LEAST * size.max(axis=0, initial=0.0)))


def unforced(A: sp.csr_array, Z: np.ndarray, rounding: float) -> np.ndarray:
    """Return orthonormal V (k, m) such that A moves nothing along Z V: the forces are `rounding` of what cancels."""
    if not Z.shape[1]:
        return np.zeros((0, 0))
    V = la.svd(A @ Z, full_matrices=False)[2].conj().T
    forces, sizes = (np.linalg.norm(x, axis=0) for x in (A @ (Z @ V), sizes_times(A, amplitudes(Z @ V))))
    return np.asarray(V[:, forces <= rounding * sizes])


def kernel_within(pencil: Pencil, motions: np.ndarray) -> np.ndarray:
    """Return the motions (n, k) in the span of `motions` (n, m) that K does not hold, to within rounding."""
    if not motions.shape[1]:
        return motions
    d = pencil.units[0][:, None]
    return np.asarray(d * _in_kernel(_scaled_parts(pencil), la.qr(motions / d, mode="economic")[0]))


def _scaled_parts(pencil: Pencil) -> list[sp.csr_array]:
    """Return the real and, where there is one, the imaginary part of K in the pencil's own units."""
    D = sp.diags_array(pencil.units[0])
    return [sp.csr_array(D @ A @ D) for A in ((pencil.K.real, pencil.K.imag) if pencil.is_complex else (pencil.K,))]


def find_kernel(pencil: Pencil, linear_solver: LinearSolver | str = "auto") -> np.ndarray:
    """Return real Z (n, k) with K Z = 0 to rounding.

    A block of vectors in which the kernel lies roughly shows which unknowns to hold so that K is regular. With these
    moved one by one, the others follow statically; combinations of them that need no force are the kernel, to the last
    digit, however soft other motions are. Nothing is found where K cannot be factorised even with a shift beside zero.
    Unknowns that have no entry in K are motions of the kernel by themselves. They are left out of the search, in which
    their forces, all zero, would be measured by rounding of others.
    """
    n, one = pencil.n, np.ones(pencil.n)
    alone = (sizes_times(pencil.K, one) == 0) & (sizes_times(pencil.K.T, one) == 0)
    if not alone.any():
        return _coupled_kernel(pencil, linear_solver)
    rest = np.flatnonzero(~alone)
    M, C, K = (None if A is None else sp.csr_array(A[rest][:, rest]) for A in (pencil.M, pencil.C, pencil.K))
    assert M is not None and K is not None
    coupled = np.zeros((0, 0))
    if len(rest):
        coupled = _coupled_kernel(replace(pencil, M=M, C=C, K=K, cancelled=None, free=None), linear_solver)
    Z = np.zeros((n, n - len(rest) + coupled.shape[1]))
    Z[np.flatnonzero(alone), np.arange(n - len(rest))] = 1.0
    Z[rest, n - len(rest) :] = coupled
    return Z


def _coupled_kernel(pencil: Pencil, linear_solver: LinearSolver | str) -> np.ndarray:
    """Return the kernel as `find_kernel`, of a K in which every unknown has an entry."""
    d, n, block = pencil.units[0], pencil.n, _BLOCK
    scaled = _scaled_parts(pencil)
    while True:
        block = min(block, n)
        try:
            X = _nearly_kernel(pencil, scaled, block, linear_solver)
            Z = _followed(scaled[0], X, pencil.symmetric, linear_solver) if X.shape[1] else X
        except NotConvergedError:  # held in too few unknowns, or singular for another reason
            Z = None
        if block >= min(n, _MOST) or (Z is not None and Z.shape[1] < block):
            Z = np.zeros((n, 0)) if Z is None else Z
            return np.asarray(d[:, None] * (_in_kernel(scaled[1:], la.qr(Z, mode="economic")[0])))
        block *= 2


def _nearly_kernel(
    pencil: Pencil, scaled: list[sp.csr_array], block: int, linear_solver: LinearSolver | str
) -> np.ndarray:
    """Return orthonormal vectors (n, block) that nearly contain the kernel; none where there is none for sure."""
    if pencil.n <= _DENSE:
        _, s, Vh = la.svd(scaled[0].toarray())
        return np.asarray(Vh[-block:].T if s[-1] <= _REGULAR * s[0] else Vh[:0].T)
    mass, stiffness = pencil.M.diagonal() * pencil.units[0] ** 2, np.abs(scaled[0].diagonal())
    if not (mass > 0).any():
        return np.zeros((pencil.n, 0))
    D = sp.diags_array(pencil.units[0])
    M = sp.csr_array(D @ pencil.M @ D)
    shifted = sp.csr_array(scaled[0] + _SHIFT * stiffness.max() / mass.max() * M)
    factor = factorize(shifted, pencil.symmetric, linear_solver)
    X = np.random.default_rng(_SEED).standard_normal((pencil.n, block))
    for _ in range(_STEPS):
        X = la.qr(factor.solve(M @ X), mode="economic")[0]
    return np.asarray(X)


def _followed(A: sp.csr_array, X: np.ndarray, symmetric: bool, linear_solver: LinearSolver | str) -> np.ndarray:
    """Return the kernel (n, k) of A among motions of as many held unknowns as X has columns; others follow."""
    ground = Ground(A, X, symmetric, linear_solver)
    Z = ground.followed()
    force, size = A[ground.held] @ Z, abs(A[ground.held]) @ amplitudes(Z)
    _, _, Vh = la.svd(force)
    V = Vh.T
    forces, sizes = np.linalg.norm(force @ V, axis=0), np.linalg.norm(size @ np.abs(V), axis=0)
    return np.asarray(Z @ V[:, forces <= _CANCELLED * sizes])


class Ground:
    """A singular matrix A with as many unknowns held as make it regular, its kernel Z being known.

    The unknowns are those on which the motions of Z differ most (pivoted QR), as determinate supports of a body do.

    Attributes
    ----------
    held : (k,) int
    """

    def __init__(self, A: sp.csr_array, Z: np.ndarray, symmetric: bool, linear_solver: LinearSolver | str) -> None:
        order = la.qr(Z.conj().T, mode="r", pivoting=True)[1]
        self._A, self._symmetric, self._linear_solver = A, symmetric, linear_solver
        self.held, self._rest = np.sort(order[: Z.shape[1]]), np.sort(order[Z.shape[1] :])
        self._factor: Factor | None = None

    def followed(self, adjoint: bool = False) -> np.ndarray:
        """Return motions (n, k) in which one held unknown moves by one, the others stay, and all else follows."""
        A = sp.csr_array(self._A.conj().T) if adjoint else self._A
        Z = np.zeros((A.shape[0], len(self.held)), A.dtype)
        Z[self.held] = np.eye(len(self.held))
        Z[self._rest] = -self._solve(sp.csr_array(A[self._rest][:, self.held]).toarray(), adjoint)
        return Z

    def pushed(self, forces: np.ndarray, adjoint: bool = False) -> np.ndarray:
        """Return u with A u = forces (or Aᴴ u) of forces that have no part in any motion of the kernel."""
        u = np.zeros(forces.shape, np.result_type(forces, self._A.dtype))
        u[self._rest] = self._solve(np.asarray(forces[self._rest]), adjoint)
        return u

    def _solve(self, b: np.ndarray, adjoint: bool) -> np.ndarray:
        """Return A_rr⁻¹ b, or with A_rrᴴ, improved once."""
        if not b.any():
            return b
        A = sp.csr_array(self._A[self._rest][:, self._rest])
        if self._factor is None:
            self._factor = factorize(A, self._symmetric, self._linear_solver)
        solve = self._factor.solve_adjoint if adjoint else self._factor.solve
        B = sp.csr_array(A.conj().T) if adjoint else A
        x = solve(b)
        return np.asarray(x + solve(b - B @ x))


def _in_kernel(parts: list[sp.csr_array], X: np.ndarray) -> np.ndarray:
    """Return the part of the span of orthonormal columns on which all forces are rounding of what cancels."""
    for A in parts:
        X = X @ unforced(A, X, _CANCELLED)
    return X
