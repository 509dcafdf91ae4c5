"""Newton's method for critical values: two eigenvalues meet, one becomes zero, or one crosses the imaginary axis."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from ..eigen.linear.choice import factorize, factorize_complex
from ..eigen.linear.dense import DenseFactor
from ..eigen.linear.factor import Factor, LinearSolver, Solve
from ..eigen.pencil import Pencil
from ..eigen.quality import ROUNDING
from ..errors import NotConvergedError
from ..problem.parameters import paths_of
from ..problem.problem import Problem
from ..problem.terms import Slot, Term

_STEPS = 12  # Newton steps, at most
_SMALL = 1e-6  # of the value, or of the sweep's step: Newton steps below this that no longer shrink are rounding
# A Newton step that changes a frequency by more than this part of ω is not the last, however small its change of p.
# Where λ = 0 crosses the axis ω is rounding: small beside what the shape would swing at by its largest forces alone.
_TURNED, _AT_REST = 1e-4, 1e-8
_FLATTEST = 5.0  # power of p − p_c, at most, with which Re λ is taken to pass zero
_SLOTS: tuple[Slot, ...] = "M", "C", "K"
_FULL = 1000  # unknowns up to which matrices that are at least half full are taken as arrays
_Matrix: TypeAlias = sp.csr_array | np.ndarray


@dataclass(frozen=True)
class Root:
    """A critical value of a parameter.

    Attributes
    ----------
    value : float
        The critical value p_c.
    theta : float, rad²/s²
        The eigenvalue θ = −λ² there.
    coefficient : float
        Where two eigenvalues meet, c in Re λ = c √|p − p_c| beyond the root, rad/s; at a crossing dRe λ/dp.
    uncertainty : float
        Uncertainty of `value`: the last Newton step, and rounding.
    right, left : (n,) float or complex
        The right and left vector of Q(λ) there.
    coefficient_sign : int
        1 where two eigenvalues become a complex pair for a rising parameter, −1 where a pair becomes two.
    """

    value: float
    theta: float
    coefficient: float
    uncertainty: float
    right: np.ndarray = field(repr=False)
    left: np.ndarray = field(repr=False)
    coefficient_sign: int = 0


def find_coalescence(
    problem: Problem, parameter: str, value: float, v: float, x: np.ndarray, y: np.ndarray, width: float,
    linear_solver: LinearSolver | str = "auto", damped: bool = False, enough: float = 0.0,
) -> Root:  # fmt: skip
    """Return where two real eigenvalues meet: two θ without dampers, or two λ with dampers.

    With borders b, c the system [[K − θM, b], [cᵀ, 0]] [x; g] = [0; 1] is regular at a defective eigenvalue, and g = 0
    exactly where K − θM is singular. Two eigenvalues meet where g = ∂g/∂θ = 0. Newton's method in (θ, p) finds this
    root as a regular one, although the eigenvalues themselves change like √|p − p_c|. With dampers Q(λ) with real λ
    takes the place of K − θM. Source: W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM
    2000, chapters 3 and 4 (bordered matrices, singular points).

    Parameters
    ----------
    problem : Problem
    parameter : str
        Name of p.
    value : float
        Approximate critical value.
    v : float
        Approximate θ, rad²/s², or with dampers λ, rad/s.
    x, y : (n,) float
        Approximate right and left mode near the meeting, for the borders.
    width : float
        A length in p, such as a part of the sweep's step: Newton steps are small against it or against the value.
    linear_solver : LinearSolver or str
    damped : bool
        Whether there are dampers, and v is λ.
    enough : float
        Of the value: a Newton step below this is the last. It is the uncertainty of the root, which is far nearer.

    Raises
    ------
    NotConvergedError
        The iteration does not converge, or the two eigenvalues touch without becoming a pair.
    """
    p, scale, last = value, abs(v), np.inf
    for _ in range(_STEPS):
        b = _Bordered(problem, parameter, p, v, x, y, linear_solver, damped=damped)
        gradient = np.array([[b.g_v, b.g_p], [b.g_v_v, b.g_v_p]])
        try:
            step = np.linalg.solve(gradient * [scale, 1.0], -np.array([b.g, b.g_v])) * [scale, 1.0]
        except np.linalg.LinAlgError as error:
            raise NotConvergedError("coalescence: the pair does not merge transversally") from error
        v, p = v + step[0], p + step[1]
        x, y = b.x, b.w
        size = abs(step[1])
        if _is_last(size, last, max(b.p_rounding, enough * abs(p)), _SMALL * max(abs(p), width)):
            coefficient = np.sqrt(2 * abs(b.g_p / b.g_v_v)) / (1.0 if damped else 2 * np.sqrt(abs(v)))
            # From g = g_p dp + g_vv dv²/2 = 0: if g_p and g_vv have the same sign, dv² < 0 for dp > 0, which is a pair.
            sign = int(np.sign(b.g_p / b.g_v_v))
            theta = -(v**2) if damped else v
            return Root(float(p), float(theta), float(coefficient), float(size + b.p_rounding), x, y, sign)
        if not np.isfinite(step).all() or size > 10 * (abs(value) + width):
            break
        last = size
    raise NotConvergedError(f"coalescence near {parameter} = {value:.6g}: Newton's method did not converge")


def find_zero(
    problem: Problem, parameter: str, value: float, x: np.ndarray, y: np.ndarray, width: float,
    rigid: np.ndarray | None = None, linear_solver: LinearSolver | str = "auto", enough: float = 0.0,
) -> Root:  # fmt: skip
    """Return where an eigenvalue θ passes zero (divergence): a root of g(0, p) within `width` of `value`, by Newton.

    Parameters
    ----------
    problem, parameter, value, x, y, linear_solver, enough
        As for `find_coalescence`.
    width : float
        How far from `value` the root may be, in p.
    rigid : (n, k) float, optional
        Motions Z with KZ = 0 at every p. K would be singular at every p because of them, so K + s MZ(MZ)ᵀ is used
        instead: it has the eigenvalues of K except for the zeros of Z.

    Raises
    ------
    NotConvergedError
        The iteration does not converge, or K does not depend on the parameter.
    """
    p, last = value, np.inf
    for _ in range(_STEPS):
        b = _Bordered(problem, parameter, p, 0.0, x, y, linear_solver, rigid)
        if not b.g_p:  # the stiffness does not depend on the parameter
            break
        step = -b.g / b.g_p
        p, x, y = p + step, b.x, b.w
        if abs(p - value) > width or b.p_rounding > 0.1 * width:
            break
        if _is_last(abs(step), last, max(b.p_rounding, enough * abs(p)), _SMALL * max(abs(p), width)):
            coefficient = float(np.sqrt(abs(b.g_p / b.g_v)))
            return Root(float(p), 0.0, coefficient, float(abs(step) + b.p_rounding), x, y)
        last = abs(step)
    raise NotConvergedError(f"divergence near {parameter} = {value:.6g}: Newton's method did not converge")


def find_crossing(
    problem: Problem, parameter: str, value: float, omega: float, x: np.ndarray, y: np.ndarray, width: float,
    linear_solver: LinearSolver | str = "auto", enough: float = 0.0,
) -> Root:  # fmt: skip
    """Return where an eigenvalue of a damped problem crosses the imaginary axis: g(iω, p) = 0, by Newton in (ω, p).

    The two equations are the real and the imaginary part of g of the bordered Q(iω). `coefficient` of the root is
    dRe λ/dp, from dλ/dp = −(∂g/∂p)/(∂g/∂λ), and its `theta` is ω².

    Parameters
    ----------
    problem, parameter, value, linear_solver, enough
        As for `find_coalescence`.
    omega : float, rad/s
        Approximate ω.
    x, y : (n,) complex
        Approximate right and left mode.
    width : float
        How far from `value` the root may be, in p. If Re λ hardly depends on p, rounding could put a root anywhere.

    Raises
    ------
    NotConvergedError
        The iteration does not converge within `width`.
    """
    p, last = value, np.inf
    for _ in range(_STEPS):
        lam = 1j * omega
        pencil, slopes = _matrices(problem, parameter, p)
        A = pencil.K + lam**2 * pencil.M if pencil.C is None else pencil.K + lam * pencil.C + lam**2 * pencil.M
        size = abs(A).max()
        b, c = (v / np.linalg.norm(v) * size for v in (pencil.M @ y, pencil.M @ x))
        bordered = _joined([[A, b[:, None]], [c.conj()[None, :], np.zeros((1, 1))]])
        solve, solve_adjoint = _factorized_complex(bordered, linear_solver)
        e = np.zeros(pencil.n + 1, complex)
        e[-1] = size
        z, w = solve(e), solve_adjoint(e)
        x, y, g = z[:-1], w[:-1], complex(z[-1])
        change = np.zeros(pencil.n, complex)
        for slot, factor in zip(_SLOTS, (lam**2, lam, 1.0), strict=True):
            change += factor * _times(slopes[slot], x)
        g_lam = -complex(np.vdot(y, pencil.derivative(np.array([lam]), x[:, None])[:, 0])) / size
        g_p = -complex(np.vdot(y, change)) / size
        jacobian = np.array([[(1j * g_lam).real, g_p.real], [(1j * g_lam).imag, g_p.imag]])
        step = np.linalg.solve(jacobian, [-g.real, -g.imag])
        omega, p = omega + step[0], p + step[1]
        speed = float((-g_p / g_lam).real)
        rounding = ROUNDING * float(np.abs(y) @ pencil.magnitude(np.array([lam]), x[:, None])[:, 0]) / size / abs(g_lam)
        rounding = rounding / abs(speed) if speed else np.inf
        if abs(p - value) > width or rounding > 0.1 * width:
            break
        small = _SMALL * max(abs(p), width)
        is_last = _is_last(abs(step[1]), last, max(rounding, enough * abs(p)), small)
        is_last &= rounding < small or np.isfinite(last)  # one step does not tell how flat a root lost in rounding is
        if is_last and (abs(step[0]) <= _TURNED * abs(omega) or abs(step[0]) <= _AT_REST * _fastest(pencil, x)):
            # Where Re λ passes zero as (p − p_c)ᵐ, a step is 1/m of the distance, 1 − 1/m of the step before.
            order = 1 / (1 - min(abs(step[1]) / last, 1 - 1 / _FLATTEST))
            return Root(float(p), float(omega**2), speed, float(order * (abs(step[1]) + rounding)), x, y)
        last = abs(step[1])
    raise NotConvergedError(f"crossing near {parameter} = {value:.6g}: Newton's method did not converge")


def _fastest(pencil: Pencil, x: np.ndarray) -> float:
    """Return ω, rad/s, at which the inertia of a shape is as large as all its elastic forces, before they cancel."""
    forces, inertia = (np.linalg.norm(abs(A) @ np.abs(x)) for A in (pencil.K, pencil.M))
    return float(np.sqrt(forces / inertia)) if inertia else 0.0


def _is_last(size: float, last: float, enough: float, small: float) -> bool:
    """Return whether a Newton step is the last: it is as small as needed, or small and hardly shorter than the last.

    Newton's method converges quadratically until rounding, where steps stop shrinking.
    """
    return size <= enough or (size < small and size >= 0.25 * last)


class _Bordered:
    """The scalar g of the bordered matrix and its derivatives (g_v = ∂g/∂v) at one (v, p), from one factorisation.

    The matrix is K − θM with v = θ, or with dampers Q(λ) = λ²M + λC + K with v = λ; v is real.
    """

    def __init__(
        self, problem: Problem, parameter: str, p: float, v: float, x: np.ndarray, y: np.ndarray,
        linear_solver: LinearSolver | str, rigid: np.ndarray | None = None, damped: bool = False,
    ) -> None:  # fmt: skip
        pencil, slopes = _matrices(problem, parameter, p)
        M, C, n = pencil.M, pencil.C, pencil.n
        # The matrix, and what its first derivative by v is times.
        A, A_v = pencil.K - v * M, -M
        if damped:
            A, A_v = (pencil.K + v**2 * M, 2 * v * M) if C is None else (pencil.K + v**2 * M + v * C, 2 * v * M + C)
        # Borders along M y and M x are far from the range of A and its transpose; their size is that of A.
        size = abs(A).max()
        b, c = (M @ y), (M @ x)
        b, c = b / np.linalg.norm(b) * size, c / np.linalg.norm(c) * size
        MZ = np.zeros((n, 0)) if rigid is None else M @ rigid
        MZ = MZ / np.linalg.norm(MZ, axis=0) * size
        beside, below = np.column_stack([MZ, b]), np.vstack([MZ.T, c])
        more = beside.shape[1]
        corner = np.diag([*[-size] * (more - 1), 0.0])
        factor = _factorized(_joined([[A, beside], [below, corner]]), linear_solver)
        e = np.zeros(n + more)
        e[-1] = size
        z, zt = factor.solve(e), factor.solve_transposed(e)
        self.x, self.w, self.g = z[:n], zt[:n], float(z[-1])
        x, w = self.x, self.w
        # A is the sum of the three matrices times these factors, A_v of them times the derivatives of the factors.
        factors, rates = ((v**2, v, 1.0), (2 * v, 1.0, 0.0)) if damped else ((-v, 0.0, 1.0), (-1.0, 0.0, 0.0))
        moved = [_times(slopes[slot], x) for slot in _SLOTS]
        Px, A_vp_x = (sum(k * u for k, u in zip(by, moved, strict=True)) for by in (factors, rates))
        Pw = sum(k * _times(slopes[slot], w, transposed=True) for k, slot in zip(factors, _SLOTS, strict=True))
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


def _matrices(problem: Problem, parameter: str, p: float) -> tuple[Pencil, dict[Slot, _Matrix | None]]:
    """Return the pencil at a value and the derivatives of its matrices, as full arrays where it is small and full."""
    at = {parameter: p}
    if problem.unknowns > _FULL or not _is_full(problem) or not problem.is_affine(parameter):
        slopes: dict[Slot, _Matrix | None] = {slot: problem.derivative(parameter, slot, at) for slot in _SLOTS}
        return problem.pencil(at), slopes
    here, paths = problem.at(at), paths_of(parameter)
    # What does not depend on the parameter is summed first, as `Problem.pencil` does it.
    terms = sorted(here.terms, key=lambda t: any(q in t.powers for q in paths))
    sums = {slot: _sum((t, t.coefficient(here.parameters)) for t in terms if t.slot == slot) for slot in _SLOTS}
    rates = {
        slot: _sum((t, sum(t.slope(q, here.parameters) for q in paths)) for t in terms if t.slot == slot)
        for slot in _SLOTS
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


def _factorized(A: _Matrix, linear_solver: LinearSolver | str) -> Factor | DenseFactor:
    return DenseFactor(A) if isinstance(A, np.ndarray) else factorize(A, False, linear_solver)


def _factorized_complex(A: _Matrix, linear_solver: LinearSolver | str) -> tuple[Solve, Solve]:
    if not isinstance(A, np.ndarray):
        return factorize_complex(A, linear_solver)
    factor = DenseFactor(A)
    return factor.solve, factor.solve_adjoint


def _times(A: _Matrix | None, x: np.ndarray, transposed: bool = False) -> np.ndarray:
    """Return A x or Aᵀ x, and zeros where there is no matrix."""
    if A is None:
        return np.zeros_like(x)
    return np.asarray((A.T if transposed else A) @ x)


def _joined(rows: list[list[Any]]) -> _Matrix:
    """Return the matrix of blocks, sparse unless the first block is an array."""
    return np.block(rows) if isinstance(rows[0][0], np.ndarray) else sp.csr_array(sp.block_array(rows, format="csr"))
