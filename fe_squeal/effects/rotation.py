"""Rotation of bodies of revolution: gyroscopic and convective inertia, and what their damping makes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
import scipy.sparse as sp
from pydantic import Field

from ..errors import suggest
from ..fem.gyroscopics import circulatory_matrices, gyroscopic_matrices
from ..fem.motion import SteadyMotion
from ..problem.terms import Term
from ..schema.section import Direction, Speed, Vector
from .cache import Same
from .context import BodyPart, Context
from .effect import Effect, Outline
from .free_rotors import free_rotors
from .friction import Friction
from .rayleigh import Rayleigh
from .rotating_bodies import (
    check_contacts,
    check_material,
    check_shape,
    check_sliding,
    joined_to_others,
    motion_of_body,
    nodes_of_body,
    turns_with_bodies,
    unit_rotation,
)
from .rotating_contacts import contact_damping_terms
from .rotating_joints import check_held_directions, check_springs
from .rotating_references import reference_terms
from .stress_stiffening import StressStiffening
from .structural_damping import FROZEN_AT, StructuralDamping


class Rotation(Effect):
    """Steady rotation of bodies of revolution, described in the frame that does not rotate.

    With w = Ω × (x − c): gyroscopic C_G = 2 ∫ ρ δu·(w·∇)u̇ (skew) and K_Ω = −∫ ρ (w·∇)δu·(w·∇)u; the body's Rayleigh
    damping, and structural damping frozen at a frequency, act on the rate that the body sees and add a circulatory
    stiffness. (Structural damping at each mode's own frequency does not: it is right for waves that run faster than the
    body turns.) The centrifugal stress comes with `[effects.preload]` and acts through `[effects.stress_stiffening]`.
    Damping of contacts between bodies that turn alike does so too.
    Of a body with damping supports and held references have to hold directions that a turn leaves alone: the axis, all
    across it, or all. Springs between bodies that turn alike turn too: across the axis they have to be alike in all
    directions, and have no dampers. Springs to the ground stand still.
    The equations stand in `fe_squeal.fem.gyroscopics`. Inertia at a reference point that the body is tied to turns with
    it, see `fe_squeal.effects.rotating_references`.

    Attributes
    ----------
    bodies : list of str
        Bodies that rotate; each has to be one of revolution, and its material the same all around the axis up to 0.1 %
        of the energy of any strain: isotropic, or orthotropic with axis 3 along the axis of rotation, equal values
        along 1 and 2, and G12 = E1/(2(1 + nu12)). Its matrices are those of the values given.
    axis : vector
        Axis of the rotation (default: that of the contacts on these bodies; given again, it has to agree).
    centre : vector, m
        A point of the axis (default: as above).
    speed : float, rad/s
        About the axis by the right hand (default: as above).
    """

    name: ClassVar[str] = "rotation"
    summary: ClassVar[str] = "Rotation of bodies of revolution."

    bodies: Annotated[list[str], Field(min_length=1)]
    axis: Direction | None = None
    centre: Vector | None = None
    speed: Speed | None = None

    def check_scene(self, outline: Outline) -> None:
        """Raise ValueError for a name that is no body, and for a body of the mixed formulation."""
        for i, name in enumerate(self.bodies):
            if name not in outline.bodies:
                raise ValueError(
                    f'effects.rotation.bodies[{i}]: given "{name}", which is no body{suggest(name, outline.bodies)}'
                )
        for name in outline.mixed_bodies:
            if name in self.bodies:
                raise ValueError(
                    f'bodies.{name}.formulation: given "mixed", and effects.rotation.bodies has {name}; expected'
                    ' "standard" for a body that rotates'
                )

    def motions(self, context: Context) -> dict[str, SteadyMotion]:
        """Return the motion of each rotating body, of which all is checked to be the same around the axis.

        Raises
        ------
        SceneError, MeshError
        """
        motions = {}
        for name in self.bodies:
            contacts = {
                c.name: c.motion
                for c in context.contacts.values()
                if c.motion is not None and name in c.carriers
            }  # fmt: skip
            motions[name] = motion_of_body(name, contacts, self.axis, self.centre, self.speed)
        for name, motion in motions.items():
            _check(context, context.bodies[name], motion)
            if _damping(context, context.bodies[name]) or _is_damped_at_contacts(context, motions, name):
                check_held_directions(context, name, motion)
        check_springs(context, motions)
        check_contacts(context, motions)
        if context.table(Friction) is not None:
            check_sliding(context, motions)
        return motions

    def body_terms(self, context: Context, body: BodyPart, path: str) -> list[Term]:
        """Return the terms of a rotating body, and of its Rayleigh damping."""
        motion = context.motions.get(body.name)
        if motion is None:
            return []
        unit = unit_rotation(motion)
        terms = [*_inertia_terms(context, body, motion)]
        damped = _damping(context, body)
        if damped:
            elastic = body.elastic
            circulatory = context.cache.get(
                f"rotating_damping.{body.name}", (motion.way, Same(elastic.matrix)),
                lambda: circulatory_matrices(context.space, body.elements, elastic.matrix, 1.0, unit),
            )  # fmt: skip
            terms += context.cache.get(
                f"rotating_damping_terms.{body.name}",
                (*_speed(motion), Same(circulatory), Same(elastic), repr(damped)),
                lambda: tuple(
                    rotating_damping_terms(body.name, body.material_path, motion, elastic, damped, circulatory)
                ),
            )  # fmt: skip
        return terms

    def terms(self, context: Context) -> list[Term]:
        """Return the terms of damped contacts, and of inertia at references that rotating bodies are tied to.

        Raises
        ------
        SceneError
            Such a point or its inertia is not the same all around the axis.
        """
        found = []
        for path, tie, table in context.references:
            # Bodies that share nodes may both reach the reference, whose inertia turns once.
            held = [name for name in context.motions if np.isin(tie.nodes, nodes_of_body(context, name)).any()]
            for name in held[:1]:
                found += reference_terms(context.space, tie, table, path, name, context.motions[name])
        for contact in context.contacts.values():
            found += contact_damping_terms(context, contact)
        return found

    def warnings(self, context: Context, others: Sequence[Term], parameters: Mapping[str, float]) -> list[str]:
        """Return a sentence for each rotating body that is joined to one that does not rotate, or held by nothing.

        Held by nothing is what can turn or tilt against no more than its own inertia.

        A rigid rotation u = e × x has (w·∇)u = Ω × u, so that K_Ω takes at most Ω²M away, and about the axis just that:
        M ü = Ω²M u grows with Re λ = Ω. The centrifugal stress σ balances ρΩ²r; the virtual work of that equation makes
        its stiffness ∫σ_ij ∂_iu·∂_ju = +Ω²M for the same u, and nothing grows.
        """
        found = joined_to_others(context)
        if context.table(StressStiffening) is not None:
            return found
        inertia = [t for name, motion in context.motions.items()
                   for t in _inertia_terms(context, context.bodies[name], motion)]  # fmt: skip
        convection = {name: next(t for t in inertia if t.name == f"convection.{name}") for name in context.motions}
        for names, words in free_rotors(context, others, convection, parameters).items():
            speed = np.linalg.norm(context.motions[names[0]].velocity)
            one = len(names) == 1
            who = f"body {names[0]} is" if one else f"bodies {', '.join(names[:-1])} and {names[-1]} together are"
            found.append(
                f"effects.rotation: {who} free to {' and to '.join(words)}; without"
                f" [effects.stress_stiffening] {'its' if one else 'their'} slow motions, up to some"
                f" {2 * speed / (2 * np.pi):.3g} Hz, are not right, and growth of up to Re λ = Ω = {speed:.4g} 1/s"
                " appears that does not exist: write [effects.preload] and [effects.stress_stiffening], or hold"
                f" {'the body' if one else 'them'}"
            )
        return found


def _check(context: Context, body: BodyPart, motion: SteadyMotion) -> None:
    """Raise where a rotating body, what holds it or its material is not the same all around the axis."""
    context.cache.get(f"revolution.{body.name}", motion.way, lambda: check_shape(context, body, motion))
    check_material(body, motion)


def _is_damped_at_contacts(context: Context, motions: dict[str, SteadyMotion], body: str) -> bool:
    """Return whether a contact with damping turns with a body."""
    return any(
        body in contact.pads | contact.carriers and context.number(f"{contact.path}.normal_damping")
        and turns_with_bodies(contact, motions)
        for contact in context.contacts.values()
    )  # fmt: skip


def _inertia_terms(context: Context, body: BodyPart, motion: SteadyMotion) -> Sequence[Term]:
    inertia = context.cache.get(
        f"rotation.{body.name}", motion.way,
        lambda: gyroscopic_matrices(context.space, body.elements, 1.0, unit_rotation(motion)),
    )  # fmt: skip
    return context.cache.get(
        f"rotation_terms.{body.name}", (*_speed(motion), Same(inertia)),
        lambda: tuple(rotation_terms(body.name, body.material_path, motion, inertia)),
    )  # fmt: skip


def _speed(motion: SteadyMotion) -> tuple[float, ...]:
    """Return the angular velocity as part of a key: terms that are equal are the same ones."""
    return tuple(motion.velocity.tolist())


def rotation_terms(
    body: str, path: str, motion: SteadyMotion, inertia: tuple[sp.csr_array, sp.csr_array]
) -> list[Term]:
    """Return the gyroscopic and the convective term of one rotating body.

    Parameters
    ----------
    path : str
        Path of the material in the scene, with which the parameters' names begin.
    motion : SteadyMotion
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


Damping = Sequence[tuple[Literal["K", "M"], float, Mapping[str, int]]]  # matrix, factor, powers of parameters


def _damping(context: Context, body: BodyPart) -> Damping:
    """Return the parts of a body's viscous damping that are not zero, multiples of its elastic stiffness or mass."""
    parts: list[tuple[Literal["K", "M"], float, Mapping[str, int]]] = []
    law = context.table_of_body(Rayleigh, body)
    if law is not None:
        damping, where = law
        parts += [("K", 1.0, {f"{where}.beta": 1})] if damping.beta else []
        parts += [("M", 1.0, {f"{where}.alpha": 1})] if damping.alpha else []
    frozen = context.table(StructuralDamping)
    if frozen is not None and frozen.reference_frequency_hz is not None and body.material.loss_factor:
        parts.append(("K", 1 / (2 * np.pi), {FROZEN_AT: -1, f"{body.material_path}.loss_factor": 1}))
    return parts


def rotating_damping_terms(
    body: str, path: str, motion: SteadyMotion, elastic: Term, damping: Damping,
    circulatory: tuple[sp.csr_array, sp.csr_array],
) -> list[Term]:  # fmt: skip
    """Return the circulatory terms of a rotating body with damping.

    Parameters
    ----------
    path, motion : as of `rotation_terms`
    elastic : Term
        Elastic stiffness of the body.
    damping : sequence of (matrix, factor, powers)
        Viscous damping as multiples of the body's elastic stiffness "K" or its mass "M".
    circulatory : pair of (n, n) sparse
        `circulatory_matrices` at unit density and `unit_rotation`.
    """
    speed = float(np.linalg.norm(motion.velocity))
    of = {"K": (circulatory[0], elastic.powers), "M": (circulatory[1], {f"{path}.density": 1})}
    return [
        Term(
            f"rotating_damping.{body}", "K", of[matrix][0] * (factor * speed), symmetric=False, skew=True,
            powers={**powers, **of[matrix][1]},
        )
        for matrix, factor, powers in damping
    ]  # fmt: skip
