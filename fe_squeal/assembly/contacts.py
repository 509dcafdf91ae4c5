"""Contacts of a scene: their operators on the mesh, and their own stiffness."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..effects.cache import Cache
from ..effects.contact_stiffness import contact_terms
from ..effects.context import ContactPart
from ..fem.contact import ContactOperators, contact_operators
from ..fem.motion import SteadyMotion
from ..fem.spaces import DisplacementSpace
from ..mesh import LoadedMesh
from ..mesh.groups import find_facets
from ..problem.terms import Term
from ..scene.contacts import Contact
from .bodies import contact_sides


def make_contact(
    space: DisplacementSpace, bodies: Mapping[str, np.ndarray], loaded: LoadedMesh, contact: Contact,
    motion: SteadyMotion | None, key: str,
) -> tuple[ContactOperators, set[str], set[str]]:  # fmt: skip
    """Return the operators of a contact, the bodies that carry its counterface, and those that carry its surface.

    Parameters
    ----------
    space : DisplacementSpace
    bodies : mapping of str to (m,) int
        Elements of each body.
    loaded : LoadedMesh
    contact : Contact
        The table of the scene.
    motion : SteadyMotion or None
        Motion of the counterface.
    key : str
        The key of the contact in the scene, for messages.

    Raises
    ------
    SceneError
        A surface is in contact with itself, or the two surfaces do not lie on each other.
    MeshError
        There is no such surface group.
    """
    pad = find_facets(loaded, contact.surface, f"{key}.surface")
    counter = None
    if not contact.is_rigid:
        counter = find_facets(loaded, contact.counterface, f"{key}.counterface", "rigid")
    sides = contact_sides(space.mesh, bodies, pad, counter, key, contact.surface, contact.counterface)
    tied = contact.kind == "tied"
    return contact_operators(space, pad, counter, motion, contact.gap_tolerance, key, tied), sides[1], sides[0]


def stiffness_terms(contact: Contact, part: ContactPart, cache: Cache) -> list[Term]:
    """Return the terms of a contact's own stiffness and damping, on its closed part."""
    return cache.get(
        f"contact stiffness.{part.name}", (part.key, bool(contact.normal_damping)),
        lambda: contact_terms(
            part.name, part.closed, contact.normal_stiffness, contact.normal_damping, contact.kind == "tied"
        ),
    )  # fmt: skip
