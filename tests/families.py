"""Random sweeps of different kinds, and an independent judge of their onsets.

The judge gets only the matrices. It counts unstable eigenvalues by LAPACK at many values, and bisects where the count
changes. It shares no code with the sweep. All kinds are in this one file, since they are best read side by side.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term

_SCAN = 1201  # values at which the judge counts


@dataclass(frozen=True)
class Family:
    """A random problem over one parameter "p", as matrices.

    Attributes
    ----------
    name : str
        Its kind.
    parts : tuple of (slot, matrix, power of p, imaginary)
        The terms of M, C and K.
    values : (m,) float
        Values of the sweep.
    planted : tuple of float
        Values of p close to which there is a narrow window of instability.
    zero : float
        Of the largest |θ|: a smaller θ is rounding. It is larger if there are free motions.
    growth : float
        Of the largest |λ|: a smaller Re λ is rounding. It is zero if every mode is damped.
    """

    name: str
    parts: tuple[tuple[str, np.ndarray, int, bool], ...]
    values: np.ndarray
    planted: tuple[float, ...] = ()
    zero: float = 1e-12
    growth: float = 1e-12

    def matrices(self, p: float) -> dict[str, np.ndarray]:
        """Return M, C and K at p."""
        found: dict[str, np.ndarray] = {}
        for slot, A, power, imaginary in self.parts:
            found[slot] = found.get(slot, 0.0) + A * p**power * (1j if imaginary else 1.0)
        return found

    def problem(self) -> Problem:
        """Return the problem for the program's own sweep."""
        terms = []
        for i, (slot, A, power, imaginary) in enumerate(self.parts):
            symmetric, skew = (bool(np.allclose(A, s * A.T, rtol=0, atol=1e-13 * abs(A).max())) for s in (1, -1))
            powers = {"p": power} if power else {}
            terms.append(Term(f"{slot}{i}", slot, sp.csr_array(A), symmetric, powers, skew, imaginary))
        return Problem(tuple(terms), {"p": float(self.values[0])})

    @property
    def undamped(self) -> bool:
        """Whether eigenvalues are those of K φ = θ M φ with real matrices."""
        return not any(slot == "C" or imaginary for slot, _, _, imaginary in self.parts)

    def unstable(self, p: float) -> int:
        """Return the number of eigenvalues with Im λ ≥ 0 that are unstable beyond rounding."""
        return self.counts(np.array([p]))[0]

    def counts(self, points: np.ndarray) -> list[int]:
        """Return the number of unstable eigenvalues at many values of p."""
        # All values in one call, since for single matrices the calls take more time than LAPACK itself.
        m: dict[str, np.ndarray] = {}
        for slot, A, power, imaginary in self.parts:
            m[slot] = m.get(slot, 0.0) + A * (points**power * (1j if imaginary else 1.0))[:, None, None]
        return self._damped_counts(m) if "C" in m else self._undamped_counts(m)

    def _undamped_counts(self, m: dict[str, np.ndarray]) -> list[int]:
        theta = np.linalg.eigvals(np.linalg.solve(m["M"], m["K"]))
        if np.iscomplexobj(m["K"]):
            lam = np.sqrt(-theta + 0j)
            lam = np.where(lam.imag < 0, -lam, lam)
            grows = lam.real > self.growth * np.abs(lam).max(axis=1, keepdims=True)
        else:
            size = np.abs(theta).max(axis=1, keepdims=True)
            real = np.abs(theta.imag) <= 1e-9 * size  # the error of a double θ is about the root of rounding
            grows = np.where(real, theta.real < -self.zero * size, theta.imag > 0)
        return [int(c) for c in np.count_nonzero(grows, axis=1)]

    def _damped_counts(self, m: dict[str, np.ndarray]) -> list[int]:
        n = m["M"].shape[1]
        lower = -np.linalg.solve(m["M"], np.concatenate([m["K"], m["C"]], axis=2))
        upper = np.broadcast_to(np.eye(n, 2 * n, n), lower.shape)
        lam = np.linalg.eigvals(np.concatenate([upper, lower], axis=1))
        above = lam.imag > -1e-9 * np.abs(lam).max(axis=1, keepdims=True)
        size = np.where(above, np.abs(lam), 0.0).max(axis=1, keepdims=True)
        gyroscopic = all(np.allclose(X, -X.T) for s, X, _, _ in self.parts if s == "C")
        grows = above & (lam.real > (3e-7 if gyroscopic else self.growth) * size)
        return [int(c) for c in np.count_nonzero(grows, axis=1)]

    @staticmethod
    def _spectrum(m: dict[str, np.ndarray]) -> np.ndarray:
        """Eigenvalues λ with Im λ ≥ 0, of matrices with dampers or with complex stiffness."""
        n = len(m["M"])
        if "C" not in m:
            lam = np.sqrt(-la.eigvals(m["K"], m["M"]) + 0j)
            return np.where(lam.imag < 0, -lam, lam)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(m["M"], m["K"]), -la.solve(m["M"], m["C"])]])
        lam = la.eigvals(A)
        return lam[lam.imag > -1e-9 * np.abs(lam).max()]

    def hardly_grows(self, a: float, b: float) -> bool:
        """Return whether |Re λ| of a mode is within rounding between a and b, while at the first value none is."""
        if self.undamped:
            return False
        found = [self._spectrum(self.matrices(p)) for p in (float(self.values[0]), *np.linspace(a, b, 5))]
        start, *inside = (np.abs(lam.real).min() / np.abs(lam).max() for lam in found)
        return start > 2 * self.growth and max(inside) < 2 * self.growth


@dataclass(frozen=True)
class Verdict:
    """What is wrong with a list of onsets: onsets that are missing, and onsets that do not exist."""

    missed: list[float]
    invented: list[float]

    def __bool__(self) -> bool:
        return bool(self.missed or self.invented)


def judge(family: Family, onsets: list[tuple[float, str, float]]) -> Verdict:
    """Compare onsets (value, direction, uncertainty) of a sweep with those of a dense scan.

    A window of the sweep that is narrower than the steps of the scan is checked by counting inside it.
    """
    low, high = float(family.values[0]), float(family.values[-1])
    logarithmic = low > 0 and high / low > 100
    grid = np.geomspace(low, high, _SCAN) if logarithmic else np.linspace(low, high, _SCAN)
    found = sorted(o[0] for o in onsets)
    inside = [(a + b) / 2 for a, b in itertools.pairwise(found)]
    points = np.unique(np.clip(np.concatenate([grid, family.planted, inside, family.values]), low, high))
    counts = family.counts(points)
    resolution = 5e-6 * (high - low) / (len(family.values) - 1)
    true: list[tuple[float, int]] = []
    for a, b, i, j in zip(points[:-1], points[1:], counts[:-1], counts[1:], strict=True):
        if i != j:
            true += _bisect(family.unstable, float(a), i, float(b), j, 1e-11 * (b if logarithmic else high - low))
    true = _merged(true, 0.4 * resolution)
    missed, left = [], [(v, 1 if d == "into" else -1, u) for v, d, u in onsets]
    for value, gain in true:
        reach = _slack(family, value, resolution)
        near = [o for o in left if o[1] == np.sign(gain) and abs(o[0] - value) <= o[2] + reach]
        if not near:  # Re λ may pass zero so slowly that it exceeds the judge's rounding only later
            same = sorted((o for o in left if o[1] == np.sign(gain)), key=lambda o: abs(o[0] - value))[:1]
            near = [o for o in same if family.hardly_grows(value, o[0])]
        if len(near) < abs(gain):
            missed.append(value)
        for o in sorted(near, key=lambda o: abs(o[0] - value))[: abs(gain)]:
            left.remove(o)
    # A window that is too narrow for the judge counts neither as right nor as wrong.
    return Verdict(missed, [value for value, _ in _merged([o[:2] for o in left], resolution)])


def _merged(changes: list[tuple[float, int]], width: float) -> list[tuple[float, int]]:
    """Return changes with those that are closer together than a width as one, since rounding makes counts flicker."""
    merged: list[tuple[float, int]] = []
    for value, gain in sorted(changes):
        if merged and value - merged[-1][0] < width:
            merged[-1] = value, merged[-1][1] + gain
        else:
            merged.append((value, gain))
    return [m for m in merged if m[1]]


def _slack(family: Family, value: float, resolution: float) -> float:
    # The judge sees doublets that couple from the start only when their growth exceeds its rounding.
    start = abs(value - family.values[0]) < 1e-5 * abs(family.values[-1] - family.values[0])
    return max(resolution, 1e-6 * abs(value), 1e-5 * abs(family.values[-1] - family.values[0]) if start else 0.0)


def _bisect(
    count: Callable[[float], int], a: float, i: int, b: float, j: int, width: float
) -> list[tuple[float, int]]:  # fmt: skip
    if i == j:
        return []
    if b - a <= width:
        return [((a + b) / 2, j - i)]
    middle = (a + b) / 2
    k = count(middle)
    return _bisect(count, a, i, middle, k, width) + _bisect(count, middle, k, b, j, width)


# The kinds of problems. In all of them θ is between 1 and 30 at p = 0, and the basis is random.


def _turned(rng: np.random.Generator, n: int, *matrices: np.ndarray) -> list[np.ndarray]:
    Q = la.qr(rng.standard_normal((n, n)))[0] * rng.uniform(0.7, 1.4, n)
    return [Q.T @ A @ Q for A in (np.eye(n), *matrices)]


def _values(rng: np.random.Generator, high: float = 1.0) -> np.ndarray:
    return np.linspace(0, high, int(rng.integers(7, 42)))


def undamped(rng: np.random.Generator) -> Family:
    """Return K + pF with F full and random."""
    n = int(rng.integers(6, 16))
    theta, F = np.sort(rng.uniform(1, 30, n)), rng.standard_normal((n, n)) * rng.uniform(0.5, 6)
    M, K, F = _turned(rng, n, np.diag(theta), F)
    return Family("undamped", (("M", M, 0, False), ("K", K, 0, False), ("K", F, 1, False)), _values(rng))


def damped(rng: np.random.Generator) -> Family:
    """Return K + pF with F full and random, and light damping."""
    n = int(rng.integers(6, 16))
    theta, F = np.sort(rng.uniform(1, 30, n)), rng.standard_normal((n, n)) * rng.uniform(0.5, 6)
    C = rng.standard_normal((n, n)) * 10 ** rng.uniform(-3, -1)
    C = C @ C.T / np.abs(C).max()
    M, K, F, C = _turned(rng, n, np.diag(theta), F, C)
    parts = (("M", M, 0, False), ("C", C, 0, False), ("K", K, 0, False), ("K", F, 1, False))
    return Family("damped", parts, _values(rng))


def gyroscopic(rng: np.random.Generator) -> Family:
    """Return K + pF with F full and random, and gyroscopic terms, damped or not."""
    n = int(rng.integers(6, 13))
    theta, F = np.sort(rng.uniform(1, 30, n)), rng.standard_normal((n, n)) * rng.uniform(0.5, 4)
    G = rng.standard_normal((n, n)) * rng.uniform(0.05, 0.5)
    D = rng.standard_normal((n, n)) * 0.03
    M, K, F, G, D = _turned(rng, n, np.diag(theta), F, G - G.T, D @ D.T)
    parts = [("M", M, 0, False), ("C", G, 0, False), ("K", K, 0, False), ("K", F, 1, False), ("C", D, 0, False)]
    return Family("gyroscopic", tuple(parts), _values(rng))


def complex_stiffness(rng: np.random.Generator) -> Family:
    """Return K + pF with loss factors that differ from unknown to unknown."""
    n = int(rng.integers(6, 16))
    theta, F = np.sort(rng.uniform(4, 30, n)), rng.standard_normal((n, n)) * rng.uniform(0.3, 2)
    eta = np.diag(theta * rng.uniform(0.001, 0.02, n))
    M, K, F, E = _turned(rng, n, np.diag(theta), F, eta)
    parts = (("M", M, 0, False), ("K", K, 0, False), ("K", E, 0, True), ("K", F, 1, False))
    return Family("complex", parts, _values(rng))


def rigid(rng: np.random.Generator) -> Family:
    """Return a problem with two free motions that friction does not couple to."""
    n = int(rng.integers(7, 15))
    theta = np.concatenate([[0, 0], np.sort(rng.uniform(1, 30, n - 2))])
    F = rng.standard_normal((n, n)) * rng.uniform(0.5, 6)
    F[:, :2] = 0
    M, K, F = _turned(rng, n, np.diag(theta), F)
    parts = (("M", M, 0, False), ("K", K, 0, False), ("K", F, 1, False))
    return Family("rigid", parts, _values(rng), zero=1e-9)


def doublets(rng: np.random.Generator) -> Family:
    """Return pairs of equal eigenvalues that F couples from the start, or does not couple because of its symmetry."""
    n = 2 * int(rng.integers(3, 7))
    theta = np.repeat(np.sort(rng.uniform(1, 30, n // 2)), 2)
    F = rng.standard_normal((n, n)) * rng.uniform(0.5, 4)
    M, K, F = _turned(rng, n, np.diag(theta), F)
    return Family("doublets", (("M", M, 0, False), ("K", K, 0, False), ("K", F, 1, False)), _values(rng))


def window(rng: np.random.Generator) -> Family:
    """Return two branches that cross with couplings of opposite sign: unstable over 1e-1 to 1e-5 of a step."""
    n = int(rng.integers(6, 16))
    values = _values(rng)
    step, at = values[1] - values[0], float(rng.uniform(0.1, 0.9))
    width = step * 10 ** rng.uniform(-5, -1)
    slope = rng.uniform(0.5, 4)
    theta = rng.uniform(12, 30, n)
    F = rng.standard_normal((n, n)) * rng.uniform(0.5, 2)
    F[:2], F[:, :2] = 0, 0
    theta[:2] = 6 + slope * at, 6 - slope * at
    F[0, 0], F[1, 1] = -slope, slope
    F[0, 1] = slope * width / 2 / at  # |K01| = p |F01|
    F[1, 0] = -F[0, 1]
    M, K, F = _turned(rng, n, np.diag(theta), F)
    planted = (at - width / 4, at, at + width / 4)
    parts = (("M", M, 0, False), ("K", K, 0, False), ("K", F, 1, False))
    return Family(f"window {width / step:.1e}", parts, values, planted)


def damped_window(rng: np.random.Generator) -> Family:
    """Return a `window` with damping that is too small to close it."""
    base = window(rng)
    growth = _window_growth(base)
    M = base.parts[0][1]
    C = M * growth * rng.uniform(0.05, 1.0)
    return Family("damped " + base.name, (*base.parts, ("C", C, 0, False)), base.values, base.planted)


def _window_growth(family: Family) -> float:
    m = family.matrices(family.planted[1])
    return float(np.sqrt(-la.eigvals(m["K"], m["M"]) + 0j).real.max())


def triple(rng: np.random.Generator) -> Family:
    """Return three modes that meet within one or two steps."""
    n = int(rng.integers(6, 12))
    values = np.linspace(0, 1, int(rng.integers(5, 15)))
    near = rng.uniform(0, 1) / (len(values) - 1)
    theta = np.concatenate([10 + near * rng.uniform(-2, 2, 3), rng.uniform(16, 30, n - 3)])
    F = rng.standard_normal((n, n)) * rng.uniform(0.5, 3)
    M, K, F = _turned(rng, n, np.diag(theta), F)
    return Family("triple", (("M", M, 0, False), ("K", K, 0, False), ("K", F, 1, False)), values)


def decades(rng: np.random.Generator) -> Family:
    """Return a stiffness that is swept over six decades and couples modes, with friction in proportion to it."""
    n = int(rng.integers(6, 12))
    theta = np.sort(rng.uniform(1, 30, n))
    g, s = rng.standard_normal((2, n, 2))
    mu = rng.uniform(0.2, 0.9)
    M, K, Kc = _turned(rng, n, np.diag(theta), (g + mu * s) @ g.T)
    values = np.geomspace(1e-3, 1e3, int(rng.integers(13, 40)))
    return Family("decades", (("M", M, 0, False), ("K", K, 0, False), ("K", Kc, 1, False)), values)


def large(rng: np.random.Generator) -> Family:
    """Return so many unknowns that the step model is a projection; only modes of near frequencies are coupled."""
    n = int(rng.integers(80, 140))
    theta = np.sort(rng.uniform(1, 900, n))
    F = rng.standard_normal((n, 6)) @ rng.standard_normal((6, n)) * rng.uniform(0.5, 4)
    M, K, F = _turned(rng, n, np.diag(theta), F)
    return Family("large", (("M", M, 0, False), ("K", K, 0, False), ("K", F, 1, False)), _values(rng))


def damping_swept(rng: np.random.Generator) -> Family:
    """Return a sweep of a damper, with friction."""
    n = int(rng.integers(6, 13))
    theta, F = np.sort(rng.uniform(1, 30, n)), rng.standard_normal((n, n)) * rng.uniform(2, 6)
    C, D = np.outer(c := rng.standard_normal(n), c), np.diag(rng.uniform(0.001, 0.01, n))
    M, K, C, D = _turned(rng, n, np.diag(theta) + F, C, D)
    parts = (("M", M, 0, False), ("K", K, 0, False), ("C", D, 0, False), ("C", C, 1, False))
    return Family("damping", parts, _values(rng, float(rng.uniform(0.2, 2))))


def overdamped(rng: np.random.Generator) -> Family:
    """Return many modes that decay without swinging, of which some meet, and friction that makes a few grow."""
    n = int(rng.integers(8, 17))
    theta, heavy = np.sort(rng.uniform(1, 30, n)), rng.random(n) < 0.75
    C = np.diag(np.where(heavy, rng.uniform(15, 120, n), rng.uniform(0.01, 0.3, n)))
    F = rng.standard_normal((n, n)) * rng.uniform(1, 12)
    M, K, F, C = _turned(rng, n, np.diag(theta), F, C)
    parts = (("M", M, 0, False), ("K", K, 0, False), ("K", F, 1, False), ("C", C, 0, False))
    return Family("overdamped", parts, np.linspace(0, 1, int(rng.integers(2, 8))))


def dipping(rng: np.random.Generator) -> Family:
    """Return springs whose stiffness falls and rises again, some below zero for a while, with friction or without.

    Some brakes are damped, and the sweep has few values, so that θ passes zero twice within a step.
    """
    n = int(rng.integers(3, 9))
    low = int(rng.integers(1, 3))
    theta, first, second = rng.uniform(4, 30, n), np.zeros(n), np.zeros(n)
    at, bent = rng.uniform(0.1, 0.9, low), rng.uniform(4, 40, low)
    depth = bent * 10 ** rng.uniform(-4, -1.5, low) * rng.choice([-1, 1, 1, 1], low)
    theta[:low], first[:low], second[:low] = bent * at**2 - depth, -2 * bent * at, bent
    F = rng.standard_normal((n, n)) * rng.choice([0.0, 0.02, 1.0])
    M, K, K1, K2, F = _turned(rng, n, np.diag(theta), np.diag(first), np.diag(second), F)
    parts = [("M", M, 0, False), ("K", K, 0, False), ("K", K1, 1, False), ("K", K2, 2, False)]
    parts += [("K", F, 1, False)] * bool(F.any())
    parts += [("C", M * rng.uniform(1e-3, 1e-1), 0, False)] * int(rng.integers(0, 2))
    return Family("dipping", tuple(parts), np.linspace(0, 1, int(rng.integers(2, 8))))


def coarse(rng: np.random.Generator) -> Family:
    """Return a strongly coupled brake whose sweep has few values, so that much happens within a step."""
    n = int(rng.integers(2, 8))
    theta, slope = rng.uniform(1, 14, n), rng.uniform(-12, 0, n)
    F = rng.standard_normal((n, n))
    F = (F - F.T if rng.random() < 0.5 else F) * rng.uniform(0.5, 5)
    M, K, F = _turned(rng, n, np.diag(theta), F + np.diag(slope))
    parts = (("M", M, 0, False), ("K", K, 0, False), ("K", F, 1, False))
    return Family("coarse", parts, np.linspace(0, 1, int(rng.integers(2, 5))))


FAMILIES = (
    undamped, damped, gyroscopic, complex_stiffness, rigid, doublets, window, damped_window, triple, decades, large,
    damping_swept, overdamped, dipping, coarse,
)  # fmt: skip


def make(kind: Callable[[np.random.Generator], Family], seed: int) -> Family:
    """Return the family of a kind for a seed, always the same one."""
    return kind(np.random.default_rng([seed, FAMILIES.index(kind)]))
