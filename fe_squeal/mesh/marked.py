"""Local refinement of tetrahedra: marked elements into parts, their neighbours as far as needed, no hanging nodes.

Tetrahedra are bisected as in D. N. Arnold, A. Mukherjee, L. Pouly, Locally adapted tetrahedral meshes using bisection,
SIAM J. Sci. Comput. 22, 2000: each has an edge at which it is cut, each of its faces too, and rules say which edges its
halves and their faces have. However often a mesh is refined, the parts of a tetrahedron have finitely many shapes (36
were counted, or some more, never above 72). A mesh that has not been refined so begins with the longest edges.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fe_squeal.errors import MeshError

from .elements import EDGES, REFERENCE, SHAPE, shape_functions
from .groups import LoadedMesh
from .raw import Floats, Ints
from .subdividing import subdivide, vtk_nodes

_EDGES = np.array(EDGES["tetra"])
_DIGITS = 9  # of an edge's length: edges that differ by less are equally long
_PARTS = 64.0  # weights of a parent's corners at the nodes of its children are multiples of 1/64
# Orders of a tetrahedron's corners, by the edge that comes first.
_FIRST = np.array([[*edge, *(c for c in range(4) if c not in edge)] for edge in EDGES["tetra"]])


@dataclass(frozen=True)
class _Cells:
    """Tetrahedra that are being bisected.

    Attributes
    ----------
    corners : (n, 4) int
        The next cut is between the first two, a and b; c and d are the others.
    marks : (n, 2) int
        At which edge the faces acd and bcd are cut: at ac or bc (0), at ad or bd (1), or at cd (2).
    flags : (n,) int
        One of the halves of a tetrahedron whose three edges lay in a plane and that had no flag.
    parents : (n,) int
    weights : (n, 4, 4) float
        Of the parent's corners at the corners.
    due : (n,) int
        How many more times to cut.
    """

    corners: Ints
    marks: Ints
    flags: Ints
    parents: Ints
    weights: Floats
    due: Ints

    def __getitem__(self, rows: Ints | np.ndarray) -> _Cells:
        return _Cells(*(column[rows] for column in vars(self).values()))

    def keys(self) -> Ints:
        """Return (n, 6) a number for each edge."""
        return _keys(self.corners[:, _EDGES])


def refine_marked(loaded: LoadedMesh, marked: Ints, halvings: int = 3) -> tuple[LoadedMesh, Ints]:
    """Bisect marked tetrahedra, and others until no node hangs.

    Curved sides are kept, see `subdivide`: both meshes fill the same domain, and a field on the coarse one is also one
    on the fine one.

    Parameters
    ----------
    marked : (m,) int
        Elements, in any order.
    halvings : int
        How many times they, and their parts, are bisected. Three cut every edge and make eight of one. One at a time
        takes more rounds and ends with fewer elements, about two thirds for the same error (measured at a clamped
        edge).

    Returns
    -------
    refined : LoadedMesh
        With the same groups, surfaces and node sets.
    parents : (n,) int
        The element that each of its elements is a part of, in ascending order.

    Raises
    ------
    MeshError
        The mesh has hexahedra, there is no such element, or a curved one is so distorted that a part of it is inverted.

    Examples
    --------
    >>> import skfem
    >>> from .building import from_skfem
    >>> fine, parents = refine_marked(from_skfem(skfem.MeshTet().refined(1)), np.array([0]))
    >>> int((parents == 0).sum()), fine.mesh.nelements < 160
    (8, True)
    """
    kind, nodes = vtk_nodes(loaded.mesh)
    if SHAPE[kind] != "tetra":
        raise MeshError(
            f"{loaded.source}: marked elements are refined where all are tetrahedra, and these are hexahedra; refine"
            " them by direction or as a whole"
        )
    marked = np.asarray(marked)
    if marked.size and marked.dtype.kind not in "iu":
        raise MeshError(f"{loaded.source}: elements to refine are of type {marked.dtype}; expected their numbers")
    marked = marked.astype(np.int64)
    bad = marked[(marked < 0) | (marked >= len(nodes))]
    if len(bad):
        raise MeshError(f"{loaded.source}: no element {bad[0]} to refine; expected 0 to {len(nodes) - 1}")
    cells = _first_cells(loaded, nodes[:, :4])
    cells.due[marked] = halvings
    cells = _bisect(cells, loaded.mesh.doflocs.shape[1])
    cells = cells[np.argsort(cells.parents, kind="stable")]
    left = np.linalg.det(cells.weights) < 0
    order = np.where(left[:, None], [0, 1, 3, 2], [0, 1, 2, 3])
    weights = np.take_along_axis(cells.weights, order[:, :, None], axis=1)
    names = np.random.default_rng(7).integers(1, 2**64, 16, dtype=np.uint64)
    whole = (_PARTS * weights).astype(np.uint64).reshape(-1, 16)
    _, first, pattern = np.unique(whole @ names, return_index=True, return_inverse=True)
    between = shape_functions("tetra", REFERENCE[kind])
    patterns = np.einsum("kc,pcb,bx->pkx", between, weights[first], REFERENCE["tetra"])
    fine, columns = subdivide(loaded, nodes, cells.parents, pattern, patterns)
    corners = np.take_along_axis(columns[:, :4], order, axis=1)
    return replace(fine, bisection=np.column_stack([corners, cells.marks, cells.flags])), cells.parents


def _first_cells(loaded: LoadedMesh, corners: Ints) -> _Cells:
    """Return all elements, none of them to be cut."""
    count, known = len(corners), loaded.bisection
    if known.shape != (count, 7) or (np.sort(known[:, :4], axis=1) != np.sort(corners, axis=1)).any():
        known = _longest_first(loaded.mesh.doflocs.T, corners)
    weights = (known[:, :4, None] == corners[:, None, :]).astype(float)
    zeros = np.zeros(count, np.int64)
    return _Cells(known[:, :4], known[:, 4:6], known[:, 6], np.arange(count), weights, zeros)


def _longest_first(points: Floats, corners: Ints) -> Ints:
    """Return (e, 7) corners, marks and flags that cut every element and face at its longest edge."""
    ends, index = np.unique(np.sort(corners[:, _EDGES], axis=2).reshape(-1, 2), axis=0, return_inverse=True)
    length = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    # Equally long edges are taken in the order of their nodes, whatever rounding says: neighbours have to agree.
    rank = np.empty(len(ends), np.int64)
    rank[np.argsort(-np.round(np.log(length), _DIGITS), kind="stable")] = np.arange(len(ends))
    rank = rank[index.reshape(-1, 6)]
    order = _FIRST[rank.argmin(axis=1)]
    between = np.empty((4, 4), np.int64)
    between[_EDGES[:, 0], _EDGES[:, 1]] = between[_EDGES[:, 1], _EDGES[:, 0]] = np.arange(6)
    marks = []
    for end in (0, 1):
        pairs = [(end, 2), (end, 3), (2, 3)]
        edges = np.stack([between[order[:, a], order[:, b]] for a, b in pairs], axis=1)
        marks.append(np.take_along_axis(rank, edges, axis=1).argmin(axis=1))
    flags = np.zeros(len(corners), np.int64)
    return np.column_stack([np.take_along_axis(corners, order, axis=1), *marks, flags])


def _keys(pairs: Ints) -> Ints:
    return np.asarray((pairs.min(axis=-1) << 32) | pairs.max(axis=-1))


def _bisect(cells: _Cells, count: int) -> _Cells:
    """Bisect cells until none is due and none has an edge that others have cut; nodes are numbered from `count` on."""
    cut = np.empty(0, np.int64)  # keys of edges, ascending, and the nodes in the middle of each
    middles = np.empty(0, np.int64)
    while True:
        hanging = np.isin(cells.keys(), cut).any(axis=1)
        now = (cells.due > 0) | hanging
        if not now.any():
            return cells
        some = cells[now]
        keys = _keys(some.corners[:, :2])
        new = np.setdiff1d(keys, cut)
        cut, middles = np.concatenate([cut, new]), np.concatenate([middles, count + np.arange(len(new))])
        count += len(new)
        order = np.argsort(cut)
        cut, middles = cut[order], middles[order]
        halves = _halves(some, middles[np.searchsorted(cut, keys)])
        parts = [cells[~now], *halves]
        cells = _Cells(*(np.concatenate(columns) for columns in zip(*(vars(p).values() for p in parts), strict=True)))


def _halves(cells: _Cells, middle: Ints) -> list[_Cells]:
    """Return both halves of each cell; `middle` (n,) are the nodes between a and b."""
    planar = (cells.marks[:, 0] == cells.marks[:, 1]) & (cells.marks[:, 0] < 2)
    again = planar & (cells.flags == 1)
    weight = cells.weights[:, :2].mean(axis=1)
    halves = []
    for end in (0, 1):
        # Corners of the half: the end, the middle m, c and d. It is cut where its face without m is.
        corners = np.column_stack([cells.corners[:, end], middle, cells.corners[:, 2:]])
        weights = np.stack([cells.weights[:, end], weight, cells.weights[:, 2], cells.weights[:, 3]], axis=1)
        order = np.array([[0, 2, 1, 3], [0, 3, 1, 2], [2, 3, 1, 0]])[cells.marks[:, end]]
        # Faces that were cut, and the new one mcd, are cut opposite to m, but mcd at an edge of m where `again`.
        marks = np.column_stack([np.ones(len(middle), np.int64), np.where(again, 0, 1)])
        halves.append(_Cells(
            np.take_along_axis(corners, order, axis=1), marks, (planar & ~again).astype(np.int64), cells.parents,
            np.take_along_axis(weights, order[:, :, None], axis=1), np.maximum(cells.due - 1, 0),
        ))  # fmt: skip
    return halves
