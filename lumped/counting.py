"""Counts of growing eigenvalues, which show whether every critical point was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .blocks import Block
from .following import CLEAR, Follower
from .passages import Passage
from .spectrum import Spectrum
from .springs import Floats

_USUAL, _GRID = 10.0, 101  # |μ| up to which so many even steps are counted at
_DECADES = 12  # below the largest |μ|, at five values each
_BLURRED, _TINY = 0.1, 1e-9  # of |λ|, and of the largest one: uncertainty of a λ of which nothing is known
_ONE = 1e-2  # of a frequency: doubts closer together are about one motion
_AROUND = 10.0  # times what a passage hides
_FINEST = 4 * np.finfo(float).eps  # of |μ|: how far a change is bisected


@dataclass(frozen=True)
class Doubt:
    """An interval of μ in which rounding hides whether a motion grows.

    Attributes
    ----------
    low, high : float
    omega : float, rad/s
        Frequency of the motion.
    """

    low: float
    high: float
    omega: float

    def is_part_of(self, passage: Passage) -> bool:
        """Return whether it is no more than what rounding hides around a passage that is known on both sides."""
        reach = _AROUND * (passage.right.mu - passage.left.mu)
        inside = passage.left.mu - reach <= self.low and self.high <= passage.right.mu + reach
        return passage.is_sure and not passage.is_vague and inside and passage.has_frequency(self.omega)

    def is_about(self, other: Doubt) -> bool:
        """Return whether another doubt says as much."""
        near = abs(self.omega - other.omega) <= _ONE * other.omega
        return near and other.low <= self.low and self.high <= other.high

    def sentence(self) -> str:
        """Return the sentence that tells of it.

        Examples
        --------
        >>> Doubt(0.25, 0.5, 2.0).sentence()[:63]
        'between mu = 0.25 and 0.5 a motion at 2 rad/s grows or decays b'
        """
        return (
            f"between mu = {self.low:.6g} and {self.high:.6g} a motion at {self.omega:.5g} rad/s grows or decays by"
            " less than rounding of the matrices: whether it is unstable there is not known"
        )


def count_growing(block: Block, mu: Floats) -> NDArray[np.int_]:
    """Return the number of eigenvalues that grow beyond their uncertainty at each of several μ.

    Examples
    --------
    >>> block = Block(np.eye(1), -np.eye(1), np.zeros((1, 1)))
    >>> count_growing(block, np.array([0.0, 2.0])).tolist()
    [0, 1]
    """
    spectrum = block.spectrum(mu)
    return np.asarray((spectrum.lam.real > spectrum.uncertainty).sum(-1))


def find_missing(
    block: Block, follower: Follower, passages: list[Passage], starts: Sequence[float], low: float, high: float
) -> list[Doubt]:
    """Add the crossings that explain changes of the number of growing eigenvalues; return where rounding hides one.

    Parameters
    ----------
    block : Block
    follower : Follower
        Of the block.
    passages : list of Passage
        Those known; found ones are appended.
    starts : sequence of float
        Candidates: between each two the number is counted.
    low, high : float
    """
    mu = _values([*starts, *(x.mu for x in passages)], low, high)
    mu = mu[[not any(p.hides(x) for p in passages) for x in mu]]
    spectrum = block.spectrum(mu)
    counts = (spectrum.lam.real > spectrum.uncertainty).sum(-1)
    left = list(zip(mu[:-1].tolist(), counts[:-1].tolist(), mu[1:].tolist(), counts[1:].tolist(), strict=True))
    doubts = [Doubt(low, high, omega) for omega in _hidden(spectrum, block.undamped)]
    while left:
        a, at_a, b, at_b = left.pop()
        if at_b - at_a == sum(x.gain for x in passages if a < x.mu < b):
            continue
        middle = _between(a, b, passages)
        if middle is not None:
            at_middle = int(count_growing(block, np.array([middle]))[0])
            left += [(a, at_a, middle, at_middle), (middle, at_middle, b, at_b)]
        elif any(_knows(x, a, b) for x in passages):
            continue
        elif not _explain(block, follower, b if at_b > at_a else a, passages):
            doubts.append(Doubt(a, b, _omega(block, a, b)))
    doubts += [_doubt(x) for x in passages if x.left.value + x.right.value == 1 or (x.is_crossing and x.is_vague)]
    doubts = [d for d in doubts if not any(d.is_part_of(x) for x in passages)]
    doubts = [replace(d, low=max(d.low, low), high=min(d.high, high)) for d in doubts if d.low < high and d.high > low]
    doubts.sort(key=lambda d: d.low - d.high)  # wide ones first
    return [d for k, d in enumerate(doubts) if not any(d.is_about(other) for other in doubts[:k])]


def _values(starts: Sequence[float], low: float, high: float) -> Floats:
    """Return where to count: between candidates, at even steps of usual values, and at even ratios up to the ends."""
    ends = np.concatenate([[low], np.unique([x for x in starts if low < x < high]), [high]])
    ratios = max(abs(low), abs(high)) * np.logspace(-_DECADES, 0, 5 * _DECADES + 1)
    even = np.linspace(max(low, -_USUAL), min(high, _USUAL), _GRID)
    values = np.unique(np.concatenate([(ends[1:] + ends[:-1]) / 2, ratios, -ratios, even]))
    return values[(values > low) & (values < high)]


def _knows(passage: Passage, a: float, b: float) -> bool:
    """Return whether the numbers at two μ differ by less than a passage because rounding hides it there."""
    hidden = passage.left.mu <= a and b <= passage.right.mu
    return passage.is_sure and hidden and (a, b) != (passage.left.mu, passage.right.mu)


def _hidden(spectrum: Spectrum, undamped: bool) -> list[float]:
    """Return the frequencies of motions whose stability rounding hides at most values of μ.

    Without damping a motion is on the axis unless another one is near: then rounding hides all only where it is as
    large as λ itself.
    """
    size, error = np.abs(spectrum.lam), spectrum.uncertainty
    hidden = (error > _BLURRED * size) & (error > _TINY * size.max(-1, keepdims=True))
    if not undamped:
        hidden |= (np.abs(spectrum.lam.real) <= error) & (spectrum.lam.imag > 0)
    usual = np.median(np.where(hidden, size, 0.0), axis=0)
    return [float(x) for x in usual if x > 0]


def _between(a: float, b: float, passages: Sequence[Passage]) -> float | None:
    """Return where to count between a and b: in the middle, but not where a known passage hides the number."""
    middle = (a + b) / 2
    for x in passages:
        if x.hides(middle):
            return next((end.mu for end in (x.left, x.right) if a < end.mu < b), None)
    return middle if b - a > _FINEST * max(abs(a), abs(b)) and a < middle < b else None


def _explain(block: Block, follower: Follower, mu: float, passages: list[Passage]) -> bool:
    """Follow each motion that grows by hardly more than its uncertainty to both sides; return whether there is one."""
    spectrum = block.spectrum(mu)
    growth, limit = spectrum.lam.real, spectrum.uncertainty
    slow = spectrum.lam[(growth > limit) & (growth <= CLEAR * limit) & (spectrum.lam.imag >= 0)]
    for lam in slow:
        near = 1j * lam.imag if block.undamped else complex(lam)
        if not any(x.covers(mu, near) for x in passages):
            passage = follower.settle(mu, near)
            if not any(passage.is_same(x) for x in passages):
                passages.append(passage)
    return len(slow) > 0


def _doubt(passage: Passage) -> Doubt:
    return Doubt(float(passage.left.mu), float(passage.right.mu), abs(passage.lam.imag))


def _omega(block: Block, a: float, b: float) -> float:
    """Return the frequency of the motion nearest to the limit of stability among those that change there."""
    before, after = (block.eigenvalues(mu) for mu in (a, b))
    return float(abs(after[np.argmax(np.abs(after.real - before.real))].imag))
