"""Extrapolation of two modes that nearly meet: their mean and the square of their difference change linearly.

A mode whose frequency falls to zero meets its own λ*: without damping λ² changes linearly, and beyond zero it diverges.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..assembly.assembly import Assembly
from ..problem.parameters import paths_of
from ..problem.problem import Problem
from .bars import BARS, Parts, bar_of_parts, beyond

_STEPS = 16  # equal steps of s in which m and D are extrapolated, so that the root √D can be followed
_APART = 10.0  # times the change of either mode: modes farther apart than this are extrapolated each by itself
_COMPRESSION = "stress_stiffening"  # the effect that takes stiffness away where the preload compresses
_ROUNDING = 1e-6  # of the sum of two distances: a smaller difference between them is taken for rounding


def bent_change(
    lam: np.ndarray, refined: np.ndarray, order: int, most: np.ndarray | None = None, least: np.ndarray | None = None,
    about: np.ndarray | None = None, may_couple: bool = True, may_diverge: bool = True,
) -> np.ndarray:  # fmt: skip
    """Return how far each λ moves if it is extrapolated together with the nearest other mode, (k,) complex, rad/s.

    The real part is the largest |Re λ(s) − Re λ| over all s from `least` to `most`, the imaginary part that of Im λ.
    With m = (λ_i + λ_j)/2 and D = ((λ_i − λ_j)/2)², index 0 for the mesh and 1 for the refined one,
    λ(s) = m(s) ± √D(s), m(s) = m₀ + s (m₁ − m₀), D(s) = D₀ + s (D₁ − D₀). A mode that nears Im λ = 0 has its own λ* as
    λ_j, see `near_zero`.

    Parameters
    ----------
    lam, refined : (k,) complex, rad/s
        The same modes on the mesh and on the refined one; NaN where a mode is not found again.
    order : int
        Order of the elements.
    most, least : (k,) float, optional
        The largest s of each mode, `BARS` if not given, and the smallest, 1 if not given.
    about : (k,) complex, rad/s, optional
        What distances are measured from, instead of λ.
    may_couple : bool
        Whether two modes may meet and grow, see the function `may_couple`; if not, their Re λ stays.
    may_diverge : bool
        Whether a mode may meet its λ*, see the function `may_diverge`.
    """
    found = np.zeros(len(lam), dtype=complex)
    start = lam if about is None else about
    first = np.ones(len(lam)) if least is None else least
    last = np.full(len(lam), BARS[order]) if most is None else most
    for i, j, _ in _nearest(lam, refined, may_couple, may_diverge):
        (m0, m1), (D0, D1) = _mean_and_square(lam, refined, i, j)
        here, re, im = refined[i], 0.0, 0.0
        for s in np.linspace(1.0, last[i], _STEPS + 1):
            root = np.sqrt(D0 + s * (D1 - D0) + 0j)
            ends = m0 + s * (m1 - m0) + np.array([root, -root])
            here = ends[0 if i == j else np.argmin(np.abs(ends - here))]
            if s >= first[i]:
                re, im = max(re, abs(here.real - start[i].real)), max(im, abs(here.imag - start[i].imag))
        found[i] = (re if may_couple or i == j else 0.0) + 1j * im
    return found


def extrapolated(
    lam: np.ndarray, refined: np.ndarray, factor: float | np.ndarray, may_couple: bool = True, may_diverge: bool = True
) -> np.ndarray:  # fmt: skip
    """Return the eigenvalues extrapolated to s = factor, (k,) complex, rad/s.

    Where two modes nearly meet, λ changes like a square root, so m and D of `bent_change` are extrapolated instead of
    λ. A mode whose distance from all others is more than `_APART` times its change is extrapolated by itself:
    λ + factor (refined − λ).

    Parameters
    ----------
    lam, refined : (k,) complex, rad/s
        The same modes on the mesh and on the refined one. `refined` is NaN where a mode is not found again; the result
        is NaN there too.
    factor : float or (k,) float
        s, of all modes or of each: 1 gives the eigenvalues on the refined mesh.
    may_couple, may_diverge : bool
        As for `bent_change`: a mode that may do neither is extrapolated by itself.

    Examples
    --------
    >>> extrapolated(np.array([10j, 99j]), np.array([9j, 99j]), 1.5).round(6)
    array([0. +8.5j, 0.+99.j ])
    >>> extrapolated(np.array([10j, 10.1j]), np.array([-0.1 + 10j, 0.1 + 10j]), 1.5).round(3)  # D: -0.0025, 0.01
    array([-0.127+9.975j,  0.127+9.975j])
    >>> extrapolated(np.array([10j, 99j]), np.array([4j, 99j]), 1.5).round(3)  # λ²: -100, -16
    array([5.099 +0.j, 0.   +99.j])
    """
    s = np.broadcast_to(factor, lam.shape)
    found = lam + s * (refined - lam)
    for i, j, apart in _nearest(lam, refined, may_couple, may_diverge):
        if (i != j and not may_couple) or apart > _APART * np.abs(refined - lam)[[i, j]].max():
            continue
        (m0, m1), (D0, D1) = _mean_and_square(lam, refined, i, j)
        # Mode i takes that of the roots ±√D which lies on its side of m on the refined mesh. If both are equally near,
        # the mode with the lower number takes +√D and the other one −√D, so that the two still differ.
        root, side = np.sqrt(D0 + s[i] * (D1 - D0) + 0j), (refined[i] - refined[j]) / 2
        same, other = abs(root - side), abs(root + side)
        is_clear = abs(same - other) > _ROUNDING * (same + other)
        is_positive = same < other if is_clear else i < j
        if i == j:  # what diverges does so as the root that grows
            is_positive = True
        found[i] = m0 + s[i] * (m1 - m0) + (root if is_positive else -root)
    return np.asarray(found)


def may_couple(problem: Problem, parameter: str, value: float) -> bool:
    """Return whether two modes may meet and grow at a value: not where K is symmetric and nothing damps or turns."""
    at = {**problem.parameters, **dict.fromkeys(paths_of(parameter), value)}
    return problem.is_damped or any(t.coefficient(at) for t in problem.terms if not t.symmetric)


def may_diverge(problem: Problem, parameter: str, value: float) -> bool:
    """Return whether a mode may lose its stiffness at a value: where modes may couple, or by a preload that compresses.

    All other symmetric terms of K add stiffness. Not with elements of order 1 either, which are so stiff in bending
    that frequencies fall by as much as here when they are refined.
    """
    order = problem.source.space.order if isinstance(problem.source, Assembly) else 2
    compressed = any(t.name.startswith(_COMPRESSION) for t in problem.terms)
    return order > 1 and (compressed or may_couple(problem, parameter, value))


def near_zero(lam: np.ndarray, refined: np.ndarray, may_couple: bool, may_diverge: bool) -> np.ndarray:
    """Return which modes (k,) bool near Im λ = 0, where they meet their own λ*, rather than another mode."""
    found = np.zeros(len(lam), dtype=bool)
    for i, j, _ in _nearest(lam, refined, may_couple, may_diverge):
        found[i] = i == j
    return found


def _nearest(
    lam: np.ndarray, refined: np.ndarray, may_couple: bool, may_diverge: bool
) -> Iterator[tuple[int, int, float]]:
    """Yield each mode that swings, the one nearest to it on either mesh, and their distance there, rad/s.

    A mode i that may diverge is its own nearest one if it is nearer to Im λ = 0, where it meets λ_i*, or may meet no
    other one.
    """
    known = np.flatnonzero(np.isfinite(refined) & (lam.imag > 0))
    for i in known.tolist():
        others = known[known != i]
        apart = np.minimum(np.abs(lam[others] - lam[i]), np.abs(refined[others] - refined[i]))
        low = float(min(lam[i].imag, abs(refined[i].imag)))
        if may_diverge and (not may_couple or low < apart.min(initial=np.inf)):
            yield i, i, 2 * low
        elif len(others):
            yield i, int(others[np.argmin(apart)]), float(apart.min())


def _mean_and_square(lam: np.ndarray, refined: np.ndarray, i: int, j: int) -> tuple[list[complex], list[complex]]:
    """Return m = (λ_i + λ_j)/2 and D = ((λ_i − λ_j)/2)² on the mesh and on the refined one; of i = j with λ_i*."""
    if i == j:
        here, then = complex(lam[i]), complex(refined[i])
        # Two λ that do not oscillate any more are no conjugates: they lie around the mean that they had.
        m = [here.real, then.real if then.imag else here.real]
        return [complex(x) for x in m], [complex(-(here.imag**2)), complex((then.real - m[1]) ** 2 - then.imag**2)]
    pairs = [(complex(x[i]), complex(x[j])) for x in (lam, refined)]
    return [(a + b) / 2 for a, b in pairs], [((a - b) / 2) ** 2 for a, b in pairs]


def growth_beyond(
    here: np.ndarray, refined: np.ndarray, parts: Parts, order: int, paired: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the bars of Re λ (k,), its likely values, and the bars of these, 1/s; NaN where no parts are known.

    Of two modes that have met without damping, λ = im ± a, so that D = a² and a part p of the change of a, to first
    order, is a part 2ap of that of D. The change of D is that sum but for what is of second order in the mesh; that of
    a is not, where a is small.

    Parameters
    ----------
    here, refined : (k,) float, 1/s
        Re λ on the mesh and on the refined one.
    parts : Parts
        Of the changes of Re λ.
    order : int
        Order of the elements.
    paired : (k,) bool
        Modes whose a = Re λ.

    Examples
    --------
    >>> a = np.array([3.0])  # D: 9 on the mesh, 16 on the refined one, and Σ 2ap = 7
    >>> parts = Parts.of(np.array([[7 / 6]]), np.array([False]))
    >>> bar, value, width = growth_beyond(a, np.array([4.0]), parts, 2, np.array([True]))
    >>> (value**2).round(3).tolist(), ((value + width) ** 2 - 9 < 7 * 4 / 3 + 0.1).tolist()
    ([17.4], [True])
    """
    bar = bar_of_parts(refined - here, parts, order)
    shift, width = beyond(refined - here, parts, order)
    moved, wide = beyond(refined**2 - here**2, parts.times(2 * here), order)
    low, likely, high = (np.sign(here) * np.sqrt(np.maximum(here**2 + moved + w, 0.0)) for w in (-wide, 0.0, wide))
    from_here, from_likely = (np.maximum(np.abs(low - x), np.abs(high - x)) for x in (here, likely))
    found = np.where(paired, [from_here, likely, from_likely], [bar, here + shift, width])
    found[:, ~parts.known] = np.nan
    return found[0], found[1], found[2]
