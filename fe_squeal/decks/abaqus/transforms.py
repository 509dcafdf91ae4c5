"""*Transform: what *Boundary holds in turned axes, as far as that is along x, y and z."""

from __future__ import annotations

import numpy as np

from ...mesh.readers.abaqus.model import Statement
from .content import Content, Reference

_ALIGNED = 1e-9  # sine of the angle between an axis and the nearest of x, y, z


def read_transform(content: Content, statement: Statement) -> None:
    """Keep *Transform until all supports are known."""
    content.transforms.append(statement)


def held_directions(content: Content, reference: Reference, freedoms: set[int]) -> str | None:
    """Return which of x, y and z freedoms 1 to 3 of a node set hold, None where they hold others."""
    if {1, 2, 3} <= freedoms:
        return "xyz"
    rows, found = content.rows(reference), set[str]()
    turned = np.zeros(len(rows), bool)
    for statement in reversed(content.transforms):  # the last one of a node counts
        inside = ~turned & np.isin(rows, content.rows((statement.block.value("NSET"), statement.scope)))
        if inside.any():
            turned |= inside
            found.add(_directions(content, statement, freedoms))
    if not turned.all():
        found.add("".join("xyz"[f - 1] for f in sorted(freedoms) if f <= 3))
    return found.pop() if len(found) == 1 and "?" not in found else None


def _directions(content: Content, statement: Statement, freedoms: set[int]) -> str:
    """Return what freedoms hold in the axes of a transform; "?" where that is not along x, y and z."""
    values = [v or 0.0 for v in (content.first(statement.block) + [0.0] * 6)[:6]]
    a, b = np.array(values[:3]), np.array(values[3:])
    kind = statement.block.value("TYPE").upper() or "R"
    if kind == "R":
        axes = [a, np.cross(np.cross(a, b), a), np.cross(a, b)]  # along the first point, towards the second
        places = [_axis_of(axis) for axis in axes]
        held = [places[f - 1] for f in freedoms if f <= 3]
        return "?" if None in held else "".join("xyz"[i] for i in sorted(i for i in held if i is not None))
    axis = _axis_of(b - a)  # 1 radial, 2 around, 3 along the axis from one point to the other
    around = {1, 2} & freedoms
    if kind != "C" or axis is None or len(around) == 1:
        return "?"
    return "".join(c for i, c in enumerate("xyz") if (3 in freedoms and i == axis) or (around and i != axis))


def _axis_of(way: np.ndarray) -> int | None:
    largest = int(np.argmax(np.abs(way)))
    size = float(np.linalg.norm(way))
    others = np.delete(way, largest)
    return largest if size and np.linalg.norm(others) <= _ALIGNED * size else None
