"""Tables on a terminal, in a pipe or a log: as wide as their contents, nothing cut."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.measure import Measurement
from rich.segment import Segments
from rich.table import Table
from rich.text import Text

_WIDEST = 100_000  # characters: more than any table has


def print_table(table: Table, console: Console, optional: Sequence[str] = ()) -> None:
    """Print a table in which no name and no number is shortened.

    Where it is wider than a terminal, columns with the headings `optional` are left out, the first of them first, and
    named below. What is still too wide is printed in lines that the terminal wraps.
    """
    dropped = []
    for heading in optional:
        if not console.is_terminal or _width(table, console) <= console.width:
            break
        found = [column for column in table.columns if column.header == heading]
        if found:
            table.columns.remove(found[0])
            dropped.append(" ".join(str(heading).split()))
    options = console.options.update(width=max(_width(table, console), 1))  # `Console.print` keeps to the terminal
    lines = console.render_lines(table, options, pad=False, new_lines=True)
    console.print(Segments([segment for line in lines for segment in line]), soft_wrap=True)
    if dropped:
        console.print(Text(f"not shown here for want of width: {', '.join(dropped)}"))


def _width(table: Table, console: Console) -> int:
    return Measurement.get(console, console.options.update(max_width=_WIDEST), table).maximum
