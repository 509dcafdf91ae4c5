"""CERIG, MASS21 and D: rigid bodies at reference nodes, and supports."""

from __future__ import annotations

import numpy as np

from ...errors import MeshError
from ...mesh.raw import rows_of
from ...mesh.readers.ansys_faces import FIRST
from ..draft import Value
from .content import Content, clean, is_zero

_HELD = {"UX": "x", "UY": "y", "UZ": "z", "ROTX": "rx", "ROTY": "ry", "ROTZ": "rz", "ALL": "x y z rx ry rz"}
_WHOLE = ("", "ALL", "UXYZ")  # freedoms of CERIG that tie all translations of solids
_MASS = 21


def write_ties(content: Content) -> None:
    """Write [[rigid]] for each reference node of CERIG, with its mass, inertia and held freedoms.

    Raises
    ------
    MeshError
        A command of the deck is wrong.
    """
    slaves: dict[int, list[str]] = {}
    places: dict[int, str] = {}
    for fields, where in content.lines:
        if fields[0] != "CERIG":
            continue
        master, slave, freedoms = (fields[1:4] + [""] * 3)[:3]
        if not (master.isdigit() and slave.isdigit()) or freedoms not in _WHOLE:
            what = "of selected nodes" if not slave.isdigit() else f"of {freedoms}"
            text = f"{what} is not read: without it the structure is another one; give [[rigid]]"
            content.draft.find("CERIG", where, text, "missing")
            continue
        rows = rows_of(np.array([int(master), int(slave)]), content.raw.node_labels)
        if (rows < 0).any():
            lost = slave if rows[0] >= 0 else master
            raise MeshError(f"{content.source}: {where}: CERIG names node {lost}, which the archive does not have")
        content.masters[int(master)] = int(rows[0])
        slaves.setdefault(int(master), []).append(slave)
        places.setdefault(int(master), where)
    masses, held = _masses(content), _held(content)
    for number, names in slaves.items():
        values: dict[str, Value] = {"name": f"rigid_{number}", "nodes": ", ".join(names)}
        point = content.raw.points[content.masters[number]] * content.units.length
        values["reference"] = [clean(float(x)) for x in point]
        values |= masses.get(number, {})
        if number in held:
            values["fixed"] = " ".join(f for f in _HELD["ALL"].split() if f in held[number])
        table = content.draft.add("rigid", is_entry=True, values=values)
        table.comments.append(f"CERIG, {places[number]}, reference node {number}")


def write_supports(content: Content) -> None:
    """Write a support for all nodes of solids that D holds alike."""
    alike: dict[str, list[str]] = {}
    for node, freedoms in sorted(_held(content, told=True).items()):
        fixed = "".join(c for c in "xyz" if c in freedoms)
        if node not in content.masters and fixed:
            alike.setdefault(fixed, []).append(str(node))
    for fixed, nodes in alike.items():
        content.draft.add("supports", is_entry=True, values={"nodes": ", ".join(nodes), "fixed": fixed})


def _held(content: Content, told: bool = False) -> dict[int, set[str]]:
    used = np.unique(np.concatenate([block.nodes.ravel() for block in content.raw.blocks]))
    solid = set(content.raw.node_labels[used[used >= 0]].tolist())
    found: dict[int, set[str]] = {}
    for fields, where in content.lines:
        if fields[0] != "D" or len(fields) < 3 or fields[2] not in _HELD:
            continue
        if not fields[1].isdigit():
            raise MeshError(f'{content.source}: {where}: D at "{fields[1][:20]}"; expected the number of a node')
        if int(fields[1]) not in solid and int(fields[1]) not in content.masters:
            continue  # a pilot node, or one that no solid has
        if told and len(fields) > 3 and not is_zero(fields[3]):
            text = "a displacement that is prescribed is held; its static state is not simulated"
            content.draft.find("D", where, text)
        found.setdefault(int(fields[1]), set()).update(_HELD[fields[2]].split())
    return found


def _masses(content: Content) -> dict[int, dict[str, Value]]:
    """Return mass and inertia by reference node; those of other nodes are told.

    With KEYOPT(3) = 0 the real constants are three masses and three inertias, with 2 one mass (Ansys element reference,
    MASS21).
    """
    kinds = {int(row[0]) for row in content.archive.ekey if int(row[1]) == _MASS}
    options = {f[1]: f[3] for f, _ in content.lines if f[0].startswith("KEYOP") and len(f) > 3 and f[2] == "3"}
    found: dict[int, dict[str, Value]] = {}
    for row in content.archive.elem:
        if int(row[1]) not in kinds:
            continue
        node, constants = int(row[FIRST]), content.archive.reals.get(int(row[2]), np.zeros(0))
        if node not in content.masters or not len(constants):
            text = "at a node that is no reference of CERIG is left out: frequencies come out too high"
            content.draft.find("MASS21", "", text)
            continue
        values = found.setdefault(node, {})
        values["mass"] = clean(float(constants[0]) * content.units.mass)
        turns = constants[3:6]
        if options.get(str(int(row[1])), "0") == "0" and np.any(turns):
            six = np.zeros(6)
            six[: len(turns)] = turns * content.units.mass * content.units.length**2
            values["inertia"] = [clean(float(v)) for v in six]
    return found
