"""*Friction and *Change Friction: the coefficient of an interaction that counts for the frequencies."""

from __future__ import annotations

from ...mesh.readers.abaqus.model import Statement
from .amplitudes import factor_of
from .content import Content


def read_change_friction(content: Content, statement: Statement) -> None:
    """Take *Change Friction: the *Friction that follows changes an interaction that was defined before.

    RESET, behind which no *Friction stands, gives the interaction its first friction again (Abaqus Keywords Guide,
    *CHANGE FRICTION).
    """
    block, where = statement.block, content.where(statement)
    content.interaction = interaction = content.interactions.get(block.value("INTERACTION").upper())
    if interaction is None:
        text = "names no *Surface Interaction of the deck and is not taken over"
        content.draft.find("*Change Friction", where, text)
        return
    interaction.first = interaction.first or (interaction.mu, interaction.rough)
    if "RESET" in block.parameters:
        interaction.mu, interaction.rough = interaction.first
    elif factor_of(content, statement) != 1.0:
        text = "its amplitude does not end at 1: give the friction that it ends at in [[contacts]]"
        content.draft.find("*Change Friction", where, text, "missing")


def read_friction(content: Content, statement: Statement) -> None:
    """Take *Friction: the coefficient of its first row; the last one in the deck counts."""
    block, where, interaction = statement.block, content.where(statement), content.interaction
    if interaction is None:
        content.draft.find("*Friction", where, "belongs to no *Surface Interaction and is not taken over")
        return
    row = content.first(block)
    interaction.rough = "ROUGH" in block.parameters
    interaction.mu = None if interaction.rough else float(row[0] or 0.0) if row else 0.0
    if interaction.rough:
        return
    if "USER" in block.parameters or "EXPONENTIAL DECAY" in block.parameters:
        text = "its law is not read: give mu, and [effects.falling_friction] slope = dmu/dv at the sliding speed"
        content.draft.find("*Friction", where, text)
    if block.value("TAUMAX"):
        text = f"its limit of the shear stress, TAUMAX={block.shown(block.value('TAUMAX'))}, is not simulated"
        content.draft.find("*Friction, TAUMAX", where, text)
    if "ANISOTROPIC" in block.parameters and len(row) > 1 and row[1] != row[0]:
        text = f"mu = {interaction.mu:g} along the first of two directions is taken for both; the other has {row[1]:g}"
        content.draft.find("*Friction, ANISOTROPIC", where, text)
    if len(block.lines) > 1:
        text = (
            f"depends on slip rate, pressure or temperature; mu = {interaction.mu:g} of the first row is taken, and"
            " [effects.falling_friction] slope gives dmu/dv"
        )
        content.draft.find("*Friction", where, text)
