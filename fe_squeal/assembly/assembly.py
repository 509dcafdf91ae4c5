"""From a scene to the sum of its terms: what the scene calls for, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..effects.elasticity import elastic_terms
from ..effects.falling_friction import falling_friction_terms
from ..effects.friction_damping import friction_damping_terms
from ..effects.preload import BaseState
from ..effects.rayleigh import rayleigh_terms
from ..effects.rotation import rotating_damping_terms, rotation_terms, unit_rotation
from ..effects.springs import Spring, spring_terms
from ..effects.stress_stiffening import stiffening_term
from ..effects.structural_damping import structural_terms
from ..eigen.memory import refuse_shortage, require_memory
from ..errors import MeshError, SceneError
from ..fem.contact import ContactOperators
from ..fem.gyroscopics import circulatory_matrices, gyroscopic_matrices
from ..fem.materials import material_axes
from ..fem.motion import Sliding
from ..fem.rigid_motions import rigid_motions
from ..fem.spaces import DisplacementSpace, Surface, make_space, straightened
from ..mesh import LoadedMesh
from ..problem.parameters import MU
from ..problem.problem import Problem
from ..problem.terms import Term
from ..scene import MatrixScene, Scene, number_at, with_numbers
from .bodies import find_bodies, find_facets, read_mesh
from .cache import Cache, Same
from .contacts import make_contact, pressure_powers, stiff_terms
from .matrices import matrix_problem
from .model import Model
from .preload_state import pressed_numbers, pressing_of, state_parameters
from .rotating_bodies import check_material, check_shape, rotating_motions
from .warnings import doubts, doubts_of_coverage, doubts_of_preload, doubts_of_rotation

_SHARED = 0.15  # of the entries of all element matrices: what elements that share nodes leave, or less
_COPIES = 3  # of the stiffness: while two sums are added to a third


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
        self._cache = Cache()
        wanted = scene.solve.modes
        if wanted is not None and wanted > self.space.unknowns:
            n = self.space.unknowns
            raise SceneError(f"solve.modes: given {wanted}; expected at most {n}, the number of unknowns")

    def number(self, path: str) -> float:
        """Return a number as it stands in the scene."""
        return number_at(self.scene, path)

    def problem(self, values: Mapping[str, float]) -> Problem:
        """Return the problem with other numbers, by their paths."""
        return self._cache.get("problem", tuple(sorted(values.items())), lambda: self._build(values))

    def _build(self, values: Mapping[str, float]) -> Problem:
        scene = with_numbers(self.scene, values) if values else self.scene
        elastic = {name: self._elastic(scene, name) for name in self.bodies}
        springs = [t for i, spring in enumerate(scene.springs) for t in self._spring(spring, i)]
        found = {name: self._contact(scene, name, i) for i, name in enumerate(scene.contact_names)}
        contacts = {name: operators for name, (operators, _) in found.items()}
        motions = rotating_motions(scene, {name: sides for name, (_, sides) in found.items()})
        for name, motion in motions.items():
            self._check_rotating(scene, name, motion)
        terms = [t for pair in elastic.values() for t in pair] + springs
        tied = {
            name: self._interface(scene, name, contacts[name], None)
            for name, c in zip(scene.contact_names, scene.contacts, strict=True)
            if c.kind == "tied"
        }
        held = [*springs, *(t for of_contact in tied.values() for t in of_contact)]
        static = [*(stiffness for _, stiffness in elastic.values()), *(t for t in held if t.slot == "K")]
        base = self._base(scene, contacts, static, motions)
        for name, operators in contacts.items():
            terms += tied[name] if name in tied else self._interface(scene, name, operators, base)
        if scene.effects.stress_stiffening is not None and base is not None:
            terms += [self._stiffening(scene, name, base) for name in self.bodies]
        for name in scene.bodies:
            terms += self._damping(scene, name, *elastic[name], motions.get(name))
        paths = sorted({p for t in terms for p in t.powers} | ({MU} if scene.effects.friction is not None else set()))
        parameters = {p: number_at(scene, p) for p in paths}
        return Problem(
            tuple(terms), parameters, self._model(scene, contacts, base, motions, terms, parameters), self,
            state_parameters(scene, static, base), dict(values), self._motions,
            state=pressed_numbers(contacts, base),
        )  # fmt: skip

    def _damping(
        self, scene: Scene, name: str, mass: Term, elastic: Term, motion: Sliding | None
    ) -> list[Term]:
        """Return the terms of damping and rotation of a body."""
        body, rayleigh, structural = scene.bodies[name], scene.effects.rayleigh, scene.effects.structural_damping
        own = (body.rayleigh, f"bodies.{name}.rayleigh") if body.rayleigh is not None else None
        law = own or ((rayleigh, "effects.rayleigh") if rayleigh is not None else None)
        path = f"materials.{body.material}"
        terms: list[Term] = []
        if law is not None:
            terms += rayleigh_terms(*law, name, mass, elastic)
        if structural is not None:
            loss = scene.materials[body.material].loss_factor
            terms += structural_terms(structural, name, loss, f"{path}.loss_factor", elastic)
        if motion is None:
            return terms
        elements, unit = self.bodies[name], unit_rotation(motion)
        inertia = self._cache.get(
            f"rotation.{name}", motion.way, lambda: gyroscopic_matrices(self.space, elements, 1.0, unit)
        )
        terms += rotation_terms(name, path, motion, inertia)
        if law is not None and (law[0].alpha or law[0].beta):
            circulatory = self._cache.get(
                f"rotating_damping.{name}", (motion.way, Same(elastic.matrix)),
                lambda: circulatory_matrices(self.space, elements, elastic.matrix, 1.0, unit),
            )  # fmt: skip
            terms += rotating_damping_terms(name, path, motion, elastic, law, circulatory)
        return terms

    def _check_rotating(self, scene: Scene, name: str, motion: Sliding) -> None:
        """Raise where a rotating body, what holds it or its material is not the same all around the axis."""
        self._cache.get(
            f"revolution.{name}", motion.way,
            lambda: check_shape(scene, self.space, self.bodies[name], self.loaded, motion, name),
        )  # fmt: skip
        check_material(scene, motion, name)

    def _base(
        self, scene: Scene, contacts: Mapping[str, ContactOperators], static: list[Term], motions: Mapping[str, Sliding]
    ) -> BaseState | None:
        pressing = pressing_of(scene, self.space, self.bodies, self.loaded, contacts, static, motions)
        if pressing is None:
            return None
        before = self._cache.latest("base")
        return self._cache.get("base", pressing.key, lambda: pressing.solve(before))

    def _stiffening(self, scene: Scene, name: str, base: BaseState) -> Term:
        return self._cache.get(
            f"stiffening.{name}", Same(base),
            lambda: stiffening_term(self.space, name, self.bodies[name], scene.elasticity(name), base.u),
        )  # fmt: skip

    def _elastic(self, scene: Scene, name: str) -> tuple[Term, Term]:
        """Return mass and stiffness of a body."""
        body = scene.bodies[name]
        material = scene.materials[body.material]
        shape = material.model_dump_json() if material.is_orthotropic else material.poisson_ratio
        axes = material_axes(*body.axes) if body.axes is not None else None
        return self._cache.get(
            f"elastic.{name}", (shape, body.axes),
            lambda: elastic_terms(
                self.space, name, self.bodies[name], material, f"materials.{body.material}", axes, body.is_mixed
            ),
        )  # fmt: skip

    def _spring(self, spring: Spring, i: int) -> list[Term]:
        key = (spring.direction, bool(spring.stiffness), bool(spring.damping))
        return self._cache.get(
            f"spring.{spring.name}", key, lambda: spring_terms(self.space, spring, *self._ends(spring, i))
        )

    def _ends(self, spring: Spring, i: int) -> tuple[Surface, Surface | None]:
        """Return the surfaces of a spring."""
        surface = self.space.surface(find_facets(self.loaded, spring.surface, f"springs[{i}].surface"))
        if spring.to is None:
            return surface, None
        return surface, self.space.surface(find_facets(self.loaded, spring.to, f"springs[{i}].to"))

    def _contact(self, scene: Scene, name: str, i: int) -> tuple[ContactOperators, set[str]]:
        """Return the operators of a contact, and the bodies that carry its counterface."""
        contact = scene.contacts[i]
        motion = contact.sliding.motion() if contact.sliding is not None else None
        key = (None if motion is None else motion.way, contact.gap_tolerance)
        return self._cache.get(
            f"contact.{name}", key,
            lambda: make_contact(self.space, self.bodies, self.loaded, contact, motion, f"contacts[{i}]"),
        )  # fmt: skip

    def _interface(
        self, scene: Scene, name: str, operators: ContactOperators, base: BaseState | None
    ) -> list[Term]:
        """Return the terms of a contact, on its closed part; without a static state it is closed all over."""
        contact, effects = scene.contacts[scene.contact_names.index(name)], scene.effects
        state = None if base is None else base.contacts[name]
        closed = operators
        if state is not None:
            closed = replace(operators, weights=operators.weights * state.closed)
        key = (
            Same(operators), None if state is None else state.closed.tobytes(),
            bool(contact.normal_damping), contact.kind == "sliding", contact.friction_ratio != 0,
        )  # fmt: skip
        terms = list(self._cache.get(f"interface.{name}", key, lambda: stiff_terms(name, closed, contact, effects)))
        if contact.kind != "sliding" or not contact.friction_ratio or contact.sliding is None:
            return terms
        p0 = np.ones(len(closed.weights)) if state is None else np.maximum(state.pressure, 0.0)
        if effects.friction_damping is not None:
            speed = contact.sliding.motion().speeds(closed.points, closed.normals)
            counts = {MU: 1, **pressure_powers(effects, name, "friction_damping", base is not None)}
            terms += self._cache.get(
                f"friction_damping.{name}",
                (Same(operators), p0.tobytes(), speed.tobytes(), tuple(counts.items())),
                lambda: friction_damping_terms(name, closed, p0, speed, counts),
            )  # fmt: skip
        if effects.falling_friction is not None and effects.falling_friction.slope:
            slopes = pressure_powers(effects, name, "falling_friction", base is not None)
            slopes = {"effects.falling_friction.slope": 1, **slopes}
            terms += self._cache.get(
                f"falling_friction.{name}", (Same(operators), p0.tobytes(), tuple(slopes.items())),
                lambda: falling_friction_terms(name, closed, p0, slopes),
            )  # fmt: skip
        return terms

    def _model(
        self, scene: Scene, contacts: dict[str, ContactOperators], base: BaseState | None,
        motions: dict[str, Sliding], terms: list[Term], parameters: dict[str, float],
    ) -> Model:  # fmt: skip
        warnings: tuple[str, ...] = self._cache.get(
            "doubts", None,
            lambda: (
                *self.loaded.warnings, *doubts_of_coverage(contacts),
                *doubts(self.scene, self.loaded, self.space, self.bodies),
            ),
        )  # fmt: skip
        if base is not None:
            warnings += tuple(doubts_of_preload(scene, contacts, base))
        if motions and scene.effects.stress_stiffening is None:
            still = [t for t in terms if not t.name.startswith("convection.")]
            warnings += tuple(doubts_of_rotation(self.space, self.bodies, motions, still, parameters))
        return Model(self.space, self.bodies, contacts, self.notes, warnings, base)


def _least_memory(space: DisplacementSpace) -> int:
    """Return the bytes that stiffness and mass matrix take at the very least, while they are added up."""
    entries = _SHARED * space.mesh.nelements * (3 * space.dofs.element_dofs.shape[0]) ** 2
    return int(_COPIES * entries * 12)
