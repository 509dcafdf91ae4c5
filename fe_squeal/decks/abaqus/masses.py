"""*Mass and *Rotary Inertia: mass and inertia of reference nodes."""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from ...errors import MeshError
from ...mesh.readers.abaqus.model import Statement
from ..draft import Value
from .content import Content, spoken
from .holding import number_of
from .links import links_under
from .materials import clean
from .orientations import local_axes, orientation_of


def read_mass(content: Content, statement: Statement) -> None:
    """Keep *Mass and *Rotary Inertia until all elements are known."""
    content.masses.append(statement)


def masses_at(content: Content, references: Container[int]) -> dict[int, dict[str, Value]]:
    """Return `mass` and `inertia` of the scene by the row of a reference node; those of other nodes are told.

    Several elements at one node add up.

    Raises
    ------
    MeshError
        A *Mass or *Rotary Inertia has no number, or an element has no node.
    """
    masses: dict[int, float] = {}
    tensors: dict[int, np.ndarray] = {}
    for statement in content.masses:
        block, where = statement.block, content.where(statement)
        what = f"*{spoken(block.keyword)}"
        numbers = [v or 0.0 for line in block.lines for v in content.floats(block, line)]
        if not numbers:
            raise MeshError(f"{content.source}: {block.where}: {what} has no number")
        damping = [block.value(word) for word in ("ALPHA", "COMPOSITE")]
        if any(text and number_of(content, statement, text) for text in damping):
            text = "the damping of a single mass is left out; give a damper in springs of its [[rigid]] or [[averaged]]"
            content.draft.find(what, where, text)
        if block.value("TYPE").upper() == "ANISOTROPIC" and len(set((numbers + [0.0] * 3)[:3])) > 1:
            text = "has a mass of its own along each axis; give mass in [[rigid]] or [[averaged]]"
            content.draft.find(f"{what}, TYPE=ANISOTROPIC", where, text, "missing")
            continue
        for key, link in links_under(content, statement):
            tensor = _tensor(content, statement, key, numbers) if block.keyword == "ROTARY INERTIA" else None
            for label, nodes in zip(link.labels, link.nodes, strict=True):
                if not nodes:
                    raise MeshError(f"{content.source}: {link.where}: element {label} of type {link.kind} has no node")
                row = int(content.rows((nodes[0], key))[0])
                if row not in references:
                    text = "at a node that is no reference of a coupling is left out: frequencies come out too high"
                    content.draft.find(what, where, text)
                elif tensor is None:
                    masses[row] = masses.get(row, 0.0) + numbers[0]
                else:
                    tensors[row] = tensors.get(row, np.zeros((3, 3))) + tensor
    found: dict[int, dict[str, Value]] = {}
    for row, mass in masses.items():
        found[row] = {"mass": clean(mass * content.units.mass)}
    for row, tensor in tensors.items():
        six = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]] * content.units.mass * content.units.length**2
        found.setdefault(row, {})["inertia"] = [clean(float(v)) + 0.0 for v in six]
    return found


def _tensor(content: Content, statement: Statement, key: str, numbers: list[float]) -> np.ndarray:
    """Return the inertia (3, 3) of *Rotary Inertia about x, y and z.

    It is given about the axes of its ORIENTATION, or those of its part (Abaqus Analysis User's Guide, Rotary inertia).
    """
    xx, yy, zz, xy, xz, yz = (numbers + [0.0] * 6)[:6]
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    axes = local_axes(content, statement, key)
    if orientation_of(content, statement) is None:
        axes = content.turned(np.eye(3), key)
    return tensor if axes is None or np.array_equal(axes, np.eye(3)) else axes.T @ tensor @ axes
