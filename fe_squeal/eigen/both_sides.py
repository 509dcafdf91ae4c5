"""Right and left eigenpairs in a disc around a shift."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..errors import NotConvergedError
from .shift_invert import ShiftInverted

_SAME = 1e-7  # of |λ|: a right and a left eigenvalue that are closer are one


def pairs_within(
    operator: ShiftInverted, radius: float, most: int, restarts: int, draw: int = 0,
    needed: Callable[[np.ndarray], np.ndarray] | None = None, least: int = 0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:  # fmt: skip
    """Return the λ in a disc around the shift, their right and left vectors, and the radius inside which all are known.

    Inside the widest circle that no eigenvalue is near, right and left eigenvalues are equally many. A random start may
    have so little of a left mode that the search ends before it shows. So where a right one that is needed has no
    partner, the left modes are looked for once more, in a space as large as there is room for.

    Parameters
    ----------
    radius, most, restarts, draw, least
        As for `ShiftInverted.within`.
    needed : callable, optional
        Which of λ (k,) are worth more restarts, and are returned even if others nearer to the shift have not converged.
        The radius is zero then.

    Raises
    ------
    NotConvergedError
        If no left modes of such λ were found; `partial` has these λ (k,) and their right vectors (n, k).
    """

    def left_modes(radius: float) -> tuple[np.ndarray, np.ndarray, float]:
        found = operator.within(radius, most, True, restarts, draw, needed, least)
        if needed is None or _have_partners(lam[needed(lam)], found[0].conj()):
            return found
        return operator.within(radius, most, True, restarts, draw, needed, operator.size)

    lam, right, reach = operator.within(radius, most, False, restarts, draw, needed, least)
    away = np.abs(lam - operator.sigma)
    if needed is None or not needed(lam[away > reach]).any():
        lam, right, away = lam[away <= reach], right[:, away <= reach], away[away <= reach]
        if not len(lam):
            return lam, right, right, reach
        other, left, reach_left = left_modes(reach)
        inner, inner_left, middle = _circle(away, np.abs(other.conj() - operator.sigma), min(reach, reach_left))
        if middle or needed is None or not needed(lam).any():
            i, j = _nearest(lam[inner], other[inner_left].conj())
            return lam[inner[i]], right[:, inner[i]], left[:, inner_left[j]], middle
    else:
        other, left, _ = left_modes(radius)
    lam, right = lam[needed(lam)], right[:, needed(lam)]
    i, j = _nearest(lam, other.conj())
    same = _are_one(lam[i], other[j].conj())
    if not same.any():
        found = operator.eigenpairs(lam, right)
        raise NotConvergedError(f"{len(lam)} modes were found without their left modes", found)
    return lam[i[same]], right[:, i[same]], left[:, j[same]], 0.0


def _are_one(lam: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(lam - other) <= _SAME * np.abs(lam))


def _have_partners(lam: np.ndarray, other: np.ndarray) -> bool:
    """Return whether each of some eigenvalues (k,) is one of others (m,), each time another one."""
    i, j = _nearest(lam, other)
    return len(i) == len(lam) and bool(_are_one(lam[i], other[j]).all())


def _circle(away: np.ndarray, away_left: np.ndarray, known: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the positions of right and left eigenvalues in the widest circle with as many of both, and its radius.

    Parameters
    ----------
    away, away_left : (k,), (m,) float
        Distances of the eigenvalues from the shift.
    known : float
        The largest radius. The one returned is zero if there is no such circle.
    """
    rims = np.sort(np.concatenate([away, away_left, [known]]))
    rims = np.append(rims[rims < known], known)
    middles = [known] + [(a + b) / 2 for a, b in zip(rims[-2::-1], rims[:0:-1], strict=True) if b - a > 1e-6 * b]
    for middle in middles:
        inner, inner_left = np.flatnonzero(away < middle), np.flatnonzero(away_left < middle)
        if len(inner) == len(inner_left):
            return inner, inner_left, float(middle)
    return np.zeros(0, int), np.zeros(0, int), 0.0


def _nearest(lam: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions in two lists of eigenvalues, of right modes and of left ones, that make pairs of the nearest.

    The left mode of λ is the transposed problem's mode of λ*: ψᴴQ(λ) = 0 is Q(λ)ᴴψ = 0.
    """
    return linear_sum_assignment(np.abs(lam[:, None] - other[None, :]))
