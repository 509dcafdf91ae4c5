"""Slip damping: friction turns with the direction of slip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from ..fem.contact import ContactOperators
from ..problem.parameters import MU
from ..problem.terms import Term
from ..schema.section import Positive
from .context import ContactPart, Context
from .effect import Effect
from .friction import Friction
from .pressure import check_pressure, warnings_without_friction


class FrictionDamping(Effect):
    """Slip damping C_f = ∫ (μ p0/|v|) δs⊥ ṡ⊥ dA, s⊥ the slip in the surface across the sliding direction.

    The friction force is opposed to the relative velocity. A slip velocity ṡ⊥ across the sliding speed v turns it by
    ṡ⊥/|v|, so that the pad feels −μ p0 ṡ⊥/|v| across. (Derived by virtual work; Kang, Krousgrill and Sadeghi, J. Sound
    Vib. 324, 2009, have it for a disc.)

    Attributes
    ----------
    contact_pressure : float, Pa
        Pressure p0 in all contacts, where there is no preload that gives it.
    """

    name: ClassVar[str] = "friction_damping"
    summary: ClassVar[str] = "Damping of slip across the sliding direction."
    needs: ClassVar[Mapping[str, str]] = {"friction": "; expected [effects.friction] with mu"}

    contact_pressure: Positive | None = None

    def check_effects(self, others: Mapping[str, Effect]) -> None:
        """Raise ValueError where the pressure is not known, or known twice, and for a negative mu.

        Friction that is reversed with its sign would feed what it damps: it depends on |mu|, and terms on powers alone.
        """
        check_pressure(self.name, self.contact_pressure, others)
        friction = others.get(Friction.name)
        if isinstance(friction, Friction) and friction.mu < 0:
            raise ValueError(
                f"given friction_damping and friction.mu = {friction.mu:g}; expected mu >= 0, and a counterface that"
                " moves the other way"
            )

    def contact_terms(self, context: Context, contact: ContactPart) -> list[Term]:
        """Return the damping of a contact in which friction acts."""
        if not contact.slides_with_friction or contact.motion is None:
            return []
        speed = contact.motion.speeds(contact.closed.points, contact.closed.normals)
        powers = {MU: 1, **contact.pressure_powers("effects.friction_damping.contact_pressure")}
        return context.cache.get(
            f"friction_damping.{contact.name}",
            (contact.key, contact.pressure.tobytes(), speed.tobytes(), tuple(powers.items())),
            lambda: friction_damping_terms(contact.name, contact.closed, contact.pressure, speed, powers),
        )

    def warnings(self, context: Context, others: Sequence[Term], parameters: Mapping[str, float]) -> list[str]:
        """Return a sentence where friction acts in no contact."""
        return warnings_without_friction(self.name, context)


def friction_damping_terms(
    name: str, operators: ContactOperators, pressure: np.ndarray, speed: np.ndarray, powers: dict[str, int]
) -> list[Term]:
    """Return the slip damping of one sliding contact.

    Parameters
    ----------
    pressure : (q,) float, Pa
        Contact pressure of the steady state; 1 if `powers` has the pressure as a parameter.
    speed : (q,) float, m/s
        |v|; where it is zero, as in a centre of rotation, nothing slides and nothing is damped.
    powers : mapping of parameter to exponent
        Exponents of the parameters that the term is multiplied by; mu is one of them.
    """
    size = np.divide(operators.weights * pressure, speed, out=np.zeros(len(speed)), where=speed > 0)
    if not size.any():
        return []
    matrix = operators.cross.T @ sp.diags_array(size) @ operators.cross
    matrix = sp.csr_array((matrix + matrix.T) / 2)
    return [Term(f"friction_damping.{name}", "C", matrix, symmetric=True, powers=powers)]
