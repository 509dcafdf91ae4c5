"""Find points from which boundaries are followed: onsets along the lines of the grid."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from ..eigen.dense import solve_dense
from ..errors import NotConvergedError, SquealError
from ..problem.problem import Problem
from ..sweep.onset import Onset
from ..sweep.sweep import sweep
from .boundary import Boundary, Kind, Scaled
from .curves import CurvePoint, solve_point

_CROSSING = (
    "where two modes cross the reduced model has windows in which nothing grows faster than its error: these are taken"
    " for crossings, and no boundary is followed there"
)

Axes = tuple[Scaled, Scaled]
Seed = tuple[Boundary, CurvePoint, int]  # the equations, a point of the boundary, the coordinate of u that was held


def seeds_on_lines(
    problem: Problem, axes: Axes, grids: tuple[np.ndarray, np.ndarray], along: int, lines: np.ndarray,
    modes: int | None, max_frequency: float | None, told: Callable[[str], None], blind: float = 0.0,
) -> Iterator[Seed]:  # fmt: skip
    """Yield a point of a boundary for each onset along the lines of the grid in one direction.

    Where two modes cross without being coupled, the error of a reduced model couples them: both ends of a window in
    which nothing grows faster than that are left out, and a sentence says so.

    Parameters
    ----------
    problem : Problem
        With few unknowns.
    axes : (Scaled, Scaled)
    grids : ((k,) float, (l,) float)
        Values of both parameters on the grid.
    along : 0 or 1
        The axis along which the lines run.
    lines : (k,) float
        Values of the other parameter at which there are lines.
    modes, max_frequency
        Which modes count, as for `sweep`.
    told : callable of str
        Gets a sentence on each onset that could not be refined.
    blind : float
        Relative error of λ that the problem may have.
    """
    name, other = axes[along].name, axes[1 - along].name
    for line in lines:
        here = problem.at({other: float(line)})
        try:
            found = sweep(here, grids[along], name, modes, max_frequency, precise=True, method="direct")
        except SquealError as error:
            told(f"{other} = {line:g}: {error}")
            continue
        for text in found.unsettled:
            told(f"{other} = {line:g}: {text}")
        # At a parting something grows on both sides: it is no boundary of stability.
        onsets = [o for o in found.onsets if o.law != "parting"]
        slow = _slow_windows(onsets, blind)
        if slow:
            told(_CROSSING)
        for onset in (o for o in onsets if o not in slow):
            s = np.zeros(2)
            s[along], s[1 - along] = axes[along].at(onset.value), axes[1 - along].at(float(line))
            seed = point_near(problem, axes, s, onset.frequency_hz, 1 - along)
            if seed is None:
                told(f"{name} = {onset.value:.6g}, {other} = {line:g}: the onset could not be followed")
            else:
                yield seed


def _slow_windows(onsets: Sequence[Onset], blind: float) -> list[Onset]:
    """Return both ends of the windows in which no mode grows faster than `blind` times its frequency.

    From both ends growth rises like c√d with the distance d where two modes meet, and like cd where one crosses alone:
    in the middle of a window of width w it is at most c√w / 2, or cw / 2.
    """
    ordered, found = sorted(onsets, key=lambda o: o.value), list[Onset]()
    for into, out in pairwise(ordered):
        same = {into.branch_a, into.branch_b} & {out.branch_a, out.branch_b} - {None, 0}
        if (into.direction, out.direction) != ("into", "out of") or not same:
            continue
        growth = np.max([o.growth_within(out.value - into.value) for o in (into, out)]) / 2
        if growth <= blind * 2 * np.pi * into.frequency_hz:
            found += [into, out]
    return found


def point_near(problem: Problem, axes: Axes, s: np.ndarray, frequency_hz: float, held: int) -> Seed | None:
    """Return the point of a boundary near a place s (2,), for a mode of about a frequency; None if there is none.

    It has the same value as the place on the axis `held`, 0 or 1.
    """
    place = {a.name: a.value(float(x)) for a, x in zip(axes, s, strict=True)}
    omega = 2 * np.pi * frequency_hz
    kind: Kind = "divergence" if omega == 0 else "hopf" if problem.is_damped else "flutter"
    modes = solve_dense(problem.pencil(place))
    assert modes.left is not None
    lam = modes.lam
    order = np.argsort(np.abs(lam - 1j * omega), kind="stable")
    first = order[0]
    right, left = modes.right[:, first], modes.left[:, first]
    unit = omega or 1.0
    if kind == "flutter":
        unit = omega**2
        right, left = _real(right), _real(left)
    elif kind == "divergence":
        right, left = _real(right), _real(left)
    boundary = Boundary(problem, axes, kind, unit, right, left)
    u = s if kind == "divergence" else np.append(1.0, s)
    fixed = np.zeros(len(u))
    coordinate = len(u) - 2 + held
    fixed[coordinate] = 1.0
    try:
        point = solve_point(boundary, u, fixed)
    except NotConvergedError:
        return None
    if np.linalg.norm(point.u - u) > 0.05:
        return None
    return boundary, point, coordinate


def _real(vector: np.ndarray) -> np.ndarray:
    """Return the larger of real and imaginary part: where two modes meet, both parts have the shape of the mode."""
    if not np.iscomplexobj(vector):
        return vector
    return vector.real if np.linalg.norm(vector.real) >= np.linalg.norm(vector.imag) else vector.imag.copy()
