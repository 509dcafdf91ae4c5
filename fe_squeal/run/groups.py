"""What `fe-squeal check --groups` shows: the groups of a mesh, even if its elements are bad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from ..assembly.bodies import read_mesh
from ..errors import MeshError
from ..mesh import LoadedMesh
from ..mesh.loading import load_mesh, read_raw
from ..mesh.measures import area_of, volume_of
from ..mesh.raw import RawMesh
from ..scene import Scene

_OF_FILE = "centre (file)"


def group_table(loaded: LoadedMesh, in_metres: bool = True) -> Table:
    """Return a table of the groups of a checked mesh, with size and place, in metres or in the file's own unit."""
    mesh = loaded.mesh
    table = _table("m3 or m2", "centre (m)") if in_metres else _table("size (file)", _OF_FILE)
    for name, elements in (mesh.subdomains or {}).items():
        size, centre = volume_of(mesh, np.asarray(elements))
        table.add_row(name, "volume", str(len(elements)), f"{size:.4g}", _point(centre), "")
    for name, facets in (mesh.boundaries or {}).items():
        size, centre, normal = area_of(mesh, np.asarray(facets))
        table.add_row(name, "surface", str(len(facets)), f"{size:.4g}", _point(centre), _point(normal))
    for name, rows in loaded.node_groups.items():
        table.add_row(name, "nodes", str(len(rows.nodes)), "", _point(mesh.doflocs[:, rows.nodes].mean(axis=1)), "")
    return table


def raw_group_table(raw: RawMesh) -> Table:
    """Return a table of the groups of a file as they are written, without sizes, since elements may be bad."""
    table = _table("size (file)", _OF_FILE)
    cells = [nodes[nodes >= 0] for block in raw.blocks for nodes in block.nodes]
    for name, members in raw.volume_groups.items():
        nodes = [cells[i] for i in members]
        table.add_row(name, "volume", str(len(members)), "", _middle(raw, nodes), "")
    for name, parts in raw.surfaces.items():
        nodes = [part.ravel() for part in parts]
        table.add_row(name, "surface", str(sum(len(part) for part in parts)), "", _middle(raw, nodes), "")
    for name, rows in raw.node_groups.items():
        if name not in raw.surfaces:
            table.add_row(name, "nodes", str(len(rows)), "", _middle(raw, [rows]), "")
    return table


def groups_of_file(path: Path) -> tuple[Table, MeshError | None]:
    """Return a table of the groups of a mesh file, and the error if its elements are bad.

    Raises
    ------
    MeshError
        The file cannot be read at all.
    """
    try:
        return group_table(load_mesh(path), in_metres=False), None
    except MeshError as error:
        return raw_group_table(read_raw(path)), error


def groups_of_scene(scene: Scene) -> tuple[Table, MeshError | None]:
    """Return a table of the groups of a scene's mesh, and the error if its elements are bad.

    Raises
    ------
    MeshError
        There is no mesh that can be read.
    """
    where = f"{scene.source}: " if scene.source is not None else ""
    try:
        return group_table(read_mesh(scene), in_metres=scene.units == "SI"), None
    except MeshError as error:
        path = scene.mesh_path
        if path is None or not path.is_file():
            raise MeshError(f"{where}{error}") from error
        try:
            raw = read_raw(path, [scene.folder], scene.mesh.allow_outside)
            return raw_group_table(raw), MeshError(f"{where}{error}")
        except MeshError:
            raise MeshError(f"{where}{error}") from error


def _table(size: str, place: str) -> Table:
    table = Table(box=SIMPLE_HEAD)
    for column in ("group", "kind", "count", size, place, "mean normal"):
        table.add_column(column, no_wrap=True)
    return table


def _middle(raw: RawMesh, nodes: list[np.ndarray]) -> str:
    rows = np.unique(np.concatenate(nodes)) if nodes else np.empty(0, int)
    rows = rows[(rows >= 0) & (rows < len(raw.points))]
    points = raw.points[rows]
    points = points[np.isfinite(points).all(axis=1)]
    return _point(points.mean(axis=0)) if len(points) else ""


def _point(x: np.ndarray) -> str:
    return ", ".join(f"{v + 0.0:.4g}" for v in np.where(np.abs(x) < 1e-9, 0.0, x))
