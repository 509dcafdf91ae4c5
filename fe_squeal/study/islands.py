"""Islands of a map: closed unstable regions that no line of the grid crosses, found by minima between its nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import minimize

from ..eigen.pencil import Modes
from ..problem.problem import Problem
from .seeds import Axes, Seed, point_near

_PROMISING = 0.2  # times the gap at a place: a minimum is looked for if the gap interpolated beside it is smaller
_RISES = 1e-6  # of θ: neighbours at which it is larger by no more are on a plateau
_CALLS = 80  # solves for the modes to find one minimum, at most
_FINE = 1e-4  # of the map's width: the accuracy of the place of a minimum
_HALVINGS = 14  # of the line from inside an island to outside


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

    def is_promising(self, g: float, around: dict[tuple[int, int], float]) -> bool:
        """Return whether parabolas along the axes say that the gap g of a place comes close to zero beside the place.

        `around` has the gaps there and at the neighbours, by their steps along both axes.
        """
        least = g
        for step in ((1, 0), (0, 1)):
            a, b = around.get((-step[0], -step[1])), around.get(step)
            if a is None or b is None or not np.isfinite([a, b]).all():
                continue
            slope, bend = (b - a) / 2, a + b - 2 * g
            if bend > 0:
                least -= slope**2 / (2 * bend)
        return least < _PROMISING * g

    def frequency(self, s: np.ndarray, omega: float) -> float:
        """Return the frequency, Hz, of the mode near omega that is unstable at s (2,)."""
        gaps, where = self.values(s)
        near = np.flatnonzero(np.abs(where - omega) <= 0.05 * omega)
        return float(where[near[np.argmin(gaps[near])]]) / (2 * np.pi)


class Stiffness(Gap):
    """The smallest real θ, which is negative where something diverges, with damping too: at λ = 0 this exerts no force.

    It has one frequency of its own, √θ of the place that is asked first, so that its minima are not mixed with others.
    """

    def __init__(self, axes: Axes, undamped_at: Callable[[float, float], Modes]) -> None:
        super().__init__(False, axes, undamped_at)
        self._unit: float | None = None

    def values(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return θ (1,) and the frequency (1,), rad/s; nothing where no θ is real."""
        lam = self._modes_at(*(a.value(float(x)) for a, x in zip(self._axes, s, strict=True))).lam
        theta = (-(lam**2)).real[(lam.real == 0) | (lam.imag == 0)]
        if not len(theta):
            return np.zeros(0), np.zeros(0)
        self._unit = self._unit or float(np.sqrt(np.abs(theta).max())) or 1.0
        return np.array([theta.min()]), np.array([self._unit])

    def growth(self, gap: float, omega: float) -> float:
        """Return the growth rate, 1/s, of what diverges."""
        return float(np.sqrt(max(-gap, 0.0)))

    def is_promising(self, g: float, around: dict[tuple[int, int], float]) -> bool:
        """Return whether θ rises along each axis, to one side at least, where a place has neighbours on both.

        No parabola tells, since θ of another mode caps the smallest one at the neighbours. Where θ stays the same along
        an axis, or falls towards a corner of the map, no closed island is there. An island amid nodes has the same θ at
        several of them.
        """
        sides = [(around.get((-i, -j)), around.get((i, j))) for i, j in ((1, 0), (0, 1))]
        whole = [max(a, b) for a, b in sides if a is not None and b is not None]
        return bool(whole) and min(whole) > (1 + _RISES) * g

    def frequency(self, s: np.ndarray, omega: float) -> float:
        """Return the frequency, Hz, of a divergence: none."""
        return 0.0


def islands(
    problem: Problem, axes: Axes, grids: tuple[np.ndarray, np.ndarray], modes_at: Callable[[float, float], Modes],
    tell: Callable[[str], None] = lambda text: None, most: int = 40,
    undamped_at: Callable[[float, float], Modes] | None = None, blind: float = 0.0,
) -> Iterator[Seed]:  # fmt: skip
    """Yield points of boundaries around islands that no line of the grid crosses.

    Where the gap at a place of the grid is smaller than at all its neighbours, a parabola through the neighbours shows
    whether it may become negative between them. If so, its minimum is looked for. At most `most` minima are; where
    there are more, a sentence says so. With light damping −Re λ is flat beside an island and falls steeply at its edge:
    the minima of the gap without damping are looked at, too. Islands of divergence are looked for by the smallest θ.

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
    searches = [(gap, gap)] + ([] if undamped_at is None else [(gap, Gap(False, axes, undamped_at))])
    if not any(t.imaginary for t in problem.terms):  # loss factors say nothing of what diverges
        static = Stiffness(axes, undamped_at or modes_at)
        searches.append((static, static))
    for own, search in searches:
        for start, omega, spacing in _minima(search, axes, grids):
            tried += 1
            if tried <= most:
                yield from _island(problem, axes, own, search, start, omega, spacing, blind)
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
                if min(around.values()) >= g and gap.is_promising(g, around):
                    yield np.array([sx[i], sy[j]]), float(omega), _spacing(sx, sy)


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
        seed = point_near(problem, axes, low, gap.frequency(low, omega), 1 - axis)
        if seed is not None:
            yield seed
            return
