"""What a scene's names mean on its mesh: elements of bodies, facets of surfaces, sides of contacts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
import skfem
from scipy.sparse.csgraph import connected_components

from ..eigen.memory import refuse_shortage
from ..errors import MeshError, SceneError, suggest
from ..geometry import make_mesh
from ..mesh import LoadedMesh, load_mesh, volume_group
from ..mesh.building import build_mesh
from ..scene import MatrixScene, Scene
from .stale import told_if_stale

_GEOMETRY = "geometry.msh"  # what a mesh that was made from a geometry is called in messages and records


def read_mesh(scene: Scene) -> LoadedMesh:
    """Read the scene's mesh, or make it from the parametric geometry.

    Raises
    ------
    MeshError
        If the file is bad, or gmsh is needed and cannot be imported.
    """
    path = scene.mesh_path
    if path is not None:
        if not path.exists() and scene.mesh.geometry is not None:
            source = scene.source or "SCENE.toml"
            raise MeshError(f"mesh.file: {path}: no such file; make it with: fe-squeal mesh {source} -o {path}")
        try:
            loaded = load_mesh(path, scene.mesh.length_unit, [scene.folder], scene.mesh.allow_outside)
        except MeshError as error:
            raise MeshError(f"mesh.file: {error}") from error
        return told_if_stale(scene, loaded)
    assert scene.mesh.geometry is not None
    try:
        raw = make_mesh(scene.mesh.geometry)
    except MeshError as error:
        kind = "disc_pad" if scene.mesh.disc_pad is not None else "block"
        raise MeshError(f"mesh.{kind}: {error}") from error
    return build_mesh(raw, _GEOMETRY, scene.mesh.scale)


def scene_mesh(scene: Scene | MatrixScene) -> LoadedMesh | None:
    """Return the mesh of a scene; None of one of matrices.

    Raises
    ------
    MeshError
        With the scene's file.
    """
    if isinstance(scene, MatrixScene):
        return None
    try:
        with refuse_shortage("the mesh"):
            return read_mesh(scene)
    except MeshError as error:
        raise MeshError(f"{scene.source}: {error}" if scene.source is not None else str(error)) from error


def find_bodies(scene: Scene, loaded: LoadedMesh) -> dict[str, np.ndarray]:
    """Return the elements of each body; every element belongs to exactly one.

    Raises
    ------
    SceneError, MeshError
        Also of materials and groups that are not there; `check_names` tells all of these.
    """
    owner = np.full(loaded.mesh.nelements, -1)
    bodies: dict[str, np.ndarray] = {}
    for number, (name, body) in enumerate(scene.bodies.items()):
        if body.material not in scene.materials:
            hint = suggest(body.material, scene.materials)
            raise SceneError(f'bodies.{name}.material: no material "{body.material}"{hint}')
        groups = body.groups or [name]
        key = f"bodies.{name}.groups" if body.groups else f"bodies.{name}"
        try:
            elements = np.unique(np.concatenate([volume_group(loaded, g) for g in groups]))
        except MeshError as error:
            raise MeshError(f"{key}: {error}") from error
        taken = owner[elements] >= 0
        if taken.any():
            first = list(scene.bodies)[owner[elements[taken][0]]]
            raise SceneError(f"{key}: {taken.sum()} elements belong to body {first} as well; expected one body each")
        owner[elements] = number
        bodies[name] = elements
    free = owner < 0
    if free.any():
        groups = [g for g, e in (loaded.mesh.subdomains or {}).items() if free[e].any()]
        hint = f' (volume group "{groups[0]}")' if groups else ""
        table, more = (groups[0], "") if groups else ("NAME", "")
        if "," in table:
            table, more = "NAME", f'groups = ["{table}"] and '
        raise SceneError(
            f"bodies: {free.sum()} elements of {loaded.source}{hint} belong to no body and so have no material; add"
            f" [bodies.{table}] with {more}material = ..."
        )
    return bodies


def _share_a_part(mesh: skfem.Mesh, pad: np.ndarray, counter: np.ndarray) -> bool:
    """Whether facets of both surfaces lie on one connected part of the mesh: a body may be of several."""
    corners, count = mesh.t, mesh.t.max() + 1
    first, others = np.repeat(corners[:1], len(corners) - 1, axis=0).ravel(), corners[1:].ravel()
    graph = sp.coo_array((np.ones(len(first), bool), (first, others)), shape=(count, count))
    part = connected_components(graph, directed=False)[1]
    return bool(np.isin(part[mesh.facets[0, pad]], part[mesh.facets[0, counter]]).any())


def contact_sides(
    mesh: skfem.Mesh, bodies: Mapping[str, np.ndarray], pad: np.ndarray, counter: np.ndarray | None, key: str,
    surface: str, counterface: str,
) -> tuple[set[str], set[str]]:  # fmt: skip
    """Return the names of the bodies on either side of a contact.

    Parameters
    ----------
    mesh : skfem.Mesh
    bodies : mapping of str to (m,) int
        Elements of each body.
    pad : (f,) int
        Facets of the contact surface.
    counter : (g,) int or None
        Facets of the counterface; None if it is rigid.
    key, surface, counterface : str
        The key of the contact and the names of both groups, for messages.

    Raises
    ------
    SceneError
        A connected part of a body is in contact with itself, or facets are inside a body.
    """
    for group, facets, name in ((surface, pad, "surface"), (counterface, counter, "counterface")):
        if facets is not None and (mesh.f2t[1, facets] >= 0).any():
            raise SceneError(
                f'{key}.{name}: "{group}" lies inside the mesh: the bodies share its nodes and are glued'
                " there; expected a free surface, with separate nodes on either side"
            )
    sides = [
        {n for n, e in bodies.items() if f is not None and np.isin(mesh.f2t[0, f], e).any()} for f in (pad, counter)
    ]
    both = sides[0] & sides[1]
    if both and counter is not None and _share_a_part(mesh, pad, counter):
        raise SceneError(
            f'{key}.surface: "{surface}" and the counterface "{counterface}" both lie on body {sorted(both)[0]};'
            " expected a surface of the pad and one of the moving body"
        )
    return sides[0], sides[1]
