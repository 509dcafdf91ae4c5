"""Read Nastran bulk data: grid points, solid elements and shells; numbers of properties become names of groups.

The formats of the cards are those of the MSC and NX Nastran quick reference guides. meshio is not used, because it
needs BEGIN BULK and ENDDATA, takes the field CP for a label and stops at continuations in free format.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from fe_squeal.errors import MeshError

from ...checking import connect
from ...raw import CellBlock, Ints, RawMesh, check_unique_nodes
from ..sources import Sources
from .coordinates import (
    OF_GRIDS,
    SYSTEMS,
    System,
    SystemOfGrids,
    read_system,
    read_systems_of_grids,
    to_global,
    with_systems_of_grids,
)
from .faces import faces_of_elements, named_faces
from .text import Card, read_cards, read_lines, real

T = TypeVar("T")

# By the name of the card: the kind of solid with corners alone and the number of these, the kind with midside nodes and
# the number of all its nodes.
_SOLIDS = {
    "CTETRA": ("tetra", 4, "tetra10", 10), "CHEXA": ("hexahedron", 8, "hexahedron20", 20),
    "CPENTA": ("wedge", 6, "wedge15", 15), "CPYRAM": ("pyramid", 5, "pyramid13", 13),
    "CPYRA": ("pyramid", 5, "pyramid13", 13),
}  # fmt: skip
_SHELLS = {"CTRIA3": 3, "CTRIAR": 3, "CTRIA6": 3, "CQUAD4": 4, "CQUADR": 4, "CQUAD8": 4, "CQUAD": 4}
# The positions p of nodes so that Nastran's nodes[p] are in VTK's order; Nastran lists the midside nodes of the bottom
# edges first, then those of the upright edges, then those of the top edges.
_ORDER = {
    "hexahedron20": [*range(12), *range(16, 20), *range(12, 16)],
    "wedge15": [*range(9), *range(12, 15), *range(9, 12)],
}
_HYPERMESH = re.compile(r'^\$HMNAME PROP\s+(\d+)\s*"([^"]+)"', re.IGNORECASE)
_ANSA = re.compile(r"^\$ANSA_NAME_COMMENT;(\d+);P(?:SOLID|SHELL)[^;]*;([^;]+);", re.IGNORECASE)
_PATRAN = re.compile(r"^\$ Elements and Element Properties for region : (.+)$", re.IGNORECASE)
_PROPERTY = re.compile(r"^(?:PSOLID|PSHELL|PLSOLID)\*?[ ,]\s*(\d+)", re.IGNORECASE)


def read_nastran(sources: Sources) -> RawMesh:
    """Read a Nastran file.

    Solids of property 3 are the volume group "3", shells of property 4 the surface group "4". If HyperMesh, Ansa or
    Patran have left names of properties in comments, the groups have these names too.

    Raises
    ------
    MeshError
        Numbers cannot be read, nodes are missing, or a coordinate system is of a kind that is not read.
    """
    source = sources.path.name
    lines = list(read_lines(sources))
    grids: list[Card] = []
    cells: dict[str, list[Card]] = {}
    systems: dict[int, System] = {}
    skipped: dict[str, int] = {}
    faced: list[Card] = []
    listed: list[Card] = []
    of_grids: list[Card] = []
    default = 0
    for card in read_cards(lines):
        if card.name == "GRID":
            grids.append(card)
        elif card.name in _SOLIDS or card.name in _SHELLS:
            cells.setdefault(card.name, []).append(card)
        elif card.name in SYSTEMS:
            number, system = _guarded(read_system, card, source)
            systems[number] = system
        elif card.name in OF_GRIDS:
            of_grids.append(card)
        elif card.name in ("PLOAD4", "BSURFS"):
            faced.append(card)
        elif card.name == "BSURF":
            listed.append(card)
        elif card.name == "GRDSET":
            default = _whole(card, 1, source)
        elif card.name.startswith(("C", "RBE", "RBAR")) and card.text(0).isdigit() and not card.name.startswith("CORD"):
            skipped[card.name] = skipped.get(card.name, 0) + 1
    if not grids:
        raise MeshError(f"{source}: no GRID entries; expected Nastran bulk data (is the file of another kind?)")
    labels, points = _points(grids, systems, of_grids, default, source)
    volumes: dict[str, list[Ints]] = {}
    surfaces: dict[str, list[Ints]] = {}
    blocks: list[CellBlock] = []
    shells: dict[int, Ints] = {}
    at = 0
    for name, cards in cells.items():
        if name in _SHELLS:
            for pid, own, corners in _shells(cards, _SHELLS[name], labels, source):
                surfaces.setdefault(str(pid), []).append(corners)
                shells.update(zip(own.tolist(), corners, strict=True))
            continue
        for block, pids in _solids(cards, *_SOLIDS[name], labels=labels, source=source):
            blocks.append(block)
            for pid in np.unique(pids):
                volumes.setdefault(str(pid), []).append(at + np.flatnonzero(pids == pid))
            at += len(block)
    surfaces |= named_faces(faced, blocks, labels, source)
    surfaces |= faces_of_elements(listed, RawMesh(points, labels, tuple(blocks), {}, {}), shells, source)
    notes = [f"{count} entries {name} are no solids or shells and are left out" for name, count in skipped.items()]
    groups = {name: np.concatenate(parts) for name, parts in volumes.items()}
    for key, title in _titles(lines).items():
        if key in groups:
            groups.setdefault(title, groups[key])
        if key in surfaces:
            surfaces.setdefault(title, surfaces[key])
    return RawMesh(points, labels, tuple(blocks), groups, surfaces, notes=tuple(notes))


def _guarded(read: Callable[[Card], T], card: Card, source: str) -> T:
    try:
        return read(card)
    except ValueError as error:
        raise MeshError(f"{source}: {card.where}: {card.name} {card.text(0)} is not readable ({error})") from None


def _whole(card: Card, i: int, source: str) -> int:
    text = card.text(i)
    try:
        value = int(text or 0)
        if abs(value) < 2**62:
            return value
    except ValueError:
        pass
    raise MeshError(f'{source}: {card.where}: {card.name} {card.text(0)} has "{text}" where a whole number is expected')


def _points(
    grids: list[Card], systems: dict[int, System], of_grids: list[Card], default: int, source: str
) -> tuple[Ints, np.ndarray]:
    labels = np.array([_whole(card, 0, source) for card in grids], dtype=np.int64)
    cps = np.array([_whole(card, 1, source) if card.text(1) else default for card in grids], dtype=np.int64)
    points = np.array([_guarded(lambda c: [real(c.text(i)) for i in (2, 3, 4)], card, source) for card in grids])
    defined: dict[int, SystemOfGrids] = {}
    for card in of_grids:
        defined |= _guarded(lambda c: read_systems_of_grids(c, labels), card, source)
    systems = with_systems_of_grids(systems, defined, points, cps)
    for cp in np.unique(cps[cps != 0]):
        which = cps == cp
        if int(cp) not in systems:
            raise MeshError(
                f"{source}: GRID {labels[which][0]} is given in coordinate system {cp}, which the file does not define "
                "by CORD2R, CORD1R or the like, or by grid points that are given in it; export it, or write the grid"
                " points in the basic system"
            )
        try:
            points[which] = to_global(points[which], int(cp), systems)
        except ValueError as error:
            raise MeshError(f"{source}: coordinate system {cp}: {error}") from None
    return check_unique_nodes(labels, points, source)


def _solids(
    cards: list[Card], linear: str, corners: int, quadratic: str, count: int, labels: Ints, source: str
) -> list[tuple[CellBlock, Ints]]:
    rows = []
    for card in cards:
        given = [_whole(card, i, source) for i in range(2, 2 + count)]
        if 0 in given[:corners]:
            raise MeshError(
                f"{source}: {card.where}: {card.name} {card.text(0)} needs {corners} corner nodes; some are blank"
            )
        rows.append([_whole(card, 0, source), _pid(card, source), *given])
    table = np.array(rows, dtype=np.int64)
    out = []
    plain = (table[:, 2 + corners :] == 0).all(axis=1)
    for kind, which, width in ((linear, plain, corners), (quadratic, ~plain, count)):
        if which.any():
            some = table[which]
            nodes = connect(some[:, 2 : 2 + width], labels, some[:, 0], "element", source)
            out.append((CellBlock(kind, nodes[:, _ORDER.get(kind, list(range(width)))], some[:, 0]), some[:, 1]))
    return out


def _shells(cards: list[Card], corners: int, labels: Ints, source: str) -> list[tuple[int, Ints, Ints]]:
    """Return for each property of shells its number, the numbers of its shells (n,) and their corners (n, 3 or 4)."""
    table = np.array(
        [
            [_whole(card, 0, source), _pid(card, source), *(_whole(card, i, source) for i in range(2, 2 + corners))]
            for card in cards
        ],
        dtype=np.int64,
    )
    blank = np.flatnonzero((table[:, 2:] == 0).any(axis=1))
    if len(blank):
        card = cards[blank[0]]
        raise MeshError(
            f"{source}: {card.where}: {card.name} {card.text(0)} needs {corners} corner nodes; some are blank"
        )
    nodes = connect(table[:, 2:], labels, table[:, 0], "shell", source)
    rows = [(int(pid), table[:, 1] == pid) for pid in np.unique(table[:, 1])]
    return [(pid, table[own, 0], nodes[own]) for pid, own in rows]


def _pid(card: Card, source: str) -> int:
    """Return the property of an element; if it is blank, that is the element's own number, by Nastran's rule."""
    return _whole(card, 1, source) if card.text(1) else _whole(card, 0, source)


def _titles(lines: list[tuple[str, str]]) -> dict[str, str]:
    """Return the names of properties, by number, that HyperMesh, Ansa and Patran leave in comments."""
    names: dict[str, str] = {}
    region = ""
    for line, _ in lines:
        if line.startswith("$"):
            for pattern in (_HYPERMESH, _ANSA):
                found = pattern.match(line)
                if found:
                    names.setdefault(found[1], found[2].strip())
            found = _PATRAN.match(line)
            region = found[1].strip() if found else region
        elif region:
            found = _PROPERTY.match(line)
            if found:
                names.setdefault(found[1], region)
                region = ""
    return names
