"""*Orientation: axes that sections, springs and inertias name."""

from __future__ import annotations

import numpy as np

from ...errors import MeshError
from ...mesh.readers.abaqus.model import Statement
from .content import Content


def read_orientation(content: Content, statement: Statement) -> None:
    """Keep *Orientation by its name and the part, instance or assembly that it stands in."""
    content.orientations[statement.block.value("NAME").upper(), statement.scope] = statement


def orientation_of(content: Content, statement: Statement) -> Statement | None:
    """Return the *Orientation that a statement names, None if it names none.

    A name means that of the part or instance which the statement stands in, and else that of the assembly.

    Raises
    ------
    MeshError
        There is none of this name.
    """
    given, scope = statement.block.value("ORIENTATION"), statement.scope
    if not given:
        return None
    instances = content.assembly.instances
    name = given.upper()
    head, _, tail = name.rpartition(".")
    if head in instances:
        name, scope = tail, head
    for home in (scope, instances[scope].part if scope in instances else "", ""):
        if (name, home) in content.orientations:
            return content.orientations[name, home]
    place = " for this part" if any(other == name for other, _ in content.orientations) else ""
    raise MeshError(f'{content.source}: {statement.block.where}: no *Orientation "{given}" in the deck{place}')


def local_axes(content: Content, statement: Statement, key: str) -> np.ndarray | None:
    """Return the axes (3, 3), a row each, of the *Orientation that a statement names, x, y and z if it names none.

    Axes of a part turn with the instance of a key. Of an *Orientation that is not read None and a finding.

    Raises
    ------
    MeshError
        The deck has no *Orientation of this name.
    """
    orientation = orientation_of(content, statement)
    if orientation is None:
        return np.eye(3)
    axes = _own_axes(content, orientation)
    return content.turned(axes, key) if axes is not None and orientation.scope else axes


def _own_axes(content: Content, statement: Statement) -> np.ndarray | None:
    """Return the axes (3, 3) of an *Orientation as it is written; None, and a finding, of one that is not read."""
    block = statement.block
    system = block.value("SYSTEM").upper() or "RECTANGULAR"
    how = block.value("DEFINITION").upper() or "COORDINATES"
    values = [v or 0.0 for v in content.first(block)] + [0.0] * 9
    a, b, c = np.array(values[:3]), np.array(values[3:6]), np.array(values[6:9])
    x, y = a - c, b - c
    z = np.cross(x, y)
    flat = np.linalg.norm(z) <= 1e-12 * np.linalg.norm(x) * np.linalg.norm(y)
    if system not in ("RECTANGULAR", "R") or how != "COORDINATES" or flat:
        text = (
            f"SYSTEM={system}, DEFINITION={how}: only rectangular axes that are the same throughout a body are"
            " simulated; give axes = [[...], [...]] for each body that it is meant for"
        )
        content.draft.find("*Orientation", content.where(statement), text, "missing")
        return None
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    axes = np.stack([x, np.cross(z, x), z])
    if len(block.lines) > 1:
        turn = content.floats(block, block.lines[1])
        axis, angle = int(turn[0] or 1) if turn else 1, np.deg2rad(turn[1] or 0.0) if len(turn) > 1 else 0.0
        j, k = axis % 3, (axis + 1) % 3
        turned = axes.copy()
        turned[j] = np.cos(angle) * axes[j] + np.sin(angle) * axes[k]
        turned[k] = -np.sin(angle) * axes[j] + np.cos(angle) * axes[k]
        axes = turned
    return axes
