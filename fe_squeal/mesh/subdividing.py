"""A mesh whose elements are cut into children: on exactly the same domain, groups, surfaces and node sets kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import skfem

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
_PARTS = 64  # weights of corners at nodes of children are multiples of 1/64


def vtk_nodes(mesh: skfem.Mesh) -> tuple[str, Ints]:
    """Return the kind of a mesh's elements and their nodes (e, k), columns of `doflocs`, right-handed in VTK's order.

    Examples
    --------
    >>> kind, nodes = vtk_nodes(skfem.MeshTet())
    >>> kind, nodes.shape
    ('tetra', (5, 4))
    """
    kind = next(kind for kind, cls in MESH_CLASS.items() if mesh.elem is cls.elem)
    local = mesh.dofs.element_dofs if kind != SHAPE[kind] else mesh.t
    nodes = local.T[:, matching(REFERENCE[kind], np.asarray(mesh.elem.doflocs))].astype(np.int64)
    left = jacobian_range(kind, mesh.doflocs.T, nodes)[1] < 0  # scikit-fem sorts corners, some cells turn left-handed
    nodes[left] = nodes[left][:, mirror_order(kind)]
    return kind, nodes


def subdivide(
    loaded: LoadedMesh, nodes: Ints, parents: Ints, pattern: Ints, patterns: Floats
) -> tuple[LoadedMesh, Ints]:
    """Return the mesh of the children of a mesh's elements, and their nodes (n, k), columns of its `doflocs`.

    A child has its nodes where its parent's own map puts them. On a face this map depends on the nodes of the face
    alone, so that children of neighbours fit, on curved faces too, if they cut the shared face alike.

    Parameters
    ----------
    nodes : (e, k) int
        The elements' nodes, see `vtk_nodes`.
    parents : (n,) int
        Each child's parent, in ascending order, every element at least once.
    pattern : (n,) int
        Which of the patterns a child is.
    patterns : (p, k, 3) float
        Where the nodes of a child lie in its parent's reference cell, at multiples of 1/4 along each axis.

    Raises
    ------
    MeshError
        A curved element is so distorted that a part of it is inverted.
    """
    mesh, kind = loaded.mesh, next(kind for kind, cls in MESH_CLASS.items() if loaded.mesh.elem is cls.elem)
    points, corners, count = mesh.doflocs.T, nodes[:, : corner_count(kind)], nodes.shape[1]
    on_corners = shape_functions(SHAPE[kind], patterns.reshape(-1, 3)).reshape(*patterns.shape[:2], -1)
    weights = np.rint(_PARTS * on_corners).astype(np.uint64)  # (p, k, corners)
    on_nodes = shape_functions(kind, patterns.reshape(-1, 3)).reshape(*patterns.shape[:2], -1)
    # Nodes of two children are one if they are the same weighted mean of the same corners. The sum of the weights times
    # a random number per corner tells that: equal sums, equal means.
    numbers = np.random.default_rng(7).integers(1, 2**64, int(corners.max()) + 1, dtype=np.uint64)
    key, places = np.empty((len(parents), count), np.uint64), np.empty((len(parents), count, 3))
    order = np.argsort(pattern, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(pattern[order])) + 1):
        v, of = pattern[rows[0]], parents[rows]
        key[rows] = numbers[corners[of]] @ weights[v].T
        places[rows] = np.einsum("cn,enx->ecx", on_nodes[v], points[nodes[of]], optimize=True)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    children = index.reshape(-1, count).astype(np.int64)
    member = np.zeros(len(nodes), bool)
    groups = {}
    for name, elements in (mesh.subdomains or {}).items():
        member[:] = False
        member[elements] = True
        groups[name] = np.flatnonzero(member[parents])
    surfaces = {
        name: [_cut_faces(mesh, SHAPE[kind], np.asarray(facets), corners, parents, pattern, weights, children)]
        for name, facets in (mesh.boundaries or {}).items()
    }
    # Messages name the parents.
    labels = loaded.element_labels[parents] if len(loaded.element_labels) else np.arange(len(children))
    block = CellBlock(kind, children, labels)
    raw = RawMesh(places.reshape(-1, 3)[first], np.arange(len(first)), (block,), groups, surfaces)
    fine = build_mesh(raw, loaded.source)
    _, column = fine.node_numbers[""]
    depends = np.abs(on_nodes) > _ROUNDED

    def renewed(rows: Ints, between: bool) -> Ints:
        found = _stands_on(~np.isin(nodes, rows), parents, depends, pattern, children, between)
        return np.sort(column[np.unique(found)])

    refined = replace(
        fine, notes=loaded.notes, warnings=loaded.warnings, unusable=loaded.unusable, ignore_case=loaded.ignore_case,
        node_groups={
            name: NodeSet(renewed(group.nodes, False), renewed(group.held, True))
            for name, group in loaded.node_groups.items()
        },
        node_numbers={}, length_unit=loaded.length_unit,
    )  # fmt: skip
    return refined, column[children]


def _stands_on(
    outside: np.ndarray, parents: Ints, depends: np.ndarray, pattern: Ints, children: Ints, between: bool
) -> Ints:
    """Return the nodes (s,) of children that are in a set.

    Parameters
    ----------
    outside : (e, m) bool
        Which nodes of the parents are not in it.
    depends : (p, k, m) bool
        On which of these a displacement at the nodes of a pattern depends.
    between : bool
        Whether nodes between those of the set count, whose displacement depends on no other nodes.
    """
    near = np.flatnonzero(~np.all(outside, axis=1)[parents])
    own = depends[pattern[near]]
    rests = ~(own & outside[parents[near]][:, None, :]).any(axis=2)
    return np.asarray(children[near][rests & (between | (own.sum(axis=2) == 1))])


def _cut_faces(
    mesh: skfem.Mesh, shape: str, facets: Ints, corners: Ints, parents: Ints, pattern: Ints, weights: np.ndarray,
    children: Ints,
) -> Ints:  # fmt: skip
    """Return the corners of the children's faces that lie on facets."""
    owner, c = mesh.f2t[0, facets], corners.shape[1]
    on = (corners[owner][:, :, None] == mesh.facets[:, facets].T[:, None, :]).any(axis=2)
    start = np.searchsorted(parents, np.arange(len(corners) + 1))
    counts = start[owner + 1] - start[owner]
    facet = np.repeat(np.arange(len(facets)), counts)
    child = start[owner[facet]] + np.arange(len(facet)) - np.repeat(np.cumsum(counts) - counts, counts)
    # A corner of a child lies on the facet if it is a mean of the facet's own corners alone.
    there = (weights[pattern[child], :c] * on[facet][:, None, :]).sum(axis=2) == _PARTS
    return np.vstack([children[child[there[:, list(face)].all(axis=1)]][:, list(face)] for face in FACES[shape]])
