"""Elements that are no solids: springs, dampers and masses in each instance of their part, and what is left out."""

from __future__ import annotations

from ...mesh.readers.abaqus.model import Links, Statement
from .content import Content, short, spoken

# Which keyword says what elements of a type are, by the beginning of its name.
_SAID_BY = {"SPRING": "SPRING", "DASHPOT": "DASHPOT", "MASS": "MASS", "ROTARYI": "ROTARY INERTIA",
            "DCOUP3D": "DISTRIBUTING COUPLING"}  # fmt: skip
_SURFACES = ("SFM3D", "CPS", "CPE")  # surface elements, and plane ones, as which mesh generators write faces

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


def tell_left_out(content: Content) -> None:
    """Tell of elements that are no solids: those that are not read, and those that no keyword gives what they need."""
    sections = any(s.block.keyword.endswith("SECTION") for s in content.model.statements)
    for kind, (count, where) in content.model.left_out.items():
        what, place = f"*Element, TYPE={kind}", short(where, content.source)
        number = f"{count} element{'s' if count > 1 else ''}"
        if kind.startswith(_SURFACES):
            content.draft.find(what, place, f"{number} without stiffness and mass, surfaces at most", "harmless")
        elif not sections:
            text = f"no solids: {number} left out; the deck has no section that gives them stiffness and mass"
            content.draft.find(what, place, text, "harmless")
        else:
            content.draft.find(what, place, f"no solids: {number} left out, with stiffness and mass")
    for start, word in _SAID_BY.items():
        statements = [s for s in content.model.statements if s.block.keyword == word]
        given = {(key, id(link)) for statement in statements for key, link in links_under(content, statement)}
        for key, link in links_of(content):
            if link.kind.startswith(start) and (key, id(link)) not in given:
                text = f"elements without a *{spoken(word)} for their set are left out"
                content.draft.find(f"*Element, TYPE={link.kind}", short(link.where, content.source), text)
