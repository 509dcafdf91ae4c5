"""Contacts of a scene: their operators on the mesh, and their own stiffness."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ..effects.cache import Cache
from ..effects.contact_stiffness import contact_terms
from ..effects.context import ContactPart
from ..fem.closing import default_gap_tolerance
from ..fem.contact import ContactOperators, contact_operators
from ..fem.motion import SteadyMotion
from ..fem.spaces import DisplacementSpace, make_space, straightened
from ..mesh import LoadedMesh
from ..mesh.groups import find_facets
from ..problem.problem import Problem
from ..problem.terms import Term
from ..scene import Scene
from ..scene.contacts import Contact
from .bodies import contact_sides
from .discretisation import discretisation_of

_CLOSED = 1e-9  # of the size of a contact: gaps up to it are rounding


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
    sliding = None if tied else motion  # nothing moves along a surface that is tied, also where both sides turn
    return contact_operators(space, pad, counter, sliding, contact.gap_tolerance, key, tied), sides[1], sides[0]


def with_gap_tolerances(scene: Scene, loaded: LoadedMesh) -> Scene:
    """Return the scene with the gap tolerance of each contact written out, for meshes that are cut from its own.

    The default depends on the size of the facets. What the mesh leaves between the surfaces stays when it is cut, so
    that with a default of smaller facets a finer mesh would lose a part of its contacts.

    Parameters
    ----------
    scene : Scene
    loaded : LoadedMesh
        Its own mesh.

    Raises
    ------
    MeshError
        There is no such surface group.
    """
    order = scene.mesh.order
    space = make_space(straightened(loaded.mesh) if order == 1 else loaded.mesh, order, [])
    contacts = []
    for i, contact in enumerate(scene.contacts):
        if contact.gap_tolerance is None and not contact.is_rigid:
            pad = space.surface(find_facets(loaded, contact.surface, f"contacts[{i}].surface"))
            counter = find_facets(loaded, contact.counterface, f"contacts[{i}].counterface", "rigid")
            tolerance = default_gap_tolerance(space.mesh, pad, counter)
            contact = contact.model_copy(update={"gap_tolerance": tolerance})
        contacts.append(contact)
    return scene.model_copy(update={"contacts": contacts})


def closed_by_default(problem: Problem, scene: Scene, own: Scene) -> Iterator[str]:
    """Yield the gap tolerance of each contact that closes a gap by it, and for which a scene gives none.

    Parameters
    ----------
    problem : Problem
        Of the scene `own`, which `with_gap_tolerances` has made of `scene`.
    """
    found = discretisation_of(problem)
    for name, given, contact in zip(own.contact_names, scene.contacts, own.contacts, strict=True):
        if given.gap_tolerance is None and contact.gap_tolerance is not None and found is not None:
            operators = found.contacts[name]
            if np.abs(operators.separation).max(initial=0.0) > _CLOSED * np.sqrt(operators.area):
                yield f"contacts.{name}.gap_tolerance = {contact.gap_tolerance:.3g}"


def stiffness_terms(contact: Contact, part: ContactPart, cache: Cache) -> list[Term]:
    """Return the terms of a contact's own stiffness and damping, on its closed part."""
    return cache.get(
        f"contact stiffness.{part.name}", (part.key, bool(contact.normal_damping)),
        lambda: contact_terms(
            part.name, part.closed, contact.normal_stiffness, contact.normal_damping, contact.kind == "tied"
        ),
    )  # fmt: skip
