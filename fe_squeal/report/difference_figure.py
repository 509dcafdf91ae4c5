"""Figure of two or more designs side by side."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from fe_squeal.report.branches import figure_text, frequency_text, title_text
from fe_squeal.report.differences import GONE, NEW
from fe_squeal.report.files import save_figure

_MOST = 30  # modes in one figure, at most
_BEFORE, _AFTER = "0.45", "tab:red"


def plot_differences(table: pd.DataFrame, path: str | os.PathLike[str], symbol: str, title: str = "") -> Path:
    """Draw onset and largest growth of each mode before and after, with error bars; modes gone or new are marked.

    A question mark stands beside a number whose error is not known.
    """
    shown = table.iloc[:_MOST]
    figure = Figure(figsize=(12, 1.8 + 0.42 * max(len(shown), 1)), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    heads = [title] if title else []
    if len(table) > len(shown):
        heads.append(f"the first {len(shown)} of {len(table)} modes")
    figure.suptitle(title_text(" – ".join(heads), figure.get_figwidth()), fontsize=12)
    if not len(shown):
        figure.text(0.5, 0.5, "no mode is unstable in any of them", ha="center", va="center", color="0.3")
        return save_figure(figure, path)
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, name, label in ((left, "onset", f"{figure_text(symbol)} at onset"), (right, "re", "largest Re λ (1/s)")):
        _draw(axes, shown, name)
        axes.set_xlabel(label)
        axes.grid(True, color="0.92", lw=0.6)
        axes.set_axisbelow(True)
    right.axvline(0.0, color="0.3", lw=0.9)
    several = shown["b"].nunique() > 1
    labels = [_label(row, several) for row in shown.to_dict("records")]
    left.set_yticks(range(len(shown)), labels, fontsize=9)
    left.set_ylim(len(shown) - 0.5, -0.5)
    handles = [left.plot([], [], "o", mfc="none", mec=_BEFORE, mew=1.4, ms=11, label="before")[0],
               left.plot([], [], "o", color=_AFTER, label="after")[0]]  # fmt: skip
    if np.isinf(shown[["onset_bar", "re_bar"]].to_numpy(float)).any():
        handles += left.plot([], [], ls="", marker="$?$", color=_AFTER, label="error not known")
    figure.legend(handles=handles, loc="outside lower right", ncols=len(handles), frameon=False, fontsize=9)
    return save_figure(figure, path)


def _label(row: dict[object, object], several: bool) -> str:
    hz = row["frequency_a_hz"] if row["state"] == GONE else row["frequency_b_hz"]
    text = frequency_text(float(str(hz)))
    tail = str(row["state"]) if row["state"] in (GONE, NEW) else f"MAC {float(str(row['mac'])):.2f}"
    return figure_text(f"{row['b']}: {text}, {tail}" if several else f"{text}, {tail}")


def _draw(axes: Axes, table: pd.DataFrame, name: str) -> None:
    before, after = table[f"{name}_a"].to_numpy(float), table[f"{name}_b"].to_numpy(float)
    bar, y = table[f"{name}_bar"].to_numpy(float), np.arange(len(table))
    both = np.isfinite(before) & np.isfinite(after)
    axes.hlines(y[both], before[both], after[both], color="0.7", lw=1.2, zorder=1)
    axes.plot(before, y, "o", mfc="none", mec=_BEFORE, mew=1.4, ms=11, zorder=3)  # visible around an equal one after
    known = np.where(np.isfinite(bar), bar, 0.0)
    axes.errorbar(after, y, xerr=known, fmt="o", color=_AFTER, ms=6, capsize=3, lw=1.0, zorder=2)
    for i in np.flatnonzero(np.isinf(bar)):
        at = after[i] if np.isfinite(after[i]) else before[i]
        axes.annotate("?", (at, y[i]), (0, 6), textcoords="offset points", ha="center", color=_AFTER)
