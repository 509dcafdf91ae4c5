"""Sobol indices: which scattered number the scatter of a result comes from.

First-order indices are estimated from the samples of the scatter itself, total indices from as many further ones. Both
estimators are right for correlated numbers too, which Saltelli's sampling scheme is not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import norm

_BOOTSTRAPS = 200  # resampled estimates, from which the error of an index is taken
_SEED = 20251122
_HALF = float(norm.ppf(0.975))  # standard deviations on either side of a 95 % interval

Interval = tuple[float, float]  # a number, and half the width of its 95 % interval


def first_order(x: np.ndarray, y: np.ndarray) -> Interval:
    """Return Var(E[Y | X]) / Var(Y) from samples of X and Y, with its error.

    The samples are sorted by X into about √m groups of equal size. The variance of the groups' means, minus the part of
    it that the scatter inside the groups explains, estimates Var(E[Y | X]) (analysis of variance with random effects).

    Parameters
    ----------
    x, y : (m,) float
        Samples of X, and Y at each.

    Returns
    -------
    index, error : float
        The index, and half the width of its 95 % interval; NaN if Y is constant.

    Examples
    --------
    >>> x = np.random.default_rng(0).random((4000, 2))
    >>> index, error = first_order(x[:, 0], 2 * x[:, 0] + x[:, 1])
    >>> abs(index - 0.8) < error < 0.05
    True
    """
    if np.ptp(y) == 0:
        return np.nan, np.nan
    rng = np.random.default_rng(_SEED)
    order = np.lexsort((rng.random(len(x)), x))  # equal values in random order
    return _with_error(len(y), lambda pick: _between_groups(y[order][np.sort(pick)]), rng)


def _between_groups(y: np.ndarray) -> float:
    count = max(int(np.sqrt(len(y))), 2)
    size = len(y) // count
    groups = y[: count * size].reshape(count, size)
    inside = groups.var(axis=1, ddof=1).mean()
    between = groups.mean(axis=1).var(ddof=1) - inside / size
    whole = between + inside
    return float(between / whole) if whole > 0 else np.nan


def total_order(y: np.ndarray, changed: np.ndarray) -> Interval:
    """Return E[Var(Y | all numbers but X)] / Var(Y), with its error.

    Parameters
    ----------
    y, changed : (m,) float
        Y at samples, and Y at the same samples with X drawn anew while the other numbers stay (M. J. W. Jansen, Comput.
        Phys. Commun. 117, 1999).

    Returns
    -------
    index, error : float
        The index, and half the width of its 95 % interval; NaN if Y is constant.

    Examples
    --------
    >>> x, new = np.random.default_rng(0).random((2, 4000, 2))
    >>> index, error = total_order(2 * x[:, 0] + x[:, 1], 2 * new[:, 0] + x[:, 1])
    >>> abs(index - 0.8) < error < 0.06
    True
    """
    if np.ptp(y) == 0 and np.ptp(changed) == 0:
        return np.nan, np.nan

    def estimate(pick: np.ndarray) -> float:
        both = np.concatenate([y[pick], changed[pick]])
        variance = both.var()
        return float(((y[pick] - changed[pick]) ** 2).mean() / 2 / variance) if variance > 0 else np.nan

    return _with_error(len(y), estimate, np.random.default_rng(_SEED))


def _with_error(count: int, estimate: Callable[[np.ndarray], float], rng: np.random.Generator) -> Interval:
    """Return an estimate from all samples, and 1.96 times its standard deviation over resampled ones (bootstrap)."""
    picks = rng.integers(0, count, (_BOOTSTRAPS, count))
    found = np.array([estimate(pick) for pick in picks])
    found = found[np.isfinite(found)]
    error = float(_HALF * found.std(ddof=1)) if len(found) > 1 else np.nan
    return estimate(np.arange(count)), error


def index_rows(
    names: Sequence[str], x: np.ndarray, outputs: dict[str, np.ndarray], again: dict[str, np.ndarray] | None
) -> list[tuple[str, str, float, float, float, float]]:
    """Return rows of parameter, output, first-order index and its error, total index and its error.

    Parameters
    ----------
    names : sequence of str
        The d parameters.
    x : (m, d) float
        Their values at m samples.
    outputs : mapping of str to (m,) float
        The outputs by name, at each sample.
    again : mapping of str to (d, k) float, optional
        The outputs at the first k samples, with one parameter after the other drawn anew; without it total indices are
        NaN.
    """
    rows = []
    for output, y in outputs.items():
        for i, name in enumerate(names):
            total = (np.nan, np.nan)
            if again is not None and again[output].shape[1]:
                total = total_order(y[: again[output].shape[1]], again[output][i])
            rows.append((name, output, *first_order(x[:, i], y), *total))
    return rows
