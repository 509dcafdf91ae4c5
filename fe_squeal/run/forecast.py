"""Forecast how long the rest of a sweep takes, and print it once near its beginning."""

from __future__ import annotations

import time

from rich.console import Console

_SAMPLE = 5  # values that are timed, from the second on, since the first includes work that is done only once
_LONG = 30.0  # s: if less time is left, no forecast is printed


class ForecastLine:
    """Prints, once, how long the rest of a sweep will take, from the time of its first values.

    Parameters
    ----------
    values : int
        Number of values of the sweep.
    console : Console
    kept : bool
        Whether the sweep keeps what is finished and can be resumed; the line says so.
    """

    def __init__(self, values: int, console: Console, kept: bool) -> None:
        self._values, self._console, self._kept = values, console, kept
        self._first: tuple[int, float] | None = None  # number of values done at the first call, and the time of it
        self._told = False

    def tell(self, done: int) -> None:
        """Note that `done` values are finished; print the forecast as soon as `_SAMPLE` values are timed."""
        now = time.perf_counter()
        if self._first is None:
            self._first = done, now
        count = done - self._first[0]
        if self._told or count < _SAMPLE:
            return
        self._told = True
        each = (now - self._first[1]) / count
        rest = each * (self._values - done)
        if rest >= _LONG:
            self._console.print(
                f"forecast: the other {self._values - done} of {self._values} values take about {duration(rest)}"
                f" ({each:.2g} s each)"
                + ("; what is finished is kept, and --resume goes on from it" if self._kept else ""),
                markup=False,
            )


def duration(seconds: float) -> str:
    """Return a time, given in seconds, in words with two digits.

    Examples
    --------
    >>> duration(41.0), duration(400.0), duration(20_000.0), duration(3e6)
    ('41 s', '6.7 minutes', '5.6 hours', '35 days')
    """
    for unit, size in (("days", 86_400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} s"
