"""Give cells the nodes that they lack, midside nodes and centres of faces and cells: neighbours have the same ones."""

from __future__ import annotations

import numpy as np

from .elements import CENTRES, EDGES, QUADRATIC, REFERENCE, SHAPE, corner_count, shape_functions
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
    the middle of the edge; where the centre of a face or cell is missing, likewise, where the map of the nodes on the
    edges has it.

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
    middle, new = shared_middles(pairs, np.concatenate(middles), len(points))
    points = np.vstack([points, points[pairs[new]].mean(axis=1)])
    at = 0
    for kind, nodes, _ in wide:
        first, count = corner_count(kind), len(EDGES[SHAPE[kind]])
        nodes[:, first : first + count] = middle[at : at + len(nodes) * count].reshape(-1, count)
        at += len(nodes) * count
    points = _fill_centres(points, [(kind, nodes) for kind, nodes, _ in wide])
    return points, tuple(CellBlock(kind, nodes, block.labels, block.prefix) for kind, nodes, block in wide)


def _fill_centres(points: Floats, cells: list[tuple[str, Ints]]) -> Floats:
    """Give cells the nodes in the centres of faces and cells that they lack, -1 in their `nodes`, which are changed.

    Parameters
    ----------
    points : (n, 3) float
    cells : list of (str, (m, k) int)
        Kinds of cells, and their nodes; those on edges are all there.

    Returns
    -------
    (n + new, 3) float
    """
    for size in (4, 8):  # corners around the centre of a face, of a cell
        corners, own, places, columns = [], [], [], []
        for kind, nodes in cells:
            known = corner_count(kind) + len(EDGES[SHAPE[kind]])
            for j, around in enumerate(CENTRES.get(kind, ()), known):
                if len(around) == size:
                    weights = shape_functions(QUADRATIC[SHAPE[kind]], REFERENCE[kind][j : j + 1])[0]
                    places.append(np.einsum("k,nkd->nd", weights, points[nodes[:, :known]]))
                    corners.append(nodes[:, around])
                    own.append(nodes[:, j])
                    columns.append((nodes, j))
        if not own or min(part.min(initial=0) for part in own) >= 0:
            continue
        middle, new = shared_middles(np.concatenate(corners), np.concatenate(own), len(points))
        points = np.vstack([points, np.concatenate(places)[new]])
        ends = np.cumsum([len(nodes) for nodes, _ in columns])
        for (nodes, j), part in zip(columns, np.split(middle, ends[:-1]), strict=True):
            nodes[:, j] = part
    return points


def shared_middles(pairs: Ints, middle: Ints, start: int) -> tuple[Ints, Ints]:
    """Give each edge, or face, a node in its middle.

    Parameters
    ----------
    pairs : (n, k) int
        The ends of edges of all cells, or corners of faces; one that several cells have is listed for each.
    middle : (n,) int
        The node that the cell has in the middle, -1 where it has none.
    start : int
        The number of the first new node.

    Returns
    -------
    middle : (n,) int
        Where there was none: the node that another cell has there, or else a new one.
    new : (m,) int
        For each new node a row of `pairs` in whose middle it is.
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
    the shape of the cell stays exactly the same; in a face of a 27-node neighbour its node is taken.

    Parameters
    ----------
    points : (n, 3) float, m
    blocks : tuple of CellBlock
        None of whose nodes is -1.
    """
    wide = [
        ("hexahedron27", np.pad(b.nodes, ((0, 0), (0, 7)), constant_values=-1), b)
        if b.kind == "hexahedron20" else (b.kind, b.nodes, b)
        for b in blocks
    ]  # fmt: skip
    points = _fill_centres(points, [(kind, nodes) for kind, nodes, _ in wide])
    return points, tuple(CellBlock(kind, nodes, b.labels, b.prefix) for kind, nodes, b in wide)
