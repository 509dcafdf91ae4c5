"""The names by which a scene speaks of its mesh: all that are not there are told at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

from ..errors import MeshError, SceneError, suggest
from ..mesh import LoadedMesh, volume_group
from ..mesh.groups import find_facets
from ..mesh.node_sets import find_nodes, with_named_sets
from ..mesh.raw import Ints
from ..scene import Scene


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


def with_own_names(scene: Scene, loaded: LoadedMesh) -> LoadedMesh:
    """Return the mesh with its groups and node sets under the names that the scene has for them.

    Numbers of nodes, lists of them and names in another case mean something with the file alone that the mesh was read
    from. Groups and node sets stay when the mesh is refined, or written as another file.

    Raises
    ------
    SceneError, MeshError
        As `check_names`.
    """
    check_names(scene, loaded)
    mesh, names = loaded.mesh, list(_names(scene))
    volumes = {group: volume_group(loaded, group) for kind, group, _ in names if kind == "volume"}
    surfaces = {group: find_facets(loaded, group, "") for kind, group, _ in names if kind in ("surface", "counterface")}
    if not (volumes.keys() <= (mesh.subdomains or {}).keys() and surfaces.keys() <= (mesh.boundaries or {}).keys()):
        mesh = replace(
            mesh, _subdomains=_renamed(mesh.subdomains, volumes), _boundaries=_renamed(mesh.boundaries, surfaces)
        )
    sets = with_named_sets(loaded, (group for kind, group, _ in names if kind == "nodes"))
    return replace(sets, mesh=mesh) if mesh is not loaded.mesh else sets


def _renamed(groups: Mapping[str, Ints] | None, named: Mapping[str, Ints]) -> dict[str, Ints]:
    """Return groups with those that the scene names under its names alone."""
    known = groups or {}
    called = {name.casefold() for name in named if name not in known}
    kept = {name: members for name, members in known.items() if name in named or name.casefold() not in called}
    return {**kept, **named}


def _look_ups(scene: Scene, loaded: LoadedMesh) -> Iterator[Callable[[], object]]:
    for name, body in scene.bodies.items():
        yield partial(_material, scene, name, body.material)
    for kind, group, key in _names(scene):
        yield partial(_FIND[kind], loaded, group, key)


def _names(scene: Scene) -> Iterator[tuple[str, str, str]]:
    """Yield the kind of each group of the mesh that a scene names, its name, and the key of the scene."""
    for name, body in scene.bodies.items():
        key = f"bodies.{name}.groups" if body.groups else f"bodies.{name}"
        for group in body.groups or [name]:
            yield "volume", group, key
    for i, support in enumerate(scene.supports):
        yield support.kind, support.group, f"supports[{i}].{support.kind}"
    for key, table in scene.ties:
        yield table.kind, table.group, f"{key}.{table.kind}"
    for i, spring in enumerate(scene.springs):
        yield spring.kind, spring.group, f"springs[{i}].{spring.kind}"
        if spring.to is not None:
            yield spring.kind, spring.to, f"springs[{i}].to"
    for i, contact in enumerate(scene.contacts):
        yield "surface", contact.surface, f"contacts[{i}].surface"
        if not contact.is_rigid:
            yield "counterface", contact.counterface, f"contacts[{i}].counterface"
    for effect in scene.effects.on.values():
        for path, group in effect.surfaces().items():
            yield "surface", group, path


def _material(scene: Scene, body: str, material: str) -> None:
    if material not in scene.materials:
        raise SceneError(f'bodies.{body}.material: no material "{material}"{suggest(material, scene.materials)}')


def _volume(loaded: LoadedMesh, group: str, key: str) -> None:
    try:
        volume_group(loaded, group)
    except MeshError as error:
        raise MeshError(f"{key}: {error}") from error


def _counterface(loaded: LoadedMesh, group: str, key: str) -> None:
    find_facets(loaded, group, key, "rigid")


_FIND: dict[str, Callable[[LoadedMesh, str, str], object]] = {
    "volume": _volume, "surface": find_facets, "counterface": _counterface, "nodes": find_nodes,
}  # fmt: skip
