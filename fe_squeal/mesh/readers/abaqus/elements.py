"""Read the elements of Abaqus input files: solids, shells that may lie on them, and what is left out."""

from __future__ import annotations

import re

import numpy as np

from fe_squeal.errors import MeshError

from ...raw import Floats, Ints
from .model import ElementBlock, Links, Members, Scope
from .text import KeywordBlock, entries, is_label, label_of, numbers, whole_numbers

# Kind of a solid by the first letters of its Abaqus type, without the D of diffusion. The first entry that fits counts,
# so longer ones stand first.
_TYPES = (("C3D10", "tetra10"), ("C3D15", "wedge15"), ("C3D20", "hexahedron20"), ("C3D27", "hexahedron27"),
          ("C3D4", "tetra"), ("C3D5", "pyramid"), ("C3D6", "wedge"), ("C3D8", "hexahedron"))  # fmt: skip
_COUNT = {"tetra": 4, "tetra10": 10, "pyramid": 5, "wedge": 6, "wedge15": 15, "hexahedron": 8, "hexahedron20": 20,
          "hexahedron27": 27}  # fmt: skip
# Abaqus puts the 27-node brick's centre first and the face centres in the order of its faces S1 ... S6.
_HEX27 = [*range(20), 26, 24, 23, 25, 21, 22, 20]
_ENTRIES = 16  # on a data line of *ELEMENT, at most
_NODES = re.compile(r"(?:3D|CL)(\d+)")  # the number of nodes in the name of a type, such as AC3D20 or CCL24
_SKIN = re.compile(r"(?:STRI|CPS|CPE|SFM3D|M3D|R3D|DS|S)(65|[34689])")
_LINKS = ("SPRING", "DASHPOT", "MASS", "ROTARYI", "DCOUP3D")  # which `decks` reads: no part of the mesh, but not lost


def read_elements(block: KeywordBlock, scope: Scope, source: str) -> tuple[str, int]:
    """Add the block's elements to the scope; of elements that are left out return type and number, else ("", 0).

    Raises
    ------
    MeshError
        Solids have too few or too many nodes, or numbers that cannot be read.
    """
    given = block.value("TYPE").upper()
    kind = next((kind for start, kind in _TYPES if given.removeprefix("D").startswith(start)), "")
    if not kind:
        rows = _other_rows(given, block)
        whole = [label_of(row[0]) for row in rows if is_label(row[0])]
        if given.startswith(_LINKS):
            first, rest = [row[0] for row in rows], [row[1:] for row in rows]
            scope.links.append(Links(given, block.value("ELSET"), first, rest, block.where))
        scope.others += [label_of(row[0]) for row in _read_skin(given, rows, scope) if is_label(row[0])]
        name_members("ELSET", block, scope, np.array(whole, dtype=np.int64))
        return ("", 0) if given.startswith(_LINKS) else (given or "(none)", len(whole))
    values, ends = numbers(block, source)
    count = _COUNT[kind]
    if kind == "hexahedron27" and not _fits(values, ends, 28) and _fits(values, ends, 22):
        kind, count = "hexahedron20", 21
    if not _fits(values, ends, count + 1):
        raise MeshError(
            f"{source}: {block.where}: elements of type {given} need a number and {count} nodes each; "
            + _misfit(block, ends, count + 1)
        )
    table = whole_numbers(values, "element and node numbers", block, source).reshape(-1, count + 1)
    nodes = table[:, 1:]
    if kind == "hexahedron27":
        nodes = nodes[:, _HEX27]
    scope.cells.append(ElementBlock(kind, table[:, 0], nodes[:, :20] if kind == "hexahedron20" else nodes))
    name_members("ELSET", block, scope, table[:, 0])
    return "", 0


def _other_rows(given: str, block: KeywordBlock) -> list[list[str]]:
    """Return the number and the nodes of each element of a type that is no solid.

    An element of at most 15 nodes has one data line. With more it goes on behind a line that is full or ends with a
    comma, until it has as many nodes as its type says; where the type does not say, as of substructures, a comma does
    not count, which some programs put behind every line.
    """
    found = _NODES.search(given)
    wanted = 1 + int(found[1]) if found else 0
    rows: list[list[str]] = []
    goes_on = False
    for line in block.lines:
        fields = entries(line)
        if not fields:
            continue
        if goes_on:
            rows[-1] += fields
        else:
            rows.append(fields)
        goes_on = len(fields) >= _ENTRIES
        if wanted:
            goes_on = wanted > _ENTRIES and len(rows[-1]) < wanted and (goes_on or line.endswith(","))
    return rows


def _read_skin(given: str, rows: list[list[str]], scope: Scope) -> list[list[str]]:
    """Keep the corners of shells, and return the rows of other elements.

    Where shells lie on faces of solids, as Gmsh exports them, they make surface groups.
    """
    found = _SKIN.match(given)
    if not found:
        return rows
    width = 4 if found[1] in ("3", "6", "65") else 5
    shells: list[list[str]] = []
    others: list[list[str]] = []
    for row in rows:
        fits = all(is_label(text) and len(text) < 18 and text[0] != "-" for text in row[:width])
        (shells if fits and len(row) >= width else others).append(row)
    if shells:
        table = np.array([row[:width] for row in shells], dtype=np.int64)
        scope.skins.append(ElementBlock("triangle" if width == 4 else "quad", table[:, 0], table[:, 1:]))
    return others


def _fits(values: Floats, ends: Ints, width: int) -> bool:
    """Return whether the numbers of a block make elements of `width` numbers each, all ending at the end of a line.

    Parameters
    ----------
    values : (n,) float
        All numbers of the block.
    ends : (l,) int
        How many numbers stand up to the end of each data line.
    width : int
    """
    whole = np.arange(width, len(values) + 1, width)
    return len(values) % width == 0 and bool(np.isin(whole, ends).all())


def _misfit(block: KeywordBlock, ends: Ints, width: int) -> str:
    whole = np.arange(width, ends[-1] + width, width) if len(ends) else np.empty(0, np.int64)
    wrong = whole[~np.isin(whole, ends)]
    row = int(np.searchsorted(ends, wrong[0])) if len(wrong) else len(ends) - 1
    shown = block.shown(block.lines[min(row, len(block.lines) - 1)])
    return f'see the data line "{shown}"'


def name_members(word: str, block: KeywordBlock, scope: Scope, labels: Ints) -> None:
    """Add labels (n,) to the set that a *NODE or *ELEMENT block names, of nodes (word "NSET") or elements ("ELSET")."""
    name = block.value(word)
    if name:
        scope.sets.setdefault((word, scope.remember(word, name)), []).append(
            Members([str(v) for v in labels.tolist()], False, "")
        )
