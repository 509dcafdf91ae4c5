"""The equations of a stability boundary in the plane of two parameters, for problems of some hundred unknowns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.linalg as la

from ..eigen.lapack import regular_lu
from ..eigen.quality import ROUNDING
from ..problem.problem import Problem
from ..problem.terms import POWER

Kind = Literal["flutter", "hopf", "divergence"]


@dataclass(frozen=True)
class Scaled:
    """An axis of a map, along which s goes from 0 to 1, linearly in the parameter or in its logarithm.

    Attributes
    ----------
    name : str
        Name of the parameter.
    low, high : float
        Values of the parameter at s = 0 and s = 1.
    log : bool
        Whether s is linear in the logarithm of the parameter.
    """

    name: str
    low: float
    high: float
    log: bool = False

    def value(self, s: float) -> float:
        """Return the parameter at s."""
        return float(self.low * (self.high / self.low) ** s if self.log else self.low + (self.high - self.low) * s)

    def at(self, value: float) -> float:
        """Return s at a value of the parameter."""
        if self.log:
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return (value - self.low) / (self.high - self.low)

    def slope(self, s: float) -> float:
        """Return the derivative of the parameter by s."""
        return self.value(s) * float(np.log(self.high / self.low)) if self.log else self.high - self.low


@dataclass(frozen=True)
class Residual:
    """The equations F(u) = 0 at one u, and their derivatives.

    Attributes
    ----------
    F : (m,) float
        Zero on the boundary.
    J : (m, m + 1) float
        ∂F/∂u.
    right, left : (n,) float or complex
        φ and ψ: where F = 0, Q(λ) φ = 0 and ψᴴQ(λ) = 0.
    slopes : (2,) float
        |ψᴴ (∂Q/∂s) φ| for s along both axes. An error of ψᴴQφ divided by this is the error of s. Where λ crosses the
        imaginary axis only Re λ has to be zero, and an error may also move λ along the axis; the number is then
        |ψᴴ (∂Q/∂λ) φ| |∂Re λ/∂s|.
    rounding : float
        By how much rounding of the matrices' entries may change ψᴴ Q φ.
    """

    F: np.ndarray
    J: np.ndarray
    right: np.ndarray
    left: np.ndarray
    slopes: np.ndarray
    rounding: float


class Boundary:
    """The equations F(u) = 0 of one kind of boundary.

    With borders b and c the scalar g of [[Q, b], [cᴴ, 0]] [φ; g] = [0; 1] is zero exactly where Q is singular. The
    equations in u = (v, s₁, s₂) are

    - flutter, without damping: g = ∂g/∂θ = 0 with Q = K − θM and v = θ/θ₀. Where three eigenvalues meet the boundary
      has a cusp in the plane (s₁, s₂), but is smooth in u;
    - Hopf points, with damping: Re g = Im g = 0 with Q = Q(iω) and v = ω/ω₀;
    - divergence: g = 0 with Q = K; there is no v, u = (s₁, s₂).

    Source: W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000, chapters 3 and 4.

    Parameters
    ----------
    problem : Problem
        With few unknowns n, affine in both parameters.
    axes : (Scaled, Scaled)
        The axes of the map.
    kind : "flutter", "hopf" or "divergence"
    unit : float
        θ₀, rad²/s², or ω₀, rad/s.
    right, left : (n,) float or complex
        Approximate right and left vector, for the borders.
    """

    def __init__(
        self, problem: Problem, axes: tuple[Scaled, Scaled], kind: Kind, unit: float, right: np.ndarray,
        left: np.ndarray,
    ) -> None:  # fmt: skip
        self.axes, self.kind, self.unit = axes, kind, unit
        self._terms = [(t, t.matrix.toarray()) for t in problem.terms]
        self._parameters = dict(problem.parameters)
        self._paths = tuple([p.strip() for p in axis.name.split(",")] for axis in axes)
        self.real = kind != "hopf"
        self.rebase(right, left)

    @property
    def unknowns(self) -> int:
        """Length of u."""
        return 2 if self.kind == "divergence" else 3

    def rebase(self, right: np.ndarray, left: np.ndarray) -> None:
        """Take new borders along right and left vectors (n,), so that the bordered matrix stays well conditioned."""
        self._c, self._b = right / la.norm(right), left / la.norm(left)

    def place(self, u: np.ndarray) -> tuple[float, float]:
        """Return the values of both parameters at u (2,) or (3,)."""
        s = u[-2:]
        return self.axes[0].value(float(s[0])), self.axes[1].value(float(s[1]))

    def eigenvalue(self, u: np.ndarray) -> complex:
        """Return λ, rad/s, at u (2,) or (3,)."""
        if self.kind == "divergence":
            return 0j
        v = float(u[0]) * self.unit
        return 1j * v if self.kind == "hopf" else 1j * np.sqrt(complex(v))

    def at(self, u: np.ndarray) -> Residual:
        """Return the equations and their derivatives at u (2,) or (3,).

        Raises
        ------
        numpy.linalg.LinAlgError
            The bordered matrix is singular.
        """
        lam = self.eigenvalue(u)
        Q, Q_v, Q_s, Q_vs, size = self._matrices(u, lam)
        scale = float(np.abs(Q).max())
        B = np.block([[Q, scale * self._b[:, None]], [scale * self._c.conj()[None, :], np.zeros((1, 1))]])
        lu = regular_lu(B)
        e = np.zeros(len(B), B.dtype)
        e[-1] = scale
        z, zt = la.lu_solve(lu, e, check_finite=False), la.lu_solve(lu, e, trans=2, check_finite=False)
        x, g, w = z[:-1], z[-1], zt[:-1]
        g_s = np.array([-np.vdot(w, A @ x) / scale for A in Q_s])
        slopes = scale * np.abs(g_s)
        rounding = ROUNDING * float(np.abs(w) @ size @ np.abs(x))
        if self.kind == "divergence":
            return Residual(np.array([g]), g_s[None, :], x, w, slopes, rounding)
        g_v = -np.vdot(w, Q_v @ x) / scale
        if self.kind == "hopf":
            row = np.array([g_v, *g_s])
            if g_v:  # δ + g_v dv + g_s ds = 0 with real dv and ds: |ds| ≤ |δ| |g_v| / |Im(g_s g_v*)|
                slopes = scale * np.abs((g_s * g_v.conj()).imag) / abs(g_v)
            return Residual(np.array([g.real, g.imag]), np.stack([row.real, row.imag]), x, w, slopes, rounding)

        def moved(A: np.ndarray) -> np.ndarray:
            return np.asarray(-la.lu_solve(lu, np.append(A @ x, 0.0), check_finite=False)[:-1])

        x_v, left_v = moved(Q_v), Q_v.T @ w
        second = [-2 * float(left_v @ x_v) / scale]
        for A, mixed in zip(Q_s, Q_vs, strict=True):
            second.append(-float((A.T @ w) @ x_v + left_v @ moved(A) + w @ (mixed @ x)) / scale)
        return Residual(np.array([g, g_v]), np.array([[g_v, *g_s], second]), x, w, slopes, rounding)

    def _matrices(
        self, u: np.ndarray, lam: complex
    ) -> tuple[np.ndarray, np.ndarray, list[np.ndarray], list[np.ndarray], np.ndarray]:
        """Return Q, ∂Q/∂v, [∂Q/∂s₁, ∂Q/∂s₂], the mixed derivatives by v and each s, and the sum of |entries| in Q."""
        here = dict(self._parameters)
        for paths, value in zip(self._paths, self.place(u), strict=True):
            here |= dict.fromkeys(paths, value)
        n, kind = len(self._terms[0][1]), np.complex128 if not self.real else np.float64
        Q, Q_v, size = np.zeros((n, n), kind), np.zeros((n, n), kind), np.zeros((n, n))
        Q_s, Q_vs = [np.zeros((n, n), kind) for _ in range(2)], [np.zeros((n, n), kind) for _ in range(2)]
        for t, A in self._terms:
            if self.real and (t.imaginary or t.slot == "C"):
                continue
            if self.kind == "hopf":
                power = POWER[t.slot]
                factor, change = t.unit(lam), 1j * self.unit * power * lam ** max(power - 1, 0) * t.unit(1.0)
            else:
                factor = 1.0 if t.slot == "K" else -float(u[0]) * self.unit if self.kind == "flutter" else 0.0
                change = -self.unit if t.slot == "M" and self.kind == "flutter" else 0.0
            c = t.coefficient(here)
            Q += (c * factor) * A
            size += abs(c * factor) * np.abs(A)
            if change:
                Q_v += (c * change) * A
            for i, (axis, paths) in enumerate(zip(self.axes, self._paths, strict=True)):
                slope = sum(t.slope(p, here) for p in paths) * axis.slope(float(u[i - 2]))
                if slope:
                    Q_s[i] += (slope * factor) * A
                    if change:
                        Q_vs[i] += (slope * change) * A
        return Q, Q_v, Q_s, Q_vs, size
