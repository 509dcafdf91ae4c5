"""Coulomb friction under steady sliding: μ K_f = μ ∫ k_n δs g dA."""

from __future__ import annotations

from typing import ClassVar

import scipy.sparse as sp

from ..fem.contact import ContactOperators
from ..problem.parameters import MU
from ..problem.terms import Term
from .context import ContactPart, Context
from .effect import Effect, Outline


class Friction(Effect):
    """Friction in every sliding contact.

    With pressure p = p0 − k_n g, the pad feels the traction μ p t along the counterface's velocity, the counterface the
    opposite. The virtual work of its change is −∫ μ k_n g δs dA, so that μ K_f stands beside K with a plus sign.

    Attributes
    ----------
    mu : float
        Friction coefficient, nominal; a sweep replaces it. A negative one is reversed sliding.
    """

    name: ClassVar[str] = "friction"
    summary: ClassVar[str] = "Friction in every sliding contact."

    mu: float

    def check_scene(self, outline: Outline) -> None:
        """Raise ValueError where nothing slides."""
        if not outline.sliding_contacts:
            raise ValueError('effects.friction: no contact slides; expected a [[contacts]] entry of kind "sliding"')

    def parameters(self) -> tuple[str, ...]:
        """Return mu, which can be swept over contacts of ratio zero too."""
        return (MU,)

    def contact_terms(self, context: Context, contact: ContactPart) -> list[Term]:
        """Return the friction of a contact that slides."""
        if contact.kind != "sliding":
            return []
        return context.cache.get(
            f"friction.{contact.name}", (contact.key, contact.friction_ratio != 0),
            lambda: friction_terms(contact.name, contact.closed, contact.friction_ratio),
        )  # fmt: skip


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
    powers = {MU: 1, f"{path}.normal_stiffness": 1, f"{path}.friction_ratio": 1}
    return [Term(f"friction.{name}", "K", sp.csr_array(matrix), symmetric=False, powers=powers)]
