"""Turn Gmsh's cells and physical groups into a mesh; they come from a file or from a geometry meshed in memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .checking import connect
from .raw import CellBlock, Floats, Ints, RawMesh, check_unique_nodes

_HEX20 = [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]
# By Gmsh's type number: the kind of cell, and the positions p of its nodes so that Gmsh's nodes[:, p] are in VTK's
# order (None: both orders are the same).
SOLIDS: dict[int, tuple[str, list[int] | None]] = {
    4: ("tetra", None), 5: ("hexahedron", None), 6: ("wedge", None), 7: ("pyramid", None),
    11: ("tetra10", [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]),
    12: ("hexahedron27", [*_HEX20, 22, 23, 21, 24, 20, 25, 26]),
    17: ("hexahedron20", _HEX20),
    13: ("wedge18", [0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11, 15, 17, 16]),
    18: ("wedge15", [0, 1, 2, 3, 4, 5, 6, 9, 7, 12, 14, 13, 8, 10, 11]),
    14: ("pyramid14", [0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12, 13]),
    19: ("pyramid13", [0, 1, 2, 3, 4, 5, 8, 10, 6, 7, 9, 11, 12]),
}  # fmt: skip
POINT = 15  # Gmsh's type number of a point
CURVES = (1, 8)  # of lines with two and three nodes
SURFACES = {2: 3, 9: 3, 3: 4, 10: 4, 16: 4}  # number of corners of surface cells, by Gmsh's type number
# Number of nodes of every cell that is read, by Gmsh's type number.
NODES = {1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18, 14: 14, 15: 1, 16: 8,
          17: 20, 18: 15, 19: 13}  # fmt: skip
# A physical group whose name is that of a node set with this behind it has `NodeSet.held` of this set.
HELD = " (held)"


@dataclass(frozen=True)
class GmshCells:
    """Cells of one type that belong to the same physical groups.

    Attributes
    ----------
    type : int
        Gmsh's type number.
    labels : (n,) int
        Numbers of the cells.
    nodes : (n, k) int
        Numbers of their nodes, in Gmsh's order.
    physical : tuple of int
        Tags of the physical groups.
    """

    type: int
    labels: Ints
    nodes: Ints
    physical: tuple[int, ...]


def raw_mesh(
    source: str, labels: Ints, points: Floats, cells: list[GmshCells], names: dict[tuple[int, int], str],
    repeats: bool = False,
) -> RawMesh:  # fmt: skip
    """Return the mesh of numbered nodes and cells in physical groups.

    Parameters
    ----------
    source : str
        The file's name, for messages.
    labels, points : (n,) int, (n, 3) float
        Numbers and coordinates of the nodes.
    cells : list of GmshCells
        Volume cells, surface cells and points.
    names : mapping of (dimension, tag) to str
        Names of the physical groups. A volume or surface group without a name is called by its tag. A group of points
        is a node set if it has a name; without one it is left out, since a number as the name of a node set means a
        node.
    repeats : bool
        Whether a cell is listed once for each of its groups, as version 2.2 does.

    Raises
    ------
    MeshError
        A node is defined twice at different places, or an element uses a node that is not defined.
    """
    labels, points = check_unique_nodes(labels, points, source)
    blocks: list[CellBlock] = []
    volumes: dict[str, list[Ints]] = {}
    surfaces: dict[str, list[Ints]] = {}
    sets: dict[str, list[Ints]] = {}
    unusable: dict[str, str] = {}
    at = 0
    for some in cells:
        if some.type in SOLIDS:
            kind, permutation = SOLIDS[some.type]
            nodes = connect(some.nodes, labels, some.labels, "element", source)
            nodes = nodes if permutation is None else nodes[:, permutation]
            blocks.append(CellBlock(kind, nodes, some.labels))
            index = at + np.arange(len(nodes))
            at += len(nodes)
            for tag in some.physical:
                volumes.setdefault(names.get((3, abs(tag)), str(abs(tag))), []).append(index)
        elif some.type in SURFACES and some.physical:
            nodes = connect(some.nodes[:, : SURFACES[some.type]], labels, some.labels, "surface element", source)
            for tag in some.physical:
                surfaces.setdefault(names.get((2, abs(tag)), str(abs(tag))), []).append(nodes)
        elif some.type == POINT:
            for tag in some.physical:
                if (0, abs(tag)) in names:
                    nodes = connect(some.nodes, labels, some.labels, "point", source)
                    sets.setdefault(names[0, abs(tag)], []).append(nodes.ravel())
                else:
                    unusable[str(abs(tag))] = "it is a physical group of points without a name; give it one"
        elif some.type in CURVES:
            for tag in some.physical:
                name = names.get((1, abs(tag)), str(abs(tag)))
                unusable[name] = "it is a physical group of curves; expected one of volumes, surfaces or points"
    node_groups = {name: np.unique(np.concatenate(parts)) for name, parts in sets.items()}
    held = {name: node_groups.pop(name + HELD) for name in list(node_groups) if name + HELD in node_groups}
    groups = {name: np.unique(np.concatenate(parts)) for name, parts in volumes.items()}
    merged, groups = merge_copies(tuple(blocks), groups) if repeats else (tuple(blocks), groups)
    return RawMesh(points, labels, merged, groups, surfaces, node_groups, unusable, held_nodes=held)


def merge_copies(
    blocks: tuple[CellBlock, ...], groups: dict[str, Ints]
) -> tuple[tuple[CellBlock, ...], dict[str, Ints]]:
    """Merge the copies of elements that a file of version 2.2 lists once for each of their physical groups.

    Copies within one group are not merged: `checking.check_cells` refuses them.
    """
    if not blocks or any(len(np.unique(block.nodes, axis=0)) < len(block) for block in blocks):
        return blocks, groups
    new = np.empty(sum(map(len, blocks)), dtype=np.int64)
    kept, total = [], 0
    for kind in dict.fromkeys(block.kind for block in blocks):
        place = np.concatenate(
            [np.arange(len(b)) + sum(map(len, blocks[:i])) for i, b in enumerate(blocks) if b.kind == kind]
        )
        nodes = np.concatenate([b.nodes for b in blocks if b.kind == kind])
        labels = np.concatenate([b.labels for b in blocks if b.kind == kind])
        _, first, inverse = np.unique(nodes, axis=0, return_index=True, return_inverse=True)
        order = np.argsort(np.argsort(first))  # keep the file's order
        new[place] = total + order[inverse.ravel()]
        rows = np.sort(first)
        kept.append(CellBlock(kind, nodes[rows], labels[rows]))
        total += len(rows)
    return tuple(kept), {name: np.unique(new[cells]) for name, cells in groups.items()}
