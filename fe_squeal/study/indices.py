"""Sobol indices: which scattered number the scatter of a result comes from.

First-order indices are estimated from the samples of the scatter itself, total indices from as many further ones. Both
estimators are right for correlated numbers too, which Saltelli's sampling scheme is not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import norm

_CARRIED = 20  # samples: where the variance of Y is that of fewer, its indices are not known
_UNSEEN = 0.05  # probability of seeing no sample change, with the largest part of them that is not ruled out
_BOOTSTRAPS = 200  # resampled estimates, from which the error of an index is taken
_SEED = 20251122
_HALF = float(norm.ppf(0.975))  # standard deviations on either side of a 95 % interval

Interval = tuple[float, float]  # a number, and half the width of its 95 % interval


def first_order(x: np.ndarray, y: np.ndarray) -> Interval:
    """Return Var(E[Y | X]) / Var(Y) from samples of X and Y, with its error.

    The samples are sorted by X. Neighbours have nearly the same X, so that their Y differ by what the other numbers do:
    half the mean square difference estimates E[Var(Y | X)], however steep E[Y | X] is and however many samples have the
    same X (as F. Gamboa, P. Gremaud, T. Klein, A. Lagnoux, Bernoulli 28, 2022, with products of Y). Pairs farther apart
    are as good where E[Y | X] is smooth, and there are more of them. Too wide a neighbourhood only makes the index
    smaller, by the slope of E[Y | X] in it, and so does too narrow a one of Sobol points, which are laid so that
    neighbours in X are far apart in the other numbers: in a neighbourhood of w samples by (1 - index)/w at most. So the
    width is taken whose index has the highest lower bound. An error is from random halves of the samples, about the
    estimate from all of them, and so has the bias by the slope too. Where a few samples alone make Y vary, as a rare
    instability, nothing is known.

    Parameters
    ----------
    x, y : (m,) float
        Samples of X, and Y at each; samples where Y is not finite, as the growth rate of no mode, do not count.

    Returns
    -------
    index, error : float
        The index, and half the width of its 95 % interval; NaN if Y is constant, or varies by a few samples alone.

    Examples
    --------
    >>> x = np.random.default_rng(0).random((4000, 2))
    >>> index, error = first_order(x[:, 0], 2 * x[:, 0] + x[:, 1])
    >>> abs(index - 0.8) < error < 0.05
    True
    """
    known = np.isfinite(y)
    x, y = x[known], y[known]
    m = len(y)
    if not _is_carried(y):
        return np.nan, np.nan
    rng = np.random.default_rng(_SEED)
    y = y[np.lexsort((rng.random(m), x))]  # equal values in random order
    halves = np.sort(rng.permuted(np.tile(np.arange(m), (_BOOTSTRAPS, 1)), axis=1)[:, : m // 2], axis=1)
    widths = 2 ** np.arange(int(np.log2(np.sqrt(m))) + 1)
    whole, parts = _of_neighbours(y[None], widths)[0], _of_neighbours(y[halves], widths)
    known = np.isfinite(parts[:, 0])
    if known.sum() < 2:
        return float(whole[0]), np.nan
    laid = (1 - whole) / widths
    best = int(np.argmax(whole - np.hypot(_HALF * parts[known].std(axis=0), laid)))
    error = _HALF * np.sqrt(((parts[known, best] - whole[best]) ** 2).mean())
    return float(whole[best]), float(np.hypot(error, laid[best]))


def _is_carried(y: np.ndarray) -> bool:
    """Return whether Y (m,) varies, and by enough samples: (Σ s)²/Σ s², with s the square of a deviation from the mean.

    It is m for samples that deviate by as much each, and about n where n of many have another Y than the rest.
    """
    square = (y - y.mean()) ** 2 if len(y) else y
    return bool(square.any() and square.sum() ** 2 >= _CARRIED * (square**2).sum())


def _of_neighbours(y: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Return (n, w) estimates of the index, by pairs up to each of w distances in sorted samples y (n, m).

    NaN where a row is constant. The sum of (y_i − y_j)² over pairs of one distance is one of squares, less twice an
    autocorrelation.
    """
    z = y - y.mean(axis=1, keepdims=True)
    m, most = z.shape[1], int(widths.max())
    spectrum = np.abs(np.fft.rfft(z, 2 * m, axis=1)) ** 2
    products = np.fft.irfft(spectrum, 2 * m, axis=1)[:, 1 : most + 1]
    squares = z**2
    ends = np.cumsum(squares[:, :most], axis=1) + np.cumsum(squares[:, ::-1][:, :most], axis=1)
    sums = np.cumsum(2 * squares.sum(axis=1, keepdims=True) - ends - 2 * products, axis=1)
    pairs = np.cumsum(m - np.arange(1, most + 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        found = 1 - (sums / pairs)[:, widths - 1] / (2 * z.var(axis=1, ddof=1, keepdims=True))
    return np.where(np.ptp(y, axis=1, keepdims=True) > 0, found, np.nan)


def total_order(y: np.ndarray, changed: np.ndarray) -> Interval:
    """Return E[Var(Y | all numbers but X)] / Var(Y), with its error.

    Parameters
    ----------
    y, changed : (m,) float
        Y at samples, and Y at the same samples with X drawn anew while the other numbers stay (M. J. W. Jansen, Comput.
        Phys. Commun. 117, 1999). Samples where one of them is not finite do not count.

    Returns
    -------
    index, error : float
        The index, and half the width of its 95 % interval; NaN if Y is constant, or varies by a few samples alone: of
        these, resampled ones are too much like each other to tell the error.

    Examples
    --------
    >>> x, new = np.random.default_rng(0).random((2, 4000, 2))
    >>> index, error = total_order(2 * x[:, 0] + x[:, 1], 2 * new[:, 0] + x[:, 1])
    >>> abs(index - 0.8) < error < 0.06
    True
    """
    known = np.isfinite(y) & np.isfinite(changed)
    y, changed = y[known], changed[known]
    if not _is_carried(np.concatenate([y, changed])):
        return np.nan, np.nan
    if np.array_equal(y, changed):  # so would all resampled ones be
        unseen = 1 - _UNSEEN ** (1 / len(y))  # the part that X may change, although it changes none of these
        return 0.0, float(unseen * np.ptp(y) ** 2 / 2 / y.var())

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
