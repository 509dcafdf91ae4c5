"""*Friction and *Change Friction: the coefficient of an interaction that counts for the frequencies."""

from __future__ import annotations

import numpy as np

from ...mesh.measures import mean_distance
from ...mesh.readers.abaqus.model import Statement
from ..draft import Value
from .amplitudes import factor_of
from .content import Content, Interaction
from .friction_laws import law_of
from .materials import clean


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
    interaction.first = interaction.first or (interaction.mu, interaction.rough, interaction.law)
    if "RESET" in block.parameters:
        interaction.mu, interaction.rough, interaction.law = interaction.first
    elif factor_of(content, statement) != 1.0:
        text = "its amplitude does not end at 1: give the friction that it ends at in [[contacts]]"
        content.draft.find("*Change Friction", where, text, "missing")


def read_friction(content: Content, statement: Statement) -> None:
    """Take *Friction: the coefficient of its first row, or its law over the sliding speed; the last one counts."""
    block, where, interaction = statement.block, content.where(statement), content.interaction
    if interaction is None:
        content.draft.find("*Friction", where, "belongs to no *Surface Interaction and is not taken over")
        return
    row = content.first(block)
    interaction.rough = "ROUGH" in block.parameters
    interaction.mu = None if interaction.rough else float(row[0] or 0.0) if row else 0.0
    rows = [content.floats(block, line) for line in block.lines]
    interaction.law = None if interaction.rough else law_of(set(block.parameters), rows)
    interaction.law_where = where
    if interaction.rough:
        return
    decays = "EXPONENTIAL DECAY" in block.parameters
    if interaction.law is None and ("USER" in block.parameters or decays):
        text = "its law is not read: give mu, and [effects.falling_friction] slope = dmu/dv at the sliding speed"
        content.draft.find("*Friction", where, text)
    if block.value("TAUMAX"):
        text = f"its limit of the shear stress, TAUMAX={block.shown(block.value('TAUMAX'))}, is not simulated"
        content.draft.find("*Friction, TAUMAX", where, text)
    if "ANISOTROPIC" in block.parameters and len(row) > 1 and row[1] != row[0]:
        text = f"mu = {interaction.mu:g} along the first of two directions is taken for both; the other has {row[1]:g}"
        content.draft.find("*Friction, ANISOTROPIC", where, text)
    if interaction.law is None and len(block.lines) > 1 and not decays:
        text = (
            f"depends on slip rate, pressure or temperature; mu = {interaction.mu:g} of the first row is taken, and"
            " [effects.falling_friction] slope gives dmu/dv"
        )
        content.draft.find("*Friction", where, text)


def friction_at(content: Content, interaction: Interaction, surface: str, sliding: dict[str, Value] | None) -> float:
    """Return the coefficient of a contact at the mean sliding speed over its surface, and tell how it was taken.

    Parameters
    ----------
    content : Content
    interaction : Interaction
    surface : str
        The surface that slides on what moves.
    sliding : dict, optional
        As the scene has it, in SI units; None where it is not known.
    """
    mu, law = interaction.mu or 0.0, interaction.law
    if law is None or interaction.rough or interaction.tied:
        return mu
    if sliding is None:
        text = (
            f"depends on the sliding speed, which the deck does not give: mu = {mu:g} of the first row is taken; give"
            " that at the sliding speed, and [effects.falling_friction] slope = dmu/dv"
        )
        content.draft.find("*Friction", interaction.law_where, text)
        return mu
    speed = _mean_speed(content, surface, sliding)
    mu, slope = law.at(speed / content.units.speed)
    text = f"depends on the sliding speed: mu = {mu:.4g} at the mean speed on {surface}, {speed:.3g} m/s, is taken"
    if slope:
        text += f"; there dmu/dv = {slope / content.units.speed:.3g} s/m, for [effects.falling_friction] slope"
    content.draft.find("*Friction", interaction.law_where, text)
    return clean(mu)


def _mean_speed(content: Content, surface: str, sliding: dict[str, Value]) -> float:
    """Return the mean sliding speed over a surface, m/s."""
    speed = abs(float(sliding["speed"]))  # type: ignore[arg-type]
    if "axis" not in sliding:
        return speed
    mesh = content.loaded.mesh
    axis, centre = (np.array(sliding.get(key, [0.0, 0.0, 0.0]), float) for key in ("axis", "centre"))
    length = content.units.length
    facets = np.asarray((mesh.boundaries or {})[surface])
    return speed * length * mean_distance(mesh, facets, axis, centre / length)
