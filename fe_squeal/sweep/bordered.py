"""The bordered matrices of Newton's method for critical values, and what they are made of."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from ..eigen.linear.choice import factorize, factorize_complex
from ..eigen.linear.dense import DenseFactor
from ..eigen.linear.factor import Factor, LinearSolver, Solve
from ..eigen.linear.spread_matrix import largest
from ..eigen.pencil import Pencil
from ..eigen.quality import ROUNDING
from ..problem.parameters import paths_of
from ..problem.problem import Problem
from ..problem.terms import Slot, Term

SLOTS: tuple[Slot, ...] = "M", "C", "K"
_FULL = 1000  # unknowns up to which matrices that are at least half full are taken as arrays
_Matrix: TypeAlias = sp.csr_array | np.ndarray


class Bordered:
    """The scalar g of the bordered matrix and its derivatives (g_v = ∂g/∂v) at one (v, p), from one factorisation.

    The matrix is K − θM with v = θ, or with dampers Q(λ) = λ²M + λC + K with v = λ; v is real. Source: see
    `newton.find_coalescence`.

    Parameters
    ----------
    problem : Problem
    parameter : str
    p, v : float
        The value of the parameter, and θ, rad²/s², or λ, rad/s.
    x, y : (n,) float
        Approximate right and left mode, for the borders.
    linear_solver : LinearSolver or str
    rigid : (n, k) float, optional
        Motions Z with KZ = 0 at every p; K + s MZ(MZ)ᵀ takes the place of K.
    damped : bool
        Whether v is λ.

    Attributes
    ----------
    x, w : (n,) float
        The right and the left vector that belong to g; modes where g = 0.
    g, g_v, g_p, g_v_v, g_v_p : float
        g and its derivatives.
    p_rounding : float
        How far rounding of the matrices moves the root g = 0 in p.
    """

    def __init__(
        self, problem: Problem, parameter: str, p: float, v: float, x: np.ndarray, y: np.ndarray,
        linear_solver: LinearSolver | str, rigid: np.ndarray | None = None, damped: bool = False,
    ) -> None:  # fmt: skip
        pencil, slopes = matrices_of(problem, parameter, p)
        M, C, n = pencil.M, pencil.C, pencil.n
        # The matrix, and what its first derivative by v is times.
        A, A_v = pencil.K - v * M, -M
        if damped:
            A, A_v = (pencil.K + v**2 * M, 2 * v * M) if C is None else (pencil.K + v**2 * M + v * C, 2 * v * M + C)
        # Borders along M y and M x are far from the range of A and its transpose; their size is that of A.
        size = largest(A)
        b, c = (M @ y), (M @ x)
        b, c = b / np.linalg.norm(b) * size, c / np.linalg.norm(c) * size
        MZ = np.zeros((n, 0)) if rigid is None else M @ rigid
        MZ = MZ / np.linalg.norm(MZ, axis=0) * size
        beside, below = np.column_stack([MZ, b]), np.vstack([MZ.T, c])
        more = beside.shape[1]
        corner = np.diag([*[-size] * (more - 1), 0.0])
        factor = factorized(joined([[A, beside], [below, corner]]), linear_solver)
        e = np.zeros(n + more)
        e[-1] = size
        z, zt = factor.solve(e), factor.solve_transposed(e)
        self.x, self.w, self.g = z[:n], zt[:n], float(z[-1])
        x, w = self.x, self.w
        # A is the sum of the three matrices times these factors, A_v of them times the derivatives of the factors.
        factors, rates = ((v**2, v, 1.0), (2 * v, 1.0, 0.0)) if damped else ((-v, 0.0, 1.0), (-1.0, 0.0, 0.0))
        moved = [times(slopes[slot], x) for slot in SLOTS]
        Px, A_vp_x = (sum(k * u for k, u in zip(by, moved, strict=True)) for by in (factors, rates))
        Pw = sum(k * times(slopes[slot], w, transposed=True) for k, slot in zip(factors, SLOTS, strict=True))
        Ax, Aw = A_v @ x, A_v.T @ w
        A_vv_x = 2 * (M @ x) if damped else np.zeros(n)
        # With Bz = e and Bᵀw = e: ∂z = −B⁻¹ ∂B z, and from eᵀz = size·g: ∂g = −wᵀ ∂B z / size.
        x_v, x_p = -factor.solve(np.pad(np.column_stack([Ax, Px]), ((0, more), (0, 0))))[:n].T
        self.g_v = -float(w @ Ax) / size
        self.g_p = -float(w @ Px) / size
        self.g_v_v = -float(2 * (Aw @ x_v) + w @ A_vv_x) / size
        # ∂²g/∂v∂p = −(w_p A_v x + w A_v x_p + w A_vp x), w_p A_v x = w A_p x_v.
        self.g_v_p = -float(Pw @ x_v + Aw @ x_p + w @ A_vp_x) / size
        lam = np.array([v + 0j]) if damped else np.array([1j * np.sqrt(abs(v))])
        magnitude = float(np.abs(self.w) @ pencil.magnitude(lam, self.x[:, None])[:, 0])
        self.p_rounding = ROUNDING * magnitude / size / abs(self.g_p) if self.g_p else np.inf


def matrices_of(problem: Problem, parameter: str, p: float) -> tuple[Pencil, dict[Slot, _Matrix | None]]:
    """Return the pencil at a value and the derivatives of its matrices, as full arrays where it is small and full."""
    at = {parameter: p}
    if problem.unknowns > _FULL or not _is_full(problem) or not problem.is_affine(parameter):
        slopes: dict[Slot, _Matrix | None] = {slot: problem.derivative(parameter, slot, at) for slot in SLOTS}
        return problem.pencil(at), slopes
    here, paths = problem.at(at), paths_of(parameter)
    # What does not depend on the parameter is summed first, as `Problem.pencil` does it.
    terms = sorted(here.terms, key=lambda t: any(q in t.powers for q in paths))
    sums = {slot: _sum((t, t.coefficient(here.parameters)) for t in terms if t.slot == slot) for slot in SLOTS}
    rates = {
        slot: _sum((t, sum(t.slope(q, here.parameters) for q in paths)) for t in terms if t.slot == slot)
        for slot in SLOTS
    }
    M, C, K = sums.values()
    zero = np.zeros((problem.unknowns, problem.unknowns))
    return Pencil(zero if M is None else M, zero if K is None else K, C), rates


def _is_full(problem: Problem) -> bool:
    """Return whether one of the terms at least has more than half of its entries."""
    return any(t.matrix.nnz > problem.unknowns**2 / 2 for t in problem.terms if t.slot == "K")


def _sum(parts: Iterable[tuple[Term, float]]) -> np.ndarray | None:
    """Return Σ coefficient · matrix as an array; None where every coefficient is zero."""
    total = None
    for term, coefficient in parts:
        if coefficient:
            matrix = term.full * (coefficient * term.unit())
            total = matrix if total is None else total + matrix
    return total


def factorized(A: _Matrix, linear_solver: LinearSolver | str) -> Factor | DenseFactor:
    return DenseFactor(A) if isinstance(A, np.ndarray) else factorize(A, False, linear_solver)


def factorized_complex(A: _Matrix, linear_solver: LinearSolver | str) -> tuple[Solve, Solve]:
    """Return what solves with a complex matrix (n, n) and with its adjoint."""
    if not isinstance(A, np.ndarray):
        return factorize_complex(A, linear_solver)
    factor = DenseFactor(A)
    return factor.solve, factor.solve_adjoint


def times(A: _Matrix | None, x: np.ndarray, transposed: bool = False) -> np.ndarray:
    """Return A x or Aᵀ x for A (n, n) and x (n,), and zeros where there is no matrix."""
    if A is None:
        return np.zeros_like(x)
    return np.asarray((A.T if transposed else A) @ x)


def joined(rows: list[list[Any]]) -> _Matrix:
    """Return the matrix of blocks, sparse unless the first block is an array."""
    return np.block(rows) if isinstance(rows[0][0], np.ndarray) else sp.csr_array(sp.block_array(rows, format="csr"))
