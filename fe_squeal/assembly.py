"""From a scene to the sum of its terms: what the scene calls for, and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from .base_state import base_state, state_parameters
from .bodies import contact_sides, find_bodies, find_facets, read_mesh
from .contact import ContactOperators, Sliding, contact_operators
from .doubts import doubts, doubts_of_preload, doubts_of_rotation
from .effects.contact_stiffness import contact_terms
from .effects.elasticity import elastic_terms
from .effects.falling_friction import FallingFriction, falling_friction_terms
from .effects.friction import friction_terms
from .effects.friction_damping import FrictionDamping, friction_damping_terms
from .effects.preload import BaseState
from .effects.rayleigh import rayleigh_terms
from .effects.rotation import rotation_terms
from .effects.springs import spring_terms
from .effects.stress_stiffening import stiffening_term
from .effects.structural_damping import structural_terms
from .eigen.memory import refuse_shortage, require_memory
from .errors import MeshError, SceneError
from .materials import material_axes
from .matrix_scene import matrix_problem
from .mesh import LoadedMesh
from .problem import Model, Problem
from .rigid_motions import rigid_motions
from .rotating_bodies import rotating_motions
from .scene import MU, MatrixScene, Scene, number_at, with_numbers
from .spaces import DisplacementSpace, make_space, straightened
from .terms import Term

_KEPT = 4  # versions of one thing that are kept: at a value, beside it for differences, and one more
_SHARED = 0.15  # of the entries of all element matrices: what elements that share nodes leave, or less
_COPIES = 3  # of the stiffness: while two sums are added to a third
_Made = TypeVar("_Made")


def assemble(scene: Scene | MatrixScene, mesh: LoadedMesh | None = None) -> Problem:
    """Assemble the terms of a scene.

    Parameters
    ----------
    scene : Scene or MatrixScene
    mesh : LoadedMesh, optional
        Used instead of the scene's own mesh.

    Returns
    -------
    Problem

    Raises
    ------
    SceneError, MeshError
        Where scene and mesh do not fit together, or a matrix file is bad.
    NotConvergedError
        If the static state of a preload is not found.
    """
    where = f"{scene.source}: " if scene.source is not None else ""
    try:
        if isinstance(scene, MatrixScene):
            return matrix_problem(scene)
        with refuse_shortage("the assembly"):
            return Assembly(scene, read_mesh(scene) if mesh is None else mesh).problem({})
    except SceneError as error:
        raise SceneError(f"{where}{error}") from error
    except MeshError as error:
        raise MeshError(f"{where}{error}") from error


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


class Assembly:
    """A scene on its mesh, with what was made from it; at other numbers only what depends on them is made anew."""

    def __init__(self, scene: Scene, loaded: LoadedMesh) -> None:
        self.scene = scene
        self.bodies = find_bodies(scene, loaded)
        supports = [
            (find_facets(loaded, s.surface, f"supports[{i}].surface"), s.fixed) for i, s in enumerate(scene.supports)
        ]
        mesh, self.notes = loaded.mesh, loaded.notes
        if scene.mesh.order == 1 and (straight := straightened(mesh)) is not mesh:
            mesh = straight
            self.notes += ("order = 1: curved edges are made straight, or rotations would not be free",)
        mixed = [elements for name, elements in self.bodies.items() if scene.bodies[name].is_mixed]
        self.space = make_space(mesh, scene.mesh.order, supports, mixed)
        require_memory(_least_memory(self.space), self.space.unknowns, "matrices", exponent=1)
        self.loaded, self._motions = loaded, rigid_motions(self.space)
        self._made: dict[str, list[tuple[object, Any]]] = {}
        self._sides: dict[str, set[str]] = {}
        wanted = scene.solve.modes
        if wanted is not None and wanted > self.space.unknowns:
            n = self.space.unknowns
            raise SceneError(f"solve.modes: given {wanted}; expected at most {n}, the number of unknowns")

    def number(self, path: str) -> float:
        """Return a number as it stands in the scene."""
        return number_at(self.scene, path)

    def problem(self, values: Mapping[str, float]) -> Problem:
        """Return the problem with other numbers, by their paths."""
        return self._kept("problem", tuple(sorted(values.items())), lambda: self._build(values))

    def _build(self, values: Mapping[str, float]) -> Problem:
        scene = with_numbers(self.scene, values) if values else self.scene
        masses, elastics = self._elastic(scene)
        springs = self._springs(scene)
        contacts = self._contacts(scene)
        motions = rotating_motions(scene, self.space, self.bodies, self.loaded, self._sides, self._kept)
        terms = [t for pair in zip(masses.values(), elastics.values(), strict=True) for t in pair] + springs
        damping, static = [], [*elastics.values(), *(t for t in springs if t.slot == "K")]
        rayleigh = scene.effects.rayleigh
        structural = scene.effects.structural_damping
        for name, body in scene.bodies.items():
            own = (body.rayleigh, f"bodies.{name}.rayleigh") if body.rayleigh is not None else None
            law = own or ((rayleigh, "effects.rayleigh") if rayleigh is not None else None)
            path = f"materials.{body.material}"
            if law is not None:
                damping += rayleigh_terms(*law, name, masses[name], elastics[name])
            if structural is not None:
                loss = scene.materials[body.material].loss_factor
                damping += structural_terms(structural, name, loss, f"{path}.loss_factor", elastics[name])
            if name in motions:
                damping += rotation_terms(
                    self.space, name, self.bodies[name], path, motions[name], elastics[name], law, self._kept
                )
        tied = {
            name: self._interface(scene, name, contacts[name], None)
            for name, c in zip(scene.contact_names, scene.contacts, strict=True)
            if c.kind == "tied"
        }
        static += [t for found in tied.values() for t in found if t.slot == "K"]
        before = self._made.get("base", [])
        base = base_state(
            scene, self.space, self.bodies, self.loaded, contacts, static, motions,
            before[-1][1] if before else None, self._kept,
        )  # fmt: skip
        for name, operators in contacts.items():
            terms += tied[name] if name in tied else self._interface(scene, name, operators, base)
        if scene.effects.stress_stiffening is not None and base is not None:
            for name, elements in self.bodies.items():

                def stiffening(name: str = name, elements: np.ndarray = elements, u: np.ndarray = base.u) -> Term:
                    return stiffening_term(self.space, name, elements, scene.elasticity(name), u)

                terms.append(self._kept(f"stiffening.{name}", id(base), stiffening))
        terms += damping
        paths = sorted({p for t in terms for p in t.powers} | ({MU} if scene.effects.friction is not None else set()))
        parameters = {p: number_at(scene, p) for p in paths}
        return Problem(
            tuple(terms), parameters, self._model(scene, contacts, base, motions, terms, parameters), self,
            state_parameters(scene, static, base), dict(values), self._motions,
        )  # fmt: skip

    def _kept(self, kind: str, key: object, make: Callable[[], _Made]) -> _Made:
        """Return what was made from the same key before, or make it."""
        entries = self._made.setdefault(kind, [])
        for known, thing in entries:
            if known == key:
                return thing
        made = make()
        entries.append((key, made))
        del entries[:-_KEPT]
        return made

    def _elastic(self, scene: Scene) -> tuple[dict[str, Term], dict[str, Term]]:
        masses, elastics = {}, {}
        for name, elements in self.bodies.items():
            body = scene.bodies[name]
            material = scene.materials[body.material]
            shape = material.model_dump_json() if material.is_orthotropic else material.poisson_ratio
            axes = material_axes(*body.axes) if body.axes is not None else None
            masses[name], elastics[name] = self._kept(
                f"elastic.{name}", (shape, body.axes),
                lambda n=name, e=elements, m=material, b=body, a=axes: elastic_terms(  # type: ignore[misc]
                    self.space, n, e, m, f"materials.{b.material}", a, b.is_mixed
                ),
            )  # fmt: skip
        return masses, elastics

    def _springs(self, scene: Scene) -> list[Term]:
        terms = []
        for i, spring in enumerate(scene.springs):

            def make(i: int = i, spring: Any = spring) -> list[Term]:
                surface = self.space.surface(find_facets(self.loaded, spring.surface, f"springs[{i}].surface"))
                other = None
                if spring.to is not None:
                    other = self.space.surface(find_facets(self.loaded, spring.to, f"springs[{i}].to"))
                return spring_terms(self.space, spring, surface, other)

            key = (spring.direction, bool(spring.stiffness), bool(spring.damping))
            terms += self._kept(f"spring.{spring.name}", key, make)
        return terms

    def _contacts(self, scene: Scene) -> dict[str, ContactOperators]:
        contacts: dict[str, ContactOperators] = {}
        for i, (name, contact) in enumerate(zip(scene.contact_names, scene.contacts, strict=True)):
            motion = contact.sliding.motion() if contact.sliding is not None else None

            def make(i: int = i, name: str = name, contact: Any = contact, motion: Any = motion) -> ContactOperators:
                key = f"contacts[{i}]"
                pad = find_facets(self.loaded, contact.surface, f"{key}.surface")
                counter = None
                if not contact.is_rigid:
                    counter = find_facets(self.loaded, contact.counterface, f"{key}.counterface", "rigid")
                sides = contact_sides(
                    self.space.mesh, self.bodies, pad, counter, key, contact.surface, contact.counterface
                )
                self._sides[name] = sides[1]
                return contact_operators(self.space, pad, counter, motion, contact.gap_tolerance, key)

            key = (None if motion is None else motion.way, contact.gap_tolerance)
            contacts[name] = self._kept(f"contact.{name}", key, make)
        return contacts

    def _interface(
        self, scene: Scene, name: str, operators: ContactOperators, base: BaseState | None
    ) -> list[Term]:
        """Return the terms of a contact, on its closed part; without a static state it is closed all over."""
        contact = scene.contacts[scene.contact_names.index(name)]
        pressure: np.ndarray | None = None
        key: object = None
        if base is not None:
            state = base.contacts[name]
            pressure, key = np.maximum(state.pressure, 0.0), state.closed.tobytes()
            operators = replace(operators, weights=operators.weights * state.closed)
        sizes = (bool(contact.normal_damping), contact.kind == "sliding", contact.friction_ratio != 0)
        effects = scene.effects

        def make() -> list[Term]:
            tied = contact.kind == "tied"
            terms = contact_terms(name, operators, contact.normal_stiffness, contact.normal_damping, tied)
            if contact.kind == "sliding" and effects.friction is not None:
                terms += friction_terms(name, operators, contact.friction_ratio)
            return terms

        terms = list(self._kept(f"interface.{name}", (id(operators.gap), key, sizes), make))
        if contact.kind != "sliding" or not contact.friction_ratio or contact.sliding is None:
            return terms
        ratio = {f"contacts.{name}.friction_ratio": 1}
        p0 = np.ones(len(operators.weights)) if pressure is None else pressure

        def powers(effect: FrictionDamping | FallingFriction, own: str) -> dict[str, int]:
            where = own if effect.contact_pressure is not None else "friction_damping"
            return ratio if base is not None else {**ratio, f"effects.{where}.contact_pressure": 1}

        if (damping := effects.friction_damping) is not None:
            speed = contact.sliding.motion().speeds(operators.points, operators.normals)
            counts = {MU: 1, **powers(damping, "friction_damping")}
            terms += self._kept(
                f"friction_damping.{name}", (id(operators.gap), p0.tobytes(), speed.tobytes(), str(counts)),
                lambda: friction_damping_terms(name, operators, p0, speed, counts),
            )  # fmt: skip
        if (falling := effects.falling_friction) is not None and falling.slope:
            slopes = {"effects.falling_friction.slope": 1, **powers(falling, "falling_friction")}
            terms += self._kept(
                f"falling_friction.{name}", (id(operators.gap), p0.tobytes(), str(slopes)),
                lambda: falling_friction_terms(name, operators, p0, slopes),
            )  # fmt: skip
        return terms

    def _model(
        self, scene: Scene, contacts: dict[str, ContactOperators], base: BaseState | None,
        motions: dict[str, Sliding], terms: list[Term], parameters: dict[str, float],
    ) -> Model:  # fmt: skip
        warnings = self._kept(
            "doubts", None,
            lambda: (
                *self.loaded.warnings, *_coverage(contacts),
                *doubts(self.scene, self.loaded, self.space, self.bodies),
            ),
        )  # fmt: skip
        if base is not None:
            warnings += tuple(doubts_of_preload(scene, contacts, base))
        if motions and scene.effects.stress_stiffening is None:
            still = [t for t in terms if not t.name.startswith("convection.")]
            warnings += tuple(doubts_of_rotation(self.space, self.bodies, motions, still, parameters))
        tied = tuple(n for n, c in zip(scene.contact_names, scene.contacts, strict=True) if c.kind == "tied")
        return Model(self.space, self.bodies, contacts, self.notes, warnings, base, tied)


def _least_memory(space: DisplacementSpace) -> int:
    """Return the bytes that stiffness and mass matrix take at the very least, while they are added up."""
    entries = _SHARED * space.mesh.nelements * (3 * space.dofs.element_dofs.shape[0]) ** 2
    return int(_COPIES * entries * 12)


def _coverage(contacts: dict[str, ContactOperators]) -> list[str]:
    return [
        f"contact {name}: only {100 * c.coverage:.3g} % of the surface lies on its counterface within the tolerance"
        for name, c in contacts.items()
        if c.coverage < 0.5
    ]
