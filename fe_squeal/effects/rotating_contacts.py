"""Damping of contacts between bodies that rotate together."""

from __future__ import annotations

import numpy as np

from ..fem.gyroscopics import circulatory_matrices
from ..problem.terms import Term
from .contact_stiffness import contact_terms
from .context import ContactPart, Context
from .rotating_bodies import turns_with_bodies, unit_rotation


def contact_damping_terms(context: Context, contact: ContactPart) -> list[Term]:
    """Return the circulatory term of a contact with damping whose bodies turn alike; none of any other contact.

    Such a contact turns with the bodies, and its damping acts on the rate that they see, u̇ + Lu, as damping inside of
    them does, see `fe_squeal.fem.gyroscopics`. A damping ∫ c δg·ġ of the jump so brings the stiffness ∫ c δg·(Lu)₋, the
    jump of Lu, of which the skew part is taken: turning all that is joined changes nothing. Of a contact that is not
    tied g is the gap along the normal n, with n·Lu = (w·∇)(n·u), since the normals turn as the bodies do.
    """
    path = f"{contact.path}.normal_damping"
    if not context.number(path) or not turns_with_bodies(contact, context.motions):
        return []
    names = sorted(contact.pads | contact.carriers)
    first = context.motions[names[0]]
    elements = np.concatenate([context.bodies[name].elements for name in names])

    def made() -> Term:
        (damping,) = contact_terms(contact.name, contact.closed, 0.0, 1.0, contact.kind == "tied")
        B, _ = circulatory_matrices(context.space, elements, damping.matrix, 1.0, unit_rotation(first))
        speed = float(np.linalg.norm(first.velocity))
        return Term(f"rotating_damping.{contact.name}", "K", B * speed, symmetric=False, skew=True, powers={path: 1})

    key = (contact.key, *first.velocity.tolist(), first.way)
    return [context.cache.get(f"rotating_damping.contact.{contact.name}", key, made)]
