"""Local refinement of tetrahedra: marked elements are bisected, and others as far as needed to leave no hanging node.

The rules are those of D. N. Arnold, A. Mukherjee, L. Pouly, "Locally adapted tetrahedral meshes using bisection", SIAM
J. Sci. Comput. 22, 2000. Each tetrahedron has a refinement edge, whose middle is the next new node, and each of its
faces has a marked edge. The rules give the edges of both halves. However often a mesh is refined, the parts of a
tetrahedron have finitely many shapes: at most 72, and usually about 36 were counted. In a mesh that was not refined in
this way yet, the longest edge of each tetrahedron and of each face is taken.
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
_DIGITS = 9  # decimals of ln(length): edges whose lengths differ by less, relatively, count as equally long
_PARTS = 64.0  # barycentric coordinates of a child's corners in its parent are multiples of 1/64
# For each edge of a tetrahedron an order of its corners that begins with the two ends of this edge.
_FIRST = np.array([[*edge, *(c for c in range(4) if c not in edge)] for edge in EDGES["tetra"]])


@dataclass(frozen=True)
class _Cells:
    """Tetrahedra that are being bisected.

    Attributes
    ----------
    corners : (n, 4) int
        Nodes a, b, c, d. The refinement edge is ab: the next cut is through its middle, c and d.
    marks : (n, 2) int
        The marked edges of the faces acd and bcd: ac or bc (0), ad or bd (1), or cd (2).
    flags : (n,) int
        1 for a half of a planar tetrahedron without a flag, else 0. A tetrahedron is planar if its refinement edge and
        the two marked edges lie in one face.
    parents : (n,) int
        The element of the given mesh that each tetrahedron is a part of.
    weights : (n, 4, 4) float
        Barycentric coordinates of each of its corners in this element.
    due : (n,) int
        How many more times the tetrahedron is to be bisected.
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
        """Return (n, 6) a number for each edge, the same in all tetrahedra that share it."""
        return _keys(self.corners[:, _EDGES])


def refine_marked(loaded: LoadedMesh, marked: Ints, halvings: int = 3) -> tuple[LoadedMesh, Ints]:
    """Bisect marked tetrahedra, and as many others as needed to leave no hanging node.

    Curved sides are kept, see `subdivide`: both meshes fill the same domain, and every displacement that the elements
    of the coarse mesh can represent can be represented on the fine one.

    Parameters
    ----------
    loaded : LoadedMesh
        A mesh of tetrahedra.
    marked : (m,) int
        The elements to refine, in any order.
    halvings : int
        How many times the marked elements, and their parts, are bisected. Three bisections cut every edge and make
        eight parts of an element. With one bisection at a time a search for a target takes more rounds, but ends with
        about two thirds of the elements for the same error (measured at a clamped edge).

    Returns
    -------
    refined : LoadedMesh
        The new mesh, with the same groups, surfaces and node sets.
    parents : (n,) int
        For each of its elements the element of the given mesh that it is a part of, in ascending order.

    Raises
    ------
    MeshError
        The mesh has hexahedra, a marked element does not exist, or a curved element is so distorted that a part of it
        is inverted.

    Examples
    --------
    >>> import skfem
    >>> from .from_python import from_skfem
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
    """Return all elements of a mesh as cells with the edges at which they would be cut, none of them due."""
    count, known = len(corners), loaded.bisection
    if known.shape != (count, 7) or (np.sort(known[:, :4], axis=1) != np.sort(corners, axis=1)).any():
        known = _longest_first(loaded.mesh.doflocs.T, corners)
    weights = (known[:, :4, None] == corners[:, None, :]).astype(float)
    zeros = np.zeros(count, np.int64)
    return _Cells(known[:, :4], known[:, 4:6], known[:, 6], np.arange(count), weights, zeros)


def _longest_first(points: Floats, corners: Ints) -> Ints:
    """Return corners, marks and flags (e, 7) with which every element and every face is cut at its longest edge."""
    ends, index = np.unique(np.sort(corners[:, _EDGES], axis=2).reshape(-1, 2), axis=0, return_inverse=True)
    length = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    # Of equally long edges that with the lowest nodes counts as the longest, so that rounding does not decide and
    # elements that share a face choose the same edge of it.
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
    """Bisect cells until none is due and none has an edge that another has cut; new nodes get numbers from `count`."""
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
    """Return both halves of each cell; `middle` (n,) int is the new node m between a and b."""
    planar = (cells.marks[:, 0] == cells.marks[:, 1]) & (cells.marks[:, 0] < 2)
    again = planar & (cells.flags == 1)
    weight = cells.weights[:, :2].mean(axis=1)
    halves = []
    for end in (0, 1):
        # The half has the corners end, m, c and d. Its refinement edge is the marked edge of its face end-c-d.
        corners = np.column_stack([cells.corners[:, end], middle, cells.corners[:, 2:]])
        weights = np.stack([cells.weights[:, end], weight, cells.weights[:, 2], cells.weights[:, 3]], axis=1)
        order = np.array([[0, 2, 1, 3], [0, 3, 1, 2], [2, 3, 1, 0]])[cells.marks[:, end]]
        # In its faces that contain m the marked edge is the one opposite to m. Only in the new face mcd it is another
        # one, at m, where the cell was planar and had the flag.
        marks = np.column_stack([np.ones(len(middle), np.int64), np.where(again, 0, 1)])
        halves.append(_Cells(
            np.take_along_axis(corners, order, axis=1), marks, (planar & ~again).astype(np.int64), cells.parents,
            np.take_along_axis(weights, order[:, :, None], axis=1), np.maximum(cells.due - 1, 0),
        ))  # fmt: skip
    return halves
