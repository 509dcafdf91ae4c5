"""One motion, followed over friction or another parameter to where it surely grows and surely does not."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.optimize import brentq

from .blocks import Block
from .passages import Passage, Sign
from .spectrum import Complexes, Spectrum
from .springs import Floats

_EPS = float(np.finfo(float).eps)
_APART = 0.5  # of the distance of the next eigenvalue: one nearer than this to where it is expected is the same motion
_STEPS = 200
_NARROWEST = 1e-10  # of a step: if eigenvalues are not told apart over such a part of it, rounding hides which is it
# Times its uncertainty: growth beyond this is followed no further. Counts take growth beyond the uncertainty itself;
# by the margin a motion that is followed from that limit does not end there at once.
CLEAR = 2.0
_HALVINGS = 3  # of the last of these steps
_LONGER = 4.0  # each step away from a candidate is as much longer than the one before
_TRIAL = 1e-5  # of μ: the first step of the secant method


class Family(Protocol):
    """A system that depends on one parameter."""

    @property
    def undamped(self) -> bool:
        """Whether it has no damping at any value."""

    def eigenvalues(self, mu: float, /) -> Complexes:
        """Return all λ, (2n,), rad/s."""

    def spectrum(self, mu: float, /) -> Spectrum:
        """Return all λ with their uncertainty."""


class Follower:
    """Follows a motion by its `measure`, which is analytic in μ and positive where the motion grows.

    With damping it is Re λ of one eigenvalue. Without, two eigenvalues have to meet for a change: on the axis of
    frequencies before or behind, and it is ((λi − λj) / 2)², negative where both are on that axis.

    Parameters
    ----------
    family : Family
    low, high : float
        How far a motion is followed.
    """

    def __init__(self, family: Family, low: float, high: float) -> None:
        self.family, self.low, self.high = family, low, high
        self.count = 2 if family.undamped else 1

    def measure(self, mu: float, near: complex) -> tuple[float, complex]:
        """Return the measure at μ and the eigenvalue, or the mean of the two, for the motion whose λ is near to one.

        The measure is not a number if the two nearest are no pair: of one of a growing pair and a third eigenvalue.
        """
        return self._measure(self.family.eigenvalues(mu), near)

    def polish(self, mu: float, near: complex, trust: float) -> tuple[float, complex] | None:
        """Return the root of the measure next to μ, and λ there, by the secant method; None if it is beyond `trust`.

        At a double root rounding ends the search early: the best is returned.
        """
        f, lam = self.measure(mu, near)
        if not np.isfinite(f):
            return None
        best = (abs(f), mu, lam)
        start, before, f_before = mu, mu, f
        mu += _TRIAL * abs(mu) or _TRIAL * trust
        for k in range(40):
            f, lam = self.measure(mu, lam)
            if not np.isfinite(f):
                break
            best = min(best, (abs(f), mu, lam), key=lambda entry: entry[0])
            if f in (0.0, f_before):
                break
            step = -f * (mu - before) / (f - f_before)
            if not abs(mu + step - start) <= trust:
                if k == 0:
                    return None
                break
            before, f_before, mu = mu, f, mu + step
            if abs(step) <= 2 * _EPS * abs(mu):
                break
        return best[1], best[2]

    def settle(self, mu: float, lam: complex) -> Passage:
        """Follow a motion to both sides of a μ at which the measure is zero, or nearly so."""
        left, right = self.leave(mu, lam, -1.0), self.leave(mu, lam, 1.0)
        passage = Passage(mu, lam, left, right)
        return self._refine(passage) if passage.is_crossing else passage

    def leave(self, mu: float, lam: complex, sense: float) -> Sign:
        """Follow a motion from μ downwards (`sense` −1) or upwards (1) to where its sign is sure."""
        last, known, rate = mu, lam, 0j
        length = 4 * _EPS * max(abs(mu), _EPS * max(abs(self.low), abs(self.high)))
        for _ in range(_STEPS):
            step = min(length, self.high - last if sense > 0 else last - self.low)
            if step <= 0:
                break
            while (found := self._identify(last + sense * step, known + sense * step * rate)) is None:
                step *= 0.5
                if step < _NARROWEST * length:
                    return Sign(0, last, known)
            sign, lam = found
            if sign:
                return self._tighten(Sign(0, last, known), Sign(sign, last + sense * step, lam))
            rate, last, known = (lam - known) / (sense * step), last + sense * step, lam
            length = _LONGER * max(step, _NARROWEST * length)
        return Sign(0, last, known)

    def _tighten(self, unsure: Sign, sure: Sign) -> Sign:
        """Return where the sign is sure, nearer to where it is not."""
        for _ in range(_HALVINGS):
            found = self._identify((unsure.mu + sure.mu) / 2, (unsure.lam + sure.lam) / 2)
            if found is None:
                break
            middle = Sign(found[0], (unsure.mu + sure.mu) / 2, found[1])
            if middle.value in (0, sure.value):
                unsure, sure = (middle, sure) if middle.value == 0 else (unsure, middle)
        return sure

    def _refine(self, passage: Passage) -> Passage:
        """Return a crossing with the root between its sides."""
        left, right = passage.left, passage.right

        def expected(mu: float) -> complex:
            return left.lam + (right.lam - left.lam) * (mu - left.mu) / (right.mu - left.mu)

        def f(mu: float) -> float:
            return float(np.nan_to_num(self.measure(mu, expected(mu))[0]))  # zero where they are no pair to rounding

        tolerance = max(_EPS * min(abs(left.mu), abs(right.mu)), float(np.finfo(float).tiny))
        mu = float(brentq(f, left.mu, right.mu, xtol=tolerance, rtol=4 * _EPS))
        return Passage(mu, self.measure(mu, expected(mu))[1], left, right)

    def _identify(self, mu: float, expected: complex) -> tuple[int, complex] | None:
        """Return the sign and λ of the motion expected at λ, or None if another one is nearly as near.

        Two damped ones, as where they meet, count as one as long as their signs are alike.
        """
        spectrum = self.family.spectrum(mu)
        distance = np.abs(spectrum.lam - expected)
        order = np.argsort(distance)
        near = max(int((distance * _APART < distance[order[self.count - 1]]).sum()), self.count)
        if self.count == 1:
            taken = order[:near]
            growth, limit = spectrum.lam.real[taken], CLEAR * spectrum.uncertainty[taken]
            signs = np.where(np.abs(growth) > limit, np.sign(growth), 0).astype(int)
            return (int(signs[0]), complex(spectrum.lam[taken].mean())) if (signs == signs[0]).all() else None
        f, lam = self._measure(spectrum.lam, expected)
        if near > 2 or not np.isfinite(f):
            return None
        sure = np.sqrt(abs(f)) > CLEAR * spectrum.uncertainty[order[:2]].max()
        return (int(np.sign(f)) if sure else 0), lam

    def _measure(self, lam: Complexes, near: complex) -> tuple[float, complex]:
        order = np.argsort(np.abs(lam - near))
        if self.count == 1:
            return float(lam[order[0]].real), complex(lam[order[0]])
        a, b = lam[order[:2]]
        middle = complex((a + b) / 2)
        return float((((a - b) / 2) ** 2).real) if middle.real == 0 else np.nan, middle


def derivative(block: Block, mu: float, lam: complex) -> complex:
    """Return dλ/dμ = −yᴴ B x / yᴴ (2 λ + C) x of a simple eigenvalue; not finite where it is double."""
    one: Floats = np.eye(len(block.A))
    u, _, vh = np.linalg.svd(lam * lam * one + lam * block.C + block.A + mu * block.B)
    x, y = vh[-1].conj(), u[:, -1].conj()
    with np.errstate(divide="ignore", invalid="ignore"):
        return complex(-(y @ block.B @ x) / (y @ (2 * lam * one + block.C) @ x))
