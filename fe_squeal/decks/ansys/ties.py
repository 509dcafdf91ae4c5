"""CERIG, MASS21 and D: rigid bodies at reference nodes, and supports."""

from __future__ import annotations

import numpy as np

from ...errors import MeshError
from ...mesh.raw import rows_of
from ...mesh.readers.ansys_faces import FIRST
from ..directions import along_axes, held_projector
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
        if held.get(number):
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
    """Return the freedoms that D holds by node: D,Node,Lab,VALUE,VALUE2,NEND,NINC,Lab2,...,Lab6.

    Pilot nodes, and others that no solid has, are left out.
    """
    used = np.unique(np.concatenate([block.nodes.ravel() for block in content.raw.blocks]))
    known = set(content.raw.node_labels[used[used >= 0]].tolist()) | set(content.masters)
    found, highest = dict[int, set[str]](), max(known)
    for fields, where in content.lines:
        if fields[0] != "D":
            continue
        labels = [label for label in (*fields[2:3], *fields[7:12]) if label in _HELD]
        nodes = [n for n in _range(content, fields, where, highest) if n in known] if labels else []
        if told and nodes and len(fields) > 3 and not is_zero(fields[3]):
            text = "a displacement that is prescribed is held; its static state is not simulated"
            content.draft.find("D", where, text)
        for node in nodes:
            found.setdefault(node, set()).update(*(_HELD[label].split() for label in labels))
    _turn(content, found)
    return found


def _range(content: Content, fields: list[str], where: str, highest: int) -> range:
    """Return the nodes of D, up to the highest one of the archive: Node, or those from it to NEND in steps of NINC."""
    texts = [fields[1], *(text or "0" for text in [*fields[5:7], "", ""][:2])]
    if all(text.isdecimal() for text in texts):
        first, last, step = map(int, texts)
        if not 0 < last < first:
            return range(first, min(last or first, highest) + 1, step or 1)
    given = ",".join((fields[1], *fields[5:7])).rstrip(",")[:20]
    what = f'D at "{given}"; expected the number of a node, or of a first and a last one, and a step'
    raise MeshError(f"{content.source}: {where}: {what}")


def _turn(content: Content, held: dict[int, set[str]]) -> None:
    """Turn what is held in axes of nodes into what is held along x, y and z; ask for what is along none of these."""
    lost = []
    for number, angles in zip(content.archive.nnum.tolist(), content.archive.angles, strict=True):
        if number not in held or not angles.any():
            continue
        axes, found = axes_of(*angles), set[str]()
        for turn in ("", "r"):  # translations, then rotations
            directions = along_axes(held_projector(axes, [f"{turn}{c}" in held[number] for c in "xyz"]))
            if directions is None:
                lost.append(number)
            found |= {f"{turn}{c}" for c in directions or ""}
        held[number] = found
    if lost:
        text = (
            f"holds {len(lost)} nodes ({lost[0]}, ...) in axes that NBLOCK turns and that are not along x, y and z:"
            " give [[supports]]"
        )
        content.draft.find("D", "", text, "missing")


def axes_of(thxy: float, thyz: float, thzx: float) -> np.ndarray:
    """Return the axes (3, 3), a row each, that three angles in degrees turn: about z, then the new x, then the new y.

    Examples
    --------
    >>> axes_of(90.0, 0.0, 0.0).round(12).tolist()[0]
    [0.0, 1.0, 0.0]
    """
    z, x, y = np.deg2rad([thxy, thyz, thzx])
    about_z = np.array([[np.cos(z), -np.sin(z), 0.0], [np.sin(z), np.cos(z), 0.0], [0.0, 0.0, 1.0]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(x), -np.sin(x)], [0.0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0.0, np.sin(y)], [0.0, 1.0, 0.0], [-np.sin(y), 0.0, np.cos(y)]])
    return (about_z @ about_x @ about_y).T


def _masses(content: Content) -> dict[int, dict[str, Value]]:
    """Return mass and inertia by reference node; those of other nodes are told.

    With KEYOPT(3) = 0 the real constants are three masses and three inertias, with 2 one mass (Ansys element reference,
    MASS21).
    """
    kinds = {int(row[0]) for row in content.archive.ekey if int(row[1]) == _MASS}
    options = {f[1]: f[3] for f, _ in content.lines if f[0].startswith("KEYOP") and len(f) > 3 and f[2] == "3"}
    found: dict[int, np.ndarray] = {}
    for row in content.archive.elem:
        if int(row[1]) not in kinds:
            continue
        node, constants = int(row[FIRST]), content.archive.reals.get(int(row[2]), np.zeros(0))
        if node not in content.masters:
            text = "at a node that is no reference of CERIG is left out: frequencies come out too high"
            content.draft.find("MASS21", "", text)
            continue
        if not len(constants):
            text = f"at node {node} has no real constants: the archive has no set {int(row[2])}; give mass in [[rigid]]"
            content.draft.find("MASS21", "", text)
            continue
        constants = np.pad(constants[:6], (0, max(0, 6 - len(constants))))
        has_turns = options.get(str(int(row[1])), "0") == "0"
        along, turns = constants[:3], constants[3:] if has_turns else np.zeros(3)
        if has_turns and np.ptp(along) > 0:
            text = f"at node {node} has masses of its own along x, y and z; give mass in [[rigid]]"
            content.draft.find("MASS21", "", text, "missing")
            continue
        total = found.setdefault(node, np.zeros(7))  # several masses at one node add up
        total[0] += along[0] * content.units.mass
        total[1:4] += turns * content.units.mass * content.units.length**2
    return {
        node: {"mass": clean(float(t[0]))} | ({"inertia": [clean(float(v)) for v in t[1:]]} if t[1:].any() else {})
        for node, t in found.items()
    }
