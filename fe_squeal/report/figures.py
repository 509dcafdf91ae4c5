"""Figures of a sweep: frequency and growth rate over the parameter, and the root locus."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from fe_squeal.process.signals import signals_deferred
from fe_squeal.report.axes import branch_styles, frequency_unit, growth_limits, parameter_label, set_parameter_axis
from fe_squeal.report.branches import (
    Branch,
    Floats,
    collect_branches,
    covered_text,
    distinct_texts,
    figure_text,
    frequency_text,
    numbers,
    parameter_name,
    parameter_symbol,
    title_text,
)
from fe_squeal.report.curves import draw_growth, draw_stretches, padded
from fe_squeal.report.files import save_figure
from fe_squeal.report.growth import segments
from fe_squeal.report.labels import place_labels
from fe_squeal.report.looks import body_text, short_diameters
from fe_squeal.report.notebook import NotebookFigure
from fe_squeal.report.onsets import mesh_states, partings, refined_only, vanishing

MAX_LABELLED_ONSETS = 12
MAX_LEGEND_ENTRIES = 26
MAX_MEASURED = 8  # measured frequencies with an entry in the legend, at most
MAX_DESCRIBED = 12  # if there are more branches in the legend, the line on what each looks like is left out
# Onsets of flutter into and out of instability, and of divergence, have different markers.
_MARKERS = {("flutter", "into"): ("o", "black"), ("flutter", "out of"): ("o", "white"),
            ("divergence", "into"): ("s", "black"), ("divergence", "out of"): ("s", "white")}


def plot_stability(
    modes: pd.DataFrame, onsets: pd.DataFrame, path: str | os.PathLike[str], title: str = "",
    covered: tuple[float, float | None] | None = None, measured: Sequence[tuple[float, str]] = (),
) -> Path:  # fmt: skip
    """Draw the frequencies (top) and growth rates (bottom) of all branches over the sweep parameter.

    Stable stretches are thin and grey, unstable ones thick and coloured, each branch with its own entry in the
    legend. Onsets carry a marker and, where there are at most twelve, their value and frequency. Below, each
    growing branch is solid, its decaying mirror thin; the band is the uncertainty of Re λ, where it is wide enough
    to be seen. Modes that decay faster than they swing have no frequencies to be drawn.

    Parameters
    ----------
    modes, onsets : DataFrame
        As in `modes.csv` and `onsets.csv`; `onsets` may be empty.
    path : path
        Where to write; the suffix chooses the format (png, pdf, svg).
    covered : (float, float or None), optional
        The range of frequencies, Hz, in which all modes are known, without an end where that is all of them; lines are
        drawn where it begins above 0, and where it ends.
    measured : sequence of (frequency in Hz, label)
        Measured squeal: dotted lines.

    Returns
    -------
    Path
        The file written.
    """
    return save_figure(stability_figure(modes, onsets, title, covered, measured), path)


@signals_deferred()  # it is laid out here, by which text is measured
def stability_figure(
    modes: pd.DataFrame, onsets: pd.DataFrame, title: str = "", covered: tuple[float, float | None] | None = None,
    measured: Sequence[tuple[float, str]] = (),
) -> Figure:  # fmt: skip
    """Return the figure that `plot_stability` writes."""
    branches = collect_branches(modes, onsets)
    growing = sorted((branch for branch in branches if branch.grows), key=lambda b: -b.frequency_hz[b.peak])
    styles = {branch.number: style for branch, style in zip(growing, branch_styles(len(growing)), strict=True)}
    unit, per_unit = frequency_unit(modes)

    layout = ConstrainedLayoutEngine()
    figure = NotebookFigure(figsize=(10, 8), dpi=150, layout=layout)
    canvas = FigureCanvasAgg(figure)
    top, bottom = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": [3, 2]})
    figure.suptitle(title_text(title, figure.get_figwidth()))

    for branch in branches:
        shown = np.where(branch.swings, branch.frequency_hz / per_unit, np.nan)
        draw_stretches(top, branch, shown, styles.get(branch.number))
    draw_growth(bottom, branches, growing, styles, onsets)
    markers = _mark_onsets(top, onsets, numbers(onsets, "value"), numbers(onsets, "frequency_hz") / per_unit)

    top.set_ylabel(f"frequency ({unit})")
    bottom.set_ylabel("growth rate Re λ (1/s)")
    bottom.set_xlabel(parameter_label(parameter_name(modes)))
    set_parameter_axis(bottom, numbers(modes, "value"))
    top.set_ylim(*_frequency_limits(modes, onsets, per_unit))
    markers += _mark_range(top, covered, per_unit)
    markers += _mark_measured(top, measured, per_unit)
    for axes in (top, bottom):
        axes.grid(True, color="0.92", lw=0.6)
        axes.set_axisbelow(True)
    _draw_legend(top, growing, styles, markers, modes)

    figure.align_ylabels([top, bottom])
    layout.execute(figure)  # now, since the places of the labels are found in pixels
    figure.set_layout_engine("none")
    if 0 < len(onsets) <= MAX_LABELLED_ONSETS:
        _label_onsets(top, canvas, branches, onsets, parameter_name(modes), per_unit)
    return figure


def plot_root_locus(
    modes: pd.DataFrame, onsets: pd.DataFrame, path: str | os.PathLike[str], title: str = "",
    covered: tuple[float, float | None] | None = None, measured: Sequence[tuple[float, str]] = (),
) -> Path:  # fmt: skip
    """Draw the eigenvalues in the λ plane, Re λ in 1/s against Im λ/2π, coloured by the sweep parameter.

    The unstable half plane is shaded, onsets are marked, but not where modes that grow already meet or part. Real
    eigenvalues far outside of the range of the others, and a few that decay much faster than these, are not shown but
    counted in a note: they would squeeze the others together.

    Parameters
    ----------
    modes, onsets : DataFrame
        As in `modes.csv` and `onsets.csv`; `onsets` may be empty.
    path : path
        Where to write; the suffix chooses the format.
    title, covered, measured
        As for `plot_stability`.
    """
    unit, per_unit = frequency_unit(modes)
    value, re, frequency = numbers(modes, "value"), numbers(modes, "re"), numbers(modes, "frequency_hz")
    figure = Figure(figsize=(9, 7), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    figure.suptitle(title_text(title, figure.get_figwidth()))

    limits, notes = growth_limits(modes)
    for branch in collect_branches(modes, onsets):
        ends = np.column_stack([branch.re, branch.frequency_hz / per_unit])
        axes.add_collection(LineCollection(list(segments(ends)[branch.joined]), colors="0.8", linewidths=0.7, zorder=1))
    points = axes.scatter(re, frequency / per_unit, c=value, s=14, cmap="viridis", zorder=3, linewidths=0)
    if len(np.unique(value)) > 1:
        figure.colorbar(points, ax=axes, label=parameter_label(parameter_name(modes)), pad=0.02)
    elif len(value):
        notes.append(f"{figure_text(parameter_symbol(parameter_name(modes)))} = {value[0]:.6g}")
    still = onsets[~partings(onsets)]  # Re λ is 0 at these
    markers = _mark_onsets(axes, still, np.zeros(len(still)), numbers(still, "frequency_hz") / per_unit, 3.5)

    axes.set_xlim(*limits)
    axes.set_ylim(*_frequency_limits(modes, onsets, per_unit))
    markers += _mark_range(axes, covered, per_unit)
    markers += _mark_measured(axes, measured, per_unit)
    axes.axvspan(0.0, max(limits[1], 0.0), color="tab:red", alpha=0.06, lw=0, zorder=0)
    axes.axvline(0.0, color="0.3", lw=0.9, zorder=2)
    axes.text(0.99, 0.01, "unstable", transform=axes.transAxes, ha="right", va="bottom", color="tab:red", fontsize=9)
    if notes:
        axes.set_title("\n".join(notes), fontsize=9, color="0.35", loc="left")
    axes.set_xlabel("growth rate Re λ (1/s)")
    axes.set_ylabel(f"Im λ / 2π ({unit})")
    axes.grid(True, color="0.92", lw=0.6)
    axes.set_axisbelow(True)
    if markers:
        axes.legend(handles=markers, loc="best", fontsize=8, framealpha=0.9)
    return save_figure(figure, path)


def _frequency_limits(modes: pd.DataFrame, onsets: pd.DataFrame, per_unit: float) -> tuple[float, float]:
    """Return the range of frequencies to be drawn; an onset of the refined mesh alone may lie outside that of modes."""
    hz = np.concatenate([numbers(modes, "frequency_hz"), numbers(onsets, "frequency_hz")])
    return padded(hz / per_unit, floor=0.0)


def _mark_range(axes: Axes, covered: tuple[float, float | None] | None, per_unit: float) -> list[Line2D]:
    """Draw lines at the ends of the range, Hz, in which all modes are known; return its entry for the legend.

    Outside of it modes were not solved for.
    """
    covered = covered or (0.0, None)
    ends = [end / per_unit for end in covered if end]
    if not ends:
        return []
    low, high = axes.get_ylim()
    axes.set_ylim(low, max(high, 1.03 * max(ends)))
    look: dict[str, Any] = {"color": "0.45", "lw": 0.8, "ls": (0, (6, 3))}
    for end in ends:
        axes.axhline(end, zorder=1, **look)
    return [Line2D([], [], label=f"all modes {covered_text(covered)}", **look)]


def _mark_measured(axes: Axes, measured: Sequence[tuple[float, str]], per_unit: float) -> list[Line2D]:
    """Draw measured frequencies as dotted lines; return entries for the legend, since labels on lines hide others."""
    handles = []
    for i, (hz, label) in enumerate(sorted(measured, reverse=True)):
        low, high = axes.get_ylim()
        axes.set_ylim(low, max(high, 1.05 * hz / per_unit))
        style: dict[str, Any] = {"color": "tab:red", "lw": 1.4, "ls": ":"}
        axes.axhline(hz / per_unit, zorder=5, **style)
        if i < MAX_MEASURED:
            text = f"measured: {figure_text(label)}{', ' if label else ''}{frequency_text(hz)}"
            handles.append(Line2D([], [], label=text, **style))
    if len(measured) > MAX_MEASURED:
        handles.append(Line2D([], [], lw=0, label=f"and {len(measured) - MAX_MEASURED} more measured"))
    return handles


def _mark_onsets(axes: Axes, onsets: pd.DataFrame, x: Floats, y: Floats, size: float = 6.0) -> list[Line2D]:
    """Draw the onsets, and return an entry for the legend for each kind that occurs.

    Where modes that grow already meet or part there is a triangle. Onsets of the refined mesh alone, which are not the
    sweep's own, are grey diamonds, and those that vanish there are crossed.
    """
    handles = []
    alone, gone, parting = refined_only(onsets), vanishing(onsets), partings(onsets)
    kinds = onsets["kind"] if "kind" in onsets else pd.Series("flutter", index=onsets.index)
    directions = onsets["direction"] if "direction" in onsets else pd.Series("into", index=onsets.index)
    for (kind, direction), (marker, face) in _MARKERS.items():
        rows = np.asarray((kinds == kind) & (directions == direction) & ~alone & ~parting, dtype=bool)
        if rows.any():
            handles += axes.plot(x[rows], y[rows], marker, mfc=face, mec="black", ms=size, zorder=8, clip_on=False,
                                 label=f"{kind}: {direction} instability")
    if (rows := parting & ~alone).any():
        handles += axes.plot(x[rows], y[rows], "v", mfc="white", mec="black", ms=size, zorder=8, clip_on=False,
                             label="growing modes meet or part")
    grey: dict[str, Any] = {"mfc": "none", "mec": "0.45", "zorder": 9, "clip_on": False}
    for rows, marker, times, label in ((alone, "D", 1.0, "on the refined mesh alone"),
                                       (gone, "x", 2.0, "vanishes on the refined mesh")):  # fmt: skip
        if rows.any():
            handles += axes.plot(x[rows], y[rows], marker, ms=times * size, mew=1.4, label=label, **grey)
    return handles


def _label_onsets(
    axes: Axes, canvas: FigureCanvasAgg, branches: list[Branch], onsets: pd.DataFrame, name: str, per_unit: float
) -> None:
    symbol = figure_text(parameter_symbol(name))
    points, texts = [], []
    values = numbers(onsets, "value")
    told = distinct_texts(values, "f" if symbol == "μ" else "g")
    hz, states = numbers(onsets, "frequency_hz"), mesh_states(onsets)
    for value, number, frequency, state in zip(values, told, hz, states, strict=True):
        if np.isfinite(value) and np.isfinite(frequency):
            points.append((value, frequency / per_unit))
            texts.append(f"{symbol} = {number}, {frequency_text(frequency)}{', ' if state else ''}{state}")
    samples = [np.empty((0, 2))]
    for branch in branches:
        if len(branch.value):
            fine = np.linspace(branch.value[0], branch.value[-1], 60)
            samples.append(np.column_stack([fine, np.interp(fine, branch.value, branch.frequency_hz / per_unit)]))
    place_labels(axes, canvas, points, texts, np.concatenate(samples))


def _draw_legend(
    axes: Axes, growing: list[Branch], styles: dict[int, dict[str, Any]], markers: Sequence[Line2D], modes: pd.DataFrame
) -> None:
    handles = list(markers)
    for branch in growing[:MAX_LEGEND_ENTRIES]:
        text = f"branch {branch.number}, {frequency_text(branch.frequency_hz[branch.peak])}"
        looks = _looks(modes, branch) if len(growing) <= MAX_DESCRIBED else ""
        text += f"\n{looks}" if looks else ""
        handles.append(Line2D([], [], lw=2.4, label=text, **styles[branch.number]))
    if len(growing) > MAX_LEGEND_ENTRIES:
        handles.append(Line2D([], [], lw=0, label=f"and {len(growing) - MAX_LEGEND_ENTRIES} more branches"))
    if growing:
        handles.append(Line2D([], [], color="0.6", lw=0.7, label="marginal or stable"))
    if handles:
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=8, frameon=False)


def _looks(modes: pd.DataFrame, branch: Branch) -> str:
    """Return, in words, what a branch looks like where it grows fastest; "" if that is not known."""
    rows = modes[(numbers(modes, "branch") == branch.number) & (numbers(modes, "value") == branch.value[branch.peak])]
    if not len(rows):
        return ""
    row = rows.iloc[0].to_dict()
    count = short_diameters(row)
    around = "" if count == "–" else "1 nodal diameter" if count == "1" else f"{count} nodal diameters"
    return figure_text(", ".join(text for text in (around, body_text(row)) if text))
