"""The static state of a scene under preload: its loads, its contacts, and the parameters that it depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..effects.preload import BaseState, PressedContact, contact_summary, pressure_load, solve_preload
from ..fem.contact import ContactOperators
from ..fem.gyroscopics import centrifugal_load
from ..fem.motion import Sliding
from ..fem.spaces import DisplacementSpace
from ..mesh import LoadedMesh
from ..problem.parameters import MU
from ..problem.terms import Term
from ..scene import Scene, number_at
from .bodies import find_facets
from .cache import Same


@dataclass(frozen=True)
class Pressing:
    """What presses on the bodies of a scene, and what holds them.

    Attributes
    ----------
    static : sequence of Term
        Stiffnesses of bodies, springs and tied contacts.
    numbers : mapping of parameter to value
        Of these terms.
    load : (n,) float, N
    resultant : (3,) float, N
        Of the pressures.
    contacts : mapping of contact to PressedContact
    mu : float
    lift_off : bool
    size : float, m
        Of the model.
    linear_solver : str
        As the scene has it.
    """

    static: Sequence[Term]
    numbers: Mapping[str, float]
    load: np.ndarray
    resultant: np.ndarray
    contacts: Mapping[str, PressedContact]
    mu: float
    lift_off: bool
    size: float
    linear_solver: str

    @property
    def key(self) -> object:
        """What the static state depends on."""
        return (
            self.load.tobytes(), self.mu, tuple(sorted(self.numbers.items())),
            tuple(Same(t.matrix) for t in self.static),
            tuple((Same(c.operators), c.stiffness, c.friction_ratio) for c in self.contacts.values()), self.lift_off,
        )  # fmt: skip

    def solve(self, start: BaseState | None) -> BaseState:
        """Return the static state, from that of nearly the same problem if there is one.

        Raises
        ------
        SceneError, NotConvergedError
        """
        K = sp.csr_array(sum(t.matrix * t.coefficient(self.numbers) for t in self.static))
        return solve_preload(
            K, self.load, self.resultant, self.contacts, self.mu, self.lift_off, self.size, start,
            self.linear_solver,
        )


def pressing_of(
    scene: Scene, space: DisplacementSpace, bodies: Mapping[str, np.ndarray], loaded: LoadedMesh,
    contacts: Mapping[str, ContactOperators], static: Sequence[Term], motions: Mapping[str, Sliding],
) -> Pressing | None:  # fmt: skip
    """Return what presses; None without preload.

    Parameters
    ----------
    static : sequence of Term
        Stiffnesses of bodies, springs and tied contacts.
    motions : mapping of body to Sliding
        Of the bodies that rotate, for their centrifugal load.

    Raises
    ------
    SceneError, MeshError
    """
    preload, friction = scene.effects.preload, scene.effects.friction
    if preload is None:
        return None
    numbers = {p: number_at(scene, p) for t in static for p in t.powers}
    load, resultant = np.zeros(space.unknowns), np.zeros(3)
    for group, pressure in preload.pressures.items():
        surface = space.surface(find_facets(loaded, group, f"effects.preload.pressures.{group}"))
        forces, total = pressure_load(space, surface, pressure)
        load, resultant = load + forces, resultant + total
    for name, motion in motions.items():
        density = scene.materials[scene.bodies[name].material].density
        load = load + centrifugal_load(space, bodies[name], density, motion)
    mu = 0.0 if friction is None else friction.mu if preload.mu == "swept" else preload.mu
    pressed = {
        name: PressedContact(
            contacts[name], c.normal_stiffness, c.friction_ratio if c.kind == "sliding" else 0.0,
            c.sliding.motion() if c.sliding is not None else None,
        )
        for name, c in zip(scene.contact_names, scene.contacts, strict=True)
        if c.kind != "tied"
    }  # fmt: skip
    size = float(np.ptp(space.mesh.p, axis=1).max())
    return Pressing(static, numbers, load, resultant, pressed, mu, preload.lift_off, size, scene.solve.linear_solver)


def pressed_numbers(
    contacts: Mapping[str, ContactOperators], base: BaseState | None
) -> dict[str, dict[str, float]]:
    """Return what presses in each contact of the static state, in numbers; nothing without preload."""
    if base is None:
        return {}
    return {name: {"mu": base.mu, **contact_summary(contacts[name], c)} for name, c in base.contacts.items()}


def state_parameters(scene: Scene, static: Sequence[Term], base: BaseState | None) -> frozenset[str]:
    """Return the parameters that the static state depends on."""
    preload = scene.effects.preload
    if base is None or preload is None:
        return frozenset()
    names = {p for t in static for p in t.powers}
    names |= {f"contacts.{n}.{key}" for n in scene.contact_names for key in ("normal_stiffness", "friction_ratio")}
    if preload.mu == "swept":
        names.add(MU)
    if scene.effects.rotation is not None:
        names |= {f"materials.{m}.density" for m in scene.materials}
    return frozenset(names)
