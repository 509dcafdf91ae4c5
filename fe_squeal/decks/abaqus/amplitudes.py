"""*Static and *Amplitude: what a load is at the end of its step, whose static state counts."""

from __future__ import annotations

import numpy as np

from ...mesh.readers.abaqus.model import Statement
from .content import Content, spoken


def read_static(content: Content, statement: Statement) -> None:
    """Take *Static, or another step in time: how long it takes."""
    row = content.first(statement.block)
    content.step_time = float(row[1] or 1.0) if len(row) > 1 else 1.0


def read_amplitude(content: Content, statement: Statement) -> None:
    """Keep *Amplitude until a load names it."""
    content.amplitudes[statement.block.value("NAME").upper()] = statement


def factor_of(content: Content, statement: Statement) -> float:
    """Return what the amplitude of a load is at the end of its step, 1 without one; others than tables are asked for.

    Raises
    ------
    MeshError
        The table holds something else than numbers.
    """
    name, where = statement.block.value("AMPLITUDE"), content.where(statement)
    if not name:
        return 1.0
    known = content.amplitudes.get(name.upper())
    block = None if known is None else known.block
    plain = block is not None and block.value("DEFINITION").upper() in ("", "TABULAR") and (
        block.value("TIME").upper() != "TOTAL TIME" and block.value("VALUE").upper() != "ABSOLUTE")  # fmt: skip
    numbers = [x or 0.0 for line in block.lines for x in content.floats(block, line)] if block and plain else []
    keyword = spoken(statement.block.keyword)
    if len(numbers) < 2 or len(numbers) % 2:
        text = f'"{name}" is no table over the time of the step: the load is written in full; give that of its end'
        content.draft.find(f"*Amplitude of *{keyword}", where, text, "missing")
        return 1.0
    factor = float(np.interp(content.step_time, numbers[::2], numbers[1::2]))
    text = f'"{name}" is {factor:g} at the end of the step, whose static state counts: the load is multiplied by it'
    content.draft.find(f"*Amplitude of *{keyword}", where, text, "harmless")
    return factor
