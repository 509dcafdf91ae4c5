"""From a scene to the sum of its terms: what the scene calls for, and nothing else."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from .contact import ContactOperators, contact_operators
from .doubts import doubts
from .effects.contact_stiffness import contact_terms
from .effects.elasticity import elastic_terms
from .effects.friction import friction_terms
from .effects.springs import spring_terms
from .errors import MeshError, SceneError, suggest
from .geometry import write_mesh
from .materials import material_axes
from .mesh import LoadedMesh, load_mesh, surface_group, volume_group
from .problem import Model, Problem
from .scene import Scene
from .spaces import DisplacementSpace, make_space, straightened
from .terms import Term


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
            return load_mesh(path, scene.mesh.length_unit)
        except MeshError as error:
            raise MeshError(f"mesh.file: {error}") from error
    assert scene.mesh.geometry is not None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "geometry.msh"
        try:
            write_mesh(scene.mesh.geometry, path)
        except MeshError as error:
            kind = "disc_pad" if scene.mesh.disc_pad is not None else "block"
            raise MeshError(f"mesh.{kind}: {error}") from error
        return load_mesh(path, scene.mesh.length_unit)


def assemble(scene: Scene, mesh: LoadedMesh | None = None) -> Problem:
    """Assemble the terms of a scene.

    Parameters
    ----------
    scene : Scene
    mesh : LoadedMesh, optional
        Used instead of the scene's own mesh.

    Returns
    -------
    Problem

    Raises
    ------
    SceneError, MeshError
        Where scene and mesh do not fit together.
    """
    where = f"{scene.source}: " if scene.source is not None else ""
    try:
        loaded = read_mesh(scene) if mesh is None else mesh
        return _assemble(scene, loaded)
    except SceneError as error:
        raise SceneError(f"{where}{error}") from error
    except MeshError as error:
        raise MeshError(f"{where}{error}") from error


def _assemble(scene: Scene, loaded: LoadedMesh) -> Problem:
    bodies = find_bodies(scene, loaded)
    supports = [
        (_facets(loaded, s.surface, f"supports[{i}].surface"), s.fixed) for i, s in enumerate(scene.supports)
    ]
    mesh, notes = loaded.mesh, loaded.notes
    if scene.mesh.order == 1 and (straight := straightened(mesh)) is not mesh:
        mesh, notes = straight, (*notes, "order = 1: curved edges are made straight, or rotations would not be free")
    space = make_space(mesh, scene.mesh.order, supports)
    terms: list[Term] = []
    for name, elements in bodies.items():
        body = scene.bodies[name]
        axes = material_axes(*body.axes) if body.axes is not None else None
        terms += elastic_terms(space, name, elements, scene.materials[body.material], axes)
    for i, spring in enumerate(scene.springs):
        surface = space.surface(_facets(loaded, spring.surface, f"springs[{i}].surface"))
        other = None
        if spring.to is not None:
            other = space.surface(_facets(loaded, spring.to, f"springs[{i}].to"))
        terms += spring_terms(space, spring, surface, other)
    contacts: dict[str, ContactOperators] = {}
    for i, (name, contact) in enumerate(zip(scene.contact_names, scene.contacts, strict=True)):
        key = f"contacts[{i}]"
        pad = _facets(loaded, contact.surface, f"{key}.surface")
        counter = None if contact.is_rigid else _facets(loaded, contact.counterface, f"{key}.counterface", "rigid")
        _check_sides(space, bodies, pad, counter, key, contact.surface, contact.counterface)
        motion = contact.sliding.motion() if contact.sliding is not None else None
        operators = contact_operators(space, pad, counter, motion, contact.gap_tolerance, key)
        contacts[name] = operators
        stiffness = contact.normal_stiffness
        terms += contact_terms(name, operators, stiffness, contact.normal_damping, contact.kind == "tied")
        if contact.kind == "sliding" and scene.effects.friction is not None:
            terms += friction_terms(name, operators, stiffness, contact.friction_ratio)
    wanted = scene.solve.modes
    if wanted is not None and wanted > space.unknowns:
        raise SceneError(f"solve.modes: given {wanted}; expected at most {space.unknowns}, the number of unknowns")
    parameters = {"mu": scene.effects.friction.mu} if scene.effects.friction is not None else {}
    model = Model(space, bodies, contacts, notes, (*loaded.warnings, *_doubts(contacts), *doubts(scene, loaded, space)))
    return Problem(tuple(terms), parameters, model)


def find_bodies(scene: Scene, loaded: LoadedMesh) -> dict[str, np.ndarray]:
    """Return the elements of each body; every element belongs to exactly one.

    Raises
    ------
    SceneError, MeshError
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
        raise SceneError(
            f"bodies: {free.sum()} elements of {loaded.source}{hint} belong to no body and so have no material; add"
            f" [bodies.{groups[0] if groups else 'NAME'}] with material = ..."
        )
    return bodies


def _facets(loaded: LoadedMesh, group: str, key: str, *others: str) -> np.ndarray:
    """Return the facets of a group; `others` are words that would be valid as well."""
    try:
        return surface_group(loaded, group)
    except MeshError as error:
        close = suggest(group, others)
        if "did you mean" in close:
            raise MeshError(f'{key}: no surface group "{group}" in {loaded.source}{close}') from error
        raise MeshError(f"{key}: {error}") from error


def _check_sides(
    space: DisplacementSpace, bodies: dict[str, np.ndarray], pad: np.ndarray, counter: np.ndarray | None, key: str,
    surface: str, counterface: str,
) -> None:  # fmt: skip
    """Refuse contact of a body with itself, and on facets inside a body."""
    mesh = space.mesh
    for group, facets, name in ((surface, pad, "surface"), (counterface, counter, "counterface")):
        if facets is not None and (mesh.f2t[1, facets] >= 0).any():
            raise SceneError(
                f'{key}.{name}: "{group}" lies inside the mesh: the bodies share its nodes and are glued'
                " there; expected a free surface, with separate nodes on either side"
            )
    if counter is None:
        return
    sides = [{n for n, e in bodies.items() if np.isin(mesh.f2t[0, f], e).any()} for f in (pad, counter)]
    both = sides[0] & sides[1]
    if both:
        raise SceneError(
            f'{key}.surface: "{surface}" and the counterface "{counterface}" both lie on body {sorted(both)[0]};'
            " expected a surface of the pad and one of the moving body"
        )


def _doubts(contacts: dict[str, ContactOperators]) -> list[str]:
    return [
        f"contact {name}: only {100 * c.coverage:.3g} % of the surface lies on its counterface within the tolerance"
        for name, c in contacts.items()
        if c.coverage < 0.5
    ]
