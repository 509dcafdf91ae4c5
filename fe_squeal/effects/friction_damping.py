"""Slip damping: friction turns with the direction of slip."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..fem.contact import ContactOperators
from ..problem.terms import Term
from ..schema.section import Positive, Section


class FrictionDamping(Section):
    """Slip damping C_f = ∫ (μ p0/|v|) δs⊥ ṡ⊥ dA, s⊥ the slip in the surface across the sliding direction.

    The friction force is opposed to the relative velocity. A slip velocity ṡ⊥ across the sliding speed v turns it by
    ṡ⊥/|v|, so that the pad feels −μ p0 ṡ⊥/|v| across. (Derived by virtual work; Kang, Krousgrill and Sadeghi, J. Sound
    Vib. 324, 2009, have it for a disc.)

    Attributes
    ----------
    contact_pressure : float, Pa
        Pressure p0 in all contacts, where there is no preload that gives it.
    """

    contact_pressure: Positive | None = None


def friction_damping_terms(
    name: str, operators: ContactOperators, pressure: np.ndarray, speed: np.ndarray, powers: dict[str, int]
) -> list[Term]:
    """Return the slip damping of one sliding contact.

    Parameters
    ----------
    pressure : (q,) float, Pa
        Of the steady state; 1 where `powers` has it.
    speed : (q,) float, m/s
        |v|; where it is zero, as in a centre of rotation, nothing slides and nothing is damped.
    powers : mapping of parameter to exponent
        Has mu.
    """
    size = np.divide(operators.weights * pressure, speed, out=np.zeros(len(speed)), where=speed > 0)
    if not size.any():
        return []
    matrix = operators.cross.T @ sp.diags_array(size) @ operators.cross
    matrix = sp.csr_array((matrix + matrix.T) / 2)
    return [Term(f"friction_damping.{name}", "C", matrix, symmetric=True, powers=powers)]
