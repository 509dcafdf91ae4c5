"""Draw the curves of branches: stable and unstable stretches, growth rates, and limits of axes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from fe_squeal.report.branches import Branch, Floats, find_mirror
from fe_squeal.report.growth import growth_curves, segments

_DEPTH = 1.5  # times the largest growth rate: the axis of growth rates goes so far below zero


def draw_stretches(
    axes: Axes, branch: Branch, y: Floats, style: dict[str, Any] | None, curves: list[Floats] | None = None
) -> None:
    """Draw a branch: thin and grey where it is stable, in its own style where it is unstable; single points as markers.

    Parameters
    ----------
    axes : Axes
    branch : Branch
        With k points.
    y : (k,) float
        What is drawn over the parameter.
    style : dict, optional
        Matplotlib's properties of the unstable stretches; None to leave these out.
    curves : list of (m, 2) float, optional
        The curve from point i to i + 1, for each i; straight lines by default.
    """
    curves = list(segments(np.column_stack([branch.value, y]))) if curves is None else curves
    shown = [curve for curve, joined in zip(curves, branch.joined, strict=True) if joined]
    axes.add_collection(LineCollection(shown, colors="0.6", linewidths=0.7, zorder=2))
    alone = ~(np.append(branch.joined, False) | np.append(False, branch.joined))
    stable = alone & ~branch.unstable & (branch.onset == 0)
    axes.plot(branch.value[stable], y[stable], "_", color="0.5", ms=12, mew=0.9, zorder=2)
    if style is None:
        return
    inside = branch.unstable_segments()
    # Neighbouring segments are drawn as one polyline, so that a dash pattern does not start anew at each point.
    for run in np.split(np.flatnonzero(inside), np.flatnonzero(np.diff(np.flatnonzero(inside)) > 1) + 1):
        if len(run):
            line = np.concatenate([curves[run[0]][:1], *(curves[i][1:] for i in run)])
            axes.plot(*line.T, lw=2.4, solid_capstyle="butt", zorder=4, **style)
    lone = branch.unstable & ~(np.append(inside, False) | np.append(False, inside))
    axes.plot(branch.value[lone], y[lone], "D", color=style["color"], ms=5, zorder=5)


def draw_growth(
    axes: Axes, branches: list[Branch], growing: list[Branch], styles: dict[int, dict[str, Any]], onsets: pd.DataFrame
) -> None:
    """Draw the growth rates of the branches that grow, with their decaying partners; without any, the largest Re λ."""
    axes.axhline(0.0, color="0.3", lw=0.9, zorder=1)
    if not growing:
        _draw_least_stable(axes, branches)
        return
    curves = [(branch, styles[branch.number], True) for branch in growing]
    for branch in growing:
        mirror = find_mirror(branch, branches, onsets)
        if mirror is not None:
            curves.append((mirror, styles[branch.number], False))
    shapes = [growth_curves(branch) for branch, _, _ in curves]
    heights = np.concatenate([curve[:, 1] for shape in shapes for curve in shape] + [b.re for b, _, _ in curves])
    # The growing modes set the range of the axis: a mode that decays a thousand times as fast would flatten them.
    top = float(np.nanmax(heights))
    low, high = padded(np.maximum(heights, -_DEPTH * top) if top > 0 else heights)
    for (branch, style, grows), shape in zip(curves, shapes, strict=True):
        pairs = [curve for curve, joined in zip(shape, branch.joined, strict=True) if joined]
        axes.add_collection(LineCollection(pairs, colors=style["color"], linewidths=0.8, alpha=0.7, zorder=3))
        if len(branch.value) == 1 and not grows:
            axes.plot(branch.value, branch.re, "_", color=style["color"], ms=12, zorder=3)
        if not grows:
            continue
        draw_stretches(axes, branch, branch.re, style, shape)
        # The uncertainty of what decays faster than it swings is set to |λ| where loss factors say nothing of it: that
        # is no bar. A larger one is.
        omega = 2 * np.pi * branch.frequency_hz
        size = np.hypot(branch.re, omega)
        unknown = (branch.re <= -omega) & (np.abs(branch.re_uncertainty - size) <= 1e-6 * size)
        bar = np.where(unknown, 0.0, branch.re_uncertainty)
        if bar.max(initial=0.0) > 0.004 * (high - low):
            lower, upper = branch.re - bar, branch.re + bar
            _draw_band(axes, branch, bar, style["color"])
            high = max(high, float(np.nanmax(upper)))
            low = max(min(low, float(np.nanmin(lower))), min(low, -_DEPTH * high))
    axes.set_ylim(low, high)
    axes.axhspan(0.0, high, color="tab:red", alpha=0.05, lw=0, zorder=0)


def _draw_band(axes: Axes, branch: Branch, bar: Floats, colour: Any) -> None:
    """Draw bars (k,) about the growth of a branch: a band along each stretch without interruption, and lone bars."""
    for run in np.split(np.arange(len(bar)), np.flatnonzero(~branch.joined) + 1):
        value, re, own = branch.value[run], branch.re[run], bar[run]
        if len(run) > 1:
            axes.fill_between(value, re - own, re + own, color=colour, alpha=0.2, lw=0, zorder=2)
        else:
            axes.errorbar(value, re, own, color=colour, capsize=4, zorder=3)


def _draw_least_stable(axes: Axes, branches: list[Branch]) -> None:
    """Draw the largest Re λ at each value, where no mode is unstable: it shows how close to instability a design is."""
    axes.text(0.5, 0.82, "no unstable mode", transform=axes.transAxes, ha="center", va="center",
              fontsize=12, color="0.25")
    if not branches:
        axes.set_ylim(-1.0, 1.0)
        return
    value = np.concatenate([branch.value for branch in branches])
    re = np.concatenate([branch.re for branch in branches])
    value, re = value[np.isfinite(re)], re[np.isfinite(re)]
    sweep = np.unique(value)
    largest = np.array([re[value == v].max() for v in sweep])
    axes.plot(sweep, largest, "o-" if len(sweep) == 1 else "-", color="0.45", lw=1.4, ms=5)
    depth = max(-1.3 * float(largest.min(initial=0.0)), 1.0)
    depth = max(depth, 1.5 * float(largest.max(initial=0.0)))
    axes.set_ylim(-depth, depth)
    if len(sweep):
        axes.annotate("least stable mode", (sweep[len(sweep) // 2], largest[len(sweep) // 2]), xytext=(0, -8),
                      textcoords="offset points", ha="center", va="top", fontsize=9, color="0.35")


def padded(values: Floats, floor: float | None = None) -> tuple[float, float]:
    """Return limits a little beyond the values (n,), never equal and, if `floor` is given, hardly below it."""
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    margin = 0.06 * (high - low) or max(0.1 * abs(high), 1e-3)
    if floor is not None and low >= floor:
        return max(low - margin, floor - 0.02 * (high - floor)), high + margin
    return low - margin, high + margin
