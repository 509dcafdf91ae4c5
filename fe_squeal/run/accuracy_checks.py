"""What is looked at before meshes of a scene are made and measured, so that faults of it are told at once."""

from __future__ import annotations

from collections.abc import Callable

from ..accuracy.own_mesh import own_mesh, require_nested
from ..assembly.bodies import find_bodies, scene_mesh
from ..assembly.units import require_si
from ..errors import MeshError, SceneError
from ..mesh import LoadedMesh
from ..scene import MatrixScene, Scene


def with_mesh(scene: Scene | MatrixScene, what: str) -> Scene:
    """Return a scene that has a mesh.

    Raises
    ------
    SceneError
        It has matrices instead; `what` is the command or option that expects a mesh.
    """
    if isinstance(scene, MatrixScene):
        where = f"{scene.source}: " if scene.source is not None else ""
        raise SceneError(f"{where}{what}: the scene has matrices instead of a mesh; expected one with [mesh]")
    return scene


def checked_mesh(scene: Scene, tell: Callable[[str], None], nested: bool = False) -> LoadedMesh:
    """Return the mesh from which others are made, see `own_mesh`, and tell notes and warnings about it.

    Parameters
    ----------
    scene : Scene
    tell : callable of str
        Gets the notes and warnings, a line each.
    nested : bool
        Whether what is asked for needs the estimate of the error of a mesh.

    Raises
    ------
    SceneError, MeshError
        The mesh cannot be read, made or refined, it has no such groups, or numbers of the scene cannot be in SI units.
    """
    read = scene_mesh(scene)
    assert read is not None
    try:
        own = own_mesh(scene, read)
        require_si(scene, own.mesh, find_bodies(scene, own))
        if nested:
            require_nested(scene, own)
    except (SceneError, MeshError) as error:
        raise type(error)(f"{scene.source}: {error}" if scene.source is not None else str(error)) from error
    for text in (*(f"note: {note}" for note in read.notes), *(f"warning: {warning}" for warning in read.warnings)):
        tell(text)
    if scene.mesh.geometry is not None and scene.mesh.file is not None:
        where = "disc_pad" if scene.mesh.disc_pad is not None else "block"
        tell(f"note: the meshes are made from [mesh.{where}]; mesh.file, which `run` alone would take, is none of them")
    return own
