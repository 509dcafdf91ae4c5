"""*Solid Section: bodies of the scene."""

from __future__ import annotations

import numpy as np

from ...errors import MeshError
from ...mesh.readers.abaqus.model import Statement
from ..draft import Value, plain_name
from .content import Content, Substance
from .materials import clean, material_name
from .orientations import local_axes, orientation_of

_NAMED, _LISTED = 3, 10  # elements and groups in a message


def write_bodies(content: Content) -> None:
    """Write a body for each section and instance, or one for each instance that a section fills.

    Raises
    ------
    MeshError
        A section of the deck is wrong.
    """
    taken: list[str] = []
    groups = content.loaded.mesh.subdomains or {}
    covered = np.zeros(content.loaded.mesh.nelements, bool)
    for section in content.sections:
        block = section.block
        key = block.value("MATERIAL").upper()
        names = content.group(groups, (block.value("ELSET"), section.scope))
        if not names:
            _tell_without_solids(content, section)
            continue
        if key not in content.substances:
            raise MeshError(
                f'{content.source}: {block.where}: *Solid Section is of material "{block.value("MATERIAL")}", which the'
                " deck does not define"
            )
        for group in names:
            elements = np.asarray(groups[group])
            again = covered[elements]
            if again.all():
                text = f'elements of "{group}" have a section already; the first one counts'
                content.draft.find("*Solid Section", content.where(section), text)
                continue
            if again.any():
                raise MeshError(
                    f'{content.source}: {block.where}: *Solid Section: {int(again.sum())} elements of "{group}" have'
                    " another section as well; expected one each"
                )
            covered[elements] = True
            owner = next((n for n, e in groups.items() if f"{n}." == group[: len(n) + 1]
                          and n in _instances(content) and len(e) == len(elements)), group)  # fmt: skip
            name = plain_name(owner, taken)
            taken.append(name)
            values: dict[str, Value] = {"material": material_name(content, key)}
            if name != group:
                values["groups"] = [group]
            substance = content.substances[key]
            axes = _axes(content, section, group, substance)
            if axes is not None:
                values["axes"] = axes
            if substance.alpha or substance.beta:
                alpha, beta = substance.alpha / content.units.time, substance.beta * content.units.time
                values["rayleigh"] = {"alpha": clean(alpha), "beta": clean(beta)}
            table = content.draft.add("bodies", name, values=values)
            table.comments.append(f"*Solid Section, {content.where(section)}")
    _ask_for_bare(content, np.flatnonzero(~covered))


def _ask_for_bare(content: Content, bare: np.ndarray) -> None:
    """Ask for the material of elements (n,) without a section, and name the groups that they are in, with numbers."""
    if not len(bare):
        return
    groups = content.loaded.mesh.subdomains or {}
    inside = {name: len(np.asarray(e)) for name, e in groups.items() if np.isin(np.asarray(e), bare).all()}
    labels = ", ".join(map(str, content.loaded.element_labels[bare[:_NAMED]])) + ", ..." * (len(bare) > _NAMED)
    hint = ""
    if list(inside.values()) == [len(bare)]:
        (name,) = inside
        hint = f'; give [bodies.{plain_name(name)}] with groups = ["{name}"] and a material'
    elif inside:
        counts = [f'"{name}" ({number})' for name, number in inside.items()][:_LISTED]
        more = f" and {len(inside) - _LISTED} more" if len(inside) > _LISTED else ""
        hint = f"; give bodies of these groups, each with a material (number of elements): {', '.join(counts)}{more}"
    number = f"{len(bare)} solid elements ({labels}) have" if len(bare) > 1 else f"1 solid element ({labels}) has"
    content.draft.find("*Solid Section", "", f"{number} none{hint}", "missing")


def _tell_without_solids(content: Content, section: Statement) -> None:
    """Tell of a section without solids: of trusses and the like it changes the answer, of no elements at all not."""
    name = section.block.value("ELSET")
    assembly = content.assembly
    placed = [assembly.instances[key] if key else assembly.own for key in content.placements(section.scope)]
    text = f'its element set "{name}" has no solid elements'
    if "." in name or any(p.sets("ELSET", name) for p in placed):
        text += "; others, such as trusses, are left out with their stiffness and mass"
        content.draft.find("*Solid Section", content.where(section), text)
    else:
        content.draft.find("*Solid Section", content.where(section), text, "harmless")


def _instances(content: Content) -> set[str]:
    return {p.name for p in content.assembly.instances.values()}


def _axes(content: Content, section: Statement, group: str, substance: Substance) -> Value | None:
    """Return the material axes 1 and 2 of a section, None where the material has none or they are the global ones."""
    if "shear_modulus" not in substance.elastic:
        return None
    key = next((k for k, i in content.model.instances.items() if f"{group}.".startswith(f"{i.name}.")), "")
    axes = local_axes(content, section, key)
    if axes is None:
        return None
    if orientation_of(content, section) is None:  # the axes of the part itself
        axes = content.turned(axes, key)
    if np.allclose(axes, np.eye(3), atol=1e-14):
        return None
    return [[clean(round(float(x), 15)) + 0.0 for x in axis] for axis in axes[:2]]
