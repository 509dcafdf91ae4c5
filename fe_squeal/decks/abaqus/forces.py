"""*Cload: forces on nodes and reference nodes that stand for a pressure on a surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...mesh.measures import area_of
from ..draft import Value
from .content import Content, Reference
from .materials import clean
from .transforms import is_turned

References = Mapping[int, Mapping[str, Value]]  # by the row of a reference node, its table [[rigid]] or [[averaged]]
_ALONG = 0.99  # of the force that an even pressure on the surface has along it; a flat one at right angles has 1
_ASIDE = 0.01  # of the root of the area: distance of the force from the middle of the surface that counts as none


@dataclass(frozen=True)
class _Total:
    """The force (3,) on a node set, the sum over its nodes, and where it stands."""

    reference: Reference
    force: np.ndarray
    where: str


def add_forces(content: Content, found: dict[str, Value], references: References) -> None:
    """Add to the pressures of the scene, by surface, those that forces on their nodes or reference nodes stand for.

    A force on a reference does the work F·U. An even pressure of the same sum does that as well, F times the mean
    displacement of its surface, where F goes through the middle of the surface, or where the reference does not turn.

    Raises
    ------
    MeshError
        A node does not exist.
    """
    for total in _totals(content):
        rows = content.rows(total.reference)
        name = f'"{total.reference[0]}"'
        if is_turned(content, rows):
            text = f"forces on {name} in axes of *Transform are left out: give pressures on surfaces"
            content.draft.find("*Cload", total.where, text)
            continue
        table = references.get(int(rows[0]), {}) if len(rows) == 1 else {}
        surfaces = [str(table["surface"])] if "surface" in table else []
        surfaces = surfaces or content.group(content.loaded.mesh.boundaries or {}, total.reference)
        size = float(np.linalg.norm(total.force)) * content.units.force
        if len(surfaces) != 1:
            text = f"forces on {name}, {_in_units(content, size, 'N')} in all, are left out: [effects.preload] takes"
            content.draft.find("*Cload", total.where, f"{text} pressures on surfaces")
            continue
        (surface,) = surfaces
        area, centre, normal = area_of(content.loaded.mesh, np.asarray((content.loaded.mesh.boundaries or {})[surface]))
        pressure = clean(size / (area * content.units.length**2))
        why = _why_not(content, total.force, area, centre, normal, int(rows[0]) if table else None, table)
        if why:
            shown = (size, "N"), (area * content.units.length**2, "m^2"), (pressure, "Pa")
            force, area_shown, even = (_in_units(content, *number) for number in shown)
            text = (
                f"the force of {force} on {name} is left out: it {why}; [effects.preload] takes pressures on surfaces,"
                f' and that of the same sum on "{surface}" of {area_shown} is {even}'
            )
            content.draft.find("*Cload", total.where, text)
            continue
        before = found.get(surface, 0.0)
        found[surface] = clean(pressure + (before if isinstance(before, float) else 0.0))
        if table:
            text = f'the force on {name} became an even pressure of the same sum on "{surface}", which it acts on'
            content.draft.find("*Cload", total.where, text, "harmless")
        else:
            text = f'forces on the nodes of "{surface}" became an even pressure of the same sum'
            content.draft.find("*Cload", total.where, text)


def _totals(content: Content) -> list[_Total]:
    """Return the forces that are not zero; moments are told."""
    found: dict[Reference, _Total] = {}
    for (reference, component), (value, where) in content.forces.items():
        if 1 <= component <= 3:
            total = found.setdefault(reference, _Total(reference, np.zeros(3), where))
            total.force[component - 1] += value * len(content.rows(reference))
        elif value and component <= 6:
            text = f'moments on "{reference[0]}" are left out: [effects.preload] takes pressures on surfaces'
            content.draft.find("*Cload", where, text)
    return [total for total in found.values() if total.force.any()]


def _why_not(
    content: Content, force: np.ndarray, area: float, centre: np.ndarray, normal: np.ndarray, row: int | None,
    table: Mapping[str, Value],
) -> str:  # fmt: skip
    """Return why an even pressure on a surface is not the same as a force, "" where it is."""
    if force @ normal > -_ALONG * np.linalg.norm(force):
        return "is not along the normal of its surface, into it"
    if row is None:
        return ""
    moment = np.cross(centre - content.raw.points[row], force)
    turns = [freedom not in str(table.get("fixed", "")).split() for freedom in ("rx", "ry", "rz")]
    aside = float(np.linalg.norm(moment[turns]) / np.linalg.norm(force))
    if aside <= _ASIDE * np.sqrt(area):
        return ""
    return f"acts {_in_units(content, aside * content.units.length, 'm')} beside the middle of its surface"


def _in_units(content: Content, value: float, unit: str) -> str:
    """Return a number with its unit, without one where the units of the deck are not known."""
    return f"{value:.4g}" if content.draft.units == "any" else f"{value:.4g} {unit}"
