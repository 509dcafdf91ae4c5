"""Newton's method for critical values: two eigenvalues meet, one becomes zero, or one crosses the imaginary axis."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Pencil
from ..eigen.quality import ROUNDING
from ..errors import NotConvergedError
from ..problem.problem import Problem
from .bordered import SLOTS, Bordered, factorized_complex, joined, matrices_of, times

_STEPS = 12  # Newton steps, at most
_SMALL = 1e-6  # of the value, or of the sweep's step: Newton steps below this that no longer shrink are rounding
# A Newton step that changes a frequency by more than this part of ω is not the last, however small its change of p.
# Where λ = 0 crosses the axis ω is rounding: small beside what the shape would swing at by its largest forces alone.
_TURNED, _AT_REST = 1e-4, 1e-8
_FLATTEST = 5.0  # power of p − p_c, at most, with which Re λ is taken to pass zero


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
    crosses : bool
        Whether an eigenvalue that moves crosses the imaginary axis there: Re λ = 0 alone is asked for.
    exact : Root or None
        Of a root of a reduced model: that of the problem itself, if that is known apart from it.
    """

    value: float
    theta: float
    coefficient: float
    uncertainty: float
    right: np.ndarray = field(repr=False)
    left: np.ndarray = field(repr=False)
    coefficient_sign: int = 0
    crosses: bool = False
    exact: Root | None = None

    @property
    def lam(self) -> complex:
        """The eigenvalue λ with Im λ ≥ 0, rad/s; a real one that grows."""
        return lam_of(self.theta)


def lam_of(theta: float) -> complex:
    """Return the λ, rad/s, with Re λ ≥ 0 and Im λ ≥ 0 of a real θ = −λ², rad²/s²."""
    return complex(np.sqrt(-theta) if theta < 0 else 1j * np.sqrt(theta))


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
        b = Bordered(problem, parameter, p, v, x, y, linear_solver, damped=damped)
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
        b = Bordered(problem, parameter, p, 0.0, x, y, linear_solver, rigid)
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
        pencil, slopes = matrices_of(problem, parameter, p)
        A = pencil.K + lam**2 * pencil.M if pencil.C is None else pencil.K + lam * pencil.C + lam**2 * pencil.M
        size = abs(A).max()
        b, c = (v / np.linalg.norm(v) * size for v in (pencil.M @ y, pencil.M @ x))
        bordered = joined([[A, b[:, None]], [c.conj()[None, :], np.zeros((1, 1))]])
        solve, solve_adjoint = factorized_complex(bordered, linear_solver)
        e = np.zeros(pencil.n + 1, complex)
        e[-1] = size
        z, w = solve(e), solve_adjoint(e)
        x, y, g = z[:-1], w[:-1], complex(z[-1])
        change = np.zeros(pencil.n, complex)
        for slot, factor in zip(SLOTS, (lam**2, lam, 1.0), strict=True):
            change += factor * times(slopes[slot], x)
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
            shrinks = min(abs(step[1]) / last, 1 - 1 / _FLATTEST) if last else 0.0  # p was exact before, and ω was not
            order = 1 / (1 - shrinks)
            uncertainty = float(order * (abs(step[1]) + rounding))
            return Root(float(p), float(omega**2), speed, uncertainty, x, y, crosses=True)
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
