"""Tables on a terminal, in a pipe or a log: as wide as their contents, nothing cut."""

from __future__ import annotations

from rich.console import Console
from rich.measure import Measurement
from rich.segment import Segments
from rich.table import Table

_WIDEST = 100_000  # characters: more than any table has


def print_table(table: Table, console: Console) -> None:
    """Print a table in which no name and no number is shortened; lines may be longer than the terminal is wide."""
    needed = Measurement.get(console, console.options.update(max_width=_WIDEST), table).maximum
    options = console.options.update(width=max(needed, 1))  # `Console.print` would not go beyond the terminal
    lines = console.render_lines(table, options, pad=False, new_lines=True)
    console.print(Segments([segment for line in lines for segment in line]), soft_wrap=True)
