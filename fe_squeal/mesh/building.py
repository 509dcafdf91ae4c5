"""Build the checked mesh with its groups from what a reader gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import skfem

from fe_squeal.errors import MeshError

from .checking import FLAT, check_cells, check_points, drop_orphans, jacobian_range, orient_cells
from .elements import MESH_CLASS, SHAPE, SPOKEN, corner_count, skfem_order
from .groups import LoadedMesh, NodeSet
from .midside import complete_hexahedra, fill_midside
from .node_sets import node_set
from .raw import CellBlock, Floats, Ints, RawMesh, element_names, listed
from .splitting import split_cells, split_quadrilaterals
from .surfaces import adopt_duplicates, boundary_of_nodes, drop_loose, faces_of, find_rows


def build_mesh(raw: RawMesh, source: str, scale: float = 1.0) -> LoadedMesh:
    """Check what a reader gives and build the mesh from it.

    Elements become either all tetrahedra or all hexahedra, of one order: missing midside nodes are added, and where
    shapes are mixed or there are wedges or pyramids every element is split into tetrahedra.

    Parameters
    ----------
    raw : RawMesh
        What a reader gives.
    source : str
        The file's name, for messages.
    scale : float
        Metres in the file's unit of length.

    Raises
    ------
    MeshError
        There are no volume elements; coordinates are not finite; or elements are inverted, flat, listed twice, lack
        nodes, or share a node that is a corner of one and a midside node of another.
    """
    with np.errstate(over="ignore"):  # an overflow is caught as a coordinate that is not finite
        raw = replace(raw, points=np.asarray(raw.points, dtype=np.float64) * scale)
    check_points(raw, source)
    check_cells(raw, source)
    own = set(raw.surfaces)
    raw = drop_orphans(adopt_duplicates(raw))
    given = len(raw.points)
    points, blocks, note = _one_order(raw)
    raw, warnings = orient_cells(replace(raw, points=points, blocks=blocks, notes=raw.notes + note), source)
    faces = faces_of(raw)
    raw = drop_loose(raw, faces)
    surfaces, unusable = dict(raw.surfaces), dict(raw.unusable)
    for name, rows in raw.node_groups.items():
        if name in own:  # a surface of the file; if it is none of solids, the nodes of its name do not make it one
            continue
        parts = boundary_of_nodes(rows, faces, given)
        if any(len(part) for part in parts):
            surfaces[name] = parts
        else:
            unusable[name] = "the node set covers no whole face of the boundary"
    points, block, parent, note = _one_kind(raw, source)
    mesh = _assemble(points, block, source, element_names(raw.blocks)[parent])
    mesh = replace(
        mesh,
        _subdomains={name: _children(cells, parent) for name, cells in raw.volume_groups.items() if len(cells)},
        _boundaries=_facet_groups(mesh, block, surfaces, split=block.kind.startswith("tetra")),
    )
    return LoadedMesh(
        mesh,
        source,
        (*raw.notes, *note),
        tuple(warnings),
        element_names(raw.blocks)[parent],
        unusable,
        raw.ignore_case,
        *_nodes(mesh, block, raw, given),
        raw.length_unit,
    )


def _one_order(raw: RawMesh) -> tuple[Floats, tuple[CellBlock, ...], tuple[str, ...]]:
    """Return points, blocks and notes with cells of one order.

    If there are both linear and quadratic cells, or quadratic ones that lack midside nodes, all become quadratic.
    """
    linear = sum(len(b) for b in raw.blocks if b.kind == SHAPE[b.kind])
    total = sum(len(b) for b in raw.blocks)
    bare = sum(int((b.nodes < 0).any(axis=1).sum()) for b in raw.blocks)
    if linear == total or (linear == 0 and bare == 0):
        return raw.points, raw.blocks, ()
    points, blocks = fill_midside(raw.points, raw.blocks)
    notes = []
    if linear:
        notes.append(f"{linear} linear elements beside quadratic ones are given midside nodes on their edges")
    if bare:
        notes.append(f"{bare} elements without some of their midside nodes are given them on their edges")
    return points, blocks, tuple(notes)


def _one_kind(raw: RawMesh, source: str) -> tuple[Floats, CellBlock, Ints, tuple[str, ...]]:
    """Return one block of tetrahedra or hexahedra, the cell that each came from, and a note if cells were split."""
    shapes = list(dict.fromkeys(SHAPE[block.kind] for block in raw.blocks))
    total = sum(len(block) for block in raw.blocks)
    if shapes == ["hexahedron"] or shapes == ["tetra"]:
        points, blocks = raw.points, raw.blocks
        if any(block.kind == "hexahedron20" for block in blocks):
            points, blocks = complete_hexahedra(points, blocks)
        nodes = np.vstack([block.nodes for block in blocks])
        return points, CellBlock(blocks[0].kind, nodes, np.arange(total)), np.arange(total), ()
    points, block, parent = split_cells(raw.points, raw.blocks)
    low = jacobian_range(block.kind, points, block.nodes)[0]
    if (low < FLAT).any():
        bad = np.unique(parent[low < FLAT])
        what = "element" if len(bad) == 1 else "elements"
        raise MeshError(
            f"{source}: {what} {listed(element_names(raw.blocks)[bad])} cannot be split into "
            "tetrahedra of positive volume (too distorted or curved); mesh with tetrahedra or hexahedra alone"
        )
    counts = {shape: sum(len(b) for b in raw.blocks if SHAPE[b.kind] == shape) for shape in shapes}
    notes = [
        f"{counts[shape]} {SPOKEN[shape]} split into {int((shape_of(raw)[parent] == shape).sum())} tetrahedra"
        for shape in shapes
        if shape != "tetra"
    ]
    if block.kind == "tetra10":
        notes.append(
            "the tetrahedra keep all nodes and curved edges; between the edges a curved surface changes slightly"
        )
    return points, block, parent, tuple(notes)


def shape_of(raw: RawMesh) -> np.ndarray:
    """Return the shape (n,) str of each cell, such as "tetra", for all blocks one after the other."""
    return np.concatenate([np.full(len(block), SHAPE[block.kind]) for block in raw.blocks])


def _assemble(points: Floats, block: CellBlock, source: str, names: np.ndarray) -> skfem.Mesh:
    """Return the scikit-fem mesh of a block; `names` (n,) str are what messages call its elements.

    scikit-fem gives the nodes of quadratic elements new numbers, the corners first in the order of their old ones.

    Raises
    ------
    MeshError
        Neighbours have different corners on an edge that they share, or midside nodes at different places.
    """
    ordered = block.nodes[:, skfem_order(block.kind)]
    used, corners = np.unique(ordered[:, : corner_count(block.kind)], return_inverse=True)
    cells = corners.reshape(len(ordered), -1).T.astype(np.int32).copy()
    mesh = MESH_CLASS[block.kind](points[used].T.copy(), cells)
    if block.kind == SHAPE[block.kind]:
        return mesh
    # scikit-fem keeps one node per corner, edge, face and cell.
    own = mesh.dofs.element_dofs.T
    place = np.empty(int(ordered.max()) + 1, np.int64)
    place[ordered] = own
    shared = np.unique(ordered[place[ordered] != own])
    bad = np.flatnonzero(np.isin(ordered, shared).any(axis=1))
    if len(bad):
        raise MeshError(
            f"{source}: elements {listed(names[bad])} have a node that is a corner of one and a midside node of another"
            ", or a midside node of two edges or faces; expected neighbours with the same corners, not a large element"
            " beside two small ones, nor nodes merged by mistake"
        )
    # So the midside nodes of neighbours have to be at the same place.
    given = points[ordered]
    places = np.empty((mesh.dofs.N, 3))
    places[own] = given
    apart = np.abs(places[own] - given).max(axis=(1, 2))
    bad = np.flatnonzero(apart > 1e-6 * np.ptp(given, axis=1).max(axis=1))
    if len(bad):
        raise MeshError(
            f"{source}: elements {listed(names[bad])} share an edge or face with a neighbour whose midside node there "
            "lies elsewhere; the mesh has a gap, merge the midside nodes"
        )
    return replace(mesh, doflocs=places.T.copy())


def _facet_groups(
    mesh: skfem.Mesh, block: CellBlock, surfaces: Mapping[str, list[Ints]], split: bool
) -> dict[str, Ints]:
    """Return the facet indices of each surface group.

    With `split` the cells have been split into tetrahedra, and each quadrilateral stands for its two triangles.
    """
    used = np.unique(block.nodes[:, : corner_count(block.kind)])
    groups = {}
    size = mesh.facets.shape[0]
    for name, parts in surfaces.items():
        triangles = [split_quadrilaterals(p) if split and p.shape[1] == 4 else p for p in parts if len(p)]
        if triangles:
            rows = np.vstack([p for p in triangles if p.shape[1] == size])
            groups[name] = rows
    if not groups:
        return {}
    # All groups are looked up at once: sorting the mesh's facets takes most of the time, and is done once so.
    every = np.searchsorted(used, np.vstack(list(groups.values())))
    found = find_rows(every, mesh.facets.T.astype(np.int64))
    ends = np.cumsum([len(rows) for rows in groups.values()])
    return {name: np.unique(part) for name, part in zip(groups, np.split(found, ends[:-1]), strict=True)}


def _nodes(
    mesh: skfem.Mesh, block: CellBlock, raw: RawMesh, given: int
) -> tuple[dict[str, NodeSet], dict[str, tuple[Ints, Ints]], np.ndarray]:
    """Return `node_groups`, `node_numbers` and `added` of a `LoadedMesh`.

    Parameters
    ----------
    given : int
        How many of the first points are nodes of the file; those behind were added as midside nodes and centres.
    """
    place = np.full(int(block.nodes.max()) + 1, -1)
    if block.kind == SHAPE[block.kind]:
        used = np.unique(block.nodes)
        place[used] = np.arange(len(used))
    else:
        place[block.nodes[:, skfem_order(block.kind)]] = mesh.dofs.element_dofs.T
    count = mesh.doflocs.shape[1]
    added = np.ones(count, dtype=bool)
    known = place[:given]
    added[known[known >= 0]] = False
    groups = {}
    for name, rows in raw.node_groups.items():
        rows = rows[rows < len(place)]
        found = np.unique(place[rows][place[rows] >= 0])
        if len(found):
            groups[name] = node_set(mesh, found, added)
            if name in raw.held_nodes:
                groups[name] = NodeSet(found, np.union1d(groups[name].held, place[raw.held_nodes[name]]))
    numbers = {}
    ends = [first for first, _ in raw.node_prefixes[1:]] + [len(known)]
    for (first, prefix), end in zip(raw.node_prefixes, ends, strict=True):
        rows = first + np.flatnonzero(known[first:end] >= 0)
        if len(rows):
            numbers[prefix] = (raw.node_labels[rows], known[rows])
    return groups, numbers, added


def _children(cells: Ints, parent: Ints) -> Ints:
    """Return the elements that came from some cells; `parent` (m,) is the cell of each element."""
    member = np.zeros(parent.max(initial=-1) + 1, dtype=bool)
    member[cells] = True
    return np.flatnonzero(member[parent])
