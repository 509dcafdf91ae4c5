"""An Ansys archive as its commands, beside the mesh that it holds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from ...errors import MeshError
from ...mesh import LoadedMesh
from ...mesh.raw import RawMesh
from ...mesh.readers.ansys_archive import Archive
from ...mesh.readers.ansys_forms import commands_of_block, fields_of
from ..draft import Draft
from ..units import SI, Units

Line = tuple[list[str], str]  # fields in capitals, and where they stand
_OPTIONS_OF_ET = 6  # key options KOP1 … KOP6 behind the kind of the elements (Mechanical APDL command reference, ET)


@dataclass
class Content:
    """What an archive says.

    Attributes
    ----------
    text : lines of the file
    lines : its commands
    materials : mapping of number to label to value
        Such as {1: {"EX": 2.1e5}}, in the archive's units.
    masters : mapping of number to node
        Reference nodes, by row of the raw mesh.
    """

    source: str
    archive: Archive
    raw: RawMesh
    loaded: LoadedMesh
    draft: Draft
    text: Sequence[str]
    lines: list[Line]
    materials: dict[int, dict[str, float]]
    units: Units = SI
    masters: dict[int, int] = field(default_factory=dict)

    def number(self, text: str, where: str, fields: Sequence[str]) -> float:
        """Return a number of a command, 0 for a blank field.

        Raises
        ------
        MeshError
        """
        try:
            return float(text or "0")
        except ValueError:
            raise MeshError(f'{self.source}: {where}: "{text}" in {",".join(fields)[:60]} is not a number') from None


def commands(lines: Sequence[str]) -> list[Line]:
    """Return the commands among the lines of an archive, without comments; for ETBLOCK and the like those of its rows.

    ET with key options (its fields behind the kind of the elements) is followed by a KEYOP for each of them. A block
    that is not read stands for itself.
    """
    found = []
    for i, line in enumerate(lines):
        if line.strip()[:1].isalpha():
            rows = commands_of_block(lines, i)
            for number, fields in [(i + 1, fields_of(line))] if rows is None else rows:
                found.append((fields, where := f"line {number}"))
                if fields[0] == "ET":
                    options = enumerate(fields[3 : 3 + _OPTIONS_OF_ET], 1)
                    found += [(["KEYOP", fields[1], str(key), value], where) for key, value in options if value]
    return found


def is_zero(text: str) -> bool:
    """Whether a field is blank or zero."""
    return not text or re.fullmatch(r"[-+]?0*\.?0*(E[-+]?\d+)?", text) is not None


def clean(value: float) -> float:
    """Return a number without the rounding of a change of units."""
    return float(f"{value:.15g}") + 0.0
