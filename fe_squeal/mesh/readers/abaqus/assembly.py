"""Make one mesh of the parts and instances of an Abaqus file, every instance moved to its place."""

from __future__ import annotations

import numpy as np

from fe_squeal.errors import MeshError, suggest

from ...checking import connect
from ...raw import CellBlock, Floats, Ints, RawMesh, listed, rows_of
from .groups import with_groups
from .loads import add_loaded_faces
from .model import DeckModel, Instance, Scope, nodes_of
from .sets import Located, ModelSets


def place_model(model: DeckModel, source: str) -> tuple[RawMesh, ModelSets]:
    """Return the mesh of the whole model, and an object that looks up its sets.

    Raises
    ------
    MeshError
        An instance is of a part that does not exist, nodes, sets or elements are missing, or two elements of a part or
        instance have one number.
    """
    points: list[Floats] = []
    labels: list[Ints] = []
    blocks: list[CellBlock] = []
    prefixes: list[tuple[int, str]] = []
    skins: list[Ints] = [np.empty((0, 4), np.int64)]
    count = {"NSET": 0, "ELSET": 0}

    def place(name: str, scopes: tuple[Scope, ...], where: tuple[tuple[float, ...], ...], part: str = "") -> Located:
        told = f"{source}: {name}" if name else source
        node_labels, xyz = nodes_of(scopes, told)
        prefix = f"{name}." if name else ""
        prefixes.append((count["NSET"], prefix))
        cell_labels, cell_rows = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        for cells in (cells for scope in scopes for cells in scope.cells):
            rows = connect(cells.nodes, node_labels, cells.labels, "element", told)
            blocks.append(CellBlock(cells.kind, np.where(rows < 0, -1, rows + count["NSET"]), cells.labels, prefix))
            cell_labels.append(cells.labels)
            cell_rows.append(count["ELSET"] + np.arange(len(rows)))
            count["ELSET"] += len(rows)
        for cells in (cells for scope in scopes for cells in scope.skins):
            rows = rows_of(cells.nodes, node_labels)
            corners = np.full((len(rows), 4), -1)
            corners[:, : rows.shape[1]] = np.where((rows < 0).any(axis=1, keepdims=True), -1, rows + count["NSET"])
            cell_labels.append(cells.labels)
            cell_rows.append(-2 - (sum(map(len, skins)) + np.arange(len(rows))))
            skins.append(corners)
        points.append(moved(xyz, where))
        labels.append(node_labels)
        node_rows = count["NSET"] + np.arange(len(node_labels))
        count["NSET"] += len(node_labels)
        others = np.array([label for scope in scopes for label in scope.others], dtype=np.int64)
        elements = np.concatenate([*cell_labels, others])
        unique, times = np.unique(elements, return_counts=True)
        if (times > 1).any():
            raise MeshError(
                f"{told}: element number {listed(unique[times > 1].astype(str))} is defined more than once; give every"
                " element its own number"
            )
        return Located(
            name,
            scopes,
            {"NSET": node_labels, "ELSET": elements},
            {"NSET": node_rows, "ELSET": np.concatenate([*cell_rows, np.full(len(others), -1)])},
            part,
        )

    add_loaded_faces(model)
    own = place("", (model.assembly,), ())
    instances = {
        key: place(item.name, _scopes(model, item, source), item.place, item.part.upper())
        for key, item in model.instances.items()
    }
    if model.parts and not model.instances:
        # A file with parts but without an assembly: each part stands where it is.
        instances = {key: place(scope.name, (scope,), (), key) for key, scope in model.parts.items()}
    raw = RawMesh(
        np.concatenate(points),
        np.concatenate(labels),
        tuple(blocks),
        {},
        {},
        {},
        {},
        tuple(model.notes),
        tuple(prefixes),
        ignore_case=True,
    )
    assembly = ModelSets(source, own, instances, np.vstack(skins), tuple(blocks))
    return with_groups(raw, assembly), assembly


def _scopes(model: DeckModel, item: Instance, source: str) -> tuple[Scope, ...]:
    if not item.part:
        return (item.scope,)
    if item.part.upper() not in model.parts:
        raise MeshError(
            f'{source}: {item.where}: instance "{item.name}" is of part "{item.part}", which does not exist'
            + suggest(item.part, [p.name for p in model.parts.values()])
        )
    return (model.parts[item.part.upper()], item.scope)


def moved(points: Floats, where: tuple[tuple[float, ...], ...]) -> Floats:
    """Return points (n, 3) translated by the first data line of an *INSTANCE, then rotated by the second.

    The first line is a translation (3 numbers), the second two points of the axis and an angle in degrees (7 numbers).

    Examples
    --------
    >>> moved(np.array([[1.0, 0.0, 0.0]]), ((1.0, 0.0, 0.0), (0, 0, 0, 0, 0, 1, 90.0))).round(12).tolist()
    [[0.0, 2.0, 0.0]]
    """
    if len(where) > 0:
        points = points + np.array(where[0])
    if len(where) > 1:
        a, b, angle = np.array(where[1][:3]), np.array(where[1][3:6]), np.deg2rad(where[1][6])
        length = float(np.linalg.norm(b - a))
        if length > 0 and angle != 0:
            k, r = (b - a) / length, points - a
            # Rodrigues' formula, right-handed about a -> b.
            points = a + r * np.cos(angle) + np.cross(k, r) * np.sin(angle) + np.outer(r @ k, k) * (1 - np.cos(angle))
    return points
