"""Uniform refinement: every element is cut into eight; domain, groups, surfaces and node sets stay the same."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np

from .elements import REFERENCE, SHAPE, corner_count, shape_functions
from .groups import LoadedMesh
from .raw import Floats, Ints
from .subdividing import subdivide, vtk_nodes

# Cutting off the four corners of a tetrahedron leaves an octahedron, which one of its three diagonals cuts into four
# tetrahedra. A diagonal joins the middles of two opposite edges; its ring are the middles of the other four, in turn.
_DIAGONALS = (((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2)))
_RINGS = (
    ((0, 2), (1, 2), (1, 3), (0, 3)),
    ((0, 1), (1, 2), (2, 3), (0, 3)),
    ((0, 1), (1, 3), (2, 3), (0, 2)),
)


def refine(loaded: LoadedMesh) -> LoadedMesh:
    """Return the mesh with every element cut into eight at the middles of its edges.

    Element i becomes the elements 8 i to 8 i + 7. Curved sides are kept: the nodes of a child are where the parent's
    own map has them. So both meshes fill the same domain, and every displacement that the elements of the coarse mesh
    can represent can be represented on the fine one. In a tetrahedron the inner octahedron is cut along the shortest of
    its three diagonals, which keeps the shape of the children good (S. Zhang, Houston J. Math. 21, 1995).

    Parameters
    ----------
    loaded : LoadedMesh
        Mesh of tetrahedra or hexahedra, straight or curved.

    Raises
    ------
    MeshError
        A curved element is so distorted that a part of it is inverted.

    Examples
    --------
    >>> import skfem
    >>> from .from_python import from_skfem
    >>> refine(from_skfem(skfem.MeshTet().refined(1))).mesh.nelements
    320
    """
    kind, nodes = vtk_nodes(loaded.mesh)
    variant = np.zeros(len(nodes), int)
    if SHAPE[kind] == "tetra":
        variant = _shortest_diagonal(loaded.mesh.doflocs.T, nodes[:, : corner_count(kind)])
    pattern = 8 * variant[:, None] + np.arange(8)
    patterns = _children(kind).reshape(-1, len(REFERENCE[kind]), 3)
    return subdivide(loaded, nodes, np.repeat(np.arange(len(nodes)), 8), pattern.ravel(), patterns)[0]


@cache
def _children(kind: str) -> Floats:
    """Return the reference coordinates (variants, 8, k, 3), in the parent, of the k nodes of its eight children.

    Nodes are in VTK's order. A tetrahedron has three variants, one for each diagonal; a hexahedron has one.
    """
    if SHAPE[kind] == "hexahedron":
        return np.array([[(REFERENCE[kind] + offset) / 2 for offset in product((0, 1), repeat=3)]])
    corner = REFERENCE["tetra"]

    def middle(edge: tuple[int, int]) -> Floats:
        return np.asarray(corner[list(edge)].mean(axis=0))

    outer = [np.array([corner[a] if a == b else middle((a, b)) for b in range(4)]) for a in range(4)]
    found = []
    for (first, last), ring in zip(_DIAGONALS, _RINGS, strict=True):
        inner = []
        for a, b in zip(ring, (*ring[1:], ring[0]), strict=True):
            cell = np.array([middle(first), middle(last), middle(a), middle(b)])
            if np.linalg.det(cell[1:] - cell[0]) < 0:
                cell[[2, 3]] = cell[[3, 2]]
            inner.append(cell)
        found.append([shape_functions("tetra", REFERENCE[kind]) @ cell for cell in (*outer, *inner)])
    return np.array(found)


def _shortest_diagonal(points: Floats, corners: Ints) -> Ints:
    """Return for each tetrahedron (e,) which of `_DIAGONALS` is the shortest."""
    x = points[corners]
    ends = [[x[:, list(edge)].mean(axis=1) for edge in pair] for pair in _DIAGONALS]
    return np.asarray(np.argmin([np.linalg.norm(a - b, axis=1) for a, b in ends], axis=0))
