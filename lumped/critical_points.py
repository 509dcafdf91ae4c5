"""Critical friction coefficients of M q̈ + C q̇ + (K0 + μ F) q = 0, all of them, to machine precision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .blocks import Block, split_blocks
from .candidates import find_double, find_opposite, find_singular
from .counting import Doubt, count_growing, find_missing
from .following import Follower, derivative
from .passages import Passage
from .spectrum import mass_normalized
from .springs import Floats

LARGEST = 1e6  # |μ| up to which is searched
_REAL = 0.1  # |Im μ| over |μ| of a candidate: the real roots of a touch, or of a narrow window, may turn into a pair
_NEAR = 0.05  # of |μ|: a motion that is farther than this from where it would turn is not that of a candidate
_PAIRS = 4  # of the nearest pairs of eigenvalues, which may be the ones that meet
_STATIC = 1e-6  # |ω| over the highest frequency
_WIDENED = 20  # times, each twice as far to both sides
_STEP = 1e-4  # of |μ|, for the slope


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
    uncertainty : float
        How far from `mu` rounding hides whether the motion is unstable.
    """

    mu: float
    omega: float
    kind: str
    into: bool
    slope: float
    uncertainty: float


@dataclass(frozen=True)
class Search:
    """The critical points of a system.

    Attributes
    ----------
    points : tuple of CriticalPoint
        By ascending μ.
    low, high : float
        The range that was searched: what was asked for, within ±1e6.
    doubts : tuple of Doubt
        Where rounding hides whether a motion is unstable.
    """

    points: tuple[CriticalPoint, ...]
    low: float
    high: float
    doubts: tuple[Doubt, ...]

    @property
    def onsets(self) -> list[float]:
        """The μ at which a flutter begins as μ rises, ascending."""
        return [o.mu for o in self.points if o.into and o.kind != "divergence"]

    @property
    def completeness(self) -> dict[str, object]:
        """What was searched, and whether rounding hides anything there: `sure`, `what`, `open` (sentences)."""
        told = [doubt.sentence() for doubt in self.doubts]
        return {"sure": not told, "what": f"critical mu from {self.low:g} to {self.high:g}", "open": told}


def search_critical_points(M: Floats, C: Floats, K0: Floats, F: Floats, lower: float, upper: float) -> Search:
    """Find every change of the number of growing motions with lower < μ < upper, and where rounding hides one.

    Candidates come from the parts of the system that move by themselves. At each the motion is followed to both sides
    until it grows, or does not, beyond the uncertainty of its eigenvalue: if it does the same on both sides it touches
    the limit and that is no critical point. Then the growing eigenvalues are counted between all candidates and on a
    grid; where their number changes and no crossing explains it, the change is bisected.

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
    >>> found = search_critical_points(np.eye(2), 0 * K0, K0, F, 0, np.inf)
    >>> [(o.kind, round(o.mu, 14)) for o in found.points], found.high, found.doubts  # ((3-4)²/4 + 1)/4
    ([('flutter', 0.3125)], 1000000.0, ())
    """
    low, high = max(float(lower), -LARGEST), min(float(upper), LARGEST)
    points: list[CriticalPoint] = []
    doubts: list[Doubt] = []
    for block in split_blocks(*(mass_normalized(M, X) for X in (K0, F, C))):
        if low < high and block.B.any():
            found, unclear = _search_block(block, low, high)
            # Equal parts of a system have their critical points in common: these are listed once.
            points += [o for o in found if not any(_are_one(o, other) for other in points)]
            doubts += [d for d in unclear if d not in doubts]
    return Search(tuple(sorted(points, key=lambda o: o.mu)), low, high, tuple(doubts))


def _search_block(block: Block, low: float, high: float) -> tuple[list[CriticalPoint], list[Doubt]]:
    still_block = replace(block, C=np.zeros_like(block.C))
    follower, static = (Follower(b, -2 * LARGEST, 2 * LARGEST) for b in (block, still_block))
    meeting = find_double(block.A, block.B) if block.undamped else find_opposite(block.A, block.B, block.C)
    moving, still = (_starts(mu, low, high) for mu in (meeting, find_singular(block.A, block.B)))
    passages: list[Passage] = []
    for start, trust in moving:
        for near in _motions(block, start):
            passage = _settle(follower, start, near, trust, passages)
            if passage is not None and not any(passage.is_same(x) for x in passages):
                passages.append(passage)
    for start, trust in still:
        if (passage := _settle(static, start, 0j, trust, passages)) is not None:
            passages.append(_with_damping(block, passage))
    doubts = find_missing(block, follower, passages, [start for start, _ in (*moving, *still)], low, high)
    crossings = [x for x in passages if x.is_crossing]
    inside = [x for x in crossings if low < x.mu < high and (not x.is_vague or low <= x.left.mu < x.right.mu <= high)]
    return [_point(block, follower, x, crossings) for x in inside], doubts


def _starts(mu: Sequence[complex] | np.ndarray, low: float, high: float) -> list[tuple[float, float]]:
    """Return real μ to start from, and how far the critical point may be."""
    starts = []
    for value in mu:
        real, imaginary = float(value.real), abs(float(value.imag))
        trust = _NEAR * abs(real) + 2 * imaginary
        if imaginary <= _REAL * abs(real) and low - trust < real < high + trust:
            starts += [(x, trust) for x in sorted({real - imaginary, real, real + imaginary})]
    return starts


def _motions(block: Block, mu: float) -> list[complex]:
    """Return the eigenvalues, or middles of two, that may be those of a candidate."""
    lam = block.eigenvalues(mu)
    if not block.undamped:
        return [complex(x) for x in lam if x.imag > 0]
    lam = lam[lam.imag > _STATIC * np.abs(lam).max()]
    i, j = np.triu_indices(len(lam), 1)
    nearest = np.argsort(np.abs(lam[i] - lam[j]))[:_PAIRS]
    return [complex(x) for x in (lam[i] + lam[j])[nearest] / 2]


def _settle(follower: Follower, start: float, near: complex, trust: float, known: list[Passage]) -> Passage | None:
    """Return the passage of a candidate, unless it is one of those known, or far away."""
    root = follower.polish(start, near, trust)
    if root is None or any(x.covers(*root) for x in known):
        return None
    return follower.settle(*root)


def _with_damping(block: Block, passage: Passage) -> Passage:
    """Return the passage of a root of det K, followed without damping, as damping has it.

    Mostly it is the same. But damping that friction drives can let a growing motion pass to a decaying one as K loses
    its positive determinant.
    """
    width = passage.uncertainty
    for _ in range(_WIDENED):
        before, behind = count_growing(block, np.array([passage.mu - width, passage.mu + width]))
        if (behind - before) % 2:  # else rounding hides the eigenvalue that passes through zero
            return passage.turned() if passage.gain * (behind - before) < 0 else passage
        width *= 2
    return passage


def _point(block: Block, follower: Follower, crossing: Passage, others: Sequence[Passage]) -> CriticalPoint:
    mu, omega, into = crossing.mu, abs(crossing.lam.imag), crossing.gain > 0
    unsure = crossing.uncertainty
    if omega == 0:
        return CriticalPoint(mu, 0.0, "divergence", into, np.nan, unsure)
    if not block.undamped:
        return CriticalPoint(mu, omega, "hopf", into, derivative(block, mu, crossing.lam).real, unsure)
    room = min((abs(x.mu - mu) for x in others if x is not crossing), default=abs(mu))
    h = min(max(_STEP * abs(mu), 1e3 * unsure), 0.1 * room)

    def rate(step: float) -> float:
        below, above = (follower.measure(mu + sense * step, crossing.lam)[0] for sense in (-1, 1))
        return (above - below) / (2 * step)

    slope = np.sqrt(abs(4 * rate(h / 2) - rate(h)) / 3)  # of ((λi − λj) / 2)² = (Re λ)², without its term h²
    return CriticalPoint(mu, omega, "flutter", into, float(slope), unsure)


def _are_one(a: CriticalPoint, b: CriticalPoint) -> bool:
    near = abs(a.mu - b.mu) <= 1e-12 * abs(a.mu) + a.uncertainty + b.uncertainty
    return (a.kind, a.into) == (b.kind, b.into) and near and abs(a.omega - b.omega) <= 1e-6 * a.omega
