"""From an Abaqus deck to the draft of a scene."""

from __future__ import annotations

from ...mesh.building import build_mesh
from ...mesh.elements import SHAPE
from ...mesh.readers.abaqus.assembly import place_model
from ...mesh.readers.abaqus.deck import parse_model
from ...mesh.readers.abaqus.model import Statement
from ...mesh.readers.sources import Sources
from ..draft import Draft
from .bodies import write_bodies
from .contacts import write_contacts
from .content import Content
from .holding import write_springs, write_supports
from .keywords import read_statement
from .links import tell_left_out
from .materials import find_units, write_materials
from .steps import write_effects, write_solution
from .ties import find_ties, write_ties


def draft_abaqus(sources: Sources, mesh_file: str) -> Draft:
    """Return the draft of the scene that an Abaqus deck describes.

    Parameters
    ----------
    sources : Sources
        The deck and what it includes.
    mesh_file : str
        How the scene names the deck.

    Raises
    ------
    MeshError
    """
    name = sources.path.name
    model = parse_model(sources)
    raw, assembly = place_model(model, name)
    loaded = build_mesh(raw, name)
    draft = Draft(sources.path.stem)
    draft.head.append(f"Made by fe-squeal new from the Abaqus deck {name}.")
    content = Content(name, model, raw, assembly, loaded, draft)
    for statement in _that_count(content):
        read_statement(content, statement)
    find_units(content)
    mesh = draft.add(
        "mesh", values={"file": mesh_file, "length_unit": content.units.length_unit, "order": 2}
    )
    linear = sum(len(block) for block in raw.blocks if block.kind == SHAPE[block.kind])
    if linear:
        mesh.notes["order"] = (
            f"{linear} of the deck's elements are linear (C3D4, C3D8, ...); order = 1 would keep them so, but locks"
        )
    write_materials(content)
    write_bodies(content)
    write_supports(content)
    ties = find_ties(content)
    write_springs(content, {row: tie.springs for row, tie in ties.items()})
    references = write_ties(content, ties)
    mu = write_contacts(content)
    write_effects(content, mu, references)
    write_solution(content, mu)
    tell_left_out(content)
    for note in loaded.notes[len(model.notes) :]:  # the reader's own come first
        draft.find("mesh", "", note, "harmless")
    return draft


def _that_count(content: Content) -> list[Statement]:
    """Return the statements without those of steps behind the one whose frequencies count: these change nothing."""
    every, counts = content.model.statements, 0
    for word in ("FREQUENCY", "COMPLEX FREQUENCY"):
        counts = max((i for i, s in enumerate(every) if s.block.keyword == word), default=counts)
    found, left, inside = list[Statement](), list[Statement](), False
    for i, statement in enumerate(every):
        inside = inside or bool(counts and i > counts and statement.block.keyword == "STEP")
        (left if inside else found).append(statement)
        inside = inside and statement.block.keyword != "END STEP"
    if left:
        text = "steps behind that of the frequencies that count are left out"
        content.draft.find("*Step", content.where(left[0]), text, "harmless")
    return found
