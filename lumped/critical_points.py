"""Critical friction coefficients of M q̈ + C q̇ + (K0 + μ F) q = 0, all of them, to machine precision."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg as la
from scipy.optimize import brentq

from .spectrum import Complexes, mass_normalized, solve_eigenvalues, state_matrix
from .springs import Floats

_RELATIVE_DISTANCE = 1e-3  # ε in `double_eigenvalues`: of the two eigenvalues θ and (1 + ε)θ of its two vectors
_STEP = 1e-6  # times 1 + |μ|: how far on both sides of an onset stability is tested
_SCAN = 401


@dataclass(frozen=True)
class CriticalPoint:
    """A friction coefficient at which a motion becomes unstable, or stable again.

    Attributes
    ----------
    mu : float
    omega : float, rad/s
        Its frequency there; 0 for a divergence.
    kind : {"flutter", "hopf", "divergence"}
        Two undamped frequencies merge; a damped pair crosses the imaginary axis; det K = 0.
    into : bool
        Whether the instability begins as μ rises.
    slope : float
        `hopf`: dRe λ/dμ, rad/s. `flutter`: the factor g in Re λ = g √(μ − μ_c), rad/s, on its unstable side.
        `divergence`: nan.
    """

    mu: float
    omega: float
    kind: str
    into: bool
    slope: float


def find_critical_points(
    M: Floats, C: Floats, K0: Floats, F: Floats, lower: float, upper: float
) -> list[CriticalPoint]:
    """Find all flutter or Hopf points and divergences with lower < μ < upper, by ascending μ.

    Parameters
    ----------
    M, C, K0, F : (n, n) arrays
        M diagonal; K(μ) = K0 + μ F.
    lower, upper : float
        May be infinite.

    Examples
    --------
    >>> import numpy as np
    >>> K0 = np.array([[3.0, -1.0], [-1.0, 4.0]])
    >>> F = np.array([[0.0, 4.0], [0.0, 0.0]])
    >>> [(o.kind, o.mu) for o in find_critical_points(np.eye(2), 0 * K0, K0, F, 0, np.inf)]  # ((3-4)²/4 + 1)/4
    [('flutter', 0.3125)]
    """
    if C.any():
        found = _hopf_points(M, C, K0, F, lower, upper)
    else:
        found = _flutter_points(mass_normalized(M, K0), mass_normalized(M, F))
    found += _divergences(M, C, K0, F)
    return sorted((o for o in found if lower < o.mu < upper), key=lambda o: o.mu)


def double_eigenvalues(A: Floats, B: Floats) -> list[tuple[float, complex]]:
    """Find approximations (μ, θ) of all real μ at which A + μ B has a double eigenvalue θ.

    Two vectors with (A + μB) x = θ x and (A + μB) y = (1+ε) θ y make z = x ⊗ y an eigenvector of the pencil

        [(1+ε) A⊗I − I⊗A] z + μ [(1+ε) B⊗I − I⊗B] z = 0,

    whose finite eigenvalues μ lie within O(ε²) of those at which θ is double. Where θ = 0, all of them fulfil it: those
    come out as well.

    Parameters
    ----------
    A, B : (n, n) arrays

    References
    ----------
    Jarlebring, Kvaal, Michiels, SIAM J. Matrix Anal. Appl. 32 (2011) 902-927.

    Examples
    --------
    >>> import numpy as np
    >>> pairs = double_eigenvalues(np.array([[3.0, -1.0], [-1.0, 4.0]]), np.array([[0.0, 4.0], [0.0, 0.0]]))
    >>> [(round(mu, 4), round(theta.real, 1)) for mu, theta in pairs if theta.real > 0.1]
    [(0.3125, 3.5)]
    """
    n = len(A)
    one = np.eye(n)
    k = 1 + _RELATIVE_DISTANCE
    D1 = k * np.kron(A, one) - np.kron(one, A)
    D0 = k * np.kron(B, one) - np.kron(one, B)
    mu, Z = la.eig(D1, -D0)
    found = []
    for value, z in zip(mu, Z.T, strict=True):
        if not np.isfinite(value) or abs(value.imag) > _RELATIVE_DISTANCE * (1 + abs(value)):
            continue
        x = la.svd(z.reshape(n, n))[0][:, 0]
        found.append((float(value.real), complex(x.conj() @ (A + value.real * B) @ x)))
    return sorted(found, key=lambda pair: pair[0])


def _flutter_points(A: Floats, B: Floats) -> list[CriticalPoint]:
    """Refine the double eigenvalues on s² = ((θi − θj)/2)², which is analytic in μ where θi and θj are not."""
    onsets: list[CriticalPoint] = []
    for start, theta in double_eigenvalues(A, B):
        onset = _refine_flutter(A, B, start, theta)
        if onset and not any(abs(onset.mu - o.mu) < 1e-10 * (1 + abs(o.mu)) for o in onsets):
            onsets.append(onset)
    return onsets


def _refine_flutter(A: Floats, B: Floats, start: float, theta: complex) -> CriticalPoint | None:
    scale = np.abs(A + start * B).max() ** 2

    def pair(mu: float, near: complex) -> tuple[float, complex]:
        values = np.linalg.eigvals(A + mu * B).astype(complex)
        a, b = values[np.argsort(np.abs(values - near))[:2]]
        return float((((a - b) / 2) ** 2).real), complex((a + b) / 2)

    step = _STEP * (1 + abs(start))
    previous, mu = start, start + step
    f_previous, theta = pair(previous, theta)
    for _ in range(50):
        f, theta = pair(mu, theta)
        if f == f_previous:
            return None  # constant: the two never approach each other
        previous, mu, f_previous = mu, mu - f * (mu - previous) / (f - f_previous), f
        if abs(mu - start) > 0.1 * (1 + abs(start)):
            return None
        if abs(mu - previous) < 0.01 * step:
            break
    low, high = mu - step, mu + step
    below, above = pair(low, theta)[0], pair(high, theta)[0]
    if below * above >= 0 or abs(above - below) < 1e-13 * scale:
        return None  # a crossing without coupling: s² touches zero and turns back
    mu = float(brentq(lambda value: pair(value, theta)[0], low, high, xtol=1e-16, rtol=4 * np.finfo(float).eps))
    f, theta = pair(mu, theta)
    if abs(f) > 1e-3 * abs(above - below) or theta.real <= 0:  # a jump of the pair, or two motions that diverge anyway
        return None
    omega = float(np.sqrt(theta.real))
    return CriticalPoint(mu, omega, "flutter", above < 0, float(np.sqrt(abs(above - below) / (2 * step)) / (2 * omega)))


def _divergences(M: Floats, C: Floats, K0: Floats, F: Floats) -> list[CriticalPoint]:
    """Real roots of det(K0 + μ F) at which an eigenvalue passes through zero."""
    values = la.eigvals(mass_normalized(M, K0), -mass_normalized(M, F))
    values = values[np.isfinite(values) & (np.abs(values) < 1e6)]
    onsets = []
    for mu in np.unique(values[np.abs(values.imag) < 1e-9 * (1 + np.abs(values))].real):
        u, _, vh = np.linalg.svd(K0 + mu * F)
        x, y = vh[-1], u[:, -1]
        # near zero λ = −(μ − μ0) yᵀFx / yᵀCx, and without damping λ² = −(μ − μ0) yᵀFx / yᵀMx
        slope, inertia = -(y @ F @ x), y @ (C if C.any() else M) @ x
        if abs(slope) > 1e-12 * np.abs(F).max() and inertia != 0:
            onsets.append(CriticalPoint(float(mu), 0.0, "divergence", bool(slope / inertia > 0), float("nan")))
    return onsets


def _hopf_points(M: Floats, C: Floats, K0: Floats, F: Floats, lower: float, upper: float) -> list[CriticalPoint]:
    """Crossings of the imaginary axis, from the bialternate sum, polished by Newton's method on Re λ(μ)."""
    starts = [*_zero_sums(state_matrix(M, C, K0), state_matrix(M, C, K0 + F) - state_matrix(M, C, K0))]
    # The bialternate pencil is singular if a motion stays undamped for every μ; a scan finds the others then.
    low, high = max(lower, -10.0), min(upper, 10.0)
    mu = np.linspace(low, high, _SCAN)
    growth = solve_eigenvalues(M, C, K0 + mu[:, None, None] * F).real.max(-1)
    starts += [(a + b) / 2 for (a, ga), (b, gb) in pairwise(zip(mu, growth, strict=True)) if ga * gb < 0]
    onsets: list[CriticalPoint] = []
    for start in starts:
        for lam in solve_eigenvalues(M, C, K0 + start * F):
            onset = _polish_hopf(M, C, K0, F, start, lam) if lam.imag > 0 else None
            if onset and not any(abs(onset.mu - o.mu) < 1e-10 * (1 + abs(o.mu)) for o in onsets):
                onsets.append(onset)
    return onsets


def _zero_sums(A: Floats, B: Floats) -> Floats:
    """Return the real μ at which two eigenvalues of A + μ B sum to zero: X → AX + XAᵀ on skew X is singular there."""
    n = len(A)
    i, j = np.triu_indices(n, 1)
    P = np.zeros((n * n, len(i)))
    P[i * n + j, range(len(i))] = np.sqrt(0.5)
    P[j * n + i, range(len(i))] = -np.sqrt(0.5)
    one = np.eye(n)
    L0, L1 = (P.T @ (np.kron(X, one) + np.kron(one, X)) @ P for X in (A, B))
    mu = la.eigvals(L0, -L1)
    mu = mu[np.isfinite(mu) & (np.abs(mu) < 1e6)]
    return np.unique(mu[np.abs(mu.imag) < 1e-5 * (1 + np.abs(mu))].real)


def _polish_hopf(M: Floats, C: Floats, K0: Floats, F: Floats, mu: float, lam: complex) -> CriticalPoint | None:
    start, first = mu, lam
    for _ in range(30):
        slope = _derivative(M, C, K0 + mu * F, F, lam).real
        if slope == 0 or not np.isfinite(slope):
            return None
        step = -lam.real / slope
        mu += step
        if abs(mu - start) > 0.1 * (1 + abs(start)):
            return None
        values: Complexes = solve_eigenvalues(M, C, K0 + mu * F)
        lam = complex(values[np.argmin(np.abs(values - lam))])
        if abs(step) <= 1e-15 * (1 + abs(mu)):
            break
    if abs(lam.real) > 1e-12 * (1 + abs(lam)) or lam.imag <= 1e-8 * abs(first):
        return None
    slope = _derivative(M, C, K0 + mu * F, F, lam).real
    if abs(slope) * (1 + abs(mu)) < 1e-9 * np.abs(C).max() / M.max():
        return None  # an undamped motion that friction does not reach stays on the axis for every μ
    return CriticalPoint(float(mu), float(lam.imag), "hopf", bool(slope > 0), float(slope))


def _derivative(M: Floats, C: Floats, K: Floats, F: Floats, lam: complex) -> complex:
    """dλ/dμ = −yᴴ F x / yᴴ (2λM + C) x."""
    u, _, vh = np.linalg.svd(lam * lam * M + lam * C + K)
    x, y = vh[-1].conj(), u[:, -1].conj()
    with np.errstate(divide="ignore", invalid="ignore"):
        return complex(-(y @ F @ x) / (y @ (2 * lam * M + C) @ x))
