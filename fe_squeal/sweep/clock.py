"""The seconds that the stages of a sweep take."""

from __future__ import annotations

import time

STAGES = "reduction", "eigenvalues", "tracking", "onsets", "completeness", "descriptors"


class Clock:
    """Adds up seconds by stage.

    Attributes
    ----------
    seconds : dict of str to float
    """

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(STAGES, 0.0)

    def now(self) -> float:
        """Return the time from which `spend` counts, s."""
        return time.perf_counter()

    def spend(self, stage: str, since: float) -> float:
        """Add the time since a moment to a stage, and return the present one."""
        now = self.now()
        self.seconds[stage] += now - since
        return now
