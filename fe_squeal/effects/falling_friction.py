"""Friction that depends on the sliding speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from ..fem.contact import ContactOperators
from ..problem.terms import Term
from ..schema.section import Positive
from .context import ContactPart, Context
from .effect import Effect
from .friction_damping import FrictionDamping
from .pressure import check_pressure, warnings_without_friction


class FallingFriction(Effect):
    """Velocity-dependent friction C_μ = ∫ p0 (dμ/dv) δs ṡ dA.

    The sliding speed is v − ṡ, so the pad feels −(dμ/dv) ṡ p0 along the counterface's velocity. A coefficient that
    falls with speed, dμ/dv < 0, feeds energy in; `mu` is its value at the steady speed. (Derived by virtual work; Popp
    and Stelter, Phil. Trans. R. Soc. A 332, 1990.)

    Attributes
    ----------
    slope : float, s/m
        dμ/dv; negative where friction falls with speed. A contact's `friction_ratio` multiplies it, as it does mu.
    contact_pressure : float, Pa
        Pressure p0 in all contacts, where there is no preload that gives it (default: that of friction_damping).
    """

    name: ClassVar[str] = "falling_friction"
    summary: ClassVar[str] = "Friction that depends on the sliding speed."
    needs: ClassVar[Mapping[str, str]] = {"friction": "; expected [effects.friction] with mu"}

    slope: float
    contact_pressure: Positive | None = None

    def check_effects(self, others: Mapping[str, Effect]) -> None:
        """Raise ValueError where the pressure is not known, or known twice."""
        damping = others.get(FrictionDamping.name)
        default = damping.contact_pressure if isinstance(damping, FrictionDamping) else None
        check_pressure(self.name, self.contact_pressure, others, default)

    def contact_terms(self, context: Context, contact: ContactPart) -> list[Term]:
        """Return the term of a contact in which friction acts; none without a slope."""
        if not self.slope or not contact.slides_with_friction:
            return []
        of = FrictionDamping.name if self.contact_pressure is None else self.name
        powers = {"effects.falling_friction.slope": 1, **contact.pressure_powers(f"effects.{of}.contact_pressure")}
        return context.cache.get(
            f"falling_friction.{contact.name}", (contact.key, contact.pressure.tobytes(), tuple(powers.items())),
            lambda: falling_friction_terms(contact.name, contact.closed, contact.pressure, powers),
        )  # fmt: skip

    def warnings(self, context: Context, others: Sequence[Term], parameters: Mapping[str, float]) -> list[str]:
        """Return a sentence where friction acts in no contact."""
        return warnings_without_friction(self.name, context)


def falling_friction_terms(
    name: str, operators: ContactOperators, pressure: np.ndarray, powers: dict[str, int]
) -> list[Term]:
    """Return the term of one sliding contact.

    Parameters
    ----------
    pressure : (q,) float, Pa
        Contact pressure of the steady state; 1 if `powers` has the pressure as a parameter.
    powers : mapping of parameter to exponent
        Exponents of the parameters that the term is multiplied by; the slope is one of them.
    """
    size = operators.weights * pressure
    if not size.any():
        return []
    matrix = operators.slip.T @ sp.diags_array(size) @ operators.slip
    matrix = sp.csr_array((matrix + matrix.T) / 2)
    return [Term(f"falling_friction.{name}", "C", matrix, symmetric=True, powers=powers)]
