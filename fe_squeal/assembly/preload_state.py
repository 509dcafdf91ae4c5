"""The static state of a scene under preload: its loads, its contacts, and the parameters that it depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp

from ..effects.preload import BaseState, PressedContact, pressure_load, solve_preload
from ..fem.contact import ContactOperators, Sliding
from ..fem.gyroscopics import centrifugal_load
from ..fem.spaces import DisplacementSpace
from ..mesh import LoadedMesh
from ..problem.parameters import MU
from ..problem.terms import Term
from ..scene import Scene, number_at
from .bodies import find_facets
from .rotating_bodies import Kept


def base_state(
    scene: Scene, space: DisplacementSpace, bodies: Mapping[str, np.ndarray], loaded: LoadedMesh,
    contacts: Mapping[str, ContactOperators], static: Sequence[Term], motions: Mapping[str, Sliding],
    start: BaseState | None, kept: Kept,
) -> BaseState | None:  # fmt: skip
    """Return the static state; None without preload.

    Parameters
    ----------
    static : sequence of Term
        Stiffnesses of bodies, springs and tied contacts.
    motions : mapping of body to Sliding
        Of the bodies that rotate, for their centrifugal load.
    start : BaseState or None
        Of nearly the same problem.

    Raises
    ------
    SceneError, NotConvergedError
    """
    preload, friction = scene.effects.preload, scene.effects.friction
    if preload is None:
        return None
    numbers = {p: number_at(scene, p) for t in static for p in t.powers}
    K = sp.csr_array(sum(t.matrix * t.coefficient(numbers) for t in static))
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
    key = (
        load.tobytes(), mu, tuple(sorted(numbers.items())), tuple(id(t.matrix) for t in static),
        tuple((id(c.operators), c.stiffness, c.friction_ratio) for c in pressed.values()), preload.lift_off,
    )  # fmt: skip
    found: BaseState = kept(
        "base", key, lambda: solve_preload(K, load, resultant, pressed, mu, preload.lift_off, size, start)
    )
    return found


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
