"""*Contact Pair, *Surface Interaction, *Surface Behavior, *Tie and *Motion: contacts of the scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import MeshError, suggest
from ...fem.closing import GAP_TOLERANCE
from ...mesh.measures import area_of
from ...mesh.readers.abaqus.model import Statement
from ..draft import Table, Value, plain_name
from .content import Content, Interaction, Pair, fields, real, spoken
from .friction import friction_at
from .general import add_general_pairs
from .materials import clean
from .motions import Motion, moving_surfaces, relative_motion

_STIFF = {"contact": 10.0, "tie": 100.0}  # times E/h of the softer side: stiff beside an element of size h
# What stands under *Surface Interaction; any other keyword ends it, so that *Friction of a connector is not its own.
INTERACTION_SUBOPTIONS = {
    "FRICTION", "SURFACE BEHAVIOR", "CONTACT DAMPING", "COHESIVE BEHAVIOR", "DAMAGE INITIATION", "DAMAGE EVOLUTION",
    "DAMAGE STABILIZATION", "FRACTURE CRITERION", "GAP CONDUCTANCE", "GAP RADIATION", "GAP HEAT GENERATION",
    "GAP ELECTRICAL CONDUCTANCE", "GAP FLOW",
}  # fmt: skip


def read_interaction(content: Content, statement: Statement) -> None:
    """Take *Surface Interaction: what follows belongs to it."""
    name = statement.block.value("NAME")
    content.interaction = content.interactions.setdefault(name.upper(), Interaction(name, content.where(statement)))


def read_behaviour(content: Content, statement: Statement) -> None:
    """Take *Surface Behavior: the slope of a linear pressure over overclosure."""
    block, interaction = statement.block, content.interaction
    if interaction is None:
        content.draft.find("*Surface Behavior", content.where(statement), "belongs to no *Surface Interaction")
        return
    kind = block.value("PRESSURE-OVERCLOSURE").upper() or "HARD"
    rows = [content.floats(block, line) for line in block.lines]
    interaction.behaviour_where = content.where(statement)
    interaction.no_separation = "NO SEPARATION" in block.parameters
    if kind == "LINEAR" and rows and rows[0]:
        interaction.stiffness = float(rows[0][0] or 0.0)
    elif kind == "TIED" and rows and rows[0]:
        interaction.stiffness, interaction.tied = float(rows[0][0] or 0.0), True
    elif kind == "TABULAR" and len(rows) > 1:
        points = [(float(r[1] or 0.0) if len(r) > 1 else 0.0, float(r[0] or 0.0)) for r in rows]
        (h0, p0), (h1, p1) = points[-2:]
        interaction.hint = (p1 - p0) / (h1 - h0) if h1 != h0 else None
        interaction.behaviour = "a table of pressure over overclosure, steepest at its end"
    else:
        interaction.behaviour = {"HARD": "hard contact", "EXPONENTIAL": "exponential pressure over overclosure"}.get(
            kind, f"PRESSURE-OVERCLOSURE={kind}"
        )


def read_pair(content: Content, statement: Statement) -> None:
    """Take *Contact Pair, which ties if it is TIED, or *Tie: one on each data line."""
    block, keyword = statement.block, f"*{spoken(statement.block.keyword)}"
    if "TIED" in block.parameters:
        keyword += ", TIED"
    pairs = content.pairs if keyword == "*Contact Pair" else content.ties
    reach = _reach(content, statement)
    if block.value("TIED NSET"):
        text = f'ties the nodes of "{block.value("TIED NSET")}" alone: give [[contacts]] with a surface of these'
        content.draft.find(f"{keyword}, TIED NSET", content.where(statement), text, "missing")
    for line in block.lines:
        names = [part for part in fields(line) if part]
        if len(names) < 2:
            text = "self contact is not simulated" if names else "names no surfaces"
            content.draft.find(keyword, content.where(statement), text, "missing")
            continue
        where = content.where(statement)
        pairs.append(Pair(names[0], names[1], block.value("INTERACTION"), block.value("NAME"), where, keyword, reach))


def _reach(content: Content, statement: Statement) -> float:
    """Return up to which distance ADJUST of a pair or POSITION TOLERANCE of a tie closes gaps; 0 if none is given."""
    word = "POSITION TOLERANCE" if statement.block.keyword == "TIE" else "ADJUST"
    try:
        return real(statement.block.value(word))
    except ValueError:  # none, or a set of nodes to be moved
        return 0.0


def write_contacts(content: Content) -> float | None:
    """Write a contact for each pair and tie; return the friction coefficient that their friction ratios multiply."""
    add_general_pairs(content)
    moving = moving_surfaces(content)
    found = [_found(content, pair, moving) for pair in content.pairs]
    at_rest = [i.mu if (i := content.interactions.get(p.interaction.upper())) else None for p in content.pairs]
    mu = max((c for f, rest in zip(found, at_rest, strict=True) if (c := f.mu if f else rest)), default=None)
    taken: list[str] = []
    for pair, one in zip(content.pairs, found, strict=True):
        if one is not None:
            _write_pair(content, pair, one, mu, taken)
    for pair in content.ties:
        names = _surfaces(content, pair)
        if names is None:
            continue
        table = _named(content, pair, names, taken)
        stiffness = clean(_suggested(content, names, "tie") * _area_unit(content))
        table.values |= {"kind": "tied", "normal_stiffness": stiffness}
        how = f"stiff springs of {_STIFF['tie']:g} E/h of the softer side; compare with ten times as much"
        table.comments.append(f"{pair.keyword}, {pair.where}: {how}")
        content.draft.find(pair.keyword, pair.where, "is exact there, and here a tied contact of finite stiffness")
    return mu


@dataclass(frozen=True)
class _Found:
    """A pair with its surface and counterface, its interaction, how it slides if that is known, and its friction."""

    names: list[str]
    interaction: Interaction
    sliding: dict[str, Value] | None
    mu: float


def _found(content: Content, pair: Pair, moving: list[tuple[set[str], Motion]]) -> _Found | None:
    names = _surfaces(content, pair)
    if names is None:
        return None
    interaction = content.interactions.get(pair.interaction.upper())
    if interaction is None:
        raise MeshError(
            f'{content.source}: {pair.where}: *Contact Pair is of interaction "{pair.interaction}", which the deck does'
            " not define" + suggest(pair.interaction, [i.name for i in content.interactions.values()])
        )
    sides = [next((m for surfaces, m in reversed(moving) if name in surfaces), None) for name in names]
    sliding = relative_motion(content, pair, names, *sides)
    if sides[0] is not None and sides[1] is None:
        names = names[::-1]  # the counterface is what moves
    return _Found(names, interaction, sliding, friction_at(content, interaction, names[0], sliding))


def _write_pair(content: Content, pair: Pair, found: _Found, mu: float | None, taken: list[str]) -> None:
    names, interaction, sliding = found.names, found.interaction, found.sliding
    table = _named(content, pair, names, taken)
    table.comments.append(f"*Contact Pair, {pair.where}; interaction {interaction.name}")
    unit = content.units
    if interaction.stiffness:
        table.values["normal_stiffness"] = clean(interaction.stiffness * unit.pressure / unit.length)
    else:
        value = clean(float(f"{_suggested(content, names, 'contact') * _area_unit(content):.2g}"))
        more = ""
        if interaction.hint:
            more = f" (the end of the table has {interaction.hint * unit.pressure / unit.length:.3g})"
        place = f" at {interaction.behaviour_where}" if interaction.behaviour_where else ""
        table.open.append((
            f"normal_stiffness = {value!r}",
            f"*Surface Behavior{place}: {interaction.behaviour}; give normal_stiffness in N/m per m^2, e.g. 10 E/h ="
            f" {value:.2g} of the softer side{more}, and see how onsets move with it",
        ))  # fmt: skip
    if interaction.rough or interaction.tied:
        table.values["kind"] = "tied"
        content.draft.find("*Friction, ROUGH", interaction.where, "points that do not slip are taken as tied")
    elif not found.mu:
        table.values["kind"] = "frictionless"
    elif sliding is not None:
        table.values["sliding"] = sliding
        if mu is not None and found.mu != mu:
            table.values["friction_ratio"] = clean(found.mu / mu)
    else:
        table.open.append((
            'sliding = { axis = [0.0, 0.0, 1.0], centre = [0.0, 0.0, 0.0], speed = 1.0 }',
            "the deck has friction but no *Motion that says how the counterface moves: give it (rad/s about an axis, or"
            ' direction and m/s); if nothing slides in this contact, write kind = "tied" instead',
        ))  # fmt: skip


def _surfaces(content: Content, pair: Pair) -> list[str] | None:
    known, found = content.loaded.mesh.boundaries or {}, []
    for text in (pair.first, pair.second):
        names = content.group(known, (text, ""))
        if len(names) != 1:
            content.draft.find(
                "*Contact Pair / *Tie", pair.where,
                f'its surface "{text}" is no surface of solid elements here{content.reason(text)}; the two'
                " parts are not connected without it", "missing",
            )  # fmt: skip
            return None
        if content.is_of_nodes((text, "")) and content.is_part_covered(names[0]):
            what = f'its surface "{text}" is of nodes, some of which are on no whole face of the set'
            content.draft.find("*Contact Pair / *Tie", pair.where, f"{what}: give a surface of elements", "missing")
        found += names
    return found


def _named(content: Content, pair: Pair, names: list[str], taken: list[str]) -> Table:
    name = plain_name(pair.name or f"{names[0]}_on_{names[1]}", taken)
    taken.append(name)
    values: dict[str, Value] = {"name": name, "surface": names[0], "counterface": names[1]}
    if pair.reach > GAP_TOLERANCE * _facet_size(content, names[0]):  # else what is closed by itself is more
        values["gap_tolerance"] = clean(pair.reach * content.units.length)
    return content.draft.add("contacts", is_entry=True, values=values)


def _area_unit(content: Content) -> float:
    return content.units.pressure / content.units.length


def _suggested(content: Content, names: list[str], what: str) -> float:
    """Return a stiffness per area, in the deck's units, that is high beside that of the softer side's elements."""
    mesh, found = content.loaded.mesh, []
    for name in names:
        moduli = _moduli(content, mesh.f2t[0, np.asarray((mesh.boundaries or {})[name])])
        found.append(min(moduli, default=0.0) / _facet_size(content, name))
    soft = min((x for x in found if x > 0), default=0.0)
    return clean(float(f"{_STIFF[what] * soft:.6g}")) or 1.0


def _facet_size(content: Content, surface: str) -> float:
    """Return the root of the mean area of a surface's facets, in the deck's unit of length."""
    mesh = content.loaded.mesh
    facets = np.asarray((mesh.boundaries or {})[surface])
    return float(np.sqrt(area_of(mesh, facets)[0] / len(facets)))


def _moduli(content: Content, elements: np.ndarray) -> list[float]:
    groups, found = content.loaded.mesh.subdomains or {}, []
    for section in content.sections:
        substance = content.substances.get(section.block.value("MATERIAL").upper())
        for group in content.group(groups, (section.block.value("ELSET"), section.scope)):
            if substance is not None and substance.elastic and np.isin(groups[group], elements).any():
                found.append(min(substance.elastic["youngs_modulus"]))
    return found
