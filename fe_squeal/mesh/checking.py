"""Checks of nodes and cells that every mesh has to pass before anything is computed on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fe_squeal.errors import MeshError

from .elements import REFERENCE, SHAPE, SPOKEN, corner_count, mirror_order, quadrature, shape_gradients
from .midside import row_ids
from .raw import CellBlock, Floats, Ints, RawMesh, element_names, listed, rows_of

# Of the cube of a cell's extent: a cell with a smaller det J counts as flat. Chosen; rounding makes errors of 1e-15.
FLAT = 1e-10
_FARTHEST = 1e20  # m: with larger coordinates their products could overflow
_CHUNK = 20_000  # cells at a time, so that the Jacobians stay within some tens of MiB


def groups_of(raw: RawMesh, cells: Ints) -> str:
    """Return ' (group "pad")', for a message, with the volume groups that hold some of the cells; "" if none does."""
    names = [name for name, members in raw.volume_groups.items() if np.isin(cells, members).any()]
    if not names:
        return ""
    return f" (group{'s' if len(names) > 1 else ''} " + ", ".join(f'"{name}"' for name in names[:3]) + ")"


def jacobian_range(kind: str, points: Floats, nodes: Ints) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the range of det J over each cell, divided by the cube of the cell's extent.

    Parameters
    ----------
    kind : str
        Kind of the cells, a key of `elements.REFERENCE`.
    points : (n, 3) float
        In any unit of length.
    nodes : (m, k) int
        Nodes of the cells, rows of `points` in VTK's order.

    Returns
    -------
    smallest, largest : (m,) float
        Over the quadrature points.
    smallest_corner, largest_corner : (m,) float
        Over the corners; the apex of a pyramid, where J is singular, is left out.
    """
    corners = REFERENCE[kind][: corner_count(kind)]
    if SHAPE[kind] == "pyramid":
        corners = corners[:4]
    inner = quadrature(kind)[0]
    gradients = shape_gradients(kind, np.vstack([inner, corners]))
    parts = []
    for start in range(0, len(nodes), _CHUNK):
        x = points[nodes[start : start + _CHUNK]]
        extent = np.ptp(x, axis=1).max(axis=1)
        extent[extent == 0] = 1.0
        # Coordinates are taken relative to a node of the cell, since far from the origin they would cost digits.
        jacobian = np.einsum("nkd,qke->nqde", (x - x[:, :1]) / extent[:, None, None], gradients)
        det = np.linalg.det(jacobian)
        at, end = det[:, : len(inner)], det[:, len(inner) :]
        parts.append(np.stack([at.min(axis=1), at.max(axis=1), end.min(axis=1), end.max(axis=1)]))
    a, b, c, d = np.concatenate(parts, axis=1) if parts else np.empty((4, 0))
    return a, b, c, d


def check_points(raw: RawMesh, source: str) -> None:
    """Raise MeshError, with numbers of nodes, if coordinates are not finite or so large that products overflow."""
    finite = np.isfinite(raw.points).all(axis=1)
    small = finite & (np.abs(np.where(np.isfinite(raw.points), raw.points, 0.0)) < _FARTHEST).all(axis=1)
    for good, what in ((finite, "not finite numbers"), (small, f"beyond {_FARTHEST:g} m, where products overflow")):
        bad = np.flatnonzero(~good)
        if len(bad):
            names = (
                listed([raw.node_name(row) for row in bad[:6]])
                if len(bad) <= 6
                else (listed([raw.node_name(row) for row in bad[:5]]) + f" and {len(bad) - 5} more")
            )
            raise MeshError(f"{source}: the coordinates of node {names} are {what}; write them anew")


def check_cells(raw: RawMesh, source: str) -> None:
    """Check that there are cells, that their nodes exist and differ, and that no cell is listed twice.

    Raises
    ------
    MeshError
        One of these fails; the message has the file's numbers of at most five such cells, and their volume group.
    """
    names = element_names(raw.blocks)
    if not len(names):
        raise MeshError(
            f"{source}: no volume elements; expected tetrahedra, hexahedra, wedges or pyramids "
            "(surface elements alone make no body; export the solid mesh)"
        )
    at = 0
    for block in raw.blocks:
        corners = block.nodes[:, : corner_count(block.kind)]
        lost = (corners < 0).any(axis=1) | (block.nodes >= len(raw.points)).any(axis=1)
        _raise(
            raw,
            source,
            names,
            at + np.flatnonzero(lost),
            "refers to nodes that the file does not define",
            "refer to nodes that the file does not define",
            "export the nodes too",
        )
        ordered = np.sort(block.nodes, axis=1)
        twice = ((ordered[:, 1:] == ordered[:, :-1]) & (ordered[:, 1:] >= 0)).any(axis=1)
        _raise(
            raw,
            source,
            names,
            at + np.flatnonzero(twice),
            "has the same node twice",
            "have the same node twice",
            "collapsed elements are not read; write them as wedges or tetrahedra",
        )
        at += len(block)
    by_shape: dict[str, list[Ints]] = {}
    at_shape: dict[str, list[Ints]] = {}
    at = 0
    for block in raw.blocks:
        by_shape.setdefault(SHAPE[block.kind], []).append(block.nodes[:, : corner_count(block.kind)])
        at_shape.setdefault(SHAPE[block.kind], []).append(at + np.arange(len(block)))
        at += len(block)
    for shape, parts in by_shape.items():
        ids, where = row_ids(np.vstack(parts)), np.concatenate(at_shape[shape])
        again = np.setdiff1d(np.arange(len(ids)), np.unique(ids, return_index=True)[1])
        _raise(
            raw,
            source,
            names,
            where[again],
            "is a copy of another element (same corner nodes)",
            "are copies of other elements (same corner nodes)",
            "delete the copies",
        )


def orient_cells(raw: RawMesh, source: str) -> tuple[RawMesh, tuple[str, ...]]:
    """Check the sign of det J over every cell; if all cells of a kind are left-handed, reorder their nodes.

    Returns
    -------
    raw : RawMesh
        The mesh with right-handed cells.
    warnings : tuple of str
        About cells where det J is zero at a corner: they are accepted, but give poor results.

    Raises
    ------
    MeshError
        Elements are inverted or flat; the message has the file's own numbers.
    """
    names, warnings, notes = element_names(raw.blocks), [], list(raw.notes)
    ranges, at = [], 0
    for block in raw.blocks:
        ranges.append((at, *jacobian_range(block.kind, raw.points, block.nodes)))
        at += len(block)
    blocks = list(raw.blocks)
    for kind in dict.fromkeys(block.kind for block in raw.blocks):
        which = [i for i, block in enumerate(raw.blocks) if block.kind == kind]
        index = np.concatenate([ranges[i][0] + np.arange(len(raw.blocks[i])) for i in which])
        low, high, corner_low, corner_high = (np.concatenate([ranges[i][j] for i in which]) for j in (1, 2, 3, 4))
        flat = (np.abs(low) < FLAT) & (np.abs(high) < FLAT)
        _raise(raw, source, names, index[flat], "has zero volume", "have zero volume", "repair the mesh")
        if (high < 0).all():
            for i in which:
                blocks[i] = replace(blocks[i], nodes=blocks[i].nodes[:, mirror_order(kind)])
            notes.append(f"{len(index)} {_spoken(kind)} were left-handed throughout and are turned over")
            low, corner_low = -high, -corner_high
        wrong = (low < FLAT) | (corner_low < -FLAT)
        _raise(
            raw,
            source,
            names,
            index[wrong],
            "is inverted or too distorted (negative Jacobian)",
            "are inverted or too distorted (negative Jacobian)",
            "check the node order and repair the mesh",
        )
        pressed = index[np.abs(corner_low) <= FLAT]
        if len(pressed):
            warnings.append(
                f"{source}: {len(pressed)} elements have a corner with a zero Jacobian: {listed(names[pressed])}"
            )
    return replace(raw, blocks=tuple(blocks), notes=tuple(notes)), tuple(warnings)


def drop_orphans(raw: RawMesh) -> RawMesh:
    """Return the mesh without the nodes that no volume cell uses.

    Call it after `adopt_duplicates`, since surface cells may have such nodes.
    """
    used = np.zeros(len(raw.points), dtype=bool)
    for block in raw.blocks:
        used[block.nodes[block.nodes >= 0]] = True
    if used.all():
        return raw
    new = np.where(used, np.cumsum(used) - 1, -1)
    blocks = tuple(CellBlock(b.kind, np.where(b.nodes >= 0, new[b.nodes], -1), b.labels, b.prefix) for b in raw.blocks)
    prefixes = tuple((int(used[:first].sum()), text) for first, text in raw.node_prefixes)
    count = int((~used).sum())
    what = "node that no volume element uses is" if count == 1 else "nodes that no volume element uses are"
    note = f"{count} {what} left out"
    return replace(
        raw,
        points=raw.points[used],
        node_labels=raw.node_labels[used],
        blocks=blocks,
        node_prefixes=prefixes,
        surfaces={name: [new[part] for part in parts] for name, parts in raw.surfaces.items()},
        node_groups={name: new[rows][new[rows] >= 0] for name, rows in raw.node_groups.items()},
        held_nodes={name: new[rows][new[rows] >= 0] for name, rows in raw.held_nodes.items()},
        notes=(*raw.notes, note),
    )


def connect(wanted: Ints, labels: Ints, element_labels: Ints, what: str, source: str) -> Ints:
    """Return the rows (n, k) of the nodes that elements name by number.

    Parameters
    ----------
    wanted : (n, k) int
        Numbers of the nodes of each element; 0, for a node that the element leaves out, gives the row -1.
    labels : (m,) int
        The number of each node of the file.
    element_labels : (n,) int
        The numbers of the elements, for messages.
    what : str
        What messages call an element, such as "surface element".
    source : str
        The file's name, for messages.

    Raises
    ------
    MeshError
        The file does not define a node; the message names the elements that use it.
    """
    rows = rows_of(wanted, labels)
    lost = ((rows < 0) & (wanted != 0)).any(axis=1)
    if lost.any():
        missing = np.unique(wanted[(rows < 0) & (wanted != 0)]).astype(str)
        names = element_labels[lost].astype(str)
        who = f"{what} {names[0]} refers" if len(names) == 1 else f"{what}s {listed(names)} refer"
        raise MeshError(
            f"{source}: {who} to node {listed(missing)}, which the file does not define; export the nodes too"
        )
    return rows


def _spoken(kind: str) -> str:
    return SPOKEN[SHAPE[kind]]


def _raise(raw: RawMesh, source: str, names: np.ndarray, cells: Ints, one: str, many: str, mend: str) -> None:
    """Raise MeshError about some cells, if there are any, in the singular or the plural, with what to do about it."""
    if len(cells):
        text = f"element {names[cells[0]]} {one}" if len(cells) == 1 else f"elements {listed(names[cells])} {many}"
        raise MeshError(f"{source}: {text}{groups_of(raw, cells)}; {mend}")
