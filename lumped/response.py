"""Free motion from given initial conditions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from .spectrum import state_matrix
from .springs import Floats

_REACH, _TERMS = 2.0, 28  # of the series: 2^28 / 28! < 1e-21


def solve_response(M: Floats, C: Floats, K: Floats, x0: ArrayLike, v0: ArrayLike, times: ArrayLike) -> Floats:
    """Solve M q̈ + C q̇ + K q = 0 by q(t) = [1 0] exp(A t) (x0, v0).

    The matrix exponential needs no eigenvectors. It is right where two of them fall into one: there the motion
    holds a term t sin ωt, which no sum of modes has.

    Parameters
    ----------
    M, C, K : (n, n) arrays
        M diagonal.
    x0, v0 : (n,) array_like, m and m/s
    times : (k,) array_like, s

    Returns
    -------
    (k, n) array, m

    Raises
    ------
    ValueError
        The initial conditions do not fit the matrices, or the motion leaves the range of floating point.

    Examples
    --------
    >>> import numpy as np
    >>> one, zero = np.eye(1), np.zeros((1, 1))
    >>> solve_response(one, zero, 4 * one, [1.0], [0.0], [0.0, np.pi / 2]).round(12)
    array([[ 1.],
           [-1.]])
    """
    n = len(M)
    start = np.concatenate([np.atleast_1d(np.asarray(x0, dtype=float)), np.atleast_1d(np.asarray(v0, dtype=float))])
    t = np.atleast_1d(np.asarray(times, dtype=float))
    if start.shape != (2 * n,) or not np.isfinite(start).all() or not np.isfinite(t).all() or t.ndim != 1:
        raise ValueError(f"expected {n} finite initial displacements, {n} velocities and a list of finite times")
    A = state_matrix(M, C, K)
    rate = max(np.sqrt(np.abs(A[n:, :n]).max()), np.abs(A[n:, n:]).max())
    balance = rate or 1.0  # displacements times a frequency stand beside velocities
    scale = np.repeat([balance, 1.0], n)
    A = scale[:, None] * A / scale
    # A few exponentials, and the series of exp(A r) from the nearest one before each instant: thousands of calls on
    # small matrices would cost a thousand times as much wherever LAPACK starts threads for each.
    block = _REACH / np.abs(A).sum(0).max()
    number, which = np.unique(np.floor((t - t.min()) / block), return_inverse=True)
    starts = t.min() + number * block
    with np.errstate(over="ignore", invalid="ignore"):
        state = np.stack([expm(A * s) @ (scale * start) for s in starts])[which]
        step = (t - starts[which])[:, None]
        term = state
        for k in range(1, _TERMS + 1):
            term = term @ A.T * step / k
            state = state + term
    motion = state[:, :n] / balance
    if not np.isfinite(motion).all():
        raise ValueError(f"the motion grows beyond 1e308 within {t.max():g} s; take a shorter time")
    return motion
