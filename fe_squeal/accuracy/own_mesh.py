"""The mesh of a scene from which other meshes are made: what the scene names on it stays on these."""

from __future__ import annotations

from ..assembly.bodies import read_mesh
from ..assembly.names import with_own_names
from ..assembly.places import holding
from ..errors import SceneError
from ..mesh import LoadedMesh
from ..scene import Scene


def own_mesh(scene: Scene, loaded: LoadedMesh | None = None) -> LoadedMesh:
    """Return the mesh of a scene, with its groups and node sets under the names that the scene has for them.

    Where the scene has a geometry, it is made from this, whether there is a file of it or not.

    Parameters
    ----------
    scene : Scene
    loaded : LoadedMesh, optional
        The mesh of the scene's file, which then is not read again.

    Raises
    ------
    SceneError
        The mesh is made from a geometry, and the scene names nodes of it by their numbers: on another mesh of this
        geometry they would be others.
    SceneError, MeshError
        The mesh cannot be read or made, or has no such groups.
    """
    if scene.mesh.geometry is None:
        return with_own_names(scene, loaded or read_mesh(scene))
    loaded = read_mesh(scene.model_copy(update={"mesh": scene.mesh.model_copy(update={"file": None})}))
    for path, kind, name in holding(scene):
        if kind == "nodes" and name not in loaded.node_groups:
            raise SceneError(
                f'{path}.nodes: given "{name}"; on other meshes of the geometry the nodes are others; expected a'
                " surface, or a scene of mesh.file alone"
            )
    return with_own_names(scene, loaded)


def require_nested(scene: Scene, loaded: LoadedMesh) -> None:
    """Raise SceneError if refining a mesh with elements of order 2 would not keep its displacements.

    That is so for the mixed formulation on tetrahedra, whose functions between elements a refined mesh does not have.
    """
    for name, body in scene.bodies.items():
        if body.is_mixed and loaded.mesh.elem.refdom.p.shape[1] == 4:
            raise SceneError(
                f'bodies.{name}.formulation: given "mixed" on tetrahedra, where the error of the mesh cannot be'
                ' estimated; expected "standard", or hexahedra'
            )
