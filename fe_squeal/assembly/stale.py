"""Whether a mesh file is still the mesh of the geometry that stands beside it in the scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import MeshError
from ..geometry import make_mesh
from ..mesh import LoadedMesh
from ..mesh.building import build_mesh
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
        own = build_mesh(make_mesh(geometry), loaded.source, scene.mesh.scale)
    except MeshError:  # the geometry cannot be meshed, which the command that meshes it says
        return loaded
    where = f"[mesh.{'disc_pad' if scene.mesh.disc_pad is not None else 'block'}]"
    again = f"to mesh it anew: fe-squeal mesh {scene.source or 'SCENE.toml'}"
    if (other := _other_dimensions(own, loaded, around=scene.mesh.disc_pad is not None)) is not None:
        told = f"mesh.file is the mesh that runs, and not that of {where}, whose {other}; {again}"
        return replace(loaded, warnings=(*loaded.warnings, told))
    if own.mesh.nelements != loaded.mesh.nelements or not _same_points(own.mesh.p, loaded.mesh.p):
        told = (
            f"mesh.file is the mesh that runs: {loaded.mesh.nelements} elements, where {where} asks for"
            f" {own.mesh.nelements} in other places; {again}"
        )
        return replace(loaded, notes=(*loaded.notes, told))
    return loaded


def _other_dimensions(own: LoadedMesh, loaded: LoadedMesh, around: bool) -> str | None:
    """Return the first body of the geometry that has other ends in the file, in words; None where all are alike."""
    size = float(np.ptp(own.mesh.p, axis=1).max())
    for name in own.mesh.subdomains or {}:
        if name not in (loaded.mesh.subdomains or {}):
            return f"group {name} it does not have"
        mine, there = (_ends(x, name, around) for x in (own, loaded))
        for what, length in mine.items():
            if abs(length - there.get(what, np.inf)) > _SAME * size:
                return f"{name} has the {what} {length:.6g} m, and {there.get(what, np.nan):.6g} m in the file"
    return None


def _ends(loaded: LoadedMesh, name: str, around: bool) -> dict[str, float]:
    """Return the least and the largest x, y and z, m, of a group's corners; with `around` the radius as well.

    Around an axis those are left out that depend on where elements begin.
    """
    mesh = loaded.mesh
    corners = mesh.p[:, np.unique(mesh.t[:, (mesh.subdomains or {})[name]])]
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
