"""Coulomb friction under steady sliding: μ K_f = μ ∫ k_n δs g dA."""

from __future__ import annotations

import scipy.sparse as sp

from ..fem.contact import ContactOperators
from ..problem.terms import Term
from ..schema.section import Section


class Friction(Section):
    """Friction in every sliding contact.

    With pressure p = p0 − k_n g, the pad feels the traction μ p t along the counterface's velocity, the counterface the
    opposite. The virtual work of its change is −∫ μ k_n g δs dA, so that μ K_f stands beside K with a plus sign.

    Attributes
    ----------
    mu : float
        Friction coefficient, nominal; a sweep replaces it. A negative one is reversed sliding.
    """

    mu: float


def friction_terms(name: str, operators: ContactOperators, ratio: float) -> list[Term]:
    """Return the friction term of one sliding contact, which counts with mu and the contact's stiffness.

    Parameters
    ----------
    ratio : float
        This contact's friction coefficient over mu; nothing is made where it is zero.
    """
    if not ratio:
        return []
    matrix = operators.slip.T @ sp.diags_array(operators.weights) @ operators.gap
    path = f"contacts.{name}"
    powers = {"mu": 1, f"{path}.normal_stiffness": 1, f"{path}.friction_ratio": 1}
    return [Term(f"friction.{name}", "K", sp.csr_array(matrix), symmetric=False, powers=powers)]
