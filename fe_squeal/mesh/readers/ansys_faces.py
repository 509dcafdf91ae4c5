"""Surface groups of Ansys archives: faces that contact elements cover, and faces under pressures of SFE."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fe_squeal.errors import MeshError

from ..raw import Ints, Rows
from .ansys_archive import Archive
from .ansys_forms import commands_of_block, fields_of, is_release

FIRST, LABEL = 10, 8  # columns of `Archive.elem` with the first node, and with the number, of an element
_CONTACTS = {170: "target", 174: "contact", 173: "contact"}
_SURFACE_LOAD, _OTHER_LOADS = 154, range(2, 6)  # and its faces on which PRES is no pressure on the surface
# Corners of faces 1 to 6 (Ansys element reference, SOLID186 and SOLID187).
_HEXAHEDRON = ((1, 0, 3, 2), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7))
_TETRAHEDRON = ((1, 0, 2), (0, 1, 3), (1, 2, 3), (2, 0, 3))
_FACES = {185: _HEXAHEDRON, 186: _HEXAHEDRON, 187: _TETRAHEDRON, 285: _TETRAHEDRON, _SURFACE_LOAD: ((0, 1, 2, 3),)}


def contact_surfaces(archive: Archive, numbers: Ints) -> dict[str, list[Ints]]:
    """Return the corners (f, 3 or 4) of contact and target elements, by "contact_4" or "target_4": real constant set 4.

    Parameters
    ----------
    archive : Archive
    numbers : (n,) int
        Numbers of the nodes; corners are returned as positions in these.
    """
    types = {int(row[0]): int(row[1]) for row in archive.ekey}
    found, find = dict[str, list[Ints]](), Rows(numbers)
    for row in archive.elem:
        word = _CONTACTS.get(types.get(int(row[1]), 0))
        if word is None or len(row) < FIRST + 3:
            continue
        corners = _corners(_corner_nodes(row, word), find)
        if len(corners) in (3, 4):
            found.setdefault(f"{word}_{int(row[2])}", []).append(corners)
    return {name: _by_count(faces) for name, faces in found.items()}


def pressures(archive: Archive, lines: Sequence[str], source: str) -> dict[float, list[tuple[int, int, str]]]:
    """Return, by value of the pressure, the element, the face and the line of each SFE; imaginary parts are ignored.

    What `other_loads` returns is left out.

    Raises
    ------
    MeshError
        An SFE cannot be read.
    """
    found: dict[float, list[tuple[int, int, str]]] = {}
    others = set(other_loads(archive, lines, source))
    for size, element, face, where in _sizes(archive, lines, source):
        if size and where not in others:
            found.setdefault(size, []).append((element, face, where))
    return found


def other_loads(archive: Archive, lines: Sequence[str], source: str) -> list[str]:
    """Return the lines of SFE on faces 2 to 5 of SURF154, which are no pressures that are the same on all of a face.

    They act along the surface (2, 3), along the normal with a gradient (4) or along a vector (5; Ansys element
    reference, SURF154).

    Raises
    ------
    MeshError
        An SFE cannot be read.
    """
    types = [int(row[0]) for row in archive.ekey if int(row[1]) == _SURFACE_LOAD]
    surfaces = set(archive.elem[np.isin(archive.elem[:, 1], types), LABEL].tolist())
    sizes = _sizes(archive, lines, source)
    return [where for size, e, face, where in sizes if size and e in surfaces and face in _OTHER_LOADS]


def _sizes(archive: Archive, lines: Sequence[str], source: str) -> Iterator[tuple[float, int, int, str]]:
    """Yield the mean over the corners, the element, the face and the line of each SFE."""
    for where, fields, values in _commands(archive, lines):
        try:
            yield float(np.mean([float(v) for v in values if v] or [0.0])), int(fields[1]), int(fields[2]), where
        except ValueError:
            raise MeshError(f'{source}: {where}: "{",".join(fields)[:60]}" gives no pressure on a face') from None


def uneven_pressures(archive: Archive, lines: Sequence[str], source: str) -> list[str]:
    """Return the lines of SFE whose pressure differs from corner to corner."""
    others = set(other_loads(archive, lines, source))
    given = [(where, {float(v) for v in values if _is_number(v)}) for where, _, values in _commands(archive, lines)]
    return [where for where, values in given if len(values) > 1 and where not in others]


def _commands(archive: Archive, lines: Sequence[str]) -> Iterator[tuple[str, list[str], list[str]]]:
    """Yield the place of each SFE and row of SFEBLOCK with its fields and its values, three at faces of tetrahedra."""
    tetrahedra = [int(row[0]) for row in archive.ekey if _FACES.get(int(row[1])) is _TETRAHEDRON]
    three = {str(label) for label in archive.elem[np.isin(archive.elem[:, 1], tetrahedra), LABEL]}
    for number, fields in _loads(lines):
        if len(fields) < 5 or not fields[3].startswith("PRES") or fields[4] in ("2", "4"):
            continue
        values = fields[5:9]
        if values and is_release(values[0]) and number < len(lines):  # CDWRITE puts values on the next line, 16 wide
            values = lines[number].replace(",", " ").split()[:4]
        if fields[1] in three:
            values = values[:3]
        corners = [v for v in values if v]
        if len(corners) > 1 and not any(float(v) for v in corners[1:] if _is_number(v)):
            values = corners[:1]  # the values at the corners are equal: one stands for all
        yield f"line {number}", fields, values


def _loads(lines: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the line, from 1, and the fields of each SFE and row of SFEBLOCK."""
    for i, line in enumerate(lines):
        head = line.lstrip()[:8].upper()
        if head == "SFEBLOCK":
            yield from commands_of_block(lines, i) or []
        elif head.startswith(("SFE,", "SFE ")):
            yield i + 1, fields_of(line)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def pressure_surfaces(archive: Archive, numbers: Ints, lines: Sequence[str], source: str) -> dict[str, list[Ints]]:
    """Return the corners (f, 3 or 4) of the faces under each pressure, by "pressure_1", ... in the archive's order.

    Parameters
    ----------
    archive : Archive
    numbers : (n,) int
        Numbers of the nodes; corners are returned as positions in these.
    lines : sequence of str
        The lines of the archive.
    source : str
        The file's name, for messages.

    Raises
    ------
    MeshError
        An SFE cannot be read, is not at a solid or SURF154, or names a face that its element does not have.
    """
    found, find = dict[str, list[Ints]](), Rows(numbers)
    given = pressures(archive, lines, source)
    types = {int(row[0]): int(row[1]) for row in archive.ekey}
    rows = {int(row[LABEL]): row for row in archive.elem} if given else {}
    for i, faces in enumerate(given.values(), 1):
        for element, face, where in faces:
            row = rows.get(element)
            table = _FACES.get(types.get(int(row[1]), 0)) if row is not None else None
            if row is None or table is None:
                raise MeshError(f"{source}: {where}: SFE at element {element}, which is no solid and no SURF154")
            if not 1 <= face <= len(table):
                raise MeshError(f"{source}: {where}: element {element} has no face {face}; expected 1 to {len(table)}")
            corners = _corners(row[FIRST:][list(table[face - 1])], find)
            if len(corners) not in (3, 4):
                raise MeshError(f"{source}: {where}: face {face} of element {element} has no area")
            found.setdefault(f"pressure_{i}", []).append(corners)
    return {name: _by_count(corners) for name, corners in found.items()}


def _corners(nodes: Ints, find: Rows) -> Ints:
    """Return the corners of a face as positions of nodes: three if it repeats a node, none if a node is missing."""
    corners = find(nodes)
    corners = corners[np.sort(np.unique(corners, return_index=True)[1])]
    return corners if (corners >= 0).all() else corners[:0]


def _corner_nodes(row: Ints, word: str) -> Ints:
    """Return the nodes of a segment's corners: the first three of the 3 or 6 of a triangle, else the first four.

    TARGE170 has triangles of their own (TRI and TRI6). Those of CONTA174 repeat a node of a quadrilateral, which may
    leave out midside nodes: they are zero.
    """
    nodes = np.trim_zeros(row[FIRST:], "b")
    return nodes[: 3 if word == "target" and len(nodes) in (3, 6) and nodes.all() else 4]


def _by_count(faces: list[Ints]) -> list[Ints]:
    return [np.array([f for f in faces if len(f) == n], dtype=np.int64).reshape(-1, n) for n in (3, 4)]
