"""The range of frequencies in which all modes are known, and unstable modes that were found above it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..report.branches import frequency_text, parameter_symbol
from ..scene import MatrixScene, Scene
from ..sweep.result import Sweep
from ..sweep.sweep import MODES


class Seen(NamedTuple):
    """An unstable mode above the range: its frequency, Hz, its growth rate, 1/s, and the value of the parameter."""

    frequency_hz: float
    growth: float
    value: float


def frequency_range(scene: Scene | MatrixScene, result: Sweep) -> tuple[float, float | None]:
    """Return the range, Hz, in which all modes are known at every value of a sweep.

    It begins where strong dampers let direct solves see no farther down, else at 0. If a number of modes is asked for,
    the range ends at the highest frequency that they reach at every value. If its end is None, all modes of the problem
    above are known.
    """
    asked, begin = scene.solve.max_frequency, _begin(result)
    if asked is not None:
        return begin, float(asked)
    wanted = scene.solve.modes or MODES
    if wanted >= result.problem.unknowns:
        return begin, None
    return begin, _reached(result)


def found_range(result: Sweep) -> tuple[float, float | None]:
    """Return the same for a sweep of which it is not known what was asked for.

    It ends at the highest frequency that the modes reach at every value. Its end is None where each value has all
    2n eigenvalues of n unknowns: real ones, and those with Im λ > 0, which have a conjugate.
    """
    numbers = [point.modes.eigenvalue_count for point in result.points]
    return _begin(result), None if min(numbers, default=0) >= 2 * result.problem.unknowns else _reached(result)


def _begin(result: Sweep) -> float:
    return float(max(point.modes.unsearched.low for point in result.points) / (2 * np.pi)) if result.points else 0.0


def _reached(result: Sweep) -> float:
    tops = [float(point.modes.frequency_hz.max(initial=0.0)) for point in result.points if len(point.modes)]
    return min(tops, default=0.0)


def unstable_above(result: Sweep) -> Seen | None:
    """Return the lowest unstable mode above the range if the solver happened to find one, where it grows fastest.

    A sweep solves for some more modes than were asked for. These are not counted, and some may be missing.
    """
    found = [
        Seen(float(lam.imag / (2 * np.pi)), float(lam.real), point.value)
        for point in result.points
        for lam in point.above
    ]
    if not found:
        return None
    lowest = min(seen.frequency_hz for seen in found)
    near = [seen for seen in found if seen.frequency_hz < 1.02 * lowest]  # taken for the same mode at other values
    return max(near, key=lambda seen: seen.growth)


def above_text(seen: Seen, parameter: str) -> str:
    """Return a sentence about an unstable mode above the range."""
    # The limit offered is a multiple of 100 Hz, for frequencies below 1 kHz one of two digits.
    size = 10.0 ** min(np.floor(np.log10(max(seen.frequency_hz, 1e-300))) - 1, 2)
    return (
        f"above the range that was asked for a mode is unstable: {frequency_text(seen.frequency_hz)}, Re λ ="
        f" {seen.growth:.3g} 1/s at {parameter_symbol(parameter)} = {seen.value:.4g}; ask for more modes, or for"
        f" solve.max_frequency = {(np.ceil(seen.frequency_hz / size) + 1) * size:g}"
    )
