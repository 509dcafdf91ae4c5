"""Find points from which boundaries are followed: onsets along the lines of the grid, and islands between the lines.

An island is a closed unstable region of the map that no line of the grid crosses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize

from ..eigen.dense import solve_dense
from ..eigen.pencil import Modes
from ..errors import NotConvergedError, SquealError
from ..problem.problem import Problem
from ..sweep.onset import Onset
from ..sweep.sweep import sweep
from .boundary import Boundary, Kind, Scaled
from .curves import CurvePoint, solve_point

_PROMISING = 0.2  # times the gap at a place: a minimum is looked for if the gap interpolated beside it is smaller
_CALLS = 80  # solves for the modes to find one minimum, at most
_FINE = 1e-4  # of the map's width: the accuracy of the place of a minimum
_HALVINGS = 14  # of the line from inside an island to outside
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
        slow = _slow_windows(found.onsets, problem.is_damped, blind)
        if slow:
            told(_CROSSING)
        for onset in (o for o in found.onsets if o not in slow):
            s = np.zeros(2)
            s[along], s[1 - along] = axes[along].at(onset.value), axes[1 - along].at(float(line))
            seed = point_near(problem, axes, s, onset.frequency_hz, 1 - along)
            if seed is None:
                told(f"{name} = {onset.value:.6g}, {other} = {line:g}: the onset could not be followed")
            else:
                yield seed


def _slow_windows(onsets: Sequence[Onset], damped: bool, blind: float) -> list[Onset]:
    """Return both ends of the windows in which no mode grows faster than `blind` times its frequency.

    From both ends growth rises like c√d with the distance d where two modes meet, and like cd with damping: in the
    middle of a window of width w it is at most c√w / 2, or cw / 2.
    """
    ordered, found = sorted(onsets, key=lambda o: o.value), list[Onset]()
    for into, out in pairwise(ordered):
        same = {into.branch_a, into.branch_b} & {out.branch_a, out.branch_b} - {None, 0}
        if (into.direction, out.direction) != ("into", "out of") or not same:
            continue
        width, speed = out.value - into.value, max(abs(into.crossing_speed), abs(out.crossing_speed))
        if speed * (width if damped else np.sqrt(width)) / 2 <= blind * 2 * np.pi * into.frequency_hz:
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


class Gap:
    """A smooth number that is negative where a mode near some frequency is unstable, to look for islands by its minima.

    Without damping it is the smallest squared gap (θ_i − θ_j)² of two neighbouring modes, which is negative where they
    are a growing pair. With damping it is −Re λ of the mode that grows most.
    """

    def __init__(self, damped: bool, axes: Axes, modes_at: Callable[[float, float], Modes]) -> None:
        self._damped, self._axes, self._modes_at = damped, axes, modes_at

    def values(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers (k,) of all pairs of modes, or of all modes, and their frequencies (k,), rad/s, at s."""
        modes = self._modes_at(*(a.value(float(x)) for a, x in zip(self._axes, s, strict=True)))
        lam = modes.lam
        if self._damped:
            return -lam.real, lam.imag
        theta = np.sort((-(lam**2)).real[lam.real == 0])
        pairs = lam[(lam.real > 0) & (lam.imag > 0)]
        gaps, omega = np.diff(theta) ** 2, np.sqrt(np.abs(theta[1:] + theta[:-1]) / 2)
        return np.append(gaps, -4 * (pairs**2).imag ** 2), np.append(omega, np.abs(pairs))

    def growth(self, gap: float, omega: float) -> float:
        """Return the growth rate, 1/s, of a mode of a frequency, rad/s, with this gap; 0 where it does not grow."""
        if not gap < 0:
            return 0.0
        return -gap if self._damped else float(np.sqrt(-gap)) / (4 * omega)  # Im θ = 2 Re λ Im λ

    def about(self, s: np.ndarray, omega: float, width: float) -> float:
        """Return the smallest number at s (2,) for frequencies within `width` omega of omega; infinite off the map."""
        if (s < 0).any() or (s > 1).any():
            return float(np.inf)
        gaps, where = self.values(s)
        return float(gaps[np.abs(where - omega) <= width * omega].min(initial=np.inf))


def islands(
    problem: Problem, axes: Axes, grids: tuple[np.ndarray, np.ndarray], modes_at: Callable[[float, float], Modes],
    tell: Callable[[str], None] = lambda text: None, most: int = 40,
    undamped_at: Callable[[float, float], Modes] | None = None, blind: float = 0.0,
) -> Iterator[Seed]:  # fmt: skip
    """Yield points of boundaries around islands that no line of the grid crosses.

    Where the gap at a place of the grid is smaller than at all its neighbours, a parabola through the neighbours shows
    whether it may become negative between them. If so, its minimum is looked for. At most `most` minima are; where
    there are more, a sentence says so. With light damping −Re λ is flat beside an island and falls steeply at its edge:
    the minima of the gap without damping are looked at, too.

    Parameters
    ----------
    problem, axes, grids
        As for `seeds_on_lines`.
    modes_at : callable of (float, float)
        Returns the modes at values of both parameters.
    undamped_at : callable of (float, float), optional
        The same without damping, where the problem has damping.
    tell : callable of str
        Gets that sentence.
    most : int
    blind : float
        As for `seeds_on_lines`: what grows more slowly is no island.
    """
    gap, tried = Gap(problem.is_damped, axes, modes_at), 0
    for search in (gap, *([] if undamped_at is None else [Gap(False, axes, undamped_at)])):
        for start, omega, spacing in _minima(search, axes, grids):
            tried += 1
            if tried <= most:
                yield from _island(problem, axes, gap, search, start, omega, spacing, blind)
    if tried > most:
        tell(f"small islands of instability were looked for at {most} of {tried} places of the grid: take a finer grid")


def _minima(
    gap: Gap, axes: Axes, grids: tuple[np.ndarray, np.ndarray]
) -> Iterator[tuple[np.ndarray, float, tuple[float, float]]]:  # fmt: skip
    """Yield places (2,) where a gap may become negative beside the grid, the frequency, rad/s, and the grid's steps."""
    sx, sy = ([a.at(float(v)) for v in grid] for a, grid in zip(axes, grids, strict=True))
    table = [[gap.values(np.array([x, y])) for y in sy] for x in sx]
    for i in range(len(sx)):
        for j in range(len(sy)):
            for g, omega in zip(*table[i][j], strict=True):
                if g <= 0 or omega <= 0:
                    continue
                around = {}
                for di in (-1, 0, 1):
                    for dj in (-1, 0, 1):
                        if 0 <= i + di < len(sx) and 0 <= j + dj < len(sy):
                            gaps, where = table[i + di][j + dj]
                            near = np.abs(where - omega) <= 0.03 * omega
                            around[di, dj] = float(gaps[near].min(initial=np.inf))
                if min(around.values()) >= g and _promising(g, around):
                    yield np.array([sx[i], sy[j]]), float(omega), _spacing(sx, sy)


def _promising(g: float, around: dict[tuple[int, int], float]) -> bool:
    """Return whether parabolas along the axes say that the gap g of a place comes close to zero beside the place."""
    least = g
    for step in ((1, 0), (0, 1)):
        a, b = around.get((-step[0], -step[1])), around.get(step)
        if a is None or b is None or not np.isfinite([a, b]).all():
            continue
        slope, bend = (b - a) / 2, a + b - 2 * g
        if bend > 0:
            least -= slope**2 / (2 * bend)
    return least < _PROMISING * g


def _spacing(sx: list[float], sy: list[float]) -> tuple[float, float]:
    return float(np.diff(sx).mean()), float(np.diff(sy).mean())


def _lowest(gap: Gap, start: np.ndarray, omega: float, spacing: tuple[float, float]) -> tuple[np.ndarray, float]:
    """Return the place (2,) of the minimum of a gap near a place, and the gap there."""
    simplex = start + np.array([[0.0, 0.0], [0.4 * spacing[0], 0.0], [0.0, 0.4 * spacing[1]]])
    simplex = np.where(simplex > 1, 2 * start - simplex, simplex)
    found = minimize(
        lambda s: gap.about(s, omega, 0.05), start, method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": _CALLS, "xatol": _FINE, "fatol": 0.0},
    )  # fmt: skip
    return np.asarray(found.x), float(found.fun)


def _island(
    problem: Problem, axes: Axes, gap: Gap, search: Gap, start: np.ndarray, omega: float,
    spacing: tuple[float, float], blind: float,
) -> Iterator[Seed]:  # fmt: skip
    inside, least = _lowest(search, start, omega, spacing)
    if search is not gap and least < 0:
        least = gap.about(inside, omega, 0.05)
        if not least < 0:  # damping has moved it
            inside, least = _lowest(gap, inside, omega, (spacing[0] / 10, spacing[1] / 10))
    if not gap.growth(least, omega) > blind * omega:
        return
    for axis in (0, 1):
        outside = inside.copy()
        for sign in (1, -1):
            outside[axis] = np.clip(inside[axis] + sign * spacing[axis], 0.0, 1.0)
            if gap.about(outside, omega, 0.05) > 0:
                break
        else:
            continue
        low, high = inside.copy(), outside.copy()
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if gap.about(middle, omega, 0.05) < 0 else (low, middle)
        gaps, where = gap.values(low)
        near = np.flatnonzero(np.abs(where - omega) <= 0.05 * omega)
        frequency = float(where[near[np.argmin(gaps[near])]]) / (2 * np.pi)
        seed = point_near(problem, axes, low, frequency, 1 - axis)
        if seed is not None:
            yield seed
            return
