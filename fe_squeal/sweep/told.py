"""What a running sweep tells: its warnings, and which of them are about onsets."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..eigen.unsearched import Unsearched
from .doubts import Doubt, joined
from .onset import Onset

_NEAR = 0.01  # of a frequency: those that differ by less are told as one


Left = tuple[float, float, Unsearched]  # first and last value of a sweep at which a solve has left something out


class Told:
    """The warnings of a sweep over a parameter so far.

    Attributes
    ----------
    warnings : list of str
    unsettled : list of str
        Those that are about onsets.
    doubt : Doubt or None
        The last one that there is a warning about; what comes may widen it.
    beyond : tuple of float, or None
        First and last value, and the rate, that `beyond_losses` has told.
    unsearched : tuple of tuple
        First and last value, and what was not looked for, of the sentences that `not_searched` has told: at most one of
        what may grow, and one of what decays.
    """

    def __init__(
        self, parameter: str, warnings: Iterable[str] = (), unsettled: Iterable[str] = (), doubt: Doubt | None = None,
        beyond: tuple[float, float, float] | None = None, unsearched: tuple[Left, ...] = (),
    ) -> None:  # fmt: skip
        self._parameter = parameter
        self.warnings, self.unsettled = list(warnings), list(unsettled)
        self.doubt, self.beyond, self.unsearched = doubt, beyond, unsearched

    def add(self, *sentences: str) -> None:
        """Add warnings that are not about onsets."""
        self.warnings += sentences

    def of_onsets(self, *sentences: str) -> None:
        """Add warnings that are about onsets."""
        self.warnings += sentences
        self.unsettled += sentences

    def unclear_branches(self, first: float, second: float, omega: np.ndarray) -> None:
        """Add a warning that it is not clear which modes continue which between two values; ω (k,), rad/s."""
        low, high = omega.min() / (2 * np.pi), omega.max() / (2 * np.pi)
        near = f"near {low:.5g} Hz" if high - low <= _NEAR * high else f"from {low:.5g} to {high:.5g} Hz"
        self.add(
            f"between {self._parameter} = {first:.8g} and {second:.8g} it is not clear which modes {near} continue"
            " which: their branches may be exchanged there"
        )

    def edge(self, which: str, value: float, beside: float, count: int) -> None:
        """Add a warning that the sweep begins or ends at a critical value, and is searched from or to one beside it.

        Parameters
        ----------
        which : "first" or "last"
        value, beside : float
        count : int
            Number of modes with λ = 0 there.
        """
        first, second = sorted((value, beside))
        self.of_onsets(
            f"{count} of the modes {'has' if count == 1 else 'have'} λ = 0 at {self._parameter} = {value:g}, the"
            f" {which} value of the sweep, and not beside it: nothing holds a body just there, or it is the edge of"
            f" divergence; onsets are not looked for between {first:.10g} and {second:.10g}"
        )

    def beyond_losses(self, value: float, rate: float) -> None:
        """Add a warning that something grows at a value of which loss factors say nothing; of several values one."""
        if self.beyond is not None:
            self._withdraw(self._beyond_text())
        first, _, before = self.beyond or (value, value, rate)
        self.beyond = first, value, max(before, rate)
        self.of_onsets(self._beyond_text())

    def _beyond_text(self) -> str:
        assert self.beyond is not None
        first, last, rate = self.beyond
        return (
            f"at {self._parameter} = {_span(first, last)} a motion grows without swinging, or as fast as it swings (by"
            f" up to {rate:.3g} 1/s): loss factors say nothing of it, it counts as marginal and has no onset; solve"
            " without them to see it"
        )

    def not_searched(self, value: float, unsearched: Unsearched) -> None:
        """Add a warning of what a solve at a value has not looked for; of several values one.

        What decays has one of its own, which is not about onsets.
        """
        for part in unsearched.parts():
            old = next((left for left in self.unsearched if left[2].may_grow == part.may_grow), None)
            if old is not None:
                self._withdraw(self._unsearched_text(old))
            first, last, before = old or (value, value, part)
            new = min(first, value), max(last, value), before.joined(part)
            self.unsearched = (*(left for left in self.unsearched if left is not old), new)
            (self.of_onsets if part.may_grow else self.add)(self._unsearched_text(new))

    def of_steps(self) -> set[str]:
        """Return the warnings that are about onsets, but for what solves have not looked for at single values."""
        return set(self.unsettled).difference(map(self._unsearched_text, self.unsearched))

    def _unsearched_text(self, left: Left) -> str:
        first, last, unsearched = left
        lost = ", and an unstable one may be missing" if unsearched.may_grow else ": some that decay may be missing"
        return f"at {self._parameter} = {_span(first, last)} {unsearched} were not looked for everywhere{lost}"

    def _withdraw(self, sentence: str) -> None:
        for told in (self.warnings, self.unsettled):
            if sentence in told:
                told.remove(sentence)

    def doubts(self, doubts: list[Doubt]) -> None:
        """Add a warning for each interval in which rounding hides onsets.

        Intervals of neighbouring steps about the same pair of modes give one warning.
        """
        for doubt in joined(doubts):
            if self.doubt is not None and (both := self.doubt.joined(doubt)) is not None:
                old, doubt = self.doubt.sentence(self._parameter), both
                self._withdraw(old)
            self.doubt = doubt
            self.of_onsets(doubt.sentence(self._parameter))

    def absorbed(self, onsets: list[Onset], start: float, end: float) -> list[Onset]:
        """Make onsets that the last doubt covers part of it, within a sweep from start to end; return the others."""
        vague = [o for o in onsets if self.doubt is not None and self.doubt.covers(o)]
        for onset in vague:
            low, high = onset.value - onset.uncertainty, onset.value + onset.uncertainty
            self.doubts([Doubt(max(low, start), min(high, end), onset.frequency_hz)])
        return [o for o in onsets if o not in vague]


def _span(first: float, last: float) -> str:
    return f"{first:g}" if first == last else f"{first:g} to {last:g}"
