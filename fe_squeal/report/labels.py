"""Labels beside points of a plot that cover neither each other nor leave the axes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

_DISTANCES = (10, 20, 34, 52, 75)  # pt, from the point to the nearest corner or edge of the label
_DIRECTIONS = (45, 135, 315, 225, 90, 270, 20, 160, 340, 200)  # degrees


def place_labels(
    axes: Axes,
    canvas: FigureCanvasAgg,
    points: Sequence[tuple[float, float]],
    texts: Sequence[str],
    avoid: NDArray[np.float64],
) -> list[Annotation]:
    """Write each text beside its point and return those that found room.

    Greedy: each label takes the cheapest of fifty places that lie inside the axes, clear of all points and of the
    labels before it; a place costs its distance and something for each sample of `avoid` that it covers. A text
    without any room is left out rather than drawn over another. The layout of the figure must be final (drawn
    once, layout engine off), since the places are found in pixels.

    Parameters
    ----------
    points : (n, 2), data coordinates
    avoid : (m, 2), data coordinates
        Samples of the curves that a label should rather not cover.
    """
    scale = axes.figure.dpi / 72.0
    frame = axes.get_window_extent().padded(-3 * scale)  # the label's own box is larger than its text
    pixels = axes.transData.transform(np.asarray(points, dtype=float).reshape(-1, 2))
    curves = axes.transData.transform(avoid)
    taken = [Bbox.from_bounds(x - 4 * scale, y - 4 * scale, 8 * scale, 8 * scale) for x, y in pixels]
    placed = []
    for point, pixel, text in zip(points, pixels, texts, strict=True):
        label = axes.annotate(
            text, point, xytext=(0, 0), textcoords="offset points", fontsize=8, ha="left", va="bottom", zorder=9,
            bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none"},
            arrowprops={"arrowstyle": "-", "lw": 0.6, "color": "0.3", "shrinkA": 0, "shrinkB": 3},
        )
        # the extent of an annotation spans its arrow too; with the text on the point only the text counts
        extent = label.get_window_extent(canvas.get_renderer())
        size = np.array([extent.width, extent.height])
        best = (np.inf, np.zeros(2))
        for distance, corner in _places(size, scale):
            box = Bbox.from_bounds(*(pixel + corner), *size)
            if not _inside(box, frame) or any(box.overlaps(other) for other in taken):
                continue
            hits = ((curves > box.min) & (curves < box.max)).all(axis=1).sum()
            if distance + 3.0 * hits < best[0]:
                best = (distance + 3.0 * hits, corner)
        if not np.isfinite(best[0]):
            label.remove()
            continue
        label.set_position(tuple(best[1] / scale))
        taken.append(Bbox.from_bounds(*(pixel + best[1]), *size).padded(3 * scale))
        placed.append(label)
    return placed


def _places(size: NDArray[np.float64], scale: float) -> Iterator[tuple[float, NDArray[np.float64]]]:
    """Yield (distance in pt, lower left corner relative to the point in pixels) of each place to try."""
    for distance in _DISTANCES:
        for degrees in _DIRECTIONS:
            x, y = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
            # the label hangs from the point by its corner, or by the middle of an edge straight above and below
            anchor = np.array([0.0 if x > 0.1 else 1.0 if x < -0.1 else 0.5, 0.0 if y > 0 else 1.0])
            yield float(distance), distance * scale * np.array([x, y]) - anchor * size


def _inside(box: Bbox, frame: Bbox) -> bool:
    return bool(box.x0 > frame.x0 and box.x1 < frame.x1 and box.y0 > frame.y0 and box.y1 < frame.y1)
