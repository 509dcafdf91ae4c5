"""Springs, dampers and masses of a deck, in each instance of their part."""

from __future__ import annotations

from ...mesh.readers.abaqus.model import Links, Statement
from .content import Content

Placed = tuple[str, Links]  # the key of the instance that links stand in, "" for the assembly


def links_of(content: Content) -> list[Placed]:
    """Return the springs, dampers and masses of the assembly and of all its instances."""
    found = [("", link) for link in content.model.assembly.links]
    for key, placed in content.assembly.instances.items():
        found += [(key, link) for scope in placed.scopes for link in scope.links]
    return found


def links_under(content: Content, statement: Statement) -> list[Placed]:
    """Return the links of the element set that a statement names.

    A name means the set of the part or instance that the statement stands in: every part may have one of that name.
    Where the assembly has none of a name, it means INSTANCE.SET, or the sets of all instances that have one.
    """
    name, links = statement.block.value("ELSET").upper(), links_of(content)
    own = content.placements(statement.scope)
    found = [(key, link) for key, link in links if key in own and link.elset.upper() == name]
    if not found and not statement.scope:
        found = [(key, link) for key, link in links if name in (link.elset.upper(), f"{key}.{link.elset.upper()}")]
    return found
