"""The balance of forces of the static state: where what is applied to each part of the model goes.

A part is a connected piece of the mesh. In a rigid translation t of one part its elastic stresses do no work, and so
the principle of virtual work leaves, for each of t = e_x, e_y, e_z,

    F_applied + Σ F_contact + Σ F_spring + F_supports = 0,

the resultants of what acts on it from outside. The first three follow from tractions at quadrature points, also at
nodes that supports hold; what supports take is what is left, and zero in a direction that none of them holds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from ..effects.preload import Preload
from ..effects.springs import Spring
from ..effects.static_forces import contact_traction, spring_forces
from ..effects.static_state import StaticState
from ..effects.ties import Rigid
from ..fem.gyroscopics import nodal_centrifugal_forces
from ..fem.motion import SteadyMotion
from ..fem.rigid_motions import connected_parts
from ..fem.surfaces import Surface
from ..fem.ties import Tie
from ..mesh.groups import find_facets
from ..problem.problem import Problem
from ..scene import Scene, with_numbers
from ..scene.contacts import Contact
from .assembly import Assembly
from .discretisation import Discretisation, discretisation_of

# Of the sum of all nodal loads on a part: loads whose resultant is less press its sides apart, and the part nowhere.
_CANCELS = 0.01
_ROUNDING = 1e-9  # of the same sum: nodal forces of a moment on a part by itself cancel but for rounding
_ELSEWHERE = 0.05  # part of the load on a part with a contact: if springs and supports take more, there is a warning


@dataclass
class PartForces:
    """Forces (3,) N on one connected part of the mesh.

    Attributes
    ----------
    bodies : tuple of str
        Bodies that the part is made of.
    applied : (3,) float, N
        Force of pressures and, on a body that rotates, centrifugal force.
    loads : float, N
        Sum of the sizes of the nodal loads that `applied` is the resultant of.
    contacts, springs : mapping of name to (3,) float, N
    held : (3,) bool
        Directions in which a support holds a node of the part.
    pressed : tuple of str
        Surface groups with a pressure on this part.
    on_pressed : tuple of str
        Springs that act on one of these surfaces.
    """

    bodies: tuple[str, ...]
    applied: np.ndarray
    contacts: dict[str, np.ndarray] = field(default_factory=dict)
    springs: dict[str, np.ndarray] = field(default_factory=dict)
    held: np.ndarray = field(default_factory=lambda: np.zeros(3, bool))
    pressed: tuple[str, ...] = ()
    on_pressed: tuple[str, ...] = ()
    loads: float = 0.0

    @property
    def rest(self) -> np.ndarray:
        """(3,) N: minus the sum of all but the supports."""
        return -np.sum([self.applied, *self.contacts.values(), *self.springs.values()], axis=0)

    @property
    def supports(self) -> np.ndarray:
        """(3,) N: what supports put on the part."""
        return np.where(self.held, self.rest, 0.0)

    @property
    def residual(self) -> float:
        """What is not balanced, over the largest force: rounding of the static solve."""
        forces = [self.applied, *self.contacts.values(), *self.springs.values(), self.rest]
        largest = max(float(np.linalg.norm(f)) for f in forces)
        return float(np.linalg.norm(self.rest - self.supports)) / largest if largest else 0.0


def force_balance(problem: Problem) -> list[PartForces]:
    """Return the forces on each part of the model in the static state at the nominal values; none without preload."""
    made, assembly = discretisation_of(problem), problem.source
    if made is None or made.static_state is None or not isinstance(assembly, Assembly):
        return []
    scene = with_numbers(assembly.scene, problem.changed) if problem.changed else assembly.scene
    balance = _Balance(made, made.static_state, scene, assembly)
    balance.add_loads(assembly.motions(problem.changed))
    for i, spring in enumerate(scene.springs):
        balance.add_spring(spring, f"springs[{i}]")
    for (_, table), tie in zip(scene.ties, made.space.ties, strict=False):
        balance.add_reference(table, tie)
    for i, (name, contact) in enumerate(zip(scene.contact_names, scene.contacts, strict=True)):
        balance.add_contact(name, contact, f"contacts[{i}]")
    return balance.parts


class _Balance:
    """The parts of a model, and what acts on them."""

    def __init__(self, made: Discretisation, state: StaticState, scene: Scene, assembly: Assembly) -> None:
        self.discretisation, self.state, self.scene, self.loaded = made, state, scene, assembly.loaded
        self.space = space = made.space
        self.part = connected_parts(space)
        self.u = space.expand(state.u)
        first = space.dofs.element_dofs[0]
        self.of_element = self.part[first]
        self.parts = [PartForces((), np.zeros(3)) for _ in range(self.part.max() + 1)]
        for i, p in enumerate(self.parts):
            p.bodies = tuple(name for name, e in made.bodies.items() if (self.of_element[e] == i).any())
            p.held = space.fixed.reshape(-1, 3)[self.part == i].any(axis=0)

    def add_loads(self, motions: Mapping[str, SteadyMotion]) -> None:
        """Add pressures, and the centrifugal force of bodies that rotate."""
        preload = next(e for e in self.scene.effects.on.values() if isinstance(e, Preload))
        for name, pressure in preload.pressures.items():
            surface = self._surface(name, f"effects.preload.pressures.{name}")
            load = surface.values.T @ (-pressure * surface.normals * surface.weights[:, None])
            self._apply(load)
            for p, force in zip(self.parts, self._by_part(np.abs(load)), strict=True):
                if force.any():
                    p.pressed += (name,)
        for name, motion in motions.items():
            density = self.scene.materials[self.scene.bodies[name].material].density
            load = nodal_centrifugal_forces(self.space, self.discretisation.bodies[name], density, motion)
            self._apply(load)

    def _apply(self, load: np.ndarray) -> None:
        """Add nodal loads (nodes, 3) N."""
        sizes = np.bincount(self.part, np.linalg.norm(load, axis=1), len(self.parts))
        for p, force, size in zip(self.parts, self._by_part(load), sizes.tolist(), strict=True):
            p.applied, p.loads = p.applied + force, p.loads + size

    def add_spring(self, spring: Spring, path: str) -> None:
        """Add the force of a spring."""
        forces = self._by_part(spring_forces(self.space, self.loaded, spring, path, self.u))
        for p, force in zip(self.parts, forces, strict=True):
            if force.any():
                p.springs[spring.name] = force
                if spring.kind == "surface" and (spring.group in p.pressed or spring.to in p.pressed):
                    p.on_pressed += (spring.name,)

    def add_reference(self, table: Rigid, tie: Tie) -> None:
        """Add the forces of springs at a tie's reference, and the directions in which it is held.

        Force and moment F (6,) on the reference act on the nodes as LᵀF, (U, θ) = L u, so that a part gets a share of
        either where the tie spans several.
        """
        for held in np.eye(6)[table.held]:
            for p, force in zip(self.parts, self._through(tie, held), strict=True):
                p.held = p.held | (force != 0)
        motion = self.space.reference(tie) @ self.state.u
        for i, spring in enumerate(table.springs):
            way = np.concatenate([spring.direction or np.zeros(3), spring.axis or np.zeros(3)])
            d = way / np.linalg.norm(way)
            forces = self._through(tie, -spring.stiffness * (motion @ d) * d)
            for p, force in zip(self.parts, forces, strict=True):
                if force.any():
                    p.springs[f"{table.name}.{i}"] = force

    def _through(self, tie: Tie, load: np.ndarray) -> np.ndarray:
        """Return the force (parts, 3) N by which a force and moment (6,) on a tie's reference act on each part."""
        nodal = np.zeros((self.space.nodes, 3))
        nodal[tie.nodes] = (tie.motion.T @ load).reshape(-1, 3)
        force = self._by_part(nodal)
        return np.where(np.abs(force) > _ROUNDING * self._by_part(np.abs(nodal)).max(axis=1, keepdims=True), force, 0.0)

    def add_contact(self, name: str, contact: Contact, path: str) -> None:
        """Add the forces of a contact on both its sides."""
        c = self.discretisation.contacts[name]
        mu = self.state.mu * contact.friction_ratio if contact.kind == "sliding" else 0.0
        traction = contact_traction(c, self.state.u, contact.normal_stiffness, self.state.contacts.get(name), mu)
        forces = traction * c.weights[:, None]
        sides = [(contact.surface, "surface", 1.0)]
        if not contact.is_rigid:
            sides.append((contact.counterface, "counterface", -1.0))
        for group, key, sign in sides:
            owner = self._part_beside(group, f"{path}.{key}", c.points)
            for i in np.unique(owner).tolist():
                known = self.parts[i].contacts.get(name, np.zeros(3))
                self.parts[i].contacts[name] = known + sign * forces[owner == i].sum(axis=0)

    def _surface(self, group: str, path: str) -> Surface:
        return self.space.surface(find_facets(self.loaded, group, path))

    def _by_part(self, forces: np.ndarray) -> np.ndarray:
        """Return the resultant (parts, 3) N of forces on the nodes (nodes, 3) N."""
        return np.stack([np.bincount(self.part, forces[:, c], len(self.parts)) for c in range(3)], axis=1)

    def _part_beside(self, group: str, path: str, points: np.ndarray) -> np.ndarray:
        """Return the part (q,) int of the nearest facet of a surface group to each point."""
        surface = self._surface(group, path)
        near = cKDTree(surface.points).query(points)[1] // (len(surface.points) // len(surface.facets))
        return np.asarray(self.of_element[self.space.mesh.f2t[0, surface.facets[near]]])


def balance_warnings(parts: list[PartForces]) -> list[str]:
    """Return a sentence for each part of whose load springs or supports take more than 5 %, instead of its contacts."""
    found = []
    for p in parts:
        size = float(np.linalg.norm(p.applied))
        if not p.pressed or not p.contacts or not size > _CANCELS * p.loads:
            continue
        along = -p.applied / size
        taken = {f"spring {name}": float(f @ along) / size for name, f in p.springs.items()}
        taken["supports"] = float(p.supports @ along) / size
        shares = {name: share for name, share in taken.items() if share > _ELSEWHERE}
        if shares:
            pressed = sum(float(f @ along) for f in p.contacts.values())
            there = {f"spring {name}": f" on the pressed surface {' and '.join(p.pressed)}" for name in p.on_pressed}
            where = ", ".join(f"{100 * s:.3g} % into {name}{there.get(name, '')}" for name, s in shares.items())
            found.append(
                f"preload: of {size:.4g} N on {_label(p)}, {pressed:.4g} N reach its contacts: {where}; if the"
                " contact is meant to carry the load, springs and supports should act across it alone"
            )
    return found


def balance_record(parts: list[PartForces]) -> dict[str, Mapping[str, object]]:
    """Return the balance for run.json, by part."""
    return {
        _label(p).removeprefix("body ").removeprefix("bodies "): {
            "applied_n": p.applied, "contacts_n": p.contacts, "springs_n": p.springs, "supports_n": p.supports,
            "residual": p.residual,
        }
        for p in parts
    }  # fmt: skip


def _label(p: PartForces) -> str:
    return f"{'body' if len(p.bodies) == 1 else 'bodies'} {' + '.join(p.bodies)}"
