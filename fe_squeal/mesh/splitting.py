"""Convert cells: add missing midside nodes, complete 20-node hexahedra to 27 nodes, split cells into tetrahedra."""

from __future__ import annotations

import numpy as np

from .elements import EDGES, FACES, QUADRATIC, REFERENCE, SHAPE, corner_count, shape_functions
from .raw import CellBlock, Floats, Ints


def row_ids(rows: Ints) -> Ints:
    """Return a number (n,) for each of the rows (n, k) int; rows that are equal as sets get the same number.

    Examples
    --------
    >>> row_ids(np.array([[1, 2, 3], [7, 2, 3], [3, 1, 2]]))
    array([0, 1, 0])
    """
    rows = np.sort(rows, axis=1)
    ids = rows[:, 0].astype(np.int64)
    for column in rows.T[1:]:
        _, column_ids = np.unique(column, return_inverse=True)
        _, ids = np.unique(ids * (column_ids.max(initial=0) + 1) + column_ids, return_inverse=True)
    return ids


def fill_midside(points: Floats, blocks: tuple[CellBlock, ...]) -> tuple[Floats, tuple[CellBlock, ...]]:
    """Make every cell quadratic.

    Where a midside node is missing, the midside node that a neighbour has on this edge is taken, or else a new node in
    the middle of the edge.

    Parameters
    ----------
    points : (n, 3) float, m
    blocks : tuple of CellBlock
        Cells with corners alone, or with midside nodes, some of which may be -1.

    Returns
    -------
    points : (m, 3) float, m
        The new nodes stand at the end.
    blocks : tuple of CellBlock
        All of kinds with midside nodes, none of which is -1.
    """
    wide = []
    for block in blocks:
        nodes = block.nodes
        if block.kind == SHAPE[block.kind]:
            nodes = np.pad(nodes, ((0, 0), (0, len(EDGES[block.kind]))), constant_values=-1)
        wide.append((QUADRATIC.get(block.kind, block.kind), nodes.copy(), block))
    ends, middles = [], []
    for kind, nodes, _ in wide:
        edges, first = np.array(EDGES[SHAPE[kind]]), corner_count(kind)
        ends.append(nodes[:, edges].reshape(-1, 2))
        middles.append(nodes[:, first : first + len(edges)].ravel())
    pairs = np.concatenate(ends)
    middle, new = _shared_middles(pairs, np.concatenate(middles), len(points))
    points = np.vstack([points, points[pairs[new]].mean(axis=1)])
    out, at = [], 0
    for kind, nodes, block in wide:
        first, count = corner_count(kind), len(EDGES[SHAPE[kind]])
        nodes[:, first : first + count] = middle[at : at + len(nodes) * count].reshape(-1, count)
        at += len(nodes) * count
        out.append(CellBlock(kind, nodes, block.labels, block.prefix))
    return points, tuple(out)


def _shared_middles(pairs: Ints, middle: Ints, start: int) -> tuple[Ints, Ints]:
    """Give each edge a node in its middle.

    Parameters
    ----------
    pairs : (n, 2) int
        The ends of edges of all cells; an edge of several cells is listed for each.
    middle : (n,) int
        The node that the cell has in the middle of the edge, -1 where it has none.
    start : int
        The number of the first new node.

    Returns
    -------
    middle : (n,) int
        Where there was none: the node that another cell has on this edge, or else a new one.
    new : (m,) int
        For each new node an edge, a row of `pairs`, in whose middle it is.
    """
    ids = row_ids(pairs)
    of_edge = np.full(ids.max(initial=-1) + 1, -1)
    of_edge[ids[middle >= 0]] = middle[middle >= 0]
    bare, new = np.unique(np.where(of_edge[ids] < 0, ids, -1), return_index=True)
    bare, new = bare[bare >= 0], new[bare >= 0]
    of_edge[bare] = start + np.arange(len(bare))
    return np.where(middle < 0, of_edge[ids], middle), new


def complete_hexahedra(points: Floats, blocks: tuple[CellBlock, ...]) -> tuple[Floats, tuple[CellBlock, ...]]:
    """Return points and blocks with 27-node hexahedra in place of 20-node ones.

    The seven new nodes, the centres of the faces and of the cell, are where the map of the 20 nodes has them, so that
    the shape of the cell stays exactly the same.

    Parameters
    ----------
    points : (n, 3) float, m
    blocks : tuple of CellBlock
    """
    out = []
    for block in blocks:
        if block.kind == "hexahedron20":
            weights = shape_functions("hexahedron20", REFERENCE["hexahedron27"][20:])
            centres = np.einsum("qk,nkd->nqd", weights, points[block.nodes])
            new = len(points) + np.arange(centres.shape[0] * 7).reshape(-1, 7)
            points = np.vstack([points, centres.reshape(-1, 3)])
            block = CellBlock("hexahedron27", np.hstack([block.nodes, new]), block.labels, block.prefix)
        out.append(block)
    return points, tuple(out)


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
        middle, new = _shared_middles(np.vstack(ends), np.concatenate(own), len(points))
        points = np.vstack([points, np.vstack(middles)[new]])
        columns, start = [], 0
        for block_nodes in nodes:
            columns.append(middle[start : start + 6 * len(block_nodes)].reshape(6, -1).T)
            start += 6 * len(block_nodes)
        tetrahedra = np.hstack([tetrahedra, np.vstack(columns)])
        kind = "tetra10"
    return points, CellBlock(kind, tetrahedra, np.concatenate(labels), prefix), np.concatenate(parents)
