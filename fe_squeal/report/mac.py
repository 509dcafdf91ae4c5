"""The modal assurance criterion (MAC) of measured and computed shapes, and its figure."""

from __future__ import annotations

import os
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from fe_squeal.report.branches import figure_text, frequency_text, parameter_name, parameter_symbol, value_text
from fe_squeal.report.files import save_figure
from fe_squeal.report.shapes import Complexes, Floats, Integers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 40  # modes in one figure, at most
_UNKNOWN = "0.85"  # colour of what has no MAC
_LONGEST = 40  # letters of the name of a measured shape, at most


def mac(a: Complexes, b: Complexes) -> float:
    """Return |aᴴb|² / (aᴴa bᴴb) of two vectors (n,): 1 if they differ by a complex factor only, 0 if orthogonal.

    Entries that are NaN in one of the vectors are left out; the result is NaN if no entry is left. Source: R. J.
    Allemang, D. L. Brown, "A correlation coefficient for modal vector analysis", IMAC 1982.

    Examples
    --------
    >>> mac(np.array([1.0, 2.0]), np.array([-2j, -4j])), mac(np.array([1.0, 1.0]), np.array([1.0, -1.0]))
    (1.0, 0.0)
    """
    a, b = np.ravel(a).astype(complex), np.ravel(b).astype(complex)
    both = np.isfinite(a) & np.isfinite(b)
    a, b = a[both], b[both]
    a, b = _scaled(a), _scaled(b)
    size = np.vdot(a, a).real * np.vdot(b, b).real
    return float(abs(np.vdot(a, b)) ** 2 / size) if size > 0 else float("nan")


def _scaled(a: Complexes) -> Complexes:
    """Return a vector (n,) times a power of two, by which its largest part lies between 1/2 and 1, unless it is 0.

    The square of a measured number may be too large or too small for a float.
    """
    parts = a.view(float)
    exponent = np.frexp(np.max(np.abs(parts), initial=0.0))[1]
    return np.ldexp(parts, -exponent).view(complex)


def nearest_nodes(points: Floats, nodes: Floats, distance: float) -> tuple[Integers, Integers]:
    """Return the positions (k,) of the points that have a node within a distance, and the nearest node (k,) of each.

    Parameters
    ----------
    points, nodes : (p, 3) and (n, 3) float, m
    distance : float, m

    Examples
    --------
    >>> nearest_nodes(np.array([[0.0, 0.0, 0.1], [5.0, 0.0, 0.0]]), np.eye(3)[:2] * 0.0, 0.2)[0].tolist()
    [0]
    """
    from scipy.spatial import cKDTree

    found, node = cKDTree(nodes).query(points, distance_upper_bound=distance)
    near = np.flatnonzero(np.isfinite(found))
    return near, np.asarray(node)[near]


def plot_mac(table: pd.DataFrame, path: str | os.PathLike[str], title: str = "") -> Path:
    """Draw the matrix of MAC values: a row for each measured shape, a column for each mode at the last value.

    Of more than 40 modes those with the largest MAC to any measured shape are drawn, and the title counts them. A shape
    without a MAC has a grey row.

    Parameters
    ----------
    table : DataFrame
        As in mac.csv: `measured`, `parameter`, `value`, `branch`, `frequency_hz`, `mac`.
    path : path
        Where to write; the suffix chooses the format (png, pdf, svg).

    Returns
    -------
    Path
        The file written.
    """
    return save_figure(mac_figure(table, title), path)


def mac_figure(table: pd.DataFrame, title: str = "") -> Figure:
    """Return the figure that `plot_mac` writes."""
    from matplotlib import colormaps  # commands that draw nothing ask for the numbers above
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = table[table["value"] == table["value"].max()] if len(table) else table
    wide = shown.pivot_table(index="measured", columns="branch", values="mac", sort=False, dropna=False)
    order = shown.groupby("branch")["frequency_hz"].first().sort_values()
    kept = wide.max().sort_values(ascending=False, kind="stable").index[:_MOST]
    branches = [int(b) for b in order.index if b in kept]
    wide = wide[branches]
    labels = [_shortened(str(name)) for name in wide.index]
    size = (max(5.0, 1.6 + 0.45 * len(branches)) + 0.1 * max(map(len, labels), default=0), 2.4 + 0.5 * len(wide))
    figure = Figure(figsize=size, dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    heads = [textwrap.fill(figure_text(title), int(11 * size[0]))] if title else []
    figure.suptitle("\n".join([*heads, _which(shown, len(branches))]), fontsize=11)
    image = axes.imshow(wide.to_numpy(float), vmin=0.0, vmax=1.0, cmap=colormaps["Blues"].with_extremes(bad=_UNKNOWN),
                        aspect="auto")  # fmt: skip
    names = [f"{b}: {frequency_text(order[b])}" for b in branches]
    axes.set_xticks(range(len(branches)), names, rotation=90, fontsize=8)
    axes.set_yticks(range(len(wide)), [figure_text(name) for name in labels], fontsize=9)
    for i in np.flatnonzero(wide.isna().all(axis=1)).tolist():
        axes.text((len(branches) - 1) / 2, i, "no MAC", ha="center", va="center", fontsize=8)
    for (i, j), value in np.ndenumerate(wide.to_numpy(float)):
        if np.isfinite(value) and value >= 0.05:
            colour = "white" if value > 0.6 else "black"
            axes.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=7, color=colour)
    axes.set_xlabel("branch: frequency")
    figure.colorbar(image, ax=axes, label="MAC", shrink=0.9)
    return figure


def _which(shown: pd.DataFrame, drawn: int) -> str:
    """Return which modes are drawn, of those in the rows that are shown, and at which value of the parameter."""
    count = shown["branch"].nunique()
    all_of_them = "1 mode" if count == 1 else f"{count} modes"
    which = all_of_them if drawn == count else f"the {drawn} of {all_of_them} with the largest MAC"
    symbol = figure_text(parameter_symbol(parameter_name(shown))) if "parameter" in shown else "parameter"
    return f"{which} at {symbol} = {value_text(float(shown['value'].max()))}" if len(shown) else which


def _shortened(name: str) -> str:
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"
