"""Which freedoms of its reference a coupling ties: data lines of *Distributing, and those of *Equation."""

from __future__ import annotations

import numpy as np

from ...errors import MeshError
from ...mesh.readers.abaqus.model import Statement
from ..directions import along_axes, held_projector
from ..draft import Value
from ..released import drop_released, said_of_both, said_of_dropped
from .content import Content, TieData, spoken
from .orientations import local_axes
from .transforms import is_turned

_ALL = {1, 2, 3, 4, 5, 6}


def freedoms_in(content: Content, statement: Statement, rows: list[list[float | None]]) -> set[int]:
    """Return the freedoms 1 to 6 of ranges, a first and a last one in each row; all of them for a first that is blank.

    Raises
    ------
    MeshError
        A range is none.
    """
    found: set[int] = set()
    for row in rows:
        if not row or not row[0]:
            return _ALL
        first, last = row[0], (row[1] if len(row) > 1 else None) or row[0]
        if not 1 <= first <= last:
            raise MeshError(
                f"{content.source}: {statement.block.where}: *{spoken(statement.block.keyword)}: degrees of freedom"
                f" {first:g} to {last:g}; expected a first one of 1 to 6 and a last one not below it"
            )
        found |= set(range(int(first), min(int(last), 6) + 1))
    return found or _ALL


def read_released(content: Content, statement: Statement, tie: TieData) -> None:
    """Take the data lines of *Distributing: it can release rotations, and ties all translations whatever they say.

    Abaqus Keywords Guide, *DISTRIBUTING.

    Raises
    ------
    MeshError
        A range of freedoms is none.
    """
    block = statement.block
    found = freedoms_in(content, statement, [content.floats(block, line) for line in block.lines])
    if not {1, 2, 3} <= found:
        text = f"ties the freedoms {sorted(found)} alone; all three translations are tied, of which it releases none"
        content.draft.find("*Distributing", content.where(statement), text)
    if not found >= {4, 5, 6}:
        tie.freedoms = found | {1, 2, 3}


def release(content: Content, tie: TieData, values: dict[str, Value]) -> None:
    """Take out of the table of a tie what acts on freedoms that it does not tie; ask for what acts on both at once."""
    if tie.freedoms is None:
        return
    what, node = tie.keyword, f"node {tie.reference[0]}"
    tied = tie.freedoms if tie.coupling is None else _along_global(content, tie, tie.coupling)
    if tied is None:
        text = f"releases rotations of {node} in axes that are not along x, y and z: give [[averaged]]"
        content.draft.find(what, tie.where, text, "missing")
        return
    rows = [content.rows(end) for end in (tie.reference, *tie.members)] if tie.coupling is None else []
    if rows and is_turned(content, np.concatenate(rows)):
        text = f"ties {node} in axes of *Transform, which is not read; give [[averaged]]"
        content.draft.find(what, tie.where, text, "missing")
    dropped, both = drop_released(values, tied)
    if both:
        content.draft.find(what, tie.where, said_of_both(tied, node, both), "missing")
    if dropped:
        content.draft.find(what, tie.where, said_of_dropped(tied, node, dropped), "harmless")


def _along_global(content: Content, tie: TieData, coupling: Statement) -> set[int] | None:
    """Return the tied freedoms along and about x, y and z; None where other axes are tied.

    A coupling counts its freedoms along its ORIENTATION, or the axes of its part.
    """
    rotations = [freedom in (tie.freedoms or set()) for freedom in (4, 5, 6)]
    if not any(rotations):
        return {1, 2, 3}
    key = content.placements(tie.reference[1])[0]
    axes = local_axes(content, coupling, key)
    if axes is not None and not coupling.block.value("ORIENTATION"):
        axes = content.turned(axes, key)
    letters = None if axes is None else along_axes(held_projector(axes, rotations))
    return None if letters is None else {1, 2, 3} | {4 + "xyz".index(letter) for letter in letters}
