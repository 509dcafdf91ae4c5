"""Damping of contacts that are tied between rotating bodies."""

from __future__ import annotations

import numpy as np

from ..fem.gyroscopics import circulatory_matrices
from ..problem.terms import Term
from .cache import Same
from .contact_stiffness import contact_terms
from .context import ContactPart, Context
from .rotating_bodies import turn_alike, unit_rotation


def tied_damping_terms(context: Context, contact: ContactPart) -> list[Term]:
    """Return the circulatory term of a tied contact with damping whose bodies turn alike; none of any other contact.

    What is glued turns with the bodies, and its damping acts on the rate that they see, u̇ + Lu, as damping inside of
    them does, see `fe_squeal.fem.gyroscopics`. A damping ∫ c δg·ġ of the jump so brings the stiffness ∫ c δg·(Lu)₋, the
    jump of Lu, of which the skew part is taken: turning all that is glued changes nothing.
    """
    path = f"{contact.path}.normal_damping"
    if contact.kind != "tied" or not context.number(path):
        return []
    names = sorted(contact.pads | contact.carriers)
    motions = [context.motions.get(name) for name in names]
    first = motions[0]
    if first is None or any(m is None or not turn_alike(first, m) for m in motions):
        return []
    elements = np.concatenate([context.bodies[name].elements for name in names])

    def made() -> Term:
        (damping,) = contact_terms(contact.name, contact.operators, 0.0, 1.0, tied=True)
        B, _ = circulatory_matrices(context.space, elements, damping.matrix, 1.0, unit_rotation(first))
        speed = float(np.linalg.norm(first.velocity))
        return Term(f"rotating_damping.{contact.name}", "K", B * speed, symmetric=False, skew=True, powers={path: 1})

    key = (Same(contact.operators), *first.velocity.tolist(), first.way)
    return [context.cache.get(f"rotating_damping.contact.{contact.name}", key, made)]
