"""Right and left eigenpairs in a disc around a shift."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from .shift_invert import ShiftInverted


def pairs_within(
    operator: ShiftInverted, radius: float, most: int, restarts: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return the λ in a disc around the shift, their right and left vectors, and the radius inside which all are known.

    Inside the widest circle that no eigenvalue is near, right and left eigenvalues are equally many.
    """
    lam, right, reach = operator.within(radius, most, restarts=restarts)
    if not len(lam):
        return lam, right, right, reach
    other, left, reach_left = operator.within(reach, most, adjoint=True, restarts=restarts)
    other = other.conj()
    known = min(reach, reach_left)
    away, away_left = np.abs(lam - operator.sigma), np.abs(other - operator.sigma)
    rims = np.sort(np.concatenate([away, away_left, [known]]))
    rims = np.append(rims[rims < known], known)
    middles = [known] + [(a + b) / 2 for a, b in zip(rims[-2::-1], rims[:0:-1], strict=True) if b - a > 1e-6 * b]
    for middle in middles:
        inner, inner_left = np.flatnonzero(away < middle), np.flatnonzero(away_left < middle)
        if len(inner) == len(inner_left):
            break
    else:
        inner, inner_left, middle = np.zeros(0, int), np.zeros(0, int), 0.0
    lam, right = lam[inner], right[:, inner]
    # The left mode of λ is the transposed problem's mode of λ*: ψᴴQ(λ) = 0 is Q(λ)ᴴψ = 0.
    _, partner = linear_sum_assignment(np.abs(lam[:, None] - other[None, inner_left]))
    return lam, right, left[:, inner_left[partner]], float(middle)
