"""Figures of the studies; Matplotlib is imported where a figure is drawn."""

from __future__ import annotations

import os
import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from .axis import Axis
from .noise import GROAN_BELOW_HZ, SQUEAL_FROM_HZ
from .results import Case, Curves, Grid, Responses, Surface, Table
from .study import Result

_SYMBOLS = {"mu": "μ", "theta1": "θ1", "theta2": "θ2", "theta": "θ"}
_COLORS = ("#1f5fa8", "#d1701b", "#2c8a4b", "#7a4fa3", "#8c5a3c", "#c24d8b", "#5f6b73", "#a39a1e", "#17a0b0")
_UNSTABLE = "#f6d5d2"
_FREQUENCY, _GROWTH = "|Im λ| (rad/s)", "Re λ (rad/s)"


def draw_study(result: Result, title: str, path: str | os.PathLike[str], spatial: bool = False, dpi: int = 120) -> Path:
    """Draw a result and write it as PNG with a palette, which keeps it small.

    Parameters
    ----------
    result : Curves, Surface, Responses, Grid or Table
    title : str
    path : path
        Ends in `.png`.
    spatial : bool
        Add the curves in (parameter, |ω|, σ).
    dpi : int

    Returns
    -------
    Path
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    figure = Figure(dpi=dpi, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    figure.suptitle(title)
    if isinstance(result, Curves):
        _draw_panels(figure, result, spatial)
    elif isinstance(result, Surface):
        _draw_surface(figure, result)
    elif isinstance(result, Responses):
        _draw_responses(figure, result)
    elif isinstance(result, Grid):
        _draw_grid(figure, result)
    else:
        assert isinstance(result, Table)
        _draw_noise_map(figure, result)
    # Matplotlib's 3-D projection warns of an overflow once in a while, on finite data that are the same in every run.
    with np.errstate(over="ignore", invalid="ignore"):
        canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    picture.quantize(colors=128, dither=Image.Dither.NONE).save(path, optimize=True)
    return Path(path)


def _label(axis: Axis) -> str:
    symbols = [_SYMBOLS.get(name, name) for name in axis.names]
    text = " = ".join(symbols if len(symbols) < 4 else [symbols[0], "…", symbols[-1]])
    return f"{text} ({axis.unit})" if axis.unit else f"friction coefficient {text}" if text == "μ" else text


def _draw_panels(figure: Any, result: Curves, spatial: bool) -> None:
    panels = list(dict.fromkeys(case.panel for case in result.cases))
    figure.set_size_inches(5.6 * len(panels) + 1.2, 9.6 if spatial else 6.2)
    grid = figure.add_gridspec(3 if spatial else 2, len(panels), height_ratios=[3, 3, 4] if spatial else [1, 1])
    limits = _limits(result)
    for column, panel in enumerate(panels):
        cases = [case for case in result.cases if case.panel == panel]
        top = figure.add_subplot(grid[0, column])
        bottom = figure.add_subplot(grid[1, column], sharex=top)
        for axes, part, name in ((top, "imag", _FREQUENCY), (bottom, "real", _GROWTH)):
            for low, high in cases[0].unstable:
                axes.axvspan(low, high, color=_UNSTABLE, lw=0)
            for number, case in enumerate(cases):
                _draw_case(axes, result.axis, case, part, _COLORS[number] if len(cases) > 1 else None)
            axes.set_ylabel(name)
            axes.grid(alpha=0.3)
            axes.set_ylim(*limits[part])
        top.tick_params(labelbottom=False)
        bottom.axhline(0, color="black", lw=0.8)
        bottom.set_xlabel(_label(result.axis))
        bottom.set_xlim(result.axis.values[0], result.axis.values[-1])
        top.set_title(_headline(panel if len(panels) > 1 else "", cases), fontsize=9.5)
        if len(cases) > 1:
            bottom.legend(fontsize=8, loc="lower left")
        if spatial:
            _draw_curves(figure.add_subplot(grid[2, column], projection="3d"), result.axis, cases)


def _headline(panel: str, cases: list[Case]) -> str:
    ends = ";  ".join(f"{a:.5g}…{b:.5g}" for a, b in cases[0].unstable)
    which = f"{cases[0].label}, " if len(cases) > 1 else ""
    shaded = "\n".join(textwrap.wrap(f"shaded: {which}unstable, {ends}" if ends else f"{which}nothing grows", 62))
    return f"{panel}\n{shaded}" if panel else shaded


def _limits(result: Curves) -> dict[str, tuple[float, float]]:
    """Return limits that all panels share; they are so wide that the rounding of zero growth rates does not show."""
    top = max(float(case.lam.imag.max()) for case in result.cases)
    re = np.concatenate([case.lam.real.ravel() for case in result.cases])
    low, high = min(float(re.min()), -0.02), max(float(re.max()), 0.02)
    margin = 0.06 * (high - low)
    return {"imag": (0.0, 1.06 * top), "real": (low - margin, high + margin)}


def _draw_case(axes: Any, axis: Axis, case: Case, part: str, color: str | None) -> None:
    for mode in range(case.lam.shape[1]):
        line = dict(color=color or _COLORS[mode % len(_COLORS)], lw=1.4, label=case.label if mode == 0 else None)
        axes.plot(axis.values, getattr(case.lam, part)[:, mode], **line)


def _draw_curves(axes: Any, axis: Axis, cases: list[Case]) -> None:
    for number, case in enumerate(cases):
        for mode in range(case.lam.shape[1]):
            color = _COLORS[number] if len(cases) > 1 else _COLORS[mode % len(_COLORS)]
            lam = case.lam[:, mode]
            axes.plot(axis.values, np.abs(lam.imag), lam.real, color=color, lw=1.4)
    axes.set_xlabel(_label(axis).removeprefix("friction coefficient "), labelpad=8)
    axes.set_ylabel("|ω| (rad/s)", labelpad=8)
    axes.set_zlabel("σ (rad/s)")
    axes.view_init(28, -58)
    axes.set_box_aspect((1.7, 1.2, 0.9), zoom=0.95)
    _thin_ticks(axes)
    if max(np.abs(case.lam.real).max() for case in cases) < 0.02:
        axes.set_zlim(-0.02, 0.02)


def _thin_ticks(axes: Any) -> None:
    from matplotlib.ticker import MaxNLocator

    for part in (axes.xaxis, axes.yaxis, axes.zaxis):
        part.set_major_locator(MaxNLocator(5))


def _draw_surface(figure: Any, result: Surface) -> None:
    rows = len(result.labels)
    figure.set_size_inches(10.5, 0.6 + 4.2 * rows)
    X, Y = np.meshgrid(result.x.values, result.y.values)
    low = min(float(g.min()) for g in result.growth)
    high = max(0.05, *(float(g.max()) for g in result.growth))
    for row, (label, growth) in enumerate(zip(result.labels, result.growth, strict=True)):
        solid = figure.add_subplot(rows, 2, 2 * row + 1, projection="3d")
        style = dict(cmap="viridis", vmin=low, vmax=high)
        solid.plot_surface(X, Y, growth, rcount=50, ccount=50, linewidth=0.1, edgecolor="#ffffff40", **style)
        solid.set_xlabel("μ")
        solid.set_ylabel(_label(result.y))
        solid.set_zlabel("max Re λ (rad/s)")
        solid.set_zlim(low, high)
        solid.view_init(30, -130)
        solid.set_box_aspect(None, zoom=0.95)
        _thin_ticks(solid)
        flat = figure.add_subplot(rows, 2, 2 * row + 2)
        image = flat.pcolormesh(X, Y, growth, shading="gouraud", **style)
        onset = result.critical_mu[row]
        flat.plot(np.where(np.isfinite(onset), onset, np.nan), result.y.values, color="white", lw=1.5)
        flat.set_xlim(result.x.values[0], result.x.values[-1])
        line = "white line: onset" if (onset < result.x.values[-1]).any() else "nothing grows"
        flat.set_title(f"{label}\n{line}", fontsize=9.5)
        flat.set_xlabel(_label(result.x))
        flat.set_ylabel(_label(result.y))
        figure.colorbar(image, ax=flat, label="max Re λ (rad/s)")


def _draw_responses(figure: Any, result: Responses) -> None:
    figure.set_size_inches(8, 7.5)
    all_axes = figure.subplots(len(result.mu), 1, sharex=True)
    rows = zip(all_axes, result.labels, result.mu, result.rates, result.motion, strict=True)
    for axes, label, mu, rate, motion in rows:
        for i, name in reversed(list(enumerate(result.coordinates))):
            axes.plot(result.times, motion[:, i], color=_COLORS[i], lw=0.9, label=name)
        growth = f", largest Re λ = {rate:.4f} rad/s" if rate > 1e-6 else ""
        axes.set_title(f"{label}: μ = {mu:.5f}{growth}", fontsize=9.5)
        axes.set_ylabel("displacement (m)")
        axes.grid(alpha=0.3)
        axes.set_xlim(result.times[0], result.times[-1])
    all_axes[0].legend(loc="upper right", ncols=2, fontsize=8)
    all_axes[-1].set_xlabel("time (s)")


def _draw_grid(figure: Any, result: Grid) -> None:
    """Maps over the first two axes, for three values of the third and four of the fourth that have finite ones."""
    from matplotlib.colors import LogNorm

    first, second, third, fourth = result.axes
    shown = np.where((result.values > 0) & np.isfinite(result.values), result.values, np.nan)
    some = np.flatnonzero(np.isfinite(shown).any((0, 1, 2)))
    rows = np.linspace(0, len(third.values) - 1, 3).astype(int)
    columns = some[np.linspace(0, len(some) - 1, 4).astype(int)]
    figure.set_size_inches(12, 9)
    all_axes = figure.subplots(len(rows), len(columns), sharex=True, sharey=True, squeeze=False)
    for (i, j), axes in np.ndenumerate(all_axes):
        values = np.ma.masked_invalid(shown[:, :, rows[i], columns[j]].T)
        axes.set_facecolor("#d5d5d5")
        style = dict(norm=LogNorm(0.03, 10), cmap="viridis", shading="nearest")
        image = axes.pcolormesh(first.values, second.values, values, **style)
        where = ((third, rows[i]), (fourth, columns[j]))
        texts = (f"{_SYMBOLS.get(a.name, a.name)} = {a.values[n]:g} {a.unit}" for a, n in where)
        axes.set_title(", ".join(texts), fontsize=9)
        if i == len(rows) - 1:
            axes.set_xlabel(_label(first))
        if j == 0:
            axes.set_ylabel(_label(second))
    figure.colorbar(image, ax=all_axes, label="critical friction coefficient (grey: no flutter)", extend="both")


def _draw_noise_map(figure: Any, result: Table) -> None:
    figure.set_size_inches(7.5, 4.2)
    axes = figure.subplots()
    scale, frequency = (np.array([float(row[i]) for row in result.rows]) for i in (0, 2))
    axes.loglog(scale, frequency, color=_COLORS[0], marker="o", ms=3)
    low, high = frequency.min() / 1.5, frequency.max() * 1.5
    bands = (("groan", low, GROAN_BELOW_HZ), ("moan", GROAN_BELOW_HZ, SQUEAL_FROM_HZ), ("squeal", SQUEAL_FROM_HZ, high))
    for (name, bottom, top), color in zip(bands, ("#e8eef5", "#f5efe0", "#f6d5d2"), strict=True):
        axes.axhspan(bottom, top, color=color, lw=0)
        axes.text(scale[0] * 1.3, np.sqrt(bottom * top), name, va="center", fontsize=11)
    axes.set_ylim(low, high)
    axes.set_xlim(scale[0], scale[-1])
    axes.set_xlabel("factor on every stiffness")
    axes.set_ylabel("frequency of the flutter (Hz)")
    axes.set_title(f"μ_c = {float(result.rows[0][1]):.4g} for every factor", fontsize=9.5)
