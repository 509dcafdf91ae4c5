"""Uniform refinement: every element into eight, on exactly the same domain, groups kept."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np

from .building import build_mesh
from .checking import jacobian_range
from .elements import (
    FACES,
    MESH_CLASS,
    REFERENCE,
    SHAPE,
    corner_count,
    matching,
    mirror_order,
    shape_functions,
)  # fmt: skip
from .groups import LoadedMesh, NodeSet
from .raw import CellBlock, Floats, Ints, RawMesh

_ROUNDED = 1e-9  # of shape functions, which are of order one
_PARTS = 64  # weights of corners at nodes of children are multiples of 1/64 (of 1/4 for tetrahedra)
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
    mesh = loaded.mesh
    kind = next(kind for kind, cls in MESH_CLASS.items() if mesh.elem is cls.elem)
    local = mesh.dofs.element_dofs if kind != SHAPE[kind] else mesh.t
    nodes = local.T[:, matching(REFERENCE[kind], np.asarray(mesh.elem.doflocs))].astype(np.int64)
    points = mesh.doflocs.T
    left = jacobian_range(kind, points, nodes)[1] < 0  # scikit-fem sorts corners, so that cells may be left-handed
    nodes[left] = nodes[left][:, mirror_order(kind)]
    corners = nodes[:, : corner_count(kind)]
    variant = _shortest_diagonal(points, corners) if SHAPE[kind] == "tetra" else np.zeros(len(nodes), int)
    weights = np.rint(_PARTS * _on_corners(kind)).astype(np.uint64)  # (variants, 8, k, corners)
    # Nodes of two children are one if they are the same weighted mean of the same corners. The sum of the weights times
    # a random number per corner tells that: equal sums, equal means.
    numbers = np.random.default_rng(7).integers(1, 2**64, int(corners.max()) + 1, dtype=np.uint64)
    count = weights.shape[2]
    key, places = np.empty((len(nodes), 8 * count), np.uint64), np.empty((len(nodes), 8 * count, 3))
    for v in np.unique(variant):
        which = variant == v
        key[which] = numbers[corners[which]] @ weights[v].reshape(8 * count, -1).T
        phi = shape_functions(kind, _children(kind)[v].reshape(-1, 3))
        places[which] = np.einsum("cn,enx->ecx", phi, points[nodes[which]], optimize=True)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    children = index.reshape(-1, count).astype(np.int64)
    groups = {n: (8 * np.asarray(c)[:, None] + np.arange(8)).ravel() for n, c in (mesh.subdomains or {}).items()}
    surfaces = {
        name: [_cut_faces(loaded, SHAPE[kind], np.asarray(facets), corners, weights, variant, children)]
        for name, facets in (mesh.boundaries or {}).items()
    }
    labels = np.repeat(loaded.element_labels, 8) if len(loaded.element_labels) else np.arange(len(children)).astype(str)
    cells = CellBlock(kind, children, np.arange(len(children)))
    sets = {
        name: [_refined_set(kind, nodes, rows, variant, index.reshape(len(nodes), -1), new) for rows, new in (
            (group.nodes, False), (group.held, True))]
        for name, group in loaded.node_groups.items()
    }  # fmt: skip
    raw = RawMesh(places.reshape(-1, 3)[first], np.arange(len(first)), (cells,), groups, surfaces)
    fine = build_mesh(raw, loaded.source)
    _, column = fine.node_numbers[""]
    node_sets = {name: NodeSet(*(np.sort(column[rows]) for rows in pair)) for name, pair in sets.items()}
    return replace(
        fine, notes=loaded.notes, warnings=loaded.warnings, element_labels=labels, unusable=loaded.unusable,
        ignore_case=loaded.ignore_case, node_groups=node_sets, node_numbers={},
    )  # fmt: skip


def _refined_set(kind: str, nodes: Ints, rows: Ints, variant: Ints, places: Ints, new: bool) -> Ints:
    """Return the nodes of a set on the refined mesh.

    Parameters
    ----------
    nodes : (e, k) int
        Of the elements.
    rows : (m,) int
        The set.
    places : (e, 8 k) int
        The children's nodes by element.
    new : bool
        Whether places count between nodes of the set, those whose displacement depends on no other nodes.
    """
    outside = ~np.isin(nodes, rows)
    near = np.flatnonzero(~outside.all(axis=1))
    found = [np.empty(0, np.int64)]
    for v in np.unique(variant[near]):
        some = near[variant[near] == v]
        depends = np.abs(shape_functions(kind, _children(kind)[v].reshape(-1, 3))) > _ROUNDED
        rests = outside[some].astype(float) @ depends.T == 0
        found.append(places[some][rests & (new | (depends.sum(axis=1) == 1))])
    return np.unique(np.concatenate(found))


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


@cache
def _on_corners(kind: str) -> Floats:
    """Return (variants, 8, k, corners) the weights of the parent's corners at these nodes."""
    X = _children(kind)
    return shape_functions(SHAPE[kind], X.reshape(-1, 3)).reshape(*X.shape[:-1], -1)


def _shortest_diagonal(points: Floats, corners: Ints) -> Ints:
    x = points[corners]
    ends = [[x[:, list(edge)].mean(axis=1) for edge in pair] for pair in _DIAGONALS]
    return np.asarray(np.argmin([np.linalg.norm(a - b, axis=1) for a, b in ends], axis=0))


def _cut_faces(
    loaded: LoadedMesh, shape: str, facets: Ints, corners: Ints, weights: np.ndarray, variant: Ints, children: Ints
) -> Ints:
    """Return the corners of the children's faces that lie on facets."""
    mesh = loaded.mesh
    parent, c = mesh.f2t[0, facets], corners.shape[1]
    on = (corners[parent][:, :, None] == mesh.facets[:, facets].T[:, None, :]).any(axis=2)
    # A corner of a child lies on the facet if it is a mean of the facet's own corners alone.
    there = (weights[variant[parent], :, :c] * on[:, None, None, :]).sum(axis=3) == _PARTS
    found = []
    for face in FACES[shape]:
        f, child = np.nonzero(there[:, :, list(face)].all(axis=2))
        found.append(children[8 * parent[f] + child][:, list(face)])
    return np.vstack(found)
