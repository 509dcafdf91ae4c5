"""Rotation of bodies of revolution: gyroscopic and convective inertia, and what their damping makes of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ..errors import SceneError
from ..fem.contact import Sliding
from ..fem.gyroscopics import circulatory_matrices, gyroscopic_matrices
from ..fem.spaces import DisplacementSpace
from ..problem.terms import Term
from ..schema.section import Direction, Section, Speed, Vector
from .rayleigh import Rayleigh


class Rotation(Section):
    """Steady rotation of bodies of revolution, described in the frame that does not rotate.

    With w = Ω × (x − c): gyroscopic C_G = 2 ∫ ρ δu·(w·∇)u̇ (skew) and K_Ω = −∫ ρ (w·∇)δu·(w·∇)u; the body's Rayleigh
    damping acts on the rate that the body sees and adds a circulatory stiffness. The centrifugal stress comes with
    `[effects.preload]` and acts through `[effects.stress_stiffening]`. The equations stand in
    `fe_squeal.fem.gyroscopics`.

    Attributes
    ----------
    bodies : list of str
        Bodies that rotate; each has to be one of revolution.
    axis : vector
        Axis of the rotation (default: that of the contacts on these bodies; given again, it has to agree).
    centre : vector, m
        A point of the axis (default: as above).
    speed : float, rad/s
        About the axis by the right hand (default: as above).
    """

    bodies: Annotated[list[str], Field(min_length=1)]
    axis: Direction | None = None
    centre: Vector | None = None
    speed: Speed | None = None


def rotation_motion(rotation: Rotation, body: str, contacts: Mapping[str, Sliding]) -> Sliding:
    """Return the motion of a rotating body: that of the contacts on it, or the one given, which has to agree.

    Raises
    ------
    SceneError
    """
    key = "effects.rotation"
    given = {"axis": rotation.axis, "centre": rotation.centre, "speed": rotation.speed}
    motion, source = None, ""
    for name, of_contact in contacts.items():
        if of_contact.centre is None:
            raise SceneError(
                f"{key}.bodies: body {body} rotates, and contact {name} moves it straight along a direction; expected"
                " sliding = { axis, centre, speed } there"
            )
        if motion is not None and not _same(motion, of_contact):
            raise SceneError(
                f"{key}: contacts {source} and {name} move body {body} differently; expected the same axis, centre and"
                " speed"
            )
        motion, source = of_contact, name
    if motion is None:
        if rotation.axis is None or rotation.speed is None:
            missing = " and ".join(k for k in ("axis", "speed") if given[k] is None)
            raise SceneError(f"{key}: no contact slides on body {body}, which gives its motion; expected {missing}")
        unit = np.array(rotation.axis) / np.linalg.norm(rotation.axis)
        return Sliding(unit * rotation.speed, np.array(rotation.centre or (0.0, 0.0, 0.0)))
    assert motion.centre is not None
    speed = np.linalg.norm(motion.velocity) if rotation.speed is None else rotation.speed
    axis = motion.velocity if rotation.axis is None else np.array(rotation.axis)
    if rotation.axis is None and rotation.speed is not None and rotation.speed < 0:
        axis = -axis
    centre = motion.centre if rotation.centre is None else np.array(rotation.centre)
    if not _same(motion, Sliding(axis / np.linalg.norm(axis) * speed, centre)):
        what = ", ".join(k for k, v in given.items() if v is not None)
        raise SceneError(f"{key}: given {what} other than those of contact {source}; expected the same, or none")
    return motion


def _same(a: Sliding, b: Sliding) -> bool:
    """Whether two rotations are one: a centre may lie anywhere on the axis."""
    assert a.centre is not None and b.centre is not None
    apart, size = b.centre - a.centre, np.linalg.norm(a.velocity)
    off = np.linalg.norm(np.cross(a.velocity, apart)) / size
    reach = np.linalg.norm(a.centre) + np.linalg.norm(b.centre)
    return bool(np.linalg.norm(a.velocity - b.velocity) <= 1e-9 * size and off <= 1e-9 * reach)


def rotation_terms(
    space: DisplacementSpace, body: str, elements: np.ndarray, path: str, motion: Sliding, elastic: Term,
    rayleigh: tuple[Rayleigh, str] | None, kept: Callable[[str, object, Callable[[], Any]], Any],
) -> list[Term]:  # fmt: skip
    """Return the terms of one rotating body.

    Parameters
    ----------
    elements : (e,) int
    path : str
        Of the material, for the parameters' names.
    motion : Sliding
        A rotation.
    elastic : Term
        Of the body.
    rayleigh : (Rayleigh, path) or None
        The damping of the body.
    kept : callable of (kind, key, make)
        Returns what `make` made for the same key before: the matrices at unit speed serve every speed.
    """
    speed = float(np.linalg.norm(motion.velocity))
    assert motion.centre is not None
    unit, density = Sliding(motion.velocity / speed, motion.centre), {f"{path}.density": 1}
    key = (*np.round(unit.velocity, 15), *motion.centre)
    G, K = kept(f"rotation.{body}", key, lambda: gyroscopic_matrices(space, elements, 1.0, unit))
    terms = [
        Term(f"gyroscopic.{body}", "C", G * speed, symmetric=False, skew=True, powers=density),
        Term(f"convection.{body}", "K", K * speed**2, symmetric=True, powers=density),
    ]
    if rayleigh is not None and (rayleigh[0].alpha or rayleigh[0].beta):
        damping, where = rayleigh
        B_K, B_M = kept(
            f"rotating_damping.{body}", (*key, id(elastic.matrix)),
            lambda: circulatory_matrices(space, elements, elastic.matrix, 1.0, unit),
        )  # fmt: skip
        name = f"rotating_damping.{body}"
        if damping.beta:
            powers = {f"{where}.beta": 1, **elastic.powers}
            terms.append(Term(name, "K", B_K * speed, symmetric=False, skew=True, powers=powers))
        if damping.alpha:
            powers = {f"{where}.alpha": 1, **density}
            terms.append(Term(name, "K", B_M * speed, symmetric=False, skew=True, powers=powers))
    return terms
