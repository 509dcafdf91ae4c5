"""The modal assurance criterion (MAC) of measured and computed shapes, and its figure."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from fe_squeal.report.branches import figure_text, frequency_text
from fe_squeal.report.files import save_figure
from fe_squeal.report.shapes import Complexes, Floats, Integers

_MOST = 40  # modes in one figure, at most
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

    Parameters
    ----------
    table : DataFrame
        As in mac.csv: `measured`, `value`, `branch`, `frequency_hz`, `mac`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # commands that draw nothing ask for the numbers above
    from matplotlib.figure import Figure

    shown = table[table["value"] == table["value"].max()] if len(table) else table
    wide = shown.pivot_table(index="measured", columns="branch", values="mac", sort=False)
    order = shown.groupby("branch")["frequency_hz"].first().sort_values()
    branches: Sequence[int] = [int(b) for b in order.index if b in wide.columns][:_MOST]
    wide = wide[list(branches)]
    labels = [_shortened(str(name)) for name in wide.index]
    size = (max(5.0, 1.6 + 0.45 * len(branches)) + 0.1 * max(map(len, labels), default=0), 2.2 + 0.5 * len(wide))
    figure = Figure(figsize=size, dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    figure.suptitle(figure_text(title), fontsize=11)
    image = axes.imshow(wide.to_numpy(float), vmin=0.0, vmax=1.0, cmap="Blues", aspect="auto")
    names = [f"{b}: {frequency_text(order[b])}" for b in branches]
    axes.set_xticks(range(len(branches)), names, rotation=90, fontsize=8)
    axes.set_yticks(range(len(wide)), [figure_text(name) for name in labels], fontsize=9)
    for (i, j), value in np.ndenumerate(wide.to_numpy(float)):
        if np.isfinite(value) and value >= 0.05:
            colour = "white" if value > 0.6 else "black"
            axes.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=7, color=colour)
    axes.set_xlabel("branch: frequency")
    figure.colorbar(image, ax=axes, label="MAC", shrink=0.9)
    return save_figure(figure, path)


def _shortened(name: str) -> str:
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"
