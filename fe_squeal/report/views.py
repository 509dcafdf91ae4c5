"""What a picture of a mode shape shows along the axis: which displacement of which body, and its nodal lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fe_squeal.report.shapes import Floats

_LEVEL = 0.2  # of the largest displacement over the width of the body: a shape with a smaller slope counts as level
_STILL = 1e-3  # of the largest amplitude: points that move less count as not moving
_MOVES = 0.05  # of the largest amplitude: a body that moves less is not what squeals
_ALONG = 0.1  # of the largest displacement of a body: what is smaller along the axis, or on one side, is not shown

_PLACES = 30  # along the width of a body: of the points at one place the highest are seen
_SAME_FACE = 0.05  # of a body's thickness: points that are lower than the highest by less are seen as well


@dataclass(frozen=True)
class AxialView:
    """A body as it is seen along the axis.

    Attributes
    ----------
    body : int
    values : (n,) float
        The displacement that colours it, over the largest amplitude.
    label : str
        Which displacement that is.
    limit : float
        End of the scale of colours.
    side : 1 or -1
        Whether it is seen from where the axis points to, or, where little moves on that side, from the other one.
    """

    body: int
    values: Floats
    label: str
    limit: float
    side: int


def choose_view(points: Floats, u: Floats, amplitude: Floats, cells: Any, body: Any, frame: Floats) -> AxialView:
    """Return what shows most of a shape: of the bodies that move the widest one, and its displacement along the axis.

    Where nearly all of the motion that is seen is in the plane, it is shown in the direction in which there is most:
    along a line, away from the body's centre or around it.

    Parameters
    ----------
    points, u : (n, 3) float
        Points, and the displacement over the largest amplitude, turned so that the axis is z.
    amplitude : (n,) float
        The largest displacement over a period.
    cells : (ne, nn) int
    body : (ne,) int
    frame : (3, 3) float
        Rows: the directions of x, y and z that points were turned to.
    """
    nodes = {int(b): np.unique(cells[body == b]) for b in np.unique(body)}
    least = _MOVES * float(amplitude.max(initial=0.0))
    moving = [b for b, own in nodes.items() if amplitude[own].max(initial=0.0) >= least]
    some = np.isin(body, moving or list(nodes))
    main = widest_body(points, cells[some], body[some])
    own = nodes[main]
    faces = [own[_outermost(points[own] * [1.0, 1.0, side])] for side in (1, -1)]
    size = [float(np.linalg.norm(u[face], axis=1).max()) for face in faces]
    side = 0 if size[0] >= _ALONG * size[1] else 1
    seen = faces[side]
    values, label = u[:, 2], f"displacement along {direction_text(frame[2])}"
    if np.abs(u[seen, 2]).max() < _ALONG * size[side]:
        values, label = _in_the_plane(points[:, :2], u[:, :2], own, seen, frame)
    return AxialView(main, np.ascontiguousarray(values), label, normal_limit(values[seen]), 1 - 2 * side)


def _outermost(points: Floats) -> Any:
    """Return which points (m, 3) of a body are seen along z, those that have none above them, (m,) bool."""
    low, width = points[:, :2].min(axis=0), np.ptp(points[:, :2], axis=0).max() or 1.0
    place = np.floor((points[:, :2] - low) / width * _PLACES).astype(int) @ [_PLACES + 1, 1]
    highest = np.full(place.max() + 1, -np.inf)
    np.maximum.at(highest, place, points[:, 2])
    return points[:, 2] >= highest[place] - _SAME_FACE * np.ptp(points[:, 2])


def _in_the_plane(points: Floats, u: Floats, own: Any, seen: Any, frame: Floats) -> tuple[Floats, str]:
    """Return the displacement (n,) of u (n, 2) in the direction in which `seen` points move most, and what it is."""
    centre = (points[own].min(axis=0) + points[own].max(axis=0)) / 2
    away = points - centre
    away = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), np.finfo(float).tiny)
    line = np.linalg.svd(u[seen], full_matrices=False)[2][0]
    line = line * np.sign(line[np.argmax(np.abs(line))])
    ways = {
        f"displacement along {direction_text(line @ frame[:2])}": np.broadcast_to(line, away.shape),
        "displacement away from the centre": away,
        "displacement around the centre": np.column_stack([-away[:, 1], away[:, 0]]),
    }
    found = {name: np.einsum("ij,ij->i", u, way) for name, way in ways.items()}
    label = max(found, key=lambda name: float(np.linalg.norm(found[name][seen])))
    return found[label], label


def widest_body(points: Floats, cells: Any, body: Any) -> int:
    """Return the body with the largest bounding box across z, in a brake the disc; points (n, 3), cells (ne, nn)."""
    areas = {int(b): float(np.prod(np.ptp(points[np.unique(cells[body == b])], axis=0)[:2])) for b in np.unique(body)}
    return max(areas, key=lambda b: areas[b])


def normal_limit(u_n: Floats) -> float:
    """Return the end of the colour scale for displacements (m,), over the shape's largest amplitude.

    It is at least 1e-3, so that rounding is not shown as a pattern.
    """
    return max(float(np.abs(u_n).max(initial=0.0)), 1e-3)


def moving_triangles(points: Floats, triangles: Any, u_n: Floats, amplitude: Floats) -> Any:
    """Return which triangles (t,) bool may contain a nodal line.

    There the displacement that is shown changes its sign; where a support holds the body it is zero, which is no nodal
    line.

    Parameters
    ----------
    points : (p, 3) float, m
        Turned so that the axis is z.
    triangles : (t, 3) int
    u_n, amplitude : (p,) float
        The displacement that is shown, and largest displacement over a period.
    """
    corner = points[triangles]  # (t, 3, 3)
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    du, dv = (u_n[triangles[:, i]] - u_n[triangles[:, 0]] for i in (1, 2))
    # The gradient g of the displacement in the triangle's plane, from g·a = du and g·b = dv along two of its edges.
    aa, ab, bb = (np.einsum("ij,ij->i", x, y) for x, y in ((a, a), (a, b), (b, b)))
    det = np.maximum(aa * bb - ab**2, np.finfo(float).tiny)
    square = (bb * du**2 - 2 * ab * du * dv + aa * dv**2) / det
    across = float(np.ptp(points[:, :2], axis=0).max())
    typical = normal_limit(u_n) / max(across, np.finfo(float).tiny)
    still = (amplitude[triangles] < _STILL * float(amplitude.max(initial=0.0))).any(axis=1)
    return (np.sqrt(np.maximum(square, 0.0)) > _LEVEL * typical) & ~still


def direction_text(axis: Sequence[float]) -> str:
    """Return `z` for a coordinate axis, else the direction as `(x, y, z)`.

    Examples
    --------
    >>> direction_text([0, 0, -2]), direction_text([0, 3, 4])
    ('−z', '(0, 0.6, 0.8)')
    """
    unit = (np.asarray(axis, dtype=float) / np.linalg.norm(axis)).round(3) + 0.0
    if np.count_nonzero(unit) == 1:
        i = int(np.argmax(np.abs(unit)))
        return ("−" if unit[i] < 0 else "") + "xyz"[i]
    return "(" + ", ".join(f"{x:.3g}" for x in unit) + ")"


def seen_text(towards: Sequence[float]) -> str:
    """Return from where a picture is seen; `towards` (3,) points from the body to the viewer.

    Examples
    --------
    >>> seen_text([0, 0, 2]), seen_text([0, 0, -2]), seen_text([0, 3, 4])
    ('seen from +z', 'seen from −z', 'seen from (0, 0.6, 0.8)')
    """
    text = direction_text(towards)
    return f"seen from {text if text[0] in '−(' else f'+{text}'}"
