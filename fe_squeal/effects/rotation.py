"""Rotation of bodies of revolution: gyroscopic and convective inertia, and what their damping makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
import scipy.sparse as sp
from pydantic import Field

from ..errors import SceneError
from ..fem.motion import Sliding
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


def unit_rotation(motion: Sliding) -> Sliding:
    """Return a rotation about the same axis at 1 rad/s, whose matrices serve every speed."""
    return Sliding(motion.velocity / float(np.linalg.norm(motion.velocity)), motion.centre)


def rotation_terms(
    body: str, path: str, motion: Sliding, inertia: tuple[sp.csr_array, sp.csr_array]
) -> list[Term]:
    """Return the gyroscopic and the convective term of one rotating body.

    Parameters
    ----------
    path : str
        Of the material, for the parameters' names.
    motion : Sliding
        A rotation.
    inertia : pair of (n, n) sparse
        `gyroscopic_matrices` at unit density and `unit_rotation`.
    """
    speed, density = float(np.linalg.norm(motion.velocity)), {f"{path}.density": 1}
    G, K = inertia
    return [
        Term(f"gyroscopic.{body}", "C", G * speed, symmetric=False, skew=True, powers=density),
        Term(f"convection.{body}", "K", K * speed**2, symmetric=True, powers=density),
    ]


def rotating_damping_terms(
    body: str, path: str, motion: Sliding, elastic: Term, rayleigh: tuple[Rayleigh, str],
    circulatory: tuple[sp.csr_array, sp.csr_array],
) -> list[Term]:  # fmt: skip
    """Return the circulatory terms of a rotating body with damping, only those that are not zero.

    Parameters
    ----------
    path, motion : as of `rotation_terms`
    elastic : Term
        Of the body.
    rayleigh : (Rayleigh, path)
        The damping of the body.
    circulatory : pair of (n, n) sparse
        `circulatory_matrices` at unit density and `unit_rotation`.
    """
    (damping, where), (B_K, B_M) = rayleigh, circulatory
    speed = float(np.linalg.norm(motion.velocity))
    parts = (("beta", damping.beta, B_K, elastic.powers), ("alpha", damping.alpha, B_M, {f"{path}.density": 1}))
    return [
        Term(
            f"rotating_damping.{body}", "K", B * speed, symmetric=False, skew=True,
            powers={f"{where}.{key}": 1, **powers},
        )
        for key, size, B, powers in parts
        if size
    ]  # fmt: skip
