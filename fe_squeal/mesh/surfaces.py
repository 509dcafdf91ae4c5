"""Surface groups: find the cells or nodes that a file lists for them among the faces of the volume cells."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from .elements import EDGES, FACES, SHAPE, corner_count
from .midside import row_ids
from .raw import Floats, Ints, RawMesh, listed

# Times the shortest edge of a face: nodes of a surface and of the volume that are nearer to each other are the same.
TOLERANCE = 1e-4
_OWN = "; expected faces of the volume mesh, on its own nodes"


@dataclass(frozen=True)
class Faces:
    """All faces of the volume cells with three corners, or all with four.

    Attributes
    ----------
    corners : (m, 3) or (m, 4) int
        Corner nodes of the faces; a face between two cells is listed twice.
    mids : (m, 3) or (m, 4) int
        Midside nodes of the faces, -1 where there are none.
    cells : (m,) int
        The cell of each face.
    boundary : (m,) bool
        Whether only one cell has the face.
    """

    corners: Ints
    mids: Ints
    cells: Ints
    boundary: np.ndarray


def faces_of(raw: RawMesh) -> dict[int, Faces]:
    """Return all faces of the volume cells, under the keys 3 and 4: their number of corners."""
    parts: dict[int, list[tuple[Ints, Ints, Ints]]] = {3: [], 4: []}
    at = 0
    for block in raw.blocks:
        shape, count = SHAPE[block.kind], corner_count(block.kind)
        edges = {frozenset(edge): count + i for i, edge in enumerate(EDGES[shape])}
        for face in FACES[shape]:
            local = [edges[frozenset((a, b))] for a, b in zip(face, face[1:] + face[:1], strict=True)]
            mids = block.nodes[:, local] if block.kind != shape else np.full((len(block), len(face)), -1)
            parts[len(face)].append((block.nodes[:, face], mids, at + np.arange(len(block))))
        at += len(block)
    out = {}
    for size, some in parts.items():
        corners, mids = (np.concatenate([np.empty((0, size), np.int64), *(p[i] for p in some)]) for i in (0, 1))
        ids = row_ids(corners)
        boundary = np.bincount(ids, minlength=1)[ids] == 1
        out[size] = Faces(corners, mids, np.concatenate([np.empty(0, np.int64), *(p[2] for p in some)]), boundary)
    return out


def find_rows(wanted: Ints, table: Ints) -> Ints:
    """Return (n,) for each row of `wanted` the number of a row of `table` with the same members, -1 if there is none.

    Examples
    --------
    >>> find_rows(np.array([[3, 1, 2], [7, 8, 9]]), np.array([[0, 1, 2], [1, 2, 3]]))
    array([ 1, -1])
    """
    if not len(table):
        return np.full(len(wanted), -1)
    ids = row_ids(np.vstack([table, wanted]))
    place = np.full(ids.max(initial=-1) + 1, -1)
    place[ids[: len(table)]] = np.arange(len(table))
    return place[ids[len(table) :]]


def boundary_of_nodes(rows: Ints, faces: dict[int, Faces], given: int) -> list[Ints]:
    """Return the corners of the boundary faces all of whose nodes are in a set of nodes, triangles and quadrilaterals.

    Nodes that the file does not have, and that were added to its cells, are not asked for. If the set has no midside
    nodes, as sets of some programs, the corners of a face suffice.

    Parameters
    ----------
    rows : (n,) int
        The nodes of the set.
    faces : dict
        As `faces_of` returns them.
    given : int
        Number of the nodes of the file; those behind them were added.
    """
    member = np.zeros(given + 1, dtype=bool)  # the last entry stands for "no node of the file"
    member[rows] = True
    held = []
    for some in faces.values():
        inside = some.boundary & member[some.corners].all(axis=1)
        held.append((some, inside))
    mids = [np.where(some.mids < given, some.mids, -1) for some, _ in held]
    if any(member[own].any() for own in mids):
        all_in = [(member[own] | (own < 0)).all(axis=1) for own in mids]
        held = [(some, inside & whole) for (some, inside), whole in zip(held, all_in, strict=True)]
    return [some.corners[inside] for some, inside in held]


def adopt_duplicates(raw: RawMesh) -> RawMesh:
    """Return the mesh with surface cells on the nodes of the volume cells, where they had nodes of their own.

    Some writers of .vtu give each cell its own copy of the nodes. A copy is replaced by the volume's node at the same
    place. A group becomes `unusable` where the volume has no node at a place, as on shells, or two bodies have faces
    there, so that the body is not known. Call it before `drop_orphans`, which would drop the copies.
    """
    used = np.zeros(len(raw.points), dtype=bool)
    for block in raw.blocks:
        used[block.nodes[block.nodes >= 0]] = True
    strays = {name for name, parts in raw.surfaces.items() if any(not used[part].all() for part in parts)}
    if not strays or not np.isfinite(raw.points).all():
        return raw
    faces = faces_of(raw)
    place = np.full(len(raw.points), -1)
    # Where two bodies touch, a node of each is at the same place, and a face found by its place may belong to either.
    corners = np.unique(np.concatenate([some.corners.ravel() for some in faces.values()]))
    reach = TOLERANCE * min(_shortest(raw.points, some.corners) for some in faces.values() if len(some.corners))
    near = cKDTree(raw.points[corners]).query_pairs(reach, output_type="ndarray")
    graph = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(corners),) * 2)
    place[corners] = connected_components(graph, directed=False)[1]
    rows = corners  # surface cells are compared with faces by their corners
    tree = cKDTree(raw.points[rows])
    surfaces, loose = dict(raw.surfaces), {}
    for name in sorted(strays):
        moved = [_moved(raw, part, tree, rows, place, faces[part.shape[1]]) for part in surfaces[name]]
        reasons = [part for part in moved if isinstance(part, str)]
        if reasons:
            loose[name] = reasons[0]
        surfaces[name] = [part for part in moved if not isinstance(part, str)]
    found = sorted(strays - set(loose))
    note = "surface groups with nodes of their own are matched to the volume by coordinates: " + listed(found)
    notes = (*raw.notes, note) if found else raw.notes
    return _without(replace(raw, surfaces=surfaces, notes=notes), loose)


def _moved(raw: RawMesh, part: Ints, tree: cKDTree, rows: Ints, place: Ints, faces: Faces) -> Ints | str:
    """Return surface cells (n, k) int on the nodes of the volume cells, or why they cannot be moved there.

    Parameters
    ----------
    part : (n, k) int
        Corners of the surface cells.
    tree : cKDTree
        Of the points in `rows`.
    rows : (m,) int
        The corners of all volume cells.
    place : (nodes,) int
        A number for each of `rows`; those at the same place have the same one.
    faces : Faces
        Those with k corners.
    """
    edge = np.linalg.norm(raw.points[part] - raw.points[np.roll(part, 1, axis=1)], axis=2).min(axis=1)
    distance, nearest = tree.query(raw.points[part])
    far = (distance > TOLERANCE * edge[:, None]).any(axis=1)
    if far.any():
        return f"{int(far.sum())} of its {len(part)} cells lie on no face of a volume element{_OWN}"
    found = place[rows[nearest]]
    table, own = place[faces.corners[faces.boundary]], faces.corners[faces.boundary]
    index, ids = find_rows(found, table), row_ids(np.vstack([table, found]))
    owners = np.bincount(ids[: len(table)], minlength=ids.max(initial=-1) + 1)[ids[len(table) :]]
    if (owners > 1).any():
        return (
            "it has nodes of its own and lies where two bodies touch, so the body it belongs to is not known; give it"
            " on the nodes of that body"
        )
    return np.where((index >= 0)[:, None], own[np.maximum(index, 0)] if len(own) else found, rows[nearest])


def drop_loose(raw: RawMesh, faces: dict[int, Faces]) -> RawMesh:
    """Return the mesh with surface groups that have cells on no face of a volume element made `unusable`."""
    loose: dict[str, str] = {}
    for size, some in faces.items():
        own = {name: [part for part in parts if part.shape[1] == size] for name, parts in raw.surfaces.items()}
        stacked = {name: np.vstack(parts) for name, parts in own.items() if parts}
        if not stacked:
            continue
        # All groups are looked up at once: sorting the faces takes most of the time, and is done once so.
        lost = find_rows(np.vstack(list(stacked.values())), some.corners) < 0
        ends = np.cumsum([len(part) for part in stacked.values()])
        for (name, part), bad in zip(stacked.items(), np.split(lost, ends[:-1]), strict=True):
            if bad.any():
                kind = "triangles" if size == 3 else "quadrilaterals"
                loose[name] = f"{int(bad.sum())} of its {len(part)} {kind} are no face of a volume element{_OWN}"
    return _without(raw, loose)


def _without(raw: RawMesh, loose: dict[str, str]) -> RawMesh:
    """Return the mesh with some surface groups, by name with the reason, made `unusable`, and a note of them."""
    if not loose:
        return raw
    return replace(
        raw,
        surfaces={name: parts for name, parts in raw.surfaces.items() if name not in loose},
        unusable={**raw.unusable, **loose},
        notes=(*raw.notes, f"surface groups that are not made of faces of solids are left out: {listed(list(loose))}"),
    )


def _shortest(points: Floats, corners: Ints) -> float:
    """Return the length of the shortest edge of some faces."""
    return float(np.linalg.norm(points[corners] - points[np.roll(corners, 1, axis=1)], axis=2).min())
