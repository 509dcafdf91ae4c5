"""Figure of the shares of each term in growth rates and energies of the unstable modes."""

from __future__ import annotations

import math
import os
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, PercentFormatter

from fe_squeal.report.branches import (
    figure_text,
    frequency_text,
    numbers,
    parameter_name,
    parameter_symbol,
    title_text,
    value_text,
)
from fe_squeal.report.files import save_figure
from fe_squeal.report.terms import ELASTIC, MASS, TermName, is_kinetic, term_of

MAX_BRANCHES = 12
MAX_TERMS = 10
SMALL = 0.02  # of the sum of the |shares| of a branch: terms below this in every branch are drawn together as OTHER
OTHER = "other"
_OTHER_COLOUR = "0.75"
# Each kind of term has a hue, and its bodies, contacts or springs have shades of it.
_HUES = {"elastic": "YlGnBu", "contact": "PuRd", "spring": "YlOrBr", "friction": "OrRd", "rayleigh": "YlGn",
         "structural_damping": "BuPu", "friction_damping": "PuBu", "falling_friction": "RdPu",
         "stress_stiffening": "YlGn", "convection": "BuPu"}  # fmt: skip
_MORE_HUES = ("BuGn", "Oranges", "Purples", "Greens", "Reds", "Blues")


def plot_contributions(
    contributions: pd.DataFrame, modes: pd.DataFrame, path: str | os.PathLike[str], title: str = ""
) -> Path:
    """Draw the shares in Re λ and in the energies, of each unstable branch at the value where it grows fastest.

    Left: what each term has of Re λ, in 1/s, to the right of zero where it feeds the vibration and to the left where
    it damps it; the diamond is their sum, Re λ itself. Right: the parts of the potential and of the kinetic energy.
    At most twelve branches are drawn, the fastest growing on top; terms below 2 % in each of them are gathered as
    "other".

    Parameters
    ----------
    contributions, modes : DataFrame
        As in `contributions.csv` and `modes.csv`. Without contributions the figure says that no mode is unstable.
    path : path
        Where to write; the suffix chooses the format (png, pdf, svg).

    Returns
    -------
    Path
        The file written.
    """
    return save_figure(contributions_figure(contributions, modes, title), path)


def contributions_figure(contributions: pd.DataFrame, modes: pd.DataFrame, title: str = "") -> Figure:
    """Return the figure that `plot_contributions` writes."""
    found = fastest_growing(contributions, modes)
    shown = found.iloc[:MAX_BRANCHES]
    heads = [textwrap.fill(figure_text(title), 110)] if title else []
    if len(found) > len(shown):
        heads.append(f"the {len(shown)} fastest growing of {len(found)} unstable branches")
    if not len(shown):
        return _empty_figure("\n".join(heads))
    terms = contributions[contributions["term"] != "sum"]
    growth = _table(terms, shown, "re_share")
    energy = _table(terms, shown, "energy_share")
    inertia = energy.columns.isin(terms.loc[is_kinetic(terms), "term"])
    tables = [gather_small(table) for table in (growth, energy.loc[:, ~inertia], energy.loc[:, inertia])]
    colours = _colours(name for main, _ in tables for name in main.columns)

    left_keys = _legend_keys(tables[:1], colours)
    left_keys.append(Line2D([], [], marker="D", ls="", mfc="black", mec="white", ms=7, label="sum: Re λ"))
    right_keys = _legend_keys(tables[1:], colours)
    columns = [_column_count(keys, width) for keys, width in ((left_keys, 4.6), (right_keys, 5.8))]
    rows = max(math.ceil(len(keys) / n) for keys, n in zip((left_keys, right_keys), columns, strict=True))
    bars, legends = 0.5 * len(shown) + 0.3, 0.19 * rows + 0.1
    figure = Figure(figsize=(13, 1.5 + 0.25 * "\n".join(heads).count("\n") + bars + legends), dpi=150,
                    layout=ConstrainedLayoutEngine(w_pad=0.12))  # fmt: skip
    FigureCanvasAgg(figure)
    figure.suptitle("\n".join(heads), fontsize=12)
    grid = figure.add_gridspec(2, 3, width_ratios=(5, 3, 3), height_ratios=(bars, legends))
    panels = [figure.add_subplot(grid[0, i]) for i in range(3)]
    for axes, (main, rest) in zip(panels, tables, strict=True):
        _draw_bars(axes, main, rest, colours)
        axes.set_ylim(len(shown) - 0.4, -0.6)
        axes.set_yticks(range(len(shown)), _branch_labels(contributions, shown) if axes is panels[0] else [])
        axes.tick_params(axis="y", length=0, labelsize=9)
    _finish_growth(panels[0], contributions, shown)
    for axes, text in zip(panels[1:], ("potential", "kinetic"), strict=True):
        axes.set_title(f"{text} energy", fontsize=11, pad=18)
        axes.set_xlabel(f"part of the {text} energy")
        axes.xaxis.set_major_formatter(PercentFormatter(1.0))
        axes.set_xlim(min(axes.get_xlim()[0], 0.0), max(axes.get_xlim()[1] / 1.05, 1.0))
    for cell, keys, n in ((grid[1, 0], left_keys, columns[0]), (grid[1, 1:], right_keys, columns[1])):
        _draw_legend(figure.add_subplot(cell), keys, n)
    return figure


def fastest_growing(contributions: pd.DataFrame, modes: pd.DataFrame) -> pd.DataFrame:
    """Return for each unstable branch its row of `modes` where it grows fastest, the fastest growing first.

    Examples
    --------
    >>> modes = pd.DataFrame({"value": [0.1, 0.2], "mode": 1, "branch": 4, "re": [3.0, 5.0], "frequency_hz": 900.0})
    >>> shares = pd.DataFrame({"value": [0.1, 0.2], "mode": 1, "term": "sum", "re_share": [3.0, 5.0]})
    >>> fastest_growing(shares, modes)[["value", "branch", "re"]].to_numpy().tolist()
    [[0.2, 4.0, 5.0]]
    """
    unstable = contributions[["value", "mode"]].drop_duplicates()
    rows = modes.merge(unstable, on=["value", "mode"]).sort_values("re", ascending=False, kind="stable")
    # A mode without a branch number is a branch of its own.
    return rows[~rows.duplicated("branch") | rows["branch"].isna()].reset_index(drop=True)


def gather_small(table: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Split the columns of shares into those with a colour of their own and the small ones; zero columns are dropped.

    Examples
    --------
    >>> main, rest = gather_small(pd.DataFrame({"a": [9.0], "b": [0.1], "c": [0.0], "d": [-0.05]}))
    >>> list(main), list(rest)
    (['a'], ['b', 'd'])
    """
    size = table.abs()
    weight = size.div(size.sum(axis=1).replace(0.0, 1.0), axis=0).max()
    order = weight[weight > 0].sort_values(ascending=False, kind="stable")
    count = min(int((order >= SMALL).sum()), MAX_TERMS)
    if len(order) - count == 1 and count < MAX_TERMS:
        count += 1  # a single small term is shown with its own name
    kept = [name for name in table.columns if name in order.index[:count]]
    return table[kept], table[[name for name in table.columns if name in order.index[count:]]]


def _table(terms: pd.DataFrame, shown: pd.DataFrame, column: str) -> pd.DataFrame:
    """Return a table with a row for each row of `shown` and a column for each term, ordered by the kind of term."""
    names = [str(name) for name in terms.loc[terms[column].notna(), "term"].unique()]
    kinds = list(dict.fromkeys(term_of(name).kind for name in names))
    names = sorted(names, key=lambda name: kinds.index(term_of(name).kind))
    wide = terms.pivot_table(index=["value", "mode"], columns="term", values=column, aggfunc="sum")
    keys = pd.MultiIndex.from_frame(shown[["value", "mode"]])
    return wide.reindex(index=keys, columns=names).fillna(0.0)


def _draw_bars(axes: Axes, main: pd.DataFrame, rest: pd.DataFrame, colours: Mapping[str, Any]) -> None:
    """Stack the shares of each row away from zero, positive ones to the right, negative ones to the left."""
    bars = [(name, main[name].to_numpy(float), colours[_colour_key(name)]) for name in main.columns]
    bars += [(OTHER, rest.clip(lower=0.0).sum(axis=1).to_numpy(float), _OTHER_COLOUR),
             (OTHER, rest.clip(upper=0.0).sum(axis=1).to_numpy(float), _OTHER_COLOUR)]
    right, left = np.zeros(len(main)), np.zeros(len(main))
    for name, share, colour in bars:
        if share.any():
            axes.barh(range(len(main)), share, left=np.where(share < 0, left, right), height=0.66, color=colour,
                      edgecolor="white", linewidth=0.4, label=name)
        right, left = right + share.clip(min=0.0), left + share.clip(max=0.0)
    axes.axvline(0.0, color="0.3", lw=0.9)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.grid(True, axis="x", color="0.92", lw=0.6)
    axes.set_axisbelow(True)


def _finish_growth(axes: Axes, contributions: pd.DataFrame, shown: pd.DataFrame) -> None:
    sums = _table(contributions[contributions["term"] == "sum"], shown, "re_share")
    if len(sums.columns):
        axes.plot(sums["sum"], range(len(shown)), "D", mfc="black", mec="white", ms=7, zorder=5, clip_on=False)
    axes.set_title("growth rate Re λ, by term", fontsize=11, pad=18)
    axes.set_xlabel("share in Re λ (1/s)")
    for text, side, shift in (("← damps", "right", -6), ("feeds →", "left", 6)):
        axes.annotate(text, (0.0, 1.0), xytext=(shift, 4), xycoords=axes.get_xaxis_transform(), ha=side, va="bottom",
                      textcoords="offset points", fontsize=9, color="0.35")


def _branch_labels(contributions: pd.DataFrame, shown: pd.DataFrame) -> list[str]:
    symbol = figure_text(parameter_symbol(parameter_name(contributions)))
    columns = (numbers(shown, name) for name in ("branch", "mode", "frequency_hz", "value", "re"))
    return [
        (f"mode {mode:.0f}" if np.isnan(branch) else f"branch {branch:.0f}")
        + f", {frequency_text(frequency)}\n{symbol} = {value_text(value)}: Re λ = {re:+.4g} 1/s"
        for branch, mode, frequency, value, re in zip(*columns, strict=True)
    ]


def _colours(names: Iterable[str]) -> dict[str, Any]:
    """Return a colour for each term; the mass and the elasticity of a body have the same."""
    keys = dict.fromkeys(_colour_key(name) for name in names)
    more = iter(_MORE_HUES * len(keys))
    colours: dict[str, Any] = {}
    for kind in dict.fromkeys(term_of(key).kind for key in keys):
        members = [key for key in keys if term_of(key).kind == kind]
        hue = _HUES.get(kind) or next(more)
        # The ends of the colour maps are nearly black and nearly white, and are not used.
        colours |= dict(zip(members, colormaps[hue](np.linspace(0.8, 0.3, len(members))), strict=True))
    return colours


def _colour_key(term: str) -> str:
    name = term_of(term)
    return str(TermName(ELASTIC, name.part)) if name.kind == MASS else term


def _legend_keys(tables: list[tuple[pd.DataFrame, pd.DataFrame]], colours: Mapping[str, Any]) -> list[Any]:
    names = dict.fromkeys(str(name) for main, _ in tables for name in main.columns)
    labels: dict[str, str] = {}
    for name in names:
        # A body has one entry for both energies, such as elastic/mass.disc.
        key = _colour_key(name)
        labels[key] = f"elastic/{name}" if key in names and key != name else name
        if len(labels[key]) > 56:
            labels[key] = f"{labels[key][:30]}…{labels[key][-25:]}"
    keys: list[Any] = [Patch(color=colours[key], label=figure_text(label)) for key, label in labels.items()]
    if any(len(rest.columns) for _, rest in tables):
        keys.append(Patch(color=_OTHER_COLOUR, label=OTHER))
    return keys


def _column_count(keys: list[Any], inches: float) -> int:
    # A letter of 9 pt is about 0.07 in wide; the patch with the gaps beside it 0.5 in.
    longest = 0.07 * max(len(key.get_label()) for key in keys) + 0.5
    return int(np.clip(inches // longest, 1, 4))


def _draw_legend(axes: Axes, keys: list[Any], columns: int) -> None:
    axes.set_axis_off()
    legend = axes.legend(handles=keys, ncols=columns, loc="upper left", borderaxespad=0.0, fontsize=9, frameon=False,
                         handlelength=1.4, columnspacing=1.4)
    legend.set_in_layout(False)  # the legend has a row of the grid to itself; a wide one must not make panels narrower


def _empty_figure(title: str) -> Figure:
    figure = Figure(figsize=(9, 3), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title_text(title, figure.get_figwidth()), fontsize=12)
    figure.text(0.5, 0.5, "no unstable mode", ha="center", va="center", fontsize=12, color="0.25")
    return figure
