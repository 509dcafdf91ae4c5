"""From a scene to the sum of its terms: what the scene calls for, and nothing else.

This file is longer than others, since every part is kept in one cache and made anew for other numbers of the scene.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import replace
from functools import partial

import scipy.sparse as sp

from ..effects.cache import Cache, Same
from ..effects.context import BodyPart, ContactPart, Context
from ..effects.elasticity import elastic_terms
from ..effects.springs import Spring, spring_terms
from ..effects.static_state import pressed_numbers
from ..effects.ties import tie_terms
from ..eigen.linear.factor import LinearSolver
from ..eigen.memory import refuse_shortage, require_memory
from ..errors import MeshError, SceneError
from ..fem.materials import material_axes
from ..fem.motion import SteadyMotion
from ..fem.places import find_patch
from ..fem.rigid_motions import rigid_motions
from ..fem.spaces import DisplacementSpace, make_space, straightened
from ..fem.surfaces import Patch
from ..mesh import LoadedMesh
from ..mesh.node_sets import with_named_sets
from ..problem.description import Describer
from ..problem.problem import Problem
from ..problem.terms import Term
from ..scene import NOT_PHYSICS, MatrixScene, Scene, number_at, with_numbers
from ..scene.numbers import full_path
from ..scene.solver import solver_of
from .bodies import find_bodies, read_mesh
from .contacts import make_contact, stiffness_terms
from .describer import describer_of
from .discretisation import Discretisation
from .effect_stages import (
    Owned,
    parameters_of,
    state_parameters,
    terms_of_body,
    terms_of_contact,
    terms_of_whole,
    warnings_of,
    with_motions,
    with_static_state,
)
from .matrices import matrix_problem
from .names import check_names
from .places import held_places, holding
from .ties import mean_motion, with_ties
from .units import require_si
from .warnings import notes_of_contacts, warnings_of_contacts, warnings_of_scene

# Of the entries of all element matrices, what is left when those of elements that share nodes are added, or less, since
# memory is predicted from below.
_SHARED = 0.15
_COPIES = 3  # so many matrices of the stiffness's size exist at once, while two sums are added to a third


def assemble(
    scene: Scene | MatrixScene, mesh: LoadedMesh | None = None, linear_solver: LinearSolver | str | None = None
) -> Problem:
    """Assemble the equation of motion of a scene, (λ²M + λC + K)u = 0, as a sum of terms.

    Parameters
    ----------
    scene : Scene or MatrixScene
        From `load_scene` or `parse_scene`.
    mesh : LoadedMesh, optional
        Used instead of the scene's own mesh; from `load_mesh` or `from_skfem`.
    linear_solver : "auto", "pardiso", "superlu", "mumps" or LinearSolver, optional
        Solves for the static state under preload (default: the solver that the scene names).

    Returns
    -------
    Problem
        In kg, N s/m, N/m and rad/s.

    Raises
    ------
    SceneError
        `scene` is no scene, the scene and the mesh do not fit together, or a matrix file is bad.
    MeshError
        The mesh cannot be read or made.
    TooLargeError
        The matrices do not fit into memory.
    NotConvergedError
        The static state under preload is not found.
    """
    if not isinstance(scene, Scene | MatrixScene):
        raise SceneError(f'assemble: given {scene!r:.60}; expected a scene, as in assemble(load_scene("brake.toml"))')
    where = f"{scene.source}: " if scene.source is not None else ""
    try:
        if isinstance(scene, MatrixScene):
            return matrix_problem(scene)
        with refuse_shortage("the assembly"):
            assembly = Assembly(scene, read_mesh(scene) if mesh is None else mesh)
            return (assembly if linear_solver is None else assembly.solved_with(linear_solver)).problem({})
    except SceneError as error:
        raise SceneError(f"{where}{error}") from error
    except MeshError as error:
        raise MeshError(f"{where}{error}") from error


class Assembly:
    """A scene on its mesh, from which problems at any numbers of the scene are assembled.

    Terms and operators are kept; for other numbers only those are made anew that depend on them.

    Parameters
    ----------
    scene : Scene
    loaded : LoadedMesh
        The mesh.

    Attributes
    ----------
    bodies : mapping of str to (m,) int
        Elements of each body.
    space : DisplacementSpace
        The unknowns.
    """

    def __init__(self, scene: Scene, loaded: LoadedMesh) -> None:
        self.scene = scene
        check_names(scene, loaded)
        loaded = with_named_sets(loaded, (name for _, kind, name in holding(scene) if kind == "nodes"))
        self.bodies = find_bodies(scene, loaded)
        require_si(scene, loaded.mesh, self.bodies)
        supports, points = held_places(scene, loaded)
        mesh, self.notes = loaded.mesh, loaded.notes
        if scene.mesh.order == 1 and (straight := straightened(mesh)) is not mesh:
            mesh = straight
            self.notes += ("order = 1: curved edges are made straight, or rotations would not be free",)
        mixed = [elements for name, elements in self.bodies.items() if scene.bodies[name].is_mixed]
        self.space = with_ties(make_space(mesh, scene.mesh.order, supports, mixed, points), scene, loaded)
        require_memory(_least_memory(self.space), self.space.unknowns, "matrices", exponent=1)
        self.loaded, self._motions = loaded, rigid_motions(self.space)
        # The word alone where that is enough: PETSc starts MPI, and is loaded where it is needed.
        self._linear_solver: LinearSolver | str = scene.solve.linear_solver
        if scene.solve.mumps is not None:
            self._linear_solver = solver_of(scene)
        self._cache = Cache()
        wanted = scene.solve.modes
        if wanted is not None and wanted > self.space.unknowns:
            n = self.space.unknowns
            raise SceneError(f"solve.modes: given {wanted}; expected at most {n}, the number of unknowns")

    def number(self, path: str) -> float:
        """Return a number as it stands in the scene.

        Raises
        ------
        SceneError
            If there is none, or it is one of the mesh, the sweep, the solution or the output.
        """
        if path.split(".")[0] in NOT_PHYSICS:
            raise SceneError(f'given "{path}"; expected a number of the physics, or another scene to be assembled')
        return number_at(self.scene, path)

    def check(self, values: Mapping[str, float]) -> None:
        """Raise SceneError for numbers, by their paths, that the scene does not allow."""
        with_numbers(self.scene, values)

    def check_effects(self, values: Mapping[str, float]) -> None:
        """Raise SceneError for numbers, by their paths, at which effects make no sense together.

        Nothing else of the scene is checked: what only multiplies terms may be 0 or below, whatever its key allows.
        """
        try:
            self.scene.effects.check_at({full_path(path): value for path, value in values.items()})
        except ValueError as error:
            given = ", ".join(f"{path} = {value:g}" for path, value in values.items())
            raise SceneError(f"{given}: effects: {error}") from None

    def motions(self, values: Mapping[str, float]) -> Mapping[str, SteadyMotion]:
        """Return the motions of the bodies that rotate, with other numbers."""
        scene = with_numbers(self.scene, values) if values else self.scene
        return with_motions(self._context(scene), scene.effects.on).motions

    def contacts(self) -> Mapping[str, ContactPart]:
        """Return the contacts by their names, with all of their surfaces, whatever is open under preload."""
        return self._context(self.scene).contacts

    def solved_with(self, linear_solver: LinearSolver | str) -> Assembly:
        """Return the same assembly, which finds static states with this linear solver; what was made is shared."""
        other = copy(self)
        other._linear_solver = linear_solver
        return other

    def prepare(self) -> None:
        """Make what every problem is made from, the bodies and contacts without effects; it is kept for `problem`."""
        self._context(self.scene)

    def problem(self, values: Mapping[str, float]) -> Problem:
        """Return the problem with other numbers of the scene, by their paths.

        Raises
        ------
        SceneError
            There is no such number, or the scene does not allow its value.
        NotConvergedError
            The static state under preload is not found.
        """
        # The solver belongs to the key because a problem refers to the assembly that made it.
        for path in values:
            if path.startswith(("rigid.", "averaged.")) and ".reference." in path:
                raise SceneError(f'given "{path}"; the unknowns depend on it: expected another scene for another place')
        key = Same(self._linear_solver), tuple(sorted(values.items()))
        return self._cache.get("problem", key, lambda: self._build(values))

    def _build(self, values: Mapping[str, float]) -> Problem:
        scene = with_numbers(self.scene, values) if values else self.scene
        on = scene.effects.on
        springs = [t for i, spring in enumerate(scene.springs) for t in self._spring(spring, i)]
        springs += self._references(scene)
        context = with_motions(self._context(scene), on)
        always = [t for body in context.bodies.values() for t in (body.mass, body.elastic)] + springs
        tied = [t for part in context.contacts.values() if part.kind == "tied" for t in self._stiffness(scene, part)]
        static = tuple(t for t in (*always, *tied) if t.slot == "K")
        context = with_static_state(replace(context, static=static), on)
        owned = [*(("", t) for t in always), *self._interfaces_and_effects(scene, context)]
        terms = tuple(t for _, t in owned)
        paths = {p for t in terms for p in t.powers} | parameters_of(on)
        parameters = {p: number_at(scene, p) for p in sorted(paths)}
        operators = {name: part.operators for name, part in context.contacts.items()}
        doubtful = warnings_of(context, scene.effects.known, on, owned, parameters)
        warnings, state = (*self._warnings(context.contacts), *doubtful), context.static_state
        notes = (*self.notes, *notes_of_contacts(context.contacts))
        return Problem(
            terms, parameters, Discretisation(self.space, self.bodies, operators, notes, warnings, state), self,
            state_parameters(context, on), dict(values), self._motions, state=pressed_numbers(operators, state),
            describer=self._describer(context),
        )  # fmt: skip

    def _interfaces_and_effects(self, scene: Scene, context: Context) -> Iterator[Owned]:
        """Yield the terms of contacts and effects, each with the name of its effect."""
        on = scene.effects.on
        for part in context.contacts.values():
            for term in self._stiffness(scene, part):
                yield "", term
            if part.kind != "tied":
                yield from terms_of_contact(context, on, part)
        yield from terms_of_whole(context, on)
        for body in context.bodies.values():
            yield from terms_of_body(context, scene.effects.known, body)

    def _stiffness(self, scene: Scene, part: ContactPart) -> list[Term]:
        """Return the terms of a contact's own stiffness and damping."""
        return stiffness_terms(scene.contacts[scene.contact_names.index(part.name)], part, self._cache)

    def _context(self, scene: Scene) -> Context:
        """Return what effects are made from, before any of them."""
        return Context(
            self.space, self.loaded, {name: self._body(scene, name) for name in self.bodies},
            {name: self._contact(scene, name, i) for i, name in enumerate(scene.contact_names)},
            scene.materials, tuple(holding(scene)),
            tuple((key, tie, table) for (key, table), tie in zip(scene.ties, self.space.ties, strict=False)),
            scene.effects.on, partial(number_at, scene), self._cache, linear_solver=self._linear_solver,
            springs=tuple(scene.springs), moved=self.scene.moved,
        )  # fmt: skip

    def _describer(self, context: Context) -> Describer | None:
        """Return what describes modes: about the axis of what turns, or along the normal of a belt."""
        contacts = {name: c.motion for name, c in context.contacts.items()}
        key = tuple((name, None if m is None else m.way) for name, m in (*contacts.items(), *context.motions.items()))
        return self._cache.get("describer", key, lambda: describer_of(context, self.bodies))

    def _body(self, scene: Scene, name: str) -> BodyPart:
        body = scene.bodies[name]
        axes = material_axes(*body.axes) if body.axes is not None else None
        return BodyPart(
            name, self.bodies[name], scene.materials[body.material], f"materials.{body.material}", axes, body.is_mixed,
            *self._elastic(scene, name), scene.own_tables(name),
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

    def _references(self, scene: Scene) -> list[Term]:
        """Return mass and springs at the reference points of ties."""
        found = []
        for (key, table), tie in zip(scene.ties, self.space.ties, strict=False):
            path = f"{key.partition('[')[0]}.{table.name}"
            numbers = (table.inertia, *(s.model_dump_json() for s in table.springs), bool(table.mass))
            terms = partial(tie_terms, self.space, tie, table, path)
            found += self._cache.get(f"reference.{path}", repr(numbers), terms)
        return found

    def _ends(self, spring: Spring, i: int) -> tuple[Patch, tuple[sp.csr_array, sp.csr_array] | None]:
        """Return the surface or node set of a spring, and the mean motions of it and that at the other end."""
        patch = find_patch(self.space, self.loaded, spring.kind, spring.group, f"springs[{i}].{spring.kind}")
        if spring.to is None:
            return patch, None
        other = find_patch(self.space, self.loaded, spring.kind, spring.to, f"springs[{i}].to")
        one, two = (mean_motion(self.space, p, spring.kind, g) for p, g in ((patch, spring.group), (other, spring.to)))
        return patch, (one, two)

    def _contact(self, scene: Scene, name: str, i: int) -> ContactPart:
        contact = scene.contacts[i]
        motion = contact.sliding.motion() if contact.sliding is not None else None
        key = (None if motion is None else motion.way, contact.gap_tolerance)
        operators, carriers, pads = self._cache.get(
            f"contact.{name}", key,
            lambda: make_contact(self.space, self.bodies, self.loaded, contact, motion, f"contacts[{i}]"),
        )  # fmt: skip
        return ContactPart(
            name, contact.kind, operators, contact.normal_stiffness, contact.friction_ratio, motion,
            frozenset(carriers), frozenset(pads),
            (contact.surface, *(() if contact.is_rigid else (contact.counterface,))),
        )  # fmt: skip

    def _warnings(self, contacts: Mapping[str, ContactPart]) -> tuple[str, ...]:
        """Return what looks doubtful in the scene as it stands, but for its effects."""
        return self._cache.get(
            "warnings", None,
            lambda: (
                *self.loaded.warnings, *warnings_of_contacts(contacts),
                *warnings_of_scene(self.scene, self.loaded, self.space, self.bodies),
            ),
        )  # fmt: skip


def _least_memory(space: DisplacementSpace) -> int:
    """Return the bytes that stiffness and mass matrix take at the very least, while they are added up."""
    entries = _SHARED * space.mesh.nelements * (3 * space.dofs.element_dofs.shape[0]) ** 2
    return int(_COPIES * entries * 12)
