"""Axes of the figures of a sweep: their limits, units and labels, and the styles of the branches."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes

from fe_squeal.report.branches import PARAMETER_LABELS, Floats, figure_text, numbers
from fe_squeal.report.curves import padded

_DASHES = ("-", "--", ":")
_FEW, _MUCH = 0.1, 0.5  # this part of the eigenvalues may be left out, if the others take less than this of the width


def growth_limits(modes: pd.DataFrame) -> tuple[tuple[float, float], list[str]]:
    """Return the range of Re λ (1/s) of the root locus, and sentences about eigenvalues outside of it.

    Of those that swing a tenth may lie further left, where they would squeeze the others into half of the picture.
    """
    re, frequency = numbers(modes, "re"), numbers(modes, "frequency_hz")
    uncertainty = np.nan_to_num(numbers(modes, "re_uncertainty"))
    magnitude = np.hypot(re, 2 * np.pi * frequency)
    finite = np.isfinite(re)
    if not finite.any():
        return (-1.0, 1.0), ["no eigenvalues"]
    # A Re λ below 1e-9 |λ| is rounding, and one below its uncertainty may be zero.
    if np.all(np.abs(re[finite]) <= np.maximum(uncertainty, 1e-9 * magnitude)[finite]):
        width = max(1.0, 2.0 * float(np.abs(re[finite]).max()))
        return (-width, width), ["Re λ = 0 within its uncertainty for all modes: neither damped nor growing"]
    shown = finite & (frequency > 0)
    if not shown.any():
        shown = finite
    rising = np.sort(re[shown])
    widths, first = max(float(rising[-1]), 0.0) - rising, 0
    for k in range(1, 1 + int(_FEW * len(rising))):
        first = k if widths[k] < _MUCH * widths[first] else first
    low, high = padded(np.append(rising[first:], 0.0))
    high = max(high, -0.15 * low)  # a part of the unstable half plane is always shown
    low = min(low, -0.15 * high)
    left, right = re[finite & (re < low)], re[finite & (re > high)]
    told = [_outside(left, "left, down", min), _outside(right, "right, up", max)]
    return (low, high), [text for text in told if text]


def _outside(re: Floats, where: str, end: Callable[[Floats], float]) -> str:
    """Return a sentence about eigenvalues outside of the picture, empty where there are none."""
    if not len(re):
        return ""
    last = f"{float(f'{end(re):.3g}'):g}".replace("-", "−")
    return f"{len(re)} eigenvalue{'s lie' if len(re) > 1 else ' lies'} further {where} to Re λ = {last} 1/s"


def branch_styles(count: int) -> list[dict[str, Any]]:
    """Return a colour and dash pattern for each of `count` branches, all different up to thirty."""
    if count <= 9:
        # Matplotlib's tab10 without grey, which is the colour of stable branches.
        colours = [colormaps["tab10"](i) for i in (3, 0, 2, 1, 4, 5, 6, 8, 9)]
        return [{"color": colour, "ls": "-"} for colour in colours[:count]]
    hues = colormaps["turbo"](np.linspace(0.04, 0.96, -(-count // len(_DASHES))))
    return [{"color": tuple(hues[i // len(_DASHES)]), "ls": _DASHES[i % len(_DASHES)]} for i in range(count)]


def frequency_unit(modes: pd.DataFrame) -> tuple[str, float]:
    """Return the unit in which the frequencies of some modes are best read, and its size in Hz."""
    frequency = numbers(modes, "frequency_hz")
    return ("kHz", 1000.0) if np.nanmax(frequency, initial=0.0) >= 2000.0 else ("Hz", 1.0)


def parameter_label(name: str) -> str:
    """Return the label of the axis of the swept parameter."""
    return PARAMETER_LABELS.get(name, figure_text(name))


def set_parameter_axis(axes: Axes, values: Floats) -> None:
    """Let the x axis span the values (m,); it is logarithmic if they span more than a factor of 50."""
    low, high = float(np.nanmin(values, initial=np.inf)), float(np.nanmax(values, initial=-np.inf))
    if not np.isfinite([low, high]).all():
        axes.set_xlim(0.0, 1.0)
    elif low == high:
        half = 0.1 * abs(low) or 0.1
        axes.set_xlim(low - half, high + half)
    elif low > 0 and high / low > 50:
        axes.set_xscale("log")
        axes.set_xlim(low, high)
    else:
        axes.set_xlim(low, high)
