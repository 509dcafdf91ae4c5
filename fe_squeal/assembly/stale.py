"""Whether a mesh file is still the mesh of the geometry that stands beside it in the scene."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import MeshError
from ..geometry import make_mesh
from ..mesh import LoadedMesh
from ..scene import Scene

_SAME = 1e-6  # of the size of the mesh: lengths that differ by less are the same


def told_if_stale(scene: Scene, loaded: LoadedMesh) -> LoadedMesh:
    """Return the mesh of a scene's file with a sentence where it is not the one of the scene's geometry.

    A warning says that its bodies have other dimensions, as after a change of the scene; a note that the elements
    differ. Structured meshes alone are compared: tetrahedra would have to be meshed anew.

    Parameters
    ----------
    scene : Scene
    loaded : LoadedMesh
        The mesh of `scene.mesh.file`, in metres.
    """
    geometry = scene.mesh.geometry
    if geometry is None or geometry.element != "hex":
        return loaded
    try:
        raw = make_mesh(geometry)
    except MeshError:  # the geometry cannot be meshed, which the command that meshes it says
        return loaded
    cells = np.vstack([block.nodes for block in raw.blocks])
    own = _Corners(scene.mesh.scale * raw.points.T, {k: cells[own].T for k, own in raw.volume_groups.items()})
    mesh = loaded.mesh
    there = _Corners(mesh.p, {name: mesh.t[:, own] for name, own in (mesh.subdomains or {}).items()})
    where = f"[mesh.{'disc_pad' if scene.mesh.disc_pad is not None else 'block'}]"
    again = f"to mesh it anew: fe-squeal mesh {scene.source or 'SCENE.toml'}"
    if (other := _other_dimensions(own, there, around=scene.mesh.disc_pad is not None)) is not None:
        told = f"mesh.file is the mesh that runs, and not that of {where}, whose {other}; {again}"
        return replace(loaded, warnings=(*loaded.warnings, told))
    if len(cells) != mesh.nelements or not _same_points(own.points, there.points):
        told = (
            f"mesh.file is the mesh that runs: {mesh.nelements} elements, where {where} asks for {len(cells)} in other"
            f" places; {again}"
        )
        return replace(loaded, notes=(*loaded.notes, told))
    return loaded


class _Corners(NamedTuple):
    """The corners (3, n) of all elements, m, and by volume group those of its elements, (8, e) int."""

    points: np.ndarray
    groups: dict[str, np.ndarray]


def _other_dimensions(own: _Corners, there: _Corners, around: bool) -> str | None:
    """Return the first body of the geometry that has other ends in the file, in words; None where all are alike."""
    size = float(np.ptp(own.points, axis=1).max())
    for name in own.groups:
        if name not in there.groups:
            return f"group {name} it does not have"
        mine, other = (_ends(x, name, around) for x in (own, there))
        for what, length in mine.items():
            if abs(length - other.get(what, np.inf)) > _SAME * size:
                return f"{name} has the {what} {length:.6g} m, and {other.get(what, np.nan):.6g} m in the file"
    return None


def _ends(mesh: _Corners, name: str, around: bool) -> dict[str, float]:
    """Return the least and the largest x, y and z, m, of a group's corners; with `around` the radius as well.

    Around an axis those are left out that depend on where elements begin.
    """
    corners = mesh.points[:, np.unique(mesh.groups[name])]
    lengths = dict(zip("xyz", corners, strict=True)) | ({"radius": np.hypot(corners[0], corners[1])} if around else {})
    found = {f"least {what}": float(v.min()) for what, v in lengths.items()}
    found |= {f"largest {what}": float(v.max()) for what, v in lengths.items()}
    left_out = ["largest x"] if around else []
    if around and corners[0].min() < 0:
        left_out += ["least x", "least y", "largest y"]
    return {what: length for what, length in found.items() if what not in left_out}


def _same_points(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether two meshes (3, n) have the same corners, in any order."""
    size = float(np.ptp(a, axis=1).max())
    if a.shape != b.shape:
        return False
    first, second = (x[:, np.lexsort(np.round(x / (_SAME * size)))] for x in (a, b))
    return bool(np.abs(first - second).max() <= 2 * _SAME * size)
