"""Uniform refinement: every element into eight, on exactly the same domain, groups kept."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np

from .elements import REFERENCE, SHAPE, corner_count, shape_functions
from .groups import LoadedMesh
from .raw import Floats, Ints
from .subdividing import subdivide, vtk_nodes

# The inner octahedron's diagonals, by the pairs of opposite edges whose middles they join, and the ring about each.
_DIAGONALS = (((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2)))
_RINGS = (
    ((0, 2), (1, 2), (1, 3), (0, 3)),
    ((0, 1), (1, 2), (2, 3), (0, 3)),
    ((0, 1), (1, 3), (2, 3), (0, 2)),
)


def refine(loaded: LoadedMesh) -> LoadedMesh:
    """Cut every element into eight at the middles of its edges; element i becomes elements 8 i ... 8 i + 7.

    Curved sides are kept: a child has its nodes where its parent's own map puts them, so that both meshes fill the same
    domain and a field on the coarse one is also one on the fine one. Of the three diagonals that can part a
    tetrahedron's inner octahedron the shortest is taken, which keeps the children in good shape (Zhang, Houston J.
    Math. 21, 1995).

    Examples
    --------
    >>> import skfem
    >>> from .building import from_skfem
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
    """Return (variants, 8, k, 3) where the nodes of the children lie in the parent, in VTK's order."""
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
    x = points[corners]
    ends = [[x[:, list(edge)].mean(axis=1) for edge in pair] for pair in _DIAGONALS]
    return np.asarray(np.argmin([np.linalg.norm(a - b, axis=1) for a, b in ends], axis=0))
