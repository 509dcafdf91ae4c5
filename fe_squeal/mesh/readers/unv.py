"""Universal files (.unv): nodes (2411), their systems (2420), elements (2412), groups (2467, 2477) and units (164)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fe_squeal.errors import MeshError

from ..checking import connect
from ..raw import CellBlock, Floats, Ints, RawMesh, Rows, check_unique_nodes
from .sources import Sources

# By FE descriptor: the kind of a solid, and the positions p of its nodes so that the file's nodes[p] are in VTK's
# order. The file lists the nodes of parabolic solids around the lower face, corners and midside nodes in turn, then the
# midside nodes of the upright edges, then the nodes around the upper face.
_SOLIDS: dict[int, tuple[str, list[int]]] = {
    111: ("tetra", [*range(4)]), 112: ("wedge", [*range(6)]), 115: ("hexahedron", [*range(8)]),
    118: ("tetra10", [0, 2, 4, 9, 1, 3, 5, 6, 7, 8]),
    113: ("wedge15", [0, 2, 4, 9, 11, 13, 1, 3, 5, 10, 12, 14, 6, 7, 8]),
    116: ("hexahedron20", [0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11]),
}  # fmt: skip
_BEAMS = {11, 21, 22, 23, 24}  # FE descriptors of beams, which have a third line of data
_TRIANGLES, _QUADRILATERALS = {41, 51, 61, 71, 81, 91}, {44, 54, 64, 74, 84, 94}  # linear membranes, plates and shells
_PARABOLIC = {42, 52, 62, 72, 82, 92, 45, 55, 65, 75, 85, 95}  # the same, parabolic: every other node is a corner
_GROUPS = {"2467", "2477", "2452", "2435"}  # datasets of groups that have four numbers for each member
_NODE, _ELEMENT = 7, 8  # entity type codes of the members of a group
_ROUNDING = 1e-6  # of direction cosines, and of the origin over the largest coordinate: the global system
_LENGTHS = {1.0: "m", 1e3: "mm"}  # the unit by its number in a metre


@dataclass
class _Content:
    points: list[tuple[Ints, Floats]] = field(default_factory=list)
    # By kind of solid: the first lines of its elements (number, descriptor, properties, ...), and their nodes.
    solids: dict[str, tuple[list[list[int]], list[list[int]]]] = field(default_factory=dict)
    faces: dict[int, Ints] = field(default_factory=dict)  # corner nodes of shells, by the number of the element
    groups: dict[str, Ints] = field(default_factory=dict)  # (m, 2) entity type code and number of the members
    others: dict[int, int] = field(default_factory=dict)  # number of elements that are no solids, by FE descriptor
    named: set[int] = field(default_factory=set)  # coordinate systems that stand beside nodes
    systems: dict[int, tuple[int, Floats]] = field(default_factory=dict)  # those the file defines: type, (4, 3) rows
    unit: str = ""


def read_unv(sources: Sources) -> RawMesh:
    """Read a universal file.

    Groups keep their names: groups of solids are volume groups, groups of shells on solids surface groups, groups of
    nodes node sets. Elements of physical property 2 are the volume group "property_2", those of material 3
    "material_3".

    Raises
    ------
    MeshError
        The file is cut off, a dataset cannot be read, there are no nodes or no solids, or nodes are in a coordinate
        system of their own.
    """
    source = sources.path.name
    lines = sources.lines(sources.path, 0, "a universal file")
    content = _Content()
    marks = [i for i, line in enumerate(lines) if line.strip() == "-1"]
    if len(marks) % 2 or not marks:
        raise MeshError(f"{source}: a dataset does not end with -1; expected a universal file, and this one is cut off")
    for first, last in zip(marks[::2], marks[1::2], strict=True):
        kind, data = lines[first + 1].strip(), lines[first + 2 : last]
        try:
            if kind == "2411":
                _read_nodes(content, data)
            elif kind == "2420":
                _read_systems(content, data)
            elif kind == "2412":
                _read_elements(content, data)
            elif kind in _GROUPS:
                _read_groups(content, data)
            elif kind == "164":
                scale = float(data[1].upper().replace("D", "E").split()[0])
                content.unit = _LENGTHS.get(scale, f"m/{scale:g}")
        except (ValueError, IndexError, OverflowError) as error:
            raise MeshError(f"{source}: dataset {kind} at line {first + 2} cannot be read: {error}") from None
    if not content.points or not content.solids:
        what = "nodes (dataset 2411)" if not content.points else "solids (dataset 2412)"
        raise MeshError(f"{source}: no {what}; expected a universal file of a solid mesh")
    return _mesh(content, source)


def _read_nodes(content: _Content, data: list[str]) -> None:
    heads = np.array([line.split()[:2] for line in data[::2]], dtype=np.int64).reshape(-1, 2)
    numbers = " ".join(data[1::2]).upper().replace("D", "E").split()
    if len(np.unique(heads[:, 1])) > 1:
        raise ValueError("nodes in several coordinate systems are not read; export them in the global one")
    content.named |= set(heads[:, 1].tolist())
    content.points.append((heads[:, 0], np.array(numbers, dtype=float).reshape(len(heads), 3)))


def _read_systems(content: _Content, data: list[str]) -> None:
    for i in range(2, len(data), 6):  # behind the number and the name of the part; each with a name and four rows
        number, kind = (int(word) for word in data[i].split()[:2])
        rows = " ".join(data[i + 2 : i + 6]).upper().replace("D", "E").split()
        content.systems[number] = kind, np.array(rows, dtype=float).reshape(4, 3)


def _check_systems(content: _Content, points: Floats, source: str) -> list[str]:
    """Return notes about the coordinate systems that stand beside the nodes, all of which have to be the global one.

    Programs differ in whether coordinates are in that system, and in how its matrix is meant. So others are refused.
    """
    notes = []
    for number in sorted(content.named):
        if number in content.systems:
            kind, rows = content.systems[number]
            moved = np.abs(rows[3]).max() > _ROUNDING * np.abs(points).max()
            if kind != 0 or moved or not np.allclose(rows[:3], np.eye(3), rtol=0, atol=_ROUNDING):
                raise MeshError(
                    f"{source}: nodes (dataset 2411) are given in coordinate system {number}, which dataset 2420"
                    " defines and which is not the global one; export them in the global Cartesian system"
                )
        elif number > 1:  # programs write 0 or 1 for the global one, and do not define it
            notes.append(f"coordinate system {number} of nodes, which the file does not define, is taken as global")
    return notes


def _read_elements(content: _Content, data: list[str]) -> None:
    i = 0
    while i < len(data):
        head = [int(word) for word in data[i].split()]
        number, kind, count = head[0], head[1], head[5]
        i += 2 if kind in _BEAMS else 1
        nodes: list[int] = []
        while len(nodes) < count:
            nodes += [int(word) for word in data[i].split()]
            i += 1
        shape, order = _SOLIDS.get(kind, ("", nodes))
        if len(nodes) != count or len(nodes) != len(order):
            raise ValueError(f"element {number} has {len(nodes)} nodes; expected {min(count, len(order))}")
        if shape:
            heads, tables = content.solids.setdefault(shape, ([], []))
            heads.append(head[:4])
            tables.append([nodes[k] for k in order])
        elif kind in _TRIANGLES | _QUADRILATERALS | _PARABOLIC:
            content.faces[number] = np.array(nodes[::2] if kind in _PARABOLIC else nodes, dtype=np.int64)
        elif 111 <= kind <= 119:
            raise ValueError(f"element {number} is of FE descriptor {kind}; expected solids {sorted(_SOLIDS)}")
        else:
            content.others[kind] = content.others.get(kind, 0) + 1


def _read_groups(content: _Content, data: list[str]) -> None:
    i = 0
    while i < len(data):
        count, name = int(data[i].split()[7]), data[i + 1].strip()
        rows = -(-count // 2)
        numbers = [int(word) for line in data[i + 2 : i + 2 + rows] for word in line.split()]
        members = np.array(numbers, dtype=np.int64).reshape(-1, 4)[:, :2]
        if len(members) != count:
            raise ValueError(f'group "{name}" has {len(members)} members; expected {count}')
        content.groups[name] = np.vstack([content.groups.get(name, members[:0]), members])
        i += 2 + rows


def _mesh(content: _Content, source: str) -> RawMesh:
    numbers, points = (np.concatenate(parts) for parts in zip(*content.points, strict=True))
    numbers, points = check_unique_nodes(numbers, points, source)
    blocks, heads = [], np.concatenate([np.array(rows) for rows, _ in content.solids.values()])
    for kind, (rows, tables) in content.solids.items():
        labels = np.array(rows)[:, 0]
        blocks.append(CellBlock(kind, connect(np.array(tables), numbers, labels, "element", source), labels))
    volumes, nodes, surfaces, unusable = dict[str, Ints](), dict[str, Ints](), dict[str, list[Ints]](), dict[str, str]()
    for word, column in (("property", 2), ("material", 3)):
        for value in np.unique(heads[:, column]):
            volumes[f"{word}_{value}"] = np.flatnonzero(heads[:, column] == value)
    find = Rows(numbers)
    for name, members in content.groups.items():
        elements = members[members[:, 0] == _ELEMENT, 1]
        found = find(members[members[:, 0] == _NODE, 1])
        inside = np.flatnonzero(np.isin(heads[:, 0], elements))
        faces = [find(content.faces[e]) for e in elements.tolist() if e in content.faces]
        if len(inside):
            volumes[name] = inside
        if faces:
            surfaces[name] = [np.array([f for f in faces if len(f) == n], np.int64).reshape(-1, n) for n in (3, 4)]
        if (found >= 0).any():
            nodes[name] = np.unique(found[found >= 0])
        if name not in volumes | surfaces | nodes:
            unusable[name] = "the group has neither nodes nor solids nor shells"
    notes = _check_systems(content, points, source)
    notes += [f"the file says that its unit of length is {content.unit}"] if content.unit else []
    notes += [f"{n} elements of FE descriptor {kind}, no solids, are left out" for kind, n in content.others.items()]
    return RawMesh(points, numbers, tuple(blocks), volumes, surfaces, nodes, unusable, tuple(notes),
                   length_unit=content.unit)  # fmt: skip
