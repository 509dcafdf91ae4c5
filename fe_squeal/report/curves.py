"""Curves of branches: stretches that are stable or not, growth rates, and the space around them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from fe_squeal.report.branches import Branch, Floats, find_mirror


def draw_stretches(axes: Axes, branch: Branch, y: Floats, style: dict[str, Any] | None) -> None:
    """Draw one branch: thin grey where stable, in its style where unstable, markers where a point stands alone."""
    pairs = segments(np.column_stack([branch.value, y]))
    axes.add_collection(LineCollection(list(pairs[branch.joined]), colors="0.6", linewidths=0.7, zorder=2))
    alone = ~(np.append(branch.joined, False) | np.append(False, branch.joined))
    stable = alone & ~branch.unstable & (branch.onset == 0)
    axes.plot(branch.value[stable], y[stable], "_", color="0.5", ms=12, mew=0.9, zorder=2)
    if style is None:
        return
    inside = branch.unstable_segments()
    # one polyline for each run of neighbouring segments, so that a dash pattern is not restarted at each point
    for run in np.split(np.flatnonzero(inside), np.flatnonzero(np.diff(np.flatnonzero(inside)) > 1) + 1):
        if len(run):
            rows = np.append(run, run[-1] + 1)
            axes.plot(branch.value[rows], y[rows], lw=2.4, solid_capstyle="butt", zorder=4, **style)
    lone = branch.unstable & ~(np.append(inside, False) | np.append(False, inside))
    axes.plot(branch.value[lone], y[lone], "D", color=style["color"], ms=5, zorder=5)


def draw_growth(
    axes: Axes, branches: list[Branch], growing: list[Branch], styles: dict[int, dict[str, Any]], onsets: pd.DataFrame
) -> None:
    """Draw the growth rates of the branches that grow, with their mirrors, or that of the least stable one."""
    axes.axhline(0.0, color="0.3", lw=0.9, zorder=1)
    if not growing:
        _draw_least_stable(axes, branches)
        return
    curves = [(branch, styles[branch.number], True) for branch in growing]
    for branch in growing:
        mirror = find_mirror(branch, branches, onsets)
        if mirror is not None:
            curves.append((mirror, styles[branch.number], False))
    heights = np.concatenate([branch.re[np.isfinite(branch.re)] for branch, _, _ in curves])
    low, high = padded(heights)
    for branch, style, grows in curves:
        pairs = segments(np.column_stack([branch.value, branch.re]))[branch.joined]
        axes.add_collection(LineCollection(list(pairs), colors=style["color"], linewidths=0.8, alpha=0.7, zorder=3))
        if len(branch.value) == 1 and not grows:
            axes.plot(branch.value, branch.re, "_", color=style["color"], ms=12, zorder=3)
        if not grows:
            continue
        draw_stretches(axes, branch, branch.re, style)
        if branch.re_uncertainty.max(initial=0.0) > 0.004 * (high - low):
            lower, upper = branch.re - branch.re_uncertainty, branch.re + branch.re_uncertainty
            if len(branch.value) > 1:
                # NaN where the branch has a hole, so that the band has it too
                hole = np.append(~branch.joined, False)
                axes.fill_between(branch.value, np.where(hole, np.nan, lower), np.where(hole, np.nan, upper),
                                  color=style["color"], alpha=0.2, lw=0, zorder=2)
            else:
                axes.errorbar(branch.value, branch.re, branch.re_uncertainty, color=style["color"], capsize=4, zorder=3)
            low, high = min(low, np.nanmin(lower)), max(high, np.nanmax(upper))
    axes.set_ylim(low, high)
    axes.axhspan(0.0, high, color="tab:red", alpha=0.05, lw=0, zorder=0)


def _draw_least_stable(axes: Axes, branches: list[Branch]) -> None:
    """Without an unstable mode: draw the largest Re λ at each value, which tells how far instability is."""
    axes.text(0.5, 0.82, "no unstable mode in this sweep", transform=axes.transAxes, ha="center", va="center",
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


def segments(points: Floats) -> Floats:
    """Return (k − 1, 2, 2): the segments between neighbouring points, (k, 2)."""
    return np.stack([points[:-1], points[1:]], axis=1)


def padded(values: Floats, floor: float | None = None) -> tuple[float, float]:
    """Return limits a little beyond the values, never empty and, given `floor`, hardly below it."""
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    margin = 0.06 * (high - low) or max(0.1 * abs(high), 1e-3)
    if floor is not None and low >= floor:
        return max(low - margin, floor - 0.02 * (high - floor)), high + margin
    return low - margin, high + margin
