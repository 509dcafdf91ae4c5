"""*Transform: the axes of nodes in which *Boundary, *Cload and *Equation count, and what is held in them."""

from __future__ import annotations

import numpy as np

from ...mesh.readers.abaqus.assembly import moved
from ...mesh.readers.abaqus.model import Statement
from ..directions import along_axes, held_projector
from .content import Content, Reference


def read_transform(content: Content, statement: Statement) -> None:
    """Keep *Transform until all supports are known."""
    content.transforms.append(statement)


def held_directions(content: Content, reference: Reference, freedoms: set[int]) -> str | None:
    """Return which of x, y and z freedoms 1 to 3 of a node set hold, None where they hold others."""
    held = [f in freedoms for f in (1, 2, 3)]
    different = np.unique(axes_at(content, content.rows(reference)), axis=0)
    found = {along_axes(held_projector(axes, held)) for axes in different}
    return found.pop() if len(found) == 1 else None


def is_turned(content: Content, rows: np.ndarray) -> bool:
    """Whether any of some nodes, rows (n,) of the raw mesh, has other axes than x, y and z."""
    return not np.array_equal(axes_at(content, rows), np.tile(np.eye(3), (len(rows), 1, 1)))


def axes_at(content: Content, rows: np.ndarray) -> np.ndarray:
    """Return the axes (n, 3, 3), a row each, of nodes: those of their last *Transform, or x, y and z.

    Axes of a part turn with each of its instances (Abaqus Analysis User's Guide, Transformed coordinate systems).

    Parameters
    ----------
    content : Content
    rows : (n,) int
        Rows of the raw mesh.
    """
    found = np.tile(np.eye(3), (len(rows), 1, 1))
    for statement in content.transforms:
        for key in content.placements(statement.scope):
            inside = np.isin(rows, content.rows((statement.block.value("NSET"), key)))
            if inside.any():
                found[inside] = _axes(content, statement, key, content.raw.points[rows[inside]])
    return found


def _axes(content: Content, statement: Statement, key: str, places: np.ndarray) -> np.ndarray:
    """Return the axes (n, 3, 3) of a *Transform at some places (n, 3); NaN where it has none.

    TYPE=R has its first axis towards the first point a and its second in the plane of both points; C has radial,
    tangential and axial axes about the line from a to b, S radial, tangential and meridional ones about a.
    """
    values = [v or 0.0 for v in (content.first(statement.block) + [0.0] * 6)[:6]]
    kind = statement.block.value("TYPE").upper() or "R"
    points = np.array(values).reshape(2, 3)
    if kind == "R":
        a, b = content.turned(points, key)
        x, z = np.broadcast_to(a, places.shape), np.broadcast_to(np.cross(a, b), places.shape)
        return np.stack([_unit(x), _unit(np.cross(z, x)), _unit(z)], axis=1)
    instance = content.model.instances.get(key)
    a, b = points if instance is None else moved(points, instance.place)
    along, out = np.broadcast_to(_unit(b - a), places.shape), places - a
    if kind == "C":
        out = out - np.sum(out * along, axis=1, keepdims=True) * along
    around = _unit(np.cross(along, out))
    return np.stack([_unit(out), around, along if kind == "C" else np.cross(_unit(out), around)], axis=1)


def _unit(ways: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) of length 1, NaN for those without a length."""
    sizes = np.linalg.norm(ways, axis=-1, keepdims=True)
    return np.divide(ways, sizes, out=np.full(ways.shape, np.nan), where=sizes > 0)
