"""Modes of a symmetric pencil compared with their number, which the inertia gives, and those that were missing.

A Krylov space of one start vector holds one copy of a multiple eigenvalue; rounding brings more of them, but not always
all. Divergences (θ < 0) may lie far beyond the modes that are nearest the shift. Sylvester's law counts both.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import NotConvergedError
from .inertia import count_below, finite_below
from .linear.factor import LinearSolver
from .pencil import Modes, Pencil
from .quality import modes_from_theta
from .request import Request
from .shift_invert import Pairs, ShiftInverted

_CLEAR = 1e-5  # of a frequency: modes that are closer are not parted by a count
# Of a shift below zero: the next one. Divergences between the two are found together, since 1/(θ − σ) of none is much
# smaller than that of others. No round number, which the θ of simple problems might be.
_STEP = 97.3


def parting_frequency(modes: Modes, wanted: Modes, request: Request) -> float | None:
    """Return a frequency, rad/s, up to which the wanted modes are known if as many are found there as there are.

    It is the highest frequency asked for, or lies in the widest gap above the wanted modes. Where all beyond are equal
    to the highest wanted ones, any of these will do, and it lies close below them. None if there is no such frequency.

    Parameters
    ----------
    modes : Modes
        Those found, the wanted ones and some more.
    """
    limit = None if request.max_frequency_hz is None else 2 * np.pi * request.max_frequency_hz
    omega = modes.lam.imag[modes.lam.imag > 0]
    if limit is not None and (np.abs(omega - limit) > _CLEAR * limit).all():
        return limit
    start = float(wanted.lam.imag.max(initial=0.0)) if limit is None else limit
    edges = np.append(start, omega[omega > start])
    gaps = np.diff(edges) / edges[1:]
    if gaps.max(initial=0.0) > _CLEAR:
        i = int(gaps.argmax())
        return float(edges[i] + edges[i + 1]) / 2
    firsts = np.flatnonzero(np.diff(omega, prepend=0.0) > _CLEAR * omega)
    return None if limit is not None or not len(firsts) else float(omega[firsts[-1]]) * (1 - _CLEAR / 2)


def counted_modes(
    pencil: Pencil, modes: Modes, at: float, sigma: float, divergent: int, linear_solver: LinearSolver | str,
    below: int | None = None,
) -> Modes:  # fmt: skip
    """Return modes with those up to a frequency, and divergences, that the search nearest the shift has missed.

    Where the linear solver does not count, nothing is known to be missing.

    Parameters
    ----------
    at : float, rad/s
        The frequency; no mode is near it.
    sigma : float, rad²/s²
        The shift, which is negative.
    divergent : int
        How many θ are below the shift.
    below : int, optional
        How many θ are below the square of the frequency, if that is known already.

    Raises
    ------
    NotConvergedError
        If modes are missing and are not found; `partial` has the others.
    """
    theta, x = _pairs(modes)
    below = count_below(pencil, at, linear_solver) if below is None else below
    far = divergent - np.count_nonzero(theta < sigma)
    if below is None or (far <= 0 and below <= np.count_nonzero(theta < at**2)):
        return modes
    try:
        operator = ShiftInverted(pencil, sigma, None, linear_solver)
        theta, x, infinite = _with_divergences(pencil, operator, divergent, theta, x, linear_solver)
        number = below - infinite - int(np.count_nonzero(theta < at**2))
        theta, x = _with_missing(operator, theta, x, number, "LM", lambda values: values < at**2)
    except NotConvergedError as error:
        raise NotConvergedError(
            f"{np.count_nonzero(theta < at**2)} modes found of {below} below {at / (2 * np.pi):.6g} Hz: {error}", modes
        ) from error
    return modes_from_theta(pencil, theta, x, x, modes.method)


def _pairs(modes: Modes) -> Pairs:
    """Return θ (k,) and φ (n, k) of modes; of the two ±λ of a divergence one."""
    once = np.flatnonzero(modes.lam.real <= 0)
    return -(modes.lam[once] ** 2).real, modes.right[:, once]


def _with_divergences(
    pencil: Pencil, operator: ShiftInverted, divergent: int, theta: np.ndarray, x: np.ndarray,
    linear_solver: LinearSolver | str,
) -> tuple[np.ndarray, np.ndarray, int]:  # fmt: skip
    """Return eigenpairs with all θ below the shift among them, and how many there are infinite but for rounding.

    One search from the shift would blur those far below it, beside the eigenvalues near it. So they are searched for
    from one shift after the other, down to the lowest of them.
    """
    last = float(operator.sigma.real) / (pencil.n * np.finfo(float).eps)
    while divergent and operator.sigma.real > last:
        upper = float(operator.sigma.real)
        lower = ShiftInverted(pencil, _STEP * upper, None, linear_solver)
        beyond = finite_below(pencil, lower.negative_pivots, linear_solver) or 0
        end = float(lower.sigma.real)
        number = divergent - beyond - int(np.count_nonzero((theta > end) & (theta < upper)))
        theta, x = _with_missing(operator, theta, x, number, "SA", _within(end, upper))
        divergent, operator = beyond, lower
    return theta, x, divergent


def _within(lower: float, upper: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: (values > lower) & (values < upper)


def _with_missing(
    operator: ShiftInverted, theta: np.ndarray, x: np.ndarray, number: int, which: str,
    inside: Callable[[np.ndarray], np.ndarray],
) -> Pairs:  # fmt: skip
    """Return eigenpairs with so many others, of which each search shows one copy at least; see `largest_symmetric`.

    Raises
    ------
    NotConvergedError
        If a search shows none.
    """
    wanted = len(theta) + number
    while len(theta) < wanted:
        values, vectors = operator.without(x).largest_symmetric(wanted - len(theta), which)
        new = inside(values)
        if not new.any():
            raise NotConvergedError(f"{wanted - len(theta)} are missing that a further search does not show")
        theta, x = np.append(theta, values[new]), np.hstack([x, vectors[:, new]])
    return theta, x
