"""Structural damping: K(1 + iη) of elastic bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from ..problem.terms import Term
from ..schema.section import Positive
from .context import BodyPart, Context
from .effect import Effect

FROZEN_AT = "effects.structural_damping.reference_frequency_hz"


class StructuralDamping(Effect):
    """Structural (hysteretic) damping: elastic stiffness K(1 + iη) with the materials' loss factors η.

    It acts at each mode's own frequency, Re λ ≈ −ηω/2, and for Im λ > 0 only. Frozen at a reference frequency, as
    other programs do it, it is the viscous damping C = η K/ω_ref, right at that frequency alone. Contact, friction and
    springs are not damped by it. (Crandall, The role of damping in vibration theory, J. Sound Vib. 11, 1970.)

    Attributes
    ----------
    reference_frequency_hz : float, Hz
        Freezes the damping at one frequency (default: each mode's own).
    """

    name: ClassVar[str] = "structural_damping"
    summary: ClassVar[str] = "Structural damping by the materials' loss factors."

    reference_frequency_hz: Positive | None = None

    def body_terms(self, context: Context, body: BodyPart, path: str) -> list[Term]:
        """Return the damping of a body."""
        factor = body.material.loss_factor
        return structural_terms(self, body.name, factor, f"{body.material_path}.loss_factor", body.elastic)

    def warnings(self, context: Context, others: Sequence[Term], parameters: Mapping[str, float]) -> list[str]:
        """Return a sentence where nothing is damped, neither as it is nor where the sweep or the study goes."""
        bodies = context.bodies.values()
        if any(b.material.loss_factor or f"{b.material_path}.loss_factor" in context.moved for b in bodies):
            return []
        return ["effects.structural_damping has no effect: no material of a body has a loss_factor"]

    @classmethod
    def warnings_without(cls, context: Context) -> list[str]:
        """Return a sentence for each loss factor that nothing reads."""
        return [
            f"materials.{name}.loss_factor has no effect: [effects.structural_damping], which reads it, is not on"
            for name, material in context.materials.items()
            if material.loss_factor
        ]


def structural_terms(
    damping: StructuralDamping, body: str, loss_factor: float, path: str, elastic: Term
) -> list[Term]:
    """Return the damping term of one body; none where its loss factor is zero.

    Parameters
    ----------
    path : str
        Path of the loss factor in the scene, the parameter's name.
    elastic : Term
        Elastic stiffness of the body.
    """
    if not loss_factor:
        return []
    name, powers = f"structural_damping.{body}", {path: 1, **elastic.powers}
    if damping.reference_frequency_hz is None:
        return [Term(name, "K", elastic.matrix, symmetric=True, powers=powers, imaginary=True)]
    return [Term(name, "C", elastic.matrix / (2 * np.pi), symmetric=True, powers={FROZEN_AT: -1, **powers})]
