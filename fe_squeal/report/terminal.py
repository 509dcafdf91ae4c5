"""Print tables on a terminal, in a pipe or a log, as wide as their contents, without cutting anything off."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.measure import Measurement
from rich.segment import Segments
from rich.table import Table
from rich.text import Text

_WIDEST = 100_000  # characters: wider than any table


def print_table(table: Table, console: Console, optional: Sequence[str] = ()) -> None:
    """Print a table without shortening any name or number.

    If it is wider than the terminal, columns with the headings `optional` are left out one after the other, and named
    below. If it is still too wide, the terminal wraps its lines.
    """
    dropped = []
    for heading in optional:
        if not console.is_terminal or _width(table, console) <= console.width:
            break
        found = [column for column in table.columns if column.header == heading]
        if found:
            table.columns.remove(found[0])
            dropped.append(" ".join(str(heading).split()))
    options = console.options.update(width=max(_width(table, console), 1))  # Console.print would cut at the terminal's
    lines = console.render_lines(table, options, pad=False, new_lines=True)
    console.print(Segments([segment for line in lines for segment in line]), soft_wrap=True)
    if dropped:
        console.print(Text(f"not shown here for want of width: {', '.join(dropped)}"))


def _width(table: Table, console: Console) -> int:
    return Measurement.get(console, console.options.update(max_width=_WIDEST), table).maximum
