"""Figure of where the error of the mesh comes from: by body and direction, of the quantities it is largest in."""

from __future__ import annotations

import os
import textwrap
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from fe_squeal.report.branches import figure_text
from fe_squeal.report.files import save_figure

MAX_QUANTITIES = 4
MAX_ROWS = 16
_COLOURS = ("#1b4965", "#d1495b", "#edae49", "#66a182")
_WHOLE = "all"


def plot_mesh_error(parts: pd.DataFrame, path: str | os.PathLike[str], title: str = "") -> Path:
    """Draw what each body and direction adds to the change by refinement, relative, of up to four quantities.

    Those shown are the worst of each kind (onsets, growth, frequencies), then the next worst of any.

    Parameters
    ----------
    parts : DataFrame
        As in `mesh_error.csv`.
    path : path
        Where to write; the suffix chooses the format (png, pdf, svg).

    Returns
    -------
    Path
        The file written.
    """
    return save_figure(mesh_error_figure(parts, title), path)


def worst_quantities(parts: pd.DataFrame, count: int = MAX_QUANTITIES) -> list[str]:
    """Return the names of the quantities that refinement changes most, of each kind one first."""
    known = parts.drop_duplicates("quantity").assign(size=lambda t: (t["change"] / t["scale"]).abs())
    known = known.sort_values("size", ascending=False, kind="stable")
    first = known.drop_duplicates("kind")["quantity"].tolist()
    names = first + [q for q in known["quantity"] if q not in first]
    shown = set(names[:count])
    return [q for q in known["quantity"] if q in shown]


def mesh_error_figure(parts: pd.DataFrame, title: str = "") -> Figure:
    """Return the figure that `plot_mesh_error` writes."""
    shown = worst_quantities(parts)
    table = parts[parts["quantity"].isin(shown)].assign(
        relative=lambda t: 100 * t["part"] / t["scale"],
        where=lambda t: np.where(t["direction"] == _WHOLE, t["body"], t["body"] + ", " + t["direction"]),
    )
    rows = table.pivot_table(index="where", columns="quantity", values="relative", sort=False)[shown]
    largest = rows.abs().max(axis=1).sort_values(ascending=False, kind="stable").index[:MAX_ROWS]
    rows = rows.loc[[where for where in rows.index if where in largest]]
    figure = Figure(figsize=(9.0, 1.9 + 0.42 * len(rows) + 0.3 * len(shown)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    height = 0.8 / max(len(shown), 1)
    at = np.arange(len(rows))
    for i, quantity in enumerate(shown):
        own = table[table["quantity"] == quantity].iloc[0]
        label = f"{quantity}: {100 * own['change'] / own['scale']:+.2g} % in all"
        axes.barh(at + (i - (len(shown) - 1) / 2) * height, rows[quantity], height, label=figure_text(label),
                  color=_COLOURS[i])  # fmt: skip
    axes.axvline(0, color="0.3", linewidth=0.8)
    axes.set_yticks(at, [textwrap.fill(figure_text(str(where)), 30) for where in rows.index])
    axes.invert_yaxis()
    axes.grid(axis="x", color="0.9")
    axes.set_axisbelow(True)
    axes.set_xlabel("part of the change when every element is cut into eight, %")
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    heads = [textwrap.fill(figure_text(title), 90)] if title else []
    axes.set_title("\n".join([*heads, "Where the error of the mesh comes from"]), loc="left", fontsize=11)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower left", fontsize=9, frameon=False)
    return figure
