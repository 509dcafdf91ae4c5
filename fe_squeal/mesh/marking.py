"""Which elements to refine, from their shares in an error."""

from __future__ import annotations

import numpy as np

from .raw import Floats, Ints


def doerfler(shares: Floats, part: float) -> Ints:
    """Return the fewest elements that have a part of the whole error together, the largest shares first.

    W. Dörfler, A convergent adaptive algorithm for Poisson's equation, SIAM J. Numer. Anal. 33, 1996.

    Parameters
    ----------
    shares : (m,) float
        Not negative, of any unit.
    part : float
        Above 0, at most 1.

    Raises
    ------
    ValueError
        A share is negative or no number, or there is no such part.

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
    left = np.cumsum(shares[order][::-1])[::-1]  # of these and all smaller ones
    if not len(order):
        return order
    behind = np.append(left[1:], 0.0)
    enough = behind <= (1 - part) * left[0] * (1 + 1e-12)
    return np.asarray(order[: int(enough.argmax()) + 1])
