"""The names by which a scene speaks of its mesh: all that are not there are told at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from ..errors import MeshError, SceneError, suggest
from ..mesh import LoadedMesh, volume_group
from ..mesh.groups import find_facets
from ..mesh.node_sets import find_nodes
from ..scene import Scene

_FIND: dict[str, Callable[[LoadedMesh, str, str], object]] = {"surface": find_facets, "nodes": find_nodes}


def check_names(scene: Scene, loaded: LoadedMesh) -> None:
    """Raise where a material or a group of the mesh is named that there is not, with all such names.

    Raises
    ------
    SceneError, MeshError
        With " | " between the faults.
    """
    faults: list[SceneError | MeshError] = []
    for look_up in _look_ups(scene, loaded):
        try:
            look_up()
        except (SceneError, MeshError) as error:
            if str(error) not in [str(f) for f in faults]:
                faults.append(error)
    if faults:
        raise type(faults[0])(" | ".join(str(f) for f in faults))


def _look_ups(scene: Scene, loaded: LoadedMesh) -> Iterator[Callable[[], object]]:
    for name, body in scene.bodies.items():
        yield partial(_material, scene, name, body.material)
        key = f"bodies.{name}.groups" if body.groups else f"bodies.{name}"
        for group in body.groups or [name]:
            yield partial(_volume, loaded, key, group)
    for i, support in enumerate(scene.supports):
        yield partial(_FIND[support.kind], loaded, support.group, f"supports[{i}].{support.kind}")
    for key, table in scene.ties:
        yield partial(_FIND[table.kind], loaded, table.group, f"{key}.{table.kind}")
    for i, spring in enumerate(scene.springs):
        yield partial(_FIND[spring.kind], loaded, spring.group, f"springs[{i}].{spring.kind}")
        if spring.to is not None:
            yield partial(_FIND[spring.kind], loaded, spring.to, f"springs[{i}].to")
    for i, contact in enumerate(scene.contacts):
        yield partial(find_facets, loaded, contact.surface, f"contacts[{i}].surface")
        if not contact.is_rigid:
            yield partial(find_facets, loaded, contact.counterface, f"contacts[{i}].counterface", "rigid")
    for effect in scene.effects.on.values():
        for path, group in effect.surfaces().items():
            yield partial(find_facets, loaded, group, path)


def _material(scene: Scene, body: str, material: str) -> None:
    if material not in scene.materials:
        raise SceneError(f'bodies.{body}.material: no material "{material}"{suggest(material, scene.materials)}')


def _volume(loaded: LoadedMesh, key: str, group: str) -> None:
    try:
        volume_group(loaded, group)
    except MeshError as error:
        raise MeshError(f"{key}: {error}") from error
