"""Choose the elements to refine, from their shares in an error."""

from __future__ import annotations

import numpy as np

from .raw import Floats, Ints


def doerfler(shares: Floats, part: float) -> Ints:
    """Return the smallest set of elements whose shares add up to a given part of the whole error.

    Source: W. Dörfler, "A convergent adaptive algorithm for Poisson's equation", SIAM J. Numer. Anal. 33, 1996.

    Parameters
    ----------
    shares : (m,) float
        What each element adds to the error, not negative, in any unit.
    part : float
        Part of the sum of the shares, above 0 and at most 1.

    Returns
    -------
    (k,) int
        The elements, by descending share.

    Raises
    ------
    ValueError
        A share is negative or not finite, or `part` is not above 0 and at most 1.

    Examples
    --------
    >>> doerfler(np.array([1.0, 5.0, 0.0, 4.0]), 0.6)
    array([1, 3])
    """
    shares = np.asarray(shares, dtype=float)
    if not (np.isfinite(shares) & (shares >= 0)).all():
        raise ValueError("shares of elements in an error are finite and not negative")
    if not 0 < part <= 1:
        raise ValueError(f"a part of {part:g} of the error; expected one above 0, at most 1")
    order = np.argsort(-shares, kind="stable")
    order = order[: np.count_nonzero(shares)]
    # Summed from the smallest share up, so that small ones do not vanish beside large ones.
    left = np.cumsum(shares[order][::-1])[::-1]  # the sum of each share and all smaller ones
    if not len(order):
        return order
    behind = np.append(left[1:], 0.0)
    enough = behind <= (1 - part) * left[0] * (1 + 1e-12)
    return np.asarray(order[: int(enough.argmax()) + 1])
