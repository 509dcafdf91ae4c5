"""An Ansys archive as its commands, beside the mesh that it holds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from ...errors import MeshError
from ...mesh import LoadedMesh
from ...mesh.raw import RawMesh
from ...mesh.readers.ansys_archive import Archive
from ..draft import Draft
from ..units import SI, Units

Line = tuple[list[str], str]  # fields in capitals, and where they stand


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
    """Return the commands among the lines of an archive, without comments."""
    found = []
    for number, line in enumerate(lines, 1):
        text = line.partition("!")[0].strip()
        if text[:1].isalpha():
            found.append(([part.strip().upper() for part in text.split(",")], f"line {number}"))
    return found


def read_materials(lines: Sequence[Line], source: str) -> dict[int, dict[str, float]]:
    """Return the values of MP, MPDATA and TB,FRIC by number and label; of tables by temperature the first.

    Raises
    ------
    MeshError
    """
    found: dict[int, dict[str, float]] = {}
    friction = 0
    for fields, where in lines:
        if fields[0] == "TB":
            friction = int(fields[2]) if fields[1:2] == ["FRIC"] and fields[2:] and fields[2].isdigit() else 0
            continue
        if fields[0] == "MPDATA" and len(fields) > 6 and fields[1].startswith("R"):
            label, material, first, value = fields[3], fields[4], fields[5], fields[6]
        elif fields[0] == "MP" and len(fields) > 3:
            label, material, first, value = fields[1], fields[2], "1", fields[3]
        elif fields[0] in ("TBDATA", "TBDAT") and friction and len(fields) > 2:
            label, material, first, value = "MU", str(friction), fields[1], fields[2]
        else:
            continue
        try:
            if int(first) == 1:
                found.setdefault(int(material), {}).setdefault(label, float(value))
        except ValueError:
            raise MeshError(f'{source}: {where}: "{",".join(fields)[:60]}" is no material value') from None
    return found


def is_zero(text: str) -> bool:
    """Whether a field is blank or zero."""
    return not text or re.fullmatch(r"[-+]?0*\.?0*(E[-+]?\d+)?", text) is not None


def clean(value: float) -> float:
    """Return a number without the rounding of a change of units."""
    return float(f"{value:.15g}") + 0.0
