"""Make the mesh of the children that elements are cut into: domain, groups, surfaces and node sets stay the same."""

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

_ROUNDED = 1e-9  # values of shape functions below this are zero, up to rounding
# The linear (in hexahedra trilinear) shape functions of a parent's corners are multiples of 1/_PARTS at the nodes of
# its children. In hexahedra these are at multiples of 1/4 along each axis; in tetrahedra bisection stays far from 1/64.
_PARTS = 64


def vtk_nodes(mesh: skfem.Mesh) -> tuple[str, Ints]:
    """Return the kind of a mesh's elements, and their nodes (e, k) int in VTK's order, as columns of `mesh.doflocs`.

    All elements are right-handed in this order.

    Examples
    --------
    >>> kind, nodes = vtk_nodes(skfem.MeshTet())
    >>> kind, nodes.shape
    ('tetra', (5, 4))
    """
    kind = next(kind for kind, cls in MESH_CLASS.items() if mesh.elem is cls.elem)
    local = mesh.dofs.element_dofs if kind != SHAPE[kind] else mesh.t
    nodes = local.T[:, matching(REFERENCE[kind], np.asarray(mesh.elem.doflocs))].astype(np.int64)
    left = jacobian_range(kind, mesh.doflocs.T, nodes)[1] < 0  # scikit-fem sorts corners: some cells are left-handed
    nodes[left] = nodes[left][:, mirror_order(kind)]
    return kind, nodes


def subdivide(
    loaded: LoadedMesh, nodes: Ints, parents: Ints, pattern: Ints, patterns: Floats
) -> tuple[LoadedMesh, Ints]:
    """Return the mesh of the children of a mesh's elements, and the nodes of the children.

    The nodes of a child are where its parent's own map has them. On a face this map depends on the nodes of the face
    alone. So the children of neighbours fit together, on curved faces too, if both parents cut the shared face alike.

    Parameters
    ----------
    loaded : LoadedMesh
        The mesh of the parents, with e elements of k nodes.
    nodes : (e, k) int
        The nodes of its elements, see `vtk_nodes`.
    parents : (n,) int
        The parent of each child, in ascending order; every element has at least one child.
    pattern : (n,) int
        Which of the p patterns each child has.
    patterns : (p, k, 3) float
        The patterns: reference coordinates, in the parent, of the nodes of a child. The linear (in hexahedra trilinear)
        shape functions of the parent's corners have to be multiples of 1/64 there.

    Returns
    -------
    refined : LoadedMesh
        The mesh of the children.
    children : (n, k) int
        The nodes of each child, in the order of its pattern, as columns of `refined.mesh.doflocs`.

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
    # Nodes of two children are the same node if they are the same weighted mean of the same corners. To compare means,
    # each corner gets a random 64-bit number: the weighted sums of these are equal where the means are.
    numbers = np.random.default_rng(7).integers(1, 2**64, int(corners.max()) + 1, dtype=np.uint64)
    key, places = np.empty((len(parents), count), np.uint64), np.empty((len(parents), count, 3))
    order = np.argsort(pattern, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(pattern[order])) + 1):
        v, of = pattern[rows[0]], parents[rows]
        key[rows] = numbers[corners[of]] @ weights[v].T
        places[rows] = np.einsum("cn,enx->ecx", on_nodes[v], points[nodes[of]], optimize=True)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    # Nodes are numbered as the children meet them, so that neighbours have near numbers: matrices act twice as fast so.
    seen = np.argsort(first)
    number = np.empty(len(first), np.int64)
    number[seen] = np.arange(len(first))
    children = number[index].reshape(-1, count)
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
    # Children are labelled with the numbers of their parents, so that messages name elements of the file.
    labels = loaded.element_labels[parents] if len(loaded.element_labels) else np.arange(len(children))
    block = CellBlock(kind, children, labels)
    raw = RawMesh(places.reshape(-1, 3)[first[seen]], np.arange(len(first)), (block,), groups, surfaces)
    fine = build_mesh(raw, loaded.source)
    _, column = fine.node_numbers[""]
    depends = np.abs(on_nodes) > _ROUNDED

    def renewed(rows: Ints, between: bool) -> Ints:
        outside = np.ones(len(points), bool)
        outside[rows] = False
        found = _stands_on(outside[nodes], parents, depends, pattern, children, between)
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
    """Return the nodes (s,) int of the refined mesh that belong to a node set of the given mesh.

    These are the nodes of the set themselves and, with `between`, all nodes whose displacement depends on nodes of the
    set alone.

    Parameters
    ----------
    outside : (e, m) bool
        Which of its m nodes each element of the given mesh has outside of the set.
    parents, pattern : (n,) int
        As for `subdivide`.
    depends : (p, k, m) bool
        On which of the parent's m nodes a displacement at each of the k nodes of a pattern depends.
    children : (n, k) int
        The nodes of the children.
    between : bool
    """
    near = np.flatnonzero(~np.all(outside, axis=1)[parents])
    own = depends[pattern[near]]
    rests = ~(own & outside[parents[near]][:, None, :]).any(axis=2)
    return np.asarray(children[near][rests & (between | (own.sum(axis=2) == 1))])


def _cut_faces(
    mesh: skfem.Mesh, shape: str, facets: Ints, corners: Ints, parents: Ints, pattern: Ints, weights: np.ndarray,
    children: Ints,
) -> Ints:  # fmt: skip
    """Return the corners (f, 3 or 4) of the faces of children that lie on some facets of the given mesh.

    Parameters
    ----------
    facets : (g,) int
        The facets of `mesh`.
    corners : (e, c) int
        Corner nodes of its elements.
    parents, pattern, children
        As for `subdivide`.
    weights : (p, k, c) int
        Shape functions of the parent's corners at the nodes of each pattern, times `_PARTS`.
    """
    owner, c = mesh.f2t[0, facets], corners.shape[1]
    on = (corners[owner][:, :, None] == mesh.facets[:, facets].T[:, None, :]).any(axis=2)
    start = np.searchsorted(parents, np.arange(len(corners) + 1))
    counts = start[owner + 1] - start[owner]
    facet = np.repeat(np.arange(len(facets)), counts)
    child = start[owner[facet]] + np.arange(len(facet)) - np.repeat(np.cumsum(counts) - counts, counts)
    # A corner of a child lies on a facet of its parent if it is a weighted mean of this facet's corners alone.
    there = (weights[pattern[child], :c] * on[facet][:, None, :]).sum(axis=2) == _PARTS
    return np.vstack([children[child[there[:, list(face)].all(axis=1)]][:, list(face)] for face in FACES[shape]])
