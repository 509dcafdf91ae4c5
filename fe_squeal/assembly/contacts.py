"""Contacts of a scene: their operators on the mesh, and what their terms scale with."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..effects.contact_stiffness import contact_terms
from ..effects.friction import friction_terms
from ..fem.contact import ContactOperators, contact_operators
from ..fem.motion import Sliding
from ..fem.spaces import DisplacementSpace
from ..mesh import LoadedMesh
from ..problem.terms import Term
from ..scene.contacts import Contact
from ..scene.scene import Effects
from .bodies import contact_sides, find_facets


def make_contact(
    space: DisplacementSpace, bodies: Mapping[str, np.ndarray], loaded: LoadedMesh, contact: Contact,
    motion: Sliding | None, key: str,
) -> tuple[ContactOperators, set[str]]:  # fmt: skip
    """Return the operators of a contact, and the bodies that carry its counterface.

    Parameters
    ----------
    key : str
        Of the contact, for messages.

    Raises
    ------
    SceneError, MeshError
    """
    pad = find_facets(loaded, contact.surface, f"{key}.surface")
    counter = None
    if not contact.is_rigid:
        counter = find_facets(loaded, contact.counterface, f"{key}.counterface", "rigid")
    sides = contact_sides(space.mesh, bodies, pad, counter, key, contact.surface, contact.counterface)
    return contact_operators(space, pad, counter, motion, contact.gap_tolerance, key), sides[1]


def stiff_terms(name: str, operators: ContactOperators, contact: Contact, effects: Effects) -> list[Term]:
    """Return the terms of a contact's stiffness and damping, and of friction where it slides."""
    tied = contact.kind == "tied"
    terms = contact_terms(name, operators, contact.normal_stiffness, contact.normal_damping, tied)
    if contact.kind == "sliding" and effects.friction is not None:
        terms += friction_terms(name, operators, contact.friction_ratio)
    return terms


def pressure_powers(effects: Effects, name: str, effect: str, pressed: bool) -> dict[str, int]:
    """Return the parameters that a term scales with which acts on a contact's pressure.

    Parameters
    ----------
    effect : "friction_damping" or "falling_friction"
    pressed : bool
        Whether the pressure is that of a static state, which no parameter scales.
    """
    ratio = {f"contacts.{name}.friction_ratio": 1}
    if pressed:
        return ratio
    own = getattr(effects, effect).contact_pressure is not None
    return {**ratio, f"effects.{effect if own else 'friction_damping'}.contact_pressure": 1}
