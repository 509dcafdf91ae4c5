"""The names under which Abaqus sets and surfaces become groups, and the faces of *SURFACE."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fe_squeal.errors import MeshError

from ...elements import SHAPE
from ...raw import Ints, RawMesh
from ...surfaces import Faces, faces_of, find_rows
from .sets import Located, ModelSets

# Corners of the faces S1 ... S6, from 0 (Abaqus Analysis User's Guide, "Three-dimensional solid element library").
ABAQUS_FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "hexahedron": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "pyramid": ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
}


def with_groups(raw: RawMesh, assembly: ModelSets) -> RawMesh:
    """Return the mesh with a group for every set and surface of the model, under the names of `read_abaqus`."""
    volumes: dict[str, Ints] = {}
    nodes: dict[str, Ints] = {}
    surfaces: dict[str, list[Ints]] = {}
    unusable: dict[str, str] = {}
    everything = [assembly.own, *assembly.instances.values()]
    skins: dict[str, list[Ints]] = {}  # shells of *ELSET
    shells: dict[str, list[Ints]] = {}  # shells of *SURFACE
    of_surfaces: set[str] = set()  # names, in capitals: *ELSET has names of its own, and they may be the same
    faces = faces_of(raw)
    homes: dict[tuple[str, str], set[str]] = {}
    for placed in everything:
        for word in ("NSET", "ELSET", "SURFACE"):
            for key in placed.names(word):
                homes.setdefault((word, key), set()).add(placed.part or placed.name)

    def names_of(placed: Located, word: str, key: str, spelled: str) -> list[str]:
        if not placed.name:
            return [spelled]
        full = f"{placed.name}.{spelled}"
        if "" in homes[word, key]:
            return [full]  # the assembly has a set of its own with the plain name
        if len(homes[word, key]) == 1:
            return [full, spelled]
        unusable[spelled] = f'several parts have a set of that name; take one of them, such as "{full}"'
        return [full]

    def lie_on_solids(parts: list[Ints]) -> bool:
        return all((find_rows(part, faces[part.shape[1]].corners) >= 0).all() for part in parts)

    for placed in everything:
        for key, spelled in placed.names("NSET").items():
            rows = assembly.members("NSET", placed, spelled)
            for name in names_of(placed, "NSET", key, spelled):
                nodes[name] = np.union1d(nodes.get(name, rows), rows)
        for key, spelled in placed.names("ELSET").items():
            rows = assembly.members("ELSET", placed, spelled)
            rows = rows[rows != -1]
            for name in names_of(placed, "ELSET", key, spelled):
                solid = rows[rows >= 0]
                volumes[name] = np.union1d(volumes.get(name, solid), solid)
                if len(rows) and not len(solid):
                    skins.setdefault(name, []).extend(assembly.skin_of(rows))
        for key, spelled in placed.names("SURFACE").items():
            kind, rows_and_labels = assembly.surface(placed, spelled)
            names = names_of(placed, "SURFACE", key, spelled)
            of_surfaces.update(name.upper() for name in names)
            if kind == "NODE":
                rows = np.concatenate([np.empty(0, np.int64), *(rows for rows, _ in rows_and_labels)])
                for name in names:
                    nodes[name] = np.union1d(nodes.get(name, rows), rows)
            elif kind == "ELEMENT":
                parts = [
                    part
                    for rows, label in rows_and_labels
                    for part in _labelled(raw, rows, label, faces, f'{assembly.source}: surface "{spelled}"')
                ]
                skin = [part for rows, _ in rows_and_labels for part in assembly.skin_of(rows) if len(part)]
                for name in names:
                    shells.setdefault(name, []).extend(skin)
                    surfaces.setdefault(name, []).extend(parts)
            else:
                unusable.update(dict.fromkeys(names, f"*SURFACE, {kind} is not read"))
    for placed in everything:
        solid = placed.rows["ELSET"][placed.rows["ELSET"] >= 0]
        if placed.name and len(solid):
            volumes.setdefault(placed.name, solid)
    off = "its shell elements are no faces of solid elements"
    for name, parts in shells.items():
        if lie_on_solids(parts):
            surfaces[name].extend(parts)
        else:
            del surfaces[name]
            unusable[name] = off
    for name, parts in skins.items():
        if name.upper() in of_surfaces:
            continue
        if lie_on_solids(parts):
            surfaces.setdefault(name, []).extend(parts)
        elif not len(volumes.get(name, [])):
            unusable[name] = off
    for name in [name for name, rows in volumes.items() if not len(rows)]:
        if name not in surfaces:
            unusable.setdefault(name, "the element set holds no solid element")
        del volumes[name]
    for name in [name for name, parts in surfaces.items() if not any(map(len, parts))]:
        unusable.setdefault(name, "the surface holds no face of a solid element")
        del surfaces[name]
    return replace(raw, volume_groups=volumes, surfaces=surfaces, node_groups=nodes, unusable=unusable)


def _labelled(raw: RawMesh, cells: Ints, label: str, faces: dict[int, Faces], where: str) -> list[Ints]:
    """Return the corners of the faces of some cells that have a label S1 ... S6; without one, of all their free faces.

    Raises
    ------
    MeshError
        These solids have no face with this label.
    """
    cells = cells[cells >= 0]
    if not label:
        return [some.corners[some.boundary & np.isin(some.cells, cells)] for some in faces.values()]
    out, at = [], 0
    for block in raw.blocks:
        rows = cells[(cells >= at) & (cells < at + len(block))] - at
        at += len(block)
        if not len(rows):
            continue
        table = ABAQUS_FACES[SHAPE[block.kind]]
        if label not in [f"S{i + 1}" for i in range(len(table))]:
            raise MeshError(
                f'{where}: face "{label}" does not exist on a solid with {len(table)} faces; expected '
                f"S1 ... S{len(table)}, or no label for all free faces"
            )
        out.append(block.nodes[rows][:, table[int(label[1:]) - 1]])
    return out
