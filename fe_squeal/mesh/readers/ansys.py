"""Ansys archives (.cdb, of CDWRITE): nodes, solids and components by mapdl-archive, contact elements as surfaces."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fe_squeal.errors import MeshError

from ..checking import connect
from ..elements import QUADRATIC
from ..raw import CellBlock, Ints, RawMesh, check_unique_nodes, rows_of
from .ansys_archive import Archive, read_apart
from .ansys_faces import FIRST, LABEL, contact_surfaces, pressure_surfaces
from .ansys_forms import element_types
from .sources import Sources

_NODES = {185: 8, 186: 20, 187: 10, 285: 4}  # number of nodes of each kind of solid that is read
# Elements that are no part of the mesh and lose nothing by it: masses, which `decks` reads, elements of surfaces, which
# become groups, and MESH200, which has no stiffness.
_WITHOUT_VOLUME = (21, 154, 170, 173, 174, 200)


def read_archive(sources: Sources) -> Archive:
    """Return the arrays that mapdl-archive reads from a file.

    Raises
    ------
    MeshError
        The file has no nodes or elements, is damaged, or mapdl-archive is not installed.
    """
    source, lines = sources.path.name, text_of(sources)
    if not any(line.upper().startswith("NBLOCK") for line in lines):
        raise MeshError(f"{source}: no NBLOCK; expected an Ansys archive as CDWRITE,DB writes it")
    archive = read_apart(sources.path)
    if not len(archive.nodes) or archive.elem.shape[1] <= FIRST:
        raise MeshError(f"{source}: no nodes or no elements; expected an archive of solids, as CDWRITE,DB writes it")
    types = {int(number): int(kind) for number, kind in archive.ekey} | element_types(lines)
    return replace(archive, ekey=np.array(list(types.items()), dtype=np.int64).reshape(-1, 2))


def read_ansys(sources: Sources) -> RawMesh:
    """Read an Ansys archive.

    Solids of material 2 are the volume group "material_2", those of element type 3 "type_3". Components keep their
    names. Contact and target elements with real constant set 4 are the surface groups "contact_4" and "target_4". Faces
    under pressures of SFE are "pressure_1", "pressure_2", ..., one group for each value of the pressure.

    Raises
    ------
    MeshError
        The file is damaged, has no solids, its elements use nodes that it does not define, or mapdl-archive is missing.
    """
    return mesh_of(read_archive(sources), text_of(sources), sources.path.name)


def text_of(sources: Sources) -> list[str]:
    """Return the lines of an archive."""
    return sources.lines(sources.path, 0, "an Ansys archive")


def left_over(archive: Archive) -> dict[int, int]:
    """Return the number of elements by their kind (14 for COMBIN14), of all kinds that the mesh has nothing of.

    An element whose type the archive does not define counts under 0.
    """
    types = {int(row[0]): int(row[1]) for row in archive.ekey}
    kinds = Counter(types.get(int(number), 0) for number in archive.elem[:, 1])
    return {kind: kinds[kind] for kind in sorted(kinds) if kind not in _NODES and kind not in _WITHOUT_VOLUME}


def mesh_of(archive: Archive, lines: Sequence[str], source: str) -> RawMesh:
    """Return the mesh from the arrays that mapdl-archive has read and the lines of the archive; see `read_ansys`.

    Raises
    ------
    MeshError
        There are no solids, or elements use nodes that are not defined.
    """
    numbers, points = np.asarray(archive.nnum, dtype=np.int64), np.asarray(archive.nodes, dtype=np.float64)[:, :3]
    numbers, points = check_unique_nodes(numbers, points, source)
    types = {int(row[0]): int(row[1]) for row in archive.ekey}
    by_kind: dict[str, list[tuple[list[int], list[int]]]] = {}
    for row in archive.elem:
        solid = types.get(int(row[1]), 0)
        if solid in _NODES:
            given = [int(n) for n in row[FIRST : FIRST + _NODES[solid]]]
            kind, nodes = _undegenerate(solid, given + [0] * (_NODES[solid] - len(given)))
            by_kind.setdefault(kind, []).append(([int(v) for v in row[:FIRST]], nodes))
    blocks, heads = [], [np.empty((0, FIRST), np.int64)]
    for kind, rows in by_kind.items():
        head = np.array([h for h, _ in rows], dtype=np.int64)
        table = np.array([n for _, n in rows], dtype=np.int64)
        labels = head[:, LABEL]
        blocks.append(CellBlock(kind, connect(table, numbers, labels, "element", source), labels))
        heads.append(head)
    if not blocks:
        raise MeshError(f"{source}: no SOLID185, SOLID186, SOLID187 or SOLID285; expected an archive of solids")
    head = np.concatenate(heads)
    volumes: dict[str, Ints] = {}
    for word, column in (("material", 0), ("type", 1)):
        for value in np.unique(head[:, column]):
            volumes[f"{word}_{value}"] = np.flatnonzero(head[:, column] == value)
    unusable = {}
    for name, members in archive.element_components.items():
        inside = np.flatnonzero(np.isin(head[:, LABEL], members))
        if len(inside):
            volumes.setdefault(str(name).strip(), inside)
        else:
            unusable[str(name).strip()] = "the component has no solids; contact elements make contact_N and target_N"
    sets = {}
    for name, members in archive.node_components.items():
        found = rows_of(np.asarray(members), numbers)
        sets[str(name).strip()] = found[found >= 0]
    surfaces = contact_surfaces(archive, numbers) | pressure_surfaces(archive, numbers, lines, source)
    notes = tuple(
        f"{count} elements of kind {kind or '(none)'} are not read and no part of the mesh"
        for kind, count in left_over(archive).items()
    )
    return RawMesh(points, numbers, tuple(blocks), volumes, surfaces, sets, unusable, notes, ignore_case=True)


def _undegenerate(solid: int, n: list[int]) -> tuple[str, list[int]]:
    """Return the kind of an element and its nodes, in VTK's order, where it may be a hexahedron with repeated corners.

    The eight corners I, J, K, L, M, N, O, P of a hexahedron are written as I, J, K, K, M, M, M, M for a tetrahedron,
    I, J, K, K, M, N, O, O for a prism and I, J, K, L, M, M, M, M for a pyramid (Ansys element reference, SOLID185 and
    SOLID186).
    """
    if solid in (187, 285):
        return ("tetra10", n) if any(n[4:]) else ("tetra", n[:4])
    flat, point, edge = n[2] == n[3], n[4] == n[5] == n[6] == n[7], n[6] == n[7]
    if flat and point:
        shape, corners, middles = "tetra", [0, 1, 2, 4], [8, 9, 11, 16, 17, 18]
    elif flat and edge:
        shape, corners, middles = "wedge", [0, 1, 2, 4, 5, 6], [8, 9, 11, 12, 13, 15, 16, 17, 18]
    elif point:
        shape, corners, middles = "pyramid", [0, 1, 2, 3, 4], [8, 9, 10, 11, 16, 17, 18, 19]
    else:
        shape, corners, middles = "hexahedron", [*range(8)], [*range(8, 20)]
    if solid == 185 or not any(n[8:]):
        return shape, [n[i] for i in corners]
    return QUADRATIC[shape], [n[i] for i in (*corners, *middles)]
