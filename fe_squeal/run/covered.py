"""Which frequencies a sweep covers, and what it has seen above them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..report.branches import frequency_text, parameter_symbol
from ..scene import MatrixScene, Scene
from ..sweep.result import Sweep
from ..sweep.sweep import MODES


class Seen(NamedTuple):
    """An unstable mode above the range: its frequency, its growth rate in 1/s, and the value of the parameter."""

    frequency_hz: float
    growth: float
    value: float


def frequency_range(scene: Scene | MatrixScene, result: Sweep) -> tuple[float, float | None]:
    """Return the frequencies in Hz, from and to, below which all modes are known at every value of a sweep.

    Of so many lowest modes it is the highest frequency that they reach at every value; None as its end stands for all
    that the model has.
    """
    asked = scene.solve.max_frequency
    if asked is not None:
        return 0.0, float(asked)
    wanted = scene.solve.modes or MODES
    if wanted >= result.problem.unknowns:
        return 0.0, None
    tops = [float(point.modes.frequency_hz.max(initial=0.0)) for point in result.points if len(point.modes)]
    return 0.0, min(tops, default=0.0)


def unstable_above(result: Sweep, end: float | None) -> Seen | None:
    """Return the lowest mode above the range that is unstable at some value, as far as the small model has seen it.

    A sweep follows some modes beyond those asked for. They are not counted, and others may be missing among them.
    """
    if end is None or result.model is None:
        return None
    found: list[Seen] = []
    for point in result.points:
        modes = result.model.modes(point.value)
        known = set(np.round(point.modes.lam, 6).tolist())
        for i in np.flatnonzero((modes.stability == "unstable") & (modes.frequency_hz > end * (1 + 1e-9))):
            if complex(np.round(modes.lam[i], 6)) not in known:
                found.append(Seen(float(modes.frequency_hz[i]), float(modes.lam[i].real), point.value))
    if not found:
        return None
    lowest = min(seen.frequency_hz for seen in found)
    near = [seen for seen in found if seen.frequency_hz < 1.02 * lowest]  # the same mode at other values
    return max(near, key=lambda seen: seen.growth)


def covered_text(covered: tuple[float, float | None]) -> str:
    """Return the range for a sentence.

    Examples
    --------
    >>> covered_text((0.0, 2009.1)), covered_text((0.0, None))
    ('below 2.01 kHz', 'at any frequency of the model')
    """
    return "at any frequency of the model" if covered[1] is None else f"below {frequency_text(covered[1])}"


def above_text(seen: Seen, parameter: str) -> str:
    """Return what is said about an unstable mode above the range."""
    return (
        f"above the range that was asked for a mode is unstable: {frequency_text(seen.frequency_hz)}, Re λ ="
        f" {seen.growth:.3g} 1/s at {parameter_symbol(parameter)} = {seen.value:.4g}; ask for more modes, or for"
        f" solve.max_frequency = {np.ceil(seen.frequency_hz / 100) * 100 + 100:g}"
    )
