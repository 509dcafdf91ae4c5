"""Forms of commands that only CDWRITE writes into Ansys archives."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import accumulate

# Blocks that stand for commands: the format of their rows, and the widths of the columns that it says.
_BLOCKS: dict[str, tuple[str, tuple[int, ...]]] = {
    "ETBLOCK": ("(2i9,19a9)", (9,) * 21), "DBLOCK": ("(i9,a6,2(pg16.9))", (9, 6, 16, 16)),
    "SFEBLOCK": ("(i9,i4,i4,6(pg20.9))", (9, 4, 4, *(20,) * 6)),
}  # fmt: skip
_KEY_OPTIONS = 18  # in a row of ETBLOCK, behind the number and the kind of the element type


def is_release(field: str) -> bool:
    """Return whether a field says how CDWRITE wrote a command: the number of a release, such as R5.0, or UNBL."""
    return field == "UNBL" or (field[:1] == "R" and field[1:2].isdigit())


def fields_of(line: str) -> list[str]:
    """Return the fields of a command in capitals, without its comment."""
    return [part.strip().upper() for part in line.partition("!")[0].split(",")]


def element_types(lines: Sequence[str]) -> dict[int, int]:
    """Return the kinds of elements by the numbers of their types, as commands ET define them.

    mapdl-archive passes over those that are indented, have key options, or name the kind (CONTA174) instead of its
    number.

    Examples
    --------
    >>> element_types([" et,2,CONTA174,,2  ! MPC", "ET,3,170", "ET,4,%kind%"])
    {2: 174, 3: 170}
    """
    found = {}
    for fields in map(fields_of, lines):
        command = re.match(r"ET,(\d+),[A-Z]*(\d+)(,|$)", ",".join(fields))
        if command:
            found[int(command[1])] = int(command[2])
    return found


def commands_of_block(lines: Sequence[str], first: int) -> list[tuple[int, list[str]]] | None:
    """Return the commands for which a block stands: KEYOP for ETBLOCK, D for DBLOCK and SFE for SFEBLOCK.

    Parameters
    ----------
    lines : sequence of str
        The lines of the archive.
    first : int
        Position of the line with the block's command; its format and its rows follow.

    Returns
    -------
    list of (int, list of str), or None
        The number of the line, from 1, and the fields of each command; None where the line is no such block, where
        its columns are not those that are known here, or where it does not end as such blocks do.
    """
    name, *given = fields_of(lines[first])
    form, widths = _BLOCKS.get(name, ("", ()))
    if not form or first + 1 >= len(lines) or lines[first + 1].strip().lower() != form:
        return None
    ends, found = list(accumulate(widths)), list[tuple[int, list[str]]]()
    for number, line in enumerate(lines[first + 2 :], first + 3):
        if not line.strip()[:1].isdigit():
            return found if fields_of(line)[0] == "-1" or fields_of(line)[:2] == ["SFE", "END"] else None
        cells = [line[end - width : end].strip().upper() for end, width in zip(ends, widths, strict=True)]
        if any(" " in cell for cell in cells):  # mapdl-archive writes rows of ETBLOCK with single blanks
            cells = line.upper().split()
        if name == "ETBLOCK":
            options = enumerate(cells[2 : 2 + _KEY_OPTIONS], 1)
            found += [(number, ["KEYOP", cells[0], str(key), value]) for key, value in options if value]
        elif name == "DBLOCK":
            found.append((number, ["D", *cells]))
        else:
            found.append((number, ["SFE", *cells[:2], *given[1:2], *cells[2:]]))
    return None
