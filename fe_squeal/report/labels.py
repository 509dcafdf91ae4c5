"""Labels beside points of a plot that do not cover each other and stay inside the axes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

_DISTANCES = (10, 20, 34, 52, 75, 105)  # pt: distances of a label from its point that are tried
_CLOSE = 75.0  # pt: labels of points closer together than this could be confused, and keep the order of their points
_BESIDE_ANOTHER = 40.0  # pt of distance: the cost of a place that is nearer to another point than to the label's own
_DIRECTIONS = (45, 135, 315, 225, 90, 270, 20, 160, 340, 200)  # degrees


def place_labels(
    axes: Axes,
    canvas: FigureCanvasAgg,
    points: Sequence[tuple[float, float]],
    texts: Sequence[str],
    avoid: NDArray[np.float64],
) -> list[Annotation]:
    """Write each text beside its point, and return the labels that found a place.

    One label after the other takes the cheapest of sixty places that are inside the axes and cover no point and no
    label placed before. The cost of a place is its distance from the point, and more for each sample of `avoid` that it
    covers. So that labels cannot be confused, those of points close together keep the order of the points, and no line
    from a point to its label crosses another such line or another point. A text without any such place is left out. The
    layout of the figure has to be final (drawn once, layout engine off), since places are found in pixels.

    Parameters
    ----------
    axes : Axes
    canvas : FigureCanvasAgg
        Canvas of the figure.
    points : (n, 2) float
        Points in data coordinates.
    texts : n str
    avoid : (m, 2) float
        Samples, in data coordinates, of curves that labels should not cover.
    """
    scale = axes.figure.dpi / 72.0
    frame = axes.get_window_extent().padded(-3 * scale)  # the box of a label is larger than its text
    pixels = axes.transData.transform(np.asarray(points, dtype=float).reshape(-1, 2))
    curves = axes.transData.transform(avoid)
    taken = [Bbox.from_bounds(x - 4 * scale, y - 4 * scale, 8 * scale, 8 * scale) for x, y in pixels]
    placed: list[Annotation] = []
    leaders: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []  # of each placed label: its point, its middle
    for i, (point, pixel, text) in enumerate(zip(points, pixels, texts, strict=True)):
        others = np.delete(pixels, i, axis=0)
        label = axes.annotate(
            text, point, xytext=(0, 0), textcoords="offset points", fontsize=8, ha="left", va="bottom", zorder=9,
            bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none"},
            arrowprops={"arrowstyle": "-", "lw": 0.6, "color": "0.3", "shrinkA": 0, "shrinkB": 3},
        )
        # The extent of an annotation includes its arrow. With the text on the point it is that of the text alone.
        extent = label.get_window_extent(canvas.get_renderer())
        size = np.array([extent.width, extent.height])
        best = (np.inf, np.zeros(2))
        for distance, corner in _places(size, scale):
            box = Bbox.from_bounds(*(pixel + corner), *size)
            if not _inside(box, frame) or any(box.overlaps(other) for other in taken):
                continue
            middle = pixel + corner + size / 2
            if _misleads(pixel, middle, leaders, others, scale):
                continue
            hits = ((curves > box.min) & (curves < box.max)).all(axis=1).sum()
            nearer = len(others) and _distance(box, others).min() < _distance(box, pixel[None])[0]
            cost = distance + 3.0 * hits + _BESIDE_ANOTHER * bool(nearer)
            if cost < best[0]:
                best = (cost, corner)
        if not np.isfinite(best[0]):
            label.remove()
            continue
        label.set_position(tuple(best[1] / scale))
        taken.append(Bbox.from_bounds(*(pixel + best[1]), *size).padded(3 * scale))
        placed.append(label)
        leaders.append((pixel, pixel + best[1] + size / 2))
    return placed


def _distance(box: Bbox, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distances (n,), pixels, of points (n, 2) from a box."""
    return np.asarray(np.hypot(*np.maximum(np.maximum(box.min - points, points - box.max), 0.0).T))


def _misleads(
    pixel: NDArray[np.float64], middle: NDArray[np.float64],
    leaders: list[tuple[NDArray[np.float64], NDArray[np.float64]]], others: NDArray[np.float64], scale: float,
) -> bool:  # fmt: skip
    """Return whether a label with its middle at `middle` could be taken for that of another point."""
    for point, label in leaders:
        apart = pixel - point
        if np.hypot(*apart) < _CLOSE * scale and (middle - label) @ apart < 0:
            return True
        if _cross(pixel, middle, point, label):
            return True
    along = middle - pixel
    if not len(others):
        return False
    t = np.clip((others - pixel) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    distance = np.hypot(*(others - pixel - t[:, None] * along).T)
    return bool(((distance < 3 * scale) & (np.hypot(*(others - pixel).T) > 3 * scale)).any())


def _cross(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], d: NDArray[np.float64]) -> bool:
    """Return whether the segments from a to b and from c to d cross."""

    def side(p: NDArray[np.float64], q: NDArray[np.float64], r: NDArray[np.float64]) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def _places(size: NDArray[np.float64], scale: float) -> Iterator[tuple[float, NDArray[np.float64]]]:
    """Yield the places to try: distance, pt, and lower left corner of the label relative to its point, pixels."""
    for distance in _DISTANCES:
        for degrees in _DIRECTIONS:
            x, y = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
            # The nearest corner of the label is at the distance; straight above and below the middle of its edge is.
            anchor = np.array([0.0 if x > 0.1 else 1.0 if x < -0.1 else 0.5, 0.0 if y > 0 else 1.0])
            yield float(distance), distance * scale * np.array([x, y]) - anchor * size


def _inside(box: Bbox, frame: Bbox) -> bool:
    return bool(box.x0 > frame.x0 and box.x1 < frame.x1 and box.y0 > frame.y0 and box.y1 < frame.y1)
