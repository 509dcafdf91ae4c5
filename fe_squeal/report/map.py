"""Figure of a map: the largest growth in colour, and the boundaries as lines with their frequency."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from fe_squeal.report.axes import frequency_unit
from fe_squeal.report.branches import figure_text, frequency_text, title_text
from fe_squeal.report.files import save_figure
from fe_squeal.report.labels import place_labels
from fe_squeal.report.study import short_name

_GROWTH, _LINES, _EMPTY = "Reds", "viridis", "0.8"
_ROOM = 0.06  # of the axes: a point of a curve that is as far from other curves has room enough for a label
_LABELLED = 12  # curves with their frequency beside them, at most


def plot_map(
    grid: pd.DataFrame, boundaries: pd.DataFrame, names: Sequence[str], logs: Sequence[bool],
    path: str | os.PathLike[str], title: str = "",
) -> Path:  # fmt: skip
    """Draw the largest growth rate on the grid in colour, and every boundary in the colour of its frequency.

    Places without an unstable mode have the colour of 0, and those without any mode are grey.

    Parameters
    ----------
    grid, boundaries : DataFrame
        As in `map.csv` and `boundaries.csv`.
    names : (str, str)
        The two parameters.
    logs : (bool, bool)
        Whether each axis is logarithmic.
    path : str or Path
        The file to write; its suffix chooses the format (png, pdf, svg).
    title : str
    """
    figure = Figure(figsize=(9.2, 5.6), dpi=130, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title_text(title, figure.get_figwidth()), fontsize=12)
    axes = figure.subplots()
    x, y = np.unique(grid["x"]), np.unique(grid["y"])
    growth = _growth(grid.sort_values(["y", "x"])).reshape(len(y), len(x))
    top = float(np.nanmax(growth, initial=0.0)) or 1.0
    norm = PowerNorm(0.5, 0.0, 1.25 * top)
    colours = colormaps[_GROWTH].with_extremes(bad=_EMPTY)
    shown = np.ma.masked_invalid(growth)
    shades = axes.pcolormesh(x, y, shown, cmap=colours, norm=norm, shading="nearest", rasterized=True)
    figure.colorbar(shades, ax=axes, label="largest Re λ (1/s)", pad=0.02)
    if np.isnan(growth).any():
        figure.legend(handles=[Patch(color=_EMPTY, label="no modes")], loc="outside lower right", frameon=False)
    axes.set_xscale("log" if logs[0] else "linear")
    axes.set_yscale("log" if logs[1] else "linear")
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(y[0], y[-1])
    if len(boundaries):
        unit, per_unit = frequency_unit(boundaries)
        lines, labelled, texts = None, list[tuple[float, float]](), list[str]()
        low, high = float(boundaries["frequency_hz"].min()), float(boundaries["frequency_hz"].max())
        for number, rows in boundaries.groupby("curve"):
            points = rows[["x", "y"]].to_numpy(float)
            parts = np.stack([points[:-1], points[1:]], axis=1)
            lines = LineCollection(list(parts), cmap=_LINES, linewidths=2.2)
            hz = rows["frequency_hz"].to_numpy(float)
            lines.set_array((hz[:-1] + hz[1:]) / (2 * per_unit))
            lines.set_clim(low / per_unit, (high if high > low else low + per_unit) / per_unit)
            axes.add_collection(lines)
            if int(str(number)) <= _LABELLED:
                middle = _alone(axes, points, others=boundaries.loc[boundaries["curve"] != number, ["x", "y"]])
                labelled.append((float(points[middle, 0]), float(points[middle, 1])))
                texts.append(frequency_text(float(hz[middle])))
        assert lines is not None
        figure.colorbar(lines, ax=axes, label=f"frequency on the boundary ({unit})", pad=0.02)
    axes.set_xlabel(figure_text(short_name(names[0])))
    axes.set_ylabel(figure_text(short_name(names[1])))
    if len(boundaries):
        canvas.draw()
        figure.set_layout_engine("none")
        place_labels(axes, canvas, labelled, texts, boundaries[["x", "y"]].to_numpy(float))
    return save_figure(figure, path)


def _growth(grid: pd.DataFrame) -> NDArray[np.float64]:
    """Return the growth of each row of a grid (m,), 1/s: 0 where no mode is unstable, NaN where there is none.

    What rounding leaves of Re λ of a stable place is none, though it may be above 0.
    """
    worst = grid["worst_re"].to_numpy(float)
    return np.where(np.isnan(worst), np.nan, np.where(grid["unstable"] > 0, np.maximum(worst, 0.0), 0.0))


def _alone(axes: Axes, points: NDArray[np.float64], others: pd.DataFrame) -> int:
    """Return the point of a curve (n, 2) that is farthest from the other curves and from the edges of the axes.

    The label of the curve belongs there. Among points that are about as far it is the one nearest to the middle.
    """
    to_axes = (axes.transData + axes.transAxes.inverted()).transform
    own = to_axes(points)
    room = np.minimum(own, 1.0 - own).min(axis=1)
    if len(others):
        apart = own[:, None] - to_axes(others.to_numpy(float))[None]
        room = np.minimum(room, np.hypot(*apart.transpose(2, 0, 1)).min(axis=1))
    enough = np.flatnonzero(room >= min(_ROOM, float(room.max())))
    return int(enough[np.argmin(np.abs(enough - len(points) // 2))])
