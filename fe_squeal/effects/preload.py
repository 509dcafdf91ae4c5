"""Preload: the static state under brake pressure, about which the brake vibrates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import ClassVar, Literal

import numpy as np

from ..errors import SceneError
from ..fem.gyroscopics import centrifugal_load
from ..fem.spaces import DisplacementSpace
from ..fem.static_contact import TangentSolver
from ..fem.surfaces import Surface
from ..problem.parameters import MU
from ..problem.terms import Term, sum_terms
from .cache import Same
from .context import ContactPart, Context
from .effect import Effect
from .friction import Friction
from .static_state import PressedContact, StaticState, solve_preload, state_warnings


class Preload(Effect):
    """Static solve under pressures, with contact that opens and steady sliding friction.

    K u + Σ ∫ (δg + μ δs) k_n min(g, 0) dA = f, pressure p0 = −k_n g where the gap of the displacements g < 0. Meshes
    that leave a gap, within gap_tolerance, count as just touching. Friction and contact stiffness then act on the
    closed part alone. Loads keep their direction, and pads stick nowhere.

    Attributes
    ----------
    pressures : table of float, Pa
        Surface group = pressure on it, against its outward normal; a negative one pulls. Beside it the centrifugal
        force acts where `[effects.rotation]` is on.
    lift_off : bool
        Whether contacts open where they would pull.
    mu : "swept" or float
        Friction coefficient of the static solve: "swept" follows effects.friction.mu through a sweep.
    """

    pressures: dict[str, float] = {}
    lift_off: bool = True
    mu: Literal["swept"] | float = "swept"

    name: ClassVar[str] = "preload"
    summary: ClassVar[str] = "Static state under pressures, with contacts that open."

    def check_effects(self, others: Mapping[str, Effect]) -> None:
        """Raise ValueError where nothing loads the bodies, and for friction of the static state alone."""
        if not self.pressures and "rotation" not in others:
            raise ValueError(
                "given preload without a load; expected preload.pressures = { SURFACE = ... }, or [effects.rotation]"
            )
        if self.mu != "swept" and self.mu and Friction.name not in others:
            raise ValueError(
                f"given preload.mu = {self.mu:g} without friction; expected [effects.friction] with mu beside it"
            )

    def surfaces(self) -> dict[str, str]:
        """Return the surfaces that are pressed."""
        return {f"effects.preload.pressures.{group}": group for group in self.pressures}

    def static_state(self, context: Context) -> StaticState:
        """Return the static state. The search starts from the one found before, at other values, if there is one.

        Raises
        ------
        SceneError, MeshError, NotConvergedError
        """
        numbers = {p: context.number(p) for t in context.static for p in t.powers}
        load, resultant = self._loads(context)
        mu = self._mu(context)
        contacts = {
            name: PressedContact(
                c.operators, c.normal_stiffness, _modulus(context, c),
                c.friction_ratio if c.kind == "sliding" else 0.0, c.motion,
            )
            for name, c in context.contacts.items()
            if c.kind != "tied"
        }
        key = (
            load.tobytes(), mu, tuple(sorted(numbers.items())), tuple(Same(t.matrix) for t in context.static),
            tuple((Same(c.operators), c.stiffness, c.friction_ratio) for c in contacts.values()), self.lift_off,
        )  # fmt: skip
        size = float(np.ptp(context.space.mesh.p, axis=1).max())
        before, solver = context.cache.latest("static state"), context.linear_solver
        tangents = context.cache.get("tangents", (Same(solver), len(load)), lambda: TangentSolver(solver))

        def solve() -> StaticState:
            K = sum_terms((t, t.coefficient(numbers)) for t in context.static)
            assert K is not None
            return solve_preload(K, load, resultant, contacts, mu, self.lift_off, size, before, tangents)

        return context.cache.get("static state", key, solve)

    def state_parameters(self, context: Context) -> frozenset[str]:
        """Return the parameters that the static state depends on."""
        names = {p for t in context.static for p in t.powers}
        for contact in context.contacts.values():
            names |= {f"{contact.path}.normal_stiffness", f"{contact.path}.friction_ratio"}
        if self.mu == "swept":
            names.add(MU)
        if context.motions:  # by the centrifugal force
            names |= {f"materials.{name}.density" for name in context.materials}
        return frozenset(names)

    def warnings(self, context: Context, others: Sequence[Term], parameters: Mapping[str, float]) -> list[str]:
        """Return a sentence for each contact whose static state is outside what the equations hold."""
        states = [(name, contact.state) for name, contact in context.contacts.items() if contact.state is not None]
        return [text for name, s in states for text in state_warnings(name, s.follower_ratio, s.pulling)]

    def _mu(self, context: Context) -> float:
        friction = context.table(Friction)
        if friction is None:
            return 0.0
        return friction.mu if self.mu == "swept" else self.mu

    def _loads(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """Return the nodal forces (n,) N of pressures and rotation, and the resultant (3,) N of the pressures."""
        space = context.space
        load, resultant = np.zeros(space.unknowns), np.zeros(3)
        for group, pressure in self.pressures.items():
            forces, total = context.cache.get(f"pressure on {group}", Same(space), partial(_unit_load, context, group))
            load, resultant = load + pressure * forces, resultant + pressure * total
        for name, motion in context.motions.items():
            body = context.bodies[name]
            load = load + centrifugal_load(space, body.elements, body.material.density, motion)
        return load, resultant


def _modulus(context: Context, contact: ContactPart) -> float:
    """Return the least Young's modulus, Pa, of the bodies that touch in a contact."""
    found = []
    for name in contact.pads | contact.carriers:
        body = context.bodies[name]
        own = body.material.youngs_modulus
        found.append(min(own) if isinstance(own, list) else context.number(f"{body.material_path}.youngs_modulus"))
    return min(found, default=np.inf)


def _unit_load(context: Context, group: str) -> tuple[np.ndarray, np.ndarray]:
    """Return what `pressure_load` does for a pressure of 1 Pa; raises SceneError for a surface inside the mesh."""
    path = f"effects.preload.pressures.{group}"
    if (context.space.mesh.f2t[1, context.facets(group, path)] >= 0).any():
        raise SceneError(
            f'{path}: "{group}" lies inside the mesh, where a pressure has no side; expected a free surface'
        )
    return pressure_load(context.space, context.surface(group, path), 1.0)


def pressure_load(space: DisplacementSpace, surface: Surface, pressure: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodal forces (n,) N and the resultant (3,) N of a pressure on a surface: −∫ p δu·n dA."""
    forces = space.along(surface.values, surface.normals).T @ (-pressure * surface.weights)
    return np.asarray(forces), -pressure * surface.weights @ surface.normals
