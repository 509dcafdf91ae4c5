"""Axes of the figures of a sweep: their limits, units and labels, and the styles of the branches."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes

from fe_squeal.report.branches import PARAMETER_LABELS, Floats, figure_text, numbers
from fe_squeal.report.curves import padded

_DASHES = ("-", "--", ":")


def growth_limits(modes: pd.DataFrame) -> tuple[tuple[float, float], list[str]]:
    """Return the range of Re λ (1/s) of the root locus, and sentences about eigenvalues outside of it."""
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
    low, high = padded(np.append(re[shown], 0.0))
    high = max(high, -0.15 * low)  # a part of the unstable half plane is always shown
    low = min(low, -0.15 * high)
    outside = int(np.count_nonzero((re[finite] < low) | (re[finite] > high)))
    return (low, high), [f"{outside} real eigenvalues lie outside of the picture"] if outside else []


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
