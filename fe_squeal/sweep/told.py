"""What a running sweep tells: its warnings, and which of them are about onsets."""

from __future__ import annotations

from collections.abc import Iterable

from .doubts import Doubt, joined
from .onset import Onset


class Told:
    """The warnings of a sweep over a parameter so far.

    Attributes
    ----------
    warnings : list of str
    unsettled : list of str
        Those that are about onsets.
    """

    def __init__(self, parameter: str, warnings: Iterable[str] = (), unsettled: Iterable[str] = ()) -> None:
        self._parameter = parameter
        self.warnings, self.unsettled = list(warnings), list(unsettled)
        self._doubt: Doubt | None = None  # the last one that there is a warning about

    def add(self, *sentences: str) -> None:
        """Add warnings that are not about onsets."""
        self.warnings += sentences

    def of_onsets(self, *sentences: str) -> None:
        """Add warnings that are about onsets."""
        self.warnings += sentences
        self.unsettled += sentences

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

    def doubts(self, doubts: list[Doubt]) -> None:
        """Add a warning for each interval in which rounding hides onsets.

        Intervals of neighbouring steps about the same pair of modes give one warning.
        """
        for doubt in joined(doubts):
            if self._doubt is not None and (both := self._doubt.joined(doubt)) is not None:
                old, doubt = self._doubt.sentence(self._parameter), both
                for told in (self.warnings, self.unsettled):
                    told.remove(old)
            self._doubt = doubt
            self.of_onsets(doubt.sentence(self._parameter))

    def absorbed(self, onsets: list[Onset], start: float, end: float) -> list[Onset]:
        """Make onsets that the last doubt covers part of it, within a sweep from start to end; return the others."""
        vague = [o for o in onsets if self._doubt is not None and self._doubt.covers(o)]
        for onset in vague:
            low, high = onset.value - onset.uncertainty, onset.value + onset.uncertainty
            self.doubts([Doubt(max(low, start), min(high, end), onset.frequency_hz)])
        return [o for o in onsets if o not in vague]
