"""Split cells into tetrahedra that fit together."""

from __future__ import annotations

import numpy as np

from .elements import EDGES, FACES, REFERENCE, SHAPE, corner_count, shape_functions
from .midside import shared_middles
from .raw import CellBlock, Floats, Ints


def local_tetrahedra(shape: str, corners: Ints) -> tuple[Ints, Ints]:
    """Return the tetrahedra that each cell is split into, by the positions of its corners.

    They are the cones from the corner with the smallest number over the faces that do not contain it. A quadrilateral
    face is cut by the diagonal through its corner with the smallest number, so that both neighbours cut it alike.
    Source: J. Dompierre, P. Labbé, M.-G. Vallet, R. Camarero, "How to subdivide pyramids, prisms and hexahedra into
    tetrahedra", 8th International Meshing Roundtable, 1999.

    Parameters
    ----------
    shape : str
        Shape of the cells, a key of `elements.FACES`.
    corners : (n, k) int
        Numbers of the corner nodes, in any numbering that all cells share.

    Returns
    -------
    local : (m, 4) int
        Positions, from 0 to k − 1, of the corners of each tetrahedron, right-handed, ordered by cell.
    parent : (m,) int
        The cell of each tetrahedron.

    Examples
    --------
    >>> local_tetrahedra("pyramid", np.array([[4, 3, 2, 1, 0]]))[0].tolist()
    [[4, 3, 2, 1], [4, 3, 1, 0]]
    """
    if shape == "tetra":
        return np.tile(np.arange(4), (len(corners), 1)), np.arange(len(corners))
    apex = corners.argmin(axis=1)
    local, parent = [], []
    for tip in range(corners.shape[1]):
        cells = np.flatnonzero(apex == tip)
        for face in FACES[shape]:
            if tip in face:
                continue
            if len(face) == 3:
                cuts = [(cells, [face])]
            else:
                a, b, c, d = face
                even = corners[cells][:, [a, c]].min(axis=1) < corners[cells][:, [b, d]].min(axis=1)
                cuts = [(cells[even], [(a, b, c), (a, c, d)]), (cells[~even], [(b, c, d), (b, d, a)])]
            for which, triangles in cuts:
                for triangle in triangles:
                    local.append(np.tile((tip, *triangle), (len(which), 1)))
                    parent.append(which)
    stacked, of = np.vstack(local), np.concatenate(parent)
    order = np.argsort(of, kind="stable")
    return stacked[order], of[order]


def split_quadrilaterals(corners: Ints) -> Ints:
    """Return the triangles (2m, 3) that the faces (m, 4) are cut into, by the rule of `local_tetrahedra`.

    The two triangles of a face follow each other.
    """
    even = corners[:, [0, 2]].min(axis=1) < corners[:, [1, 3]].min(axis=1)
    first = np.where(even[:, None], corners[:, [0, 1, 2]], corners[:, [1, 2, 3]])
    second = np.where(even[:, None], corners[:, [0, 2, 3]], corners[:, [1, 3, 0]])
    return np.stack([first, second], axis=1).reshape(-1, 3)


def split_cells(points: Floats, blocks: tuple[CellBlock, ...]) -> tuple[Floats, CellBlock, Ints]:
    """Split all cells into tetrahedra that fit together across shared faces.

    Quadratic cells give 10-node tetrahedra. Nodes of the cells, on edges and in the centres of faces and cells, stay in
    the middles of edges of the tetrahedra. The middle node of an edge that has none is where the cell's own curved map
    has it; only between its edges the surface of a curved quadrilateral changes slightly.

    Parameters
    ----------
    points : (n, 3) float, m
    blocks : tuple of CellBlock
        All linear or all quadratic (see `fill_midside`).

    Returns
    -------
    points : (m, 3) float, m
        The new nodes stand at the end: middles of diagonals of faces and cells that have no node in their centre.
    block : CellBlock
        Cells of kind "tetra" or "tetra10"; its labels are those of the cells that the tetrahedra came from.
    parent : (t,) int
        The cell of each tetrahedron, counted through all blocks.
    """
    quadratic = any(block.kind != SHAPE[block.kind] for block in blocks)
    nodes, parents, labels, at = [], [], [], 0
    ends, own, middles = [], [], []  # of the edges of the tetrahedra: corners, the cell's node in the middle, its place
    edges = np.array(EDGES["tetra"])
    for block in blocks:
        shape, count = SHAPE[block.kind], corner_count(block.kind)
        local, parent = local_tetrahedra(shape, block.nodes[:, :count])
        tetra = np.take_along_axis(block.nodes[parent], local, axis=1)
        nodes.append(tetra)
        parents.append(parent + at)
        labels.append(block.labels[parent])
        at += len(block)
        if quadratic:
            # Shape functions are evaluated once for each pair of corners of the reference cell, not for each
            # tetrahedron.
            corners = REFERENCE[block.kind][:count]
            pair_points = (corners[:, None] + corners[None]).reshape(-1, 3) / 2
            weights = shape_functions(block.kind, pair_points).reshape(count, count, -1)
            apart = np.abs(pair_points[:, None] - REFERENCE[block.kind]).max(axis=2)
            node = np.where(apart.min(axis=1) == 0.0, apart.argmin(axis=1), -1).reshape(count, count)
            pairs = np.sort(local[:, edges], axis=2)
            for j in range(len(edges)):
                w, local_node = weights[pairs[:, j, 0], pairs[:, j, 1]], node[pairs[:, j, 0], pairs[:, j, 1]]
                own.append(np.where(local_node >= 0, block.nodes[parent, local_node], -1))
                middles.append(np.einsum("nk,nkd->nd", w, points[block.nodes[parent]]))
                ends.append(tetra[:, edges[j]])
    tetrahedra = np.vstack(nodes)
    prefix = blocks[0].prefix if len({block.prefix for block in blocks}) == 1 else ""
    kind = "tetra"
    if quadratic:
        middle, new = shared_middles(np.vstack(ends), np.concatenate(own), len(points))
        points = np.vstack([points, np.vstack(middles)[new]])
        columns, start = [], 0
        for block_nodes in nodes:
            columns.append(middle[start : start + 6 * len(block_nodes)].reshape(6, -1).T)
            start += 6 * len(block_nodes)
        tetrahedra = np.hstack([tetrahedra, np.vstack(columns)])
        kind = "tetra10"
    return points, CellBlock(kind, tetrahedra, np.concatenate(labels), prefix), np.concatenate(parents)
