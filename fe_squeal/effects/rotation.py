"""Rotation of bodies of revolution: gyroscopic and convective inertia, and what their damping makes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

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
from .rayleigh import Rayleigh
from .rotating_bodies import check_material, check_shape, free_motions, motion_of_body
from .stress_stiffening import StressStiffening


class Rotation(Effect):
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
        return motions

    def body_terms(self, context: Context, body: BodyPart, path: str) -> list[Term]:
        """Return the terms of a rotating body, and of its Rayleigh damping."""
        motion = context.motions.get(body.name)
        if motion is None:
            return []
        unit = unit_rotation(motion)
        inertia = context.cache.get(
            f"rotation.{body.name}", motion.way, lambda: gyroscopic_matrices(context.space, body.elements, 1.0, unit)
        )
        terms = rotation_terms(body.name, body.material_path, motion, inertia)
        law = context.table_of_body(Rayleigh, body)
        if law is not None and (law[0].alpha or law[0].beta):
            elastic = body.elastic
            circulatory = context.cache.get(
                f"rotating_damping.{body.name}", (motion.way, Same(elastic.matrix)),
                lambda: circulatory_matrices(context.space, body.elements, elastic.matrix, 1.0, unit),
            )  # fmt: skip
            terms += rotating_damping_terms(body.name, body.material_path, motion, elastic, law, circulatory)
        return terms

    def warnings(self, context: Context, others: Sequence[Term], parameters: Mapping[str, float]) -> list[str]:
        """Return a sentence for each rotating body that can turn or tilt against no more than its own inertia.

        A rigid rotation u = e × x has (w·∇)u = Ω × u, so that K_Ω takes at most Ω²M away, and about the axis just that:
        M ü = Ω²M u grows with Re λ = Ω. The centrifugal stress σ balances ρΩ²r; the virtual work of that equation makes
        its stiffness ∫σ_ij ∂_iu·∂_ju = +Ω²M for the same u, and nothing grows.
        """
        if context.table(StressStiffening) is not None:
            return []
        found = []
        for name, motion in context.motions.items():
            free = free_motions(context.space, context.bodies[name].elements, motion, others, parameters)
            speed = np.linalg.norm(motion.velocity)
            if free:
                found.append(
                    f"effects.rotation: body {name} is free to {' and to '.join(free)}; without"
                    f" [effects.stress_stiffening] its slow motions, up to some {2 * speed / (2 * np.pi):.3g} Hz, are"
                    f" not right, and growth of up to Re λ = Ω = {speed:.4g} 1/s appears that does not exist: write"
                    " [effects.preload] and [effects.stress_stiffening], or hold the body"
                )
        return found


def _check(context: Context, body: BodyPart, motion: SteadyMotion) -> None:
    """Raise where a rotating body, what holds it or its material is not the same all around the axis."""
    context.cache.get(f"revolution.{body.name}", motion.way, lambda: check_shape(context, body, motion))
    check_material(body, motion)


def unit_rotation(motion: SteadyMotion) -> SteadyMotion:
    """Return a rotation about the same axis at 1 rad/s, whose matrices serve every speed."""
    return SteadyMotion(motion.velocity / float(np.linalg.norm(motion.velocity)), motion.centre)


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


def rotating_damping_terms(
    body: str, path: str, motion: SteadyMotion, elastic: Term, rayleigh: tuple[Rayleigh, str],
    circulatory: tuple[sp.csr_array, sp.csr_array],
) -> list[Term]:  # fmt: skip
    """Return the circulatory terms of a rotating body with damping, only those that are not zero.

    Parameters
    ----------
    path, motion : as of `rotation_terms`
    elastic : Term
        Elastic stiffness of the body.
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
