"""Which modes are wanted, and which of those found are they."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .pencil import Modes, is_mirror


@dataclass(frozen=True)
class Request:
    """Which modes are wanted: the `count` lowest, or all up to a frequency.

    Attributes
    ----------
    count : int or None
    max_frequency_hz : float or None
    tolerance : float
        Largest backward error accepted of a direct solve, largest relative error of λ of a reduced model.
    """

    count: int | None = None
    max_frequency_hz: float | None = None
    tolerance: float = 1e-8


@dataclass(frozen=True)
class Completeness:
    """How many of the wanted modes were found, how many there are (None: not counted), and whether that is proven."""

    found: int
    expected: int | None
    proven: bool

    def without(self, count: int) -> Completeness:
        """Return the same for fewer modes."""
        return Completeness(self.found - count, None if self.expected is None else self.expected - count, self.proven)


def select_wanted(modes: Modes, request: Request, radius: float) -> Modes | None:
    """Return the modes asked for, or None if they reach beyond the radius (rad/s) inside which all are known."""
    omega = modes.lam.imag
    if request.max_frequency_hz is not None:
        limit = 2 * np.pi * request.max_frequency_hz
        return modes.select(np.flatnonzero(omega <= limit)) if radius > limit else None
    count = wanted_count(modes, request)
    if np.count_nonzero(~is_beside(modes)) < (request.count or 0) and np.isfinite(radius):
        return None
    if count and omega[count - 1] > radius:
        return None
    return modes.select(np.arange(count))


def wanted_count(modes: Modes, request: Request) -> int:
    """Return how many of the modes, lowest first, were asked for.

    Eigenvalues that are real, or nearly so, are returned beside the `count` asked for, see `is_beside`: in a heavily
    damped problem they would take the place of every oscillating mode. A pair λ, −λ* is not cut apart.
    """
    if request.max_frequency_hz is not None:
        return int(np.count_nonzero(modes.frequency_hz <= request.max_frequency_hz))
    beside, omega = is_beside(modes), modes.lam.imag
    counted = np.flatnonzero(~beside)[: request.count or 0]
    if len(counted) < (request.count or 0):  # there are no more that swing
        counted = np.flatnonzero(~beside | (modes.re_uncertainty < np.abs(modes.lam)))
    limit = omega[counted].max(initial=0.0)
    counted = counted[~beside[counted]]
    count = len(counted) + int(np.count_nonzero(beside & (omega <= limit)))
    cuts_a_pair = 0 < count < len(modes) and is_mirror(modes.lam[count - 1], modes.lam[count])
    return count + 1 if cuts_a_pair else count


def is_beside(modes: Modes) -> np.ndarray:
    """Return which modes, (m,) bool, do not count towards `Request.count`.

    These are real ones, those that decay as fast as they swing (damping ratio above 0.71) or faster, and those so
    uncertain that they may be real.
    """
    lam = modes.lam
    still = (lam.imag == 0) | (-lam.real >= lam.imag) | (modes.re_uncertainty >= np.abs(lam))
    return np.asarray((lam != 0) & still)


def is_needed(modes: Modes) -> np.ndarray:
    """Return which modes, (m,) bool, have to be found: all but those that decay without swinging, see `is_beside`."""
    return np.asarray(~is_beside(modes) | (modes.lam.real >= 0))
