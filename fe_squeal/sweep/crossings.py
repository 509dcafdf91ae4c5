"""Changes of stability with dampers or complex stiffness: eigenvalues that cross the imaginary axis."""

from __future__ import annotations

import itertools

import numpy as np

from .changes import Asked, Change
from .samples import NEAR_ZERO, Samples, between, diagonals

_SAFE = 4.0  # times the difference of the cubic H from a parabola: taken for its error
_REAL = 1e-6  # of |λ|: a real eigenvalue has less of an imaginary part
_VARIES = 8.0  # times the error of H: its slope over the interval (t from 0 to 1) is taken to be at most so large


def _growth(samples: Samples, v: np.ndarray) -> np.ndarray:
    """Return Re λ of eigenvalues v, which are λ, or θ = −λ²: then of that root λ which has Im λ ≥ 0."""
    return v.real if not samples.theta else np.sqrt(-v + 0j).real * np.where(np.sqrt(-v + 0j).imag < 0, -1.0, 1.0)


def find_crossings(samples: Samples) -> tuple[list[Change], float]:
    """Return the changes of stability of a group, and the width of the widest window that may have been missed.

    The width is a part of the interval, whose length is 1.

    Raises
    ------
    Asked
        The error of the group matrix is so large that a change cannot be told from none.
    """
    _follow(samples)
    t, growth, error = samples.t, _growth(samples, samples.v), samples.cluster.error(samples.t)
    if samples.theta:
        rate = 2 * np.sqrt(np.abs(samples.v).mean())
        blur, error = samples.blur / rate, error / rate
    else:
        blur = samples.blur
    i, j = np.triu_indices(samples.cluster.m, 1)
    apart = np.abs(samples.v[:, i] - samples.v[:, j]).min(axis=1, initial=np.inf)
    # An error of H moves an eigenvalue by the error times its condition number; close to a meeting by the root of it.
    distance = np.maximum(apart, error)
    amplified = error + samples.departure * np.divide(error, distance, out=np.zeros_like(error), where=distance > 0)
    worst = np.sqrt(error * (error + samples.departure)) + error
    group = np.minimum(amplified, worst) if samples.cluster.m > 1 else error
    hidden, shifts = samples.finest, _SAFE * _shifts(samples)
    found: list[tuple[int, int, Change]] = []
    unstable = (growth > blur) & _in_the_law(samples)
    for end, at in ((0, 0), (1, -1)):
        node, s = samples.cluster.ends[end], samples.cluster.members[end]
        near = np.abs(node.v[s][:, None] - samples.v[at][None, :]).argmin(axis=0)
        unstable[at] = node.unstable[s[near]]
    for b in range(samples.cluster.m):
        g, up = growth[:, b], unstable[:, b]
        unsure = np.fmin(group, error * samples.condition[:, b])
        jumps = np.flatnonzero(np.diff(up))
        borders = [0, *(int(k) + 1 for k in jumps), len(t)]
        for begin, end in itertools.pairwise(borders):
            inside = slice(begin, end)
            at_end = begin == 0 or end == len(t)  # at the ends modes were solved for, and H is not needed
            sure = at_end or bool((np.abs(g[inside]) > unsure[inside]).any())
            close = ~up[inside] & (g[inside] > -unsure[inside]) & (unsure[inside] > blur)
            close[[0, -1]] = False
            if not sure or (close[1:-1].any() and not _towards_a_change(close)):
                best = begin + int(np.argmax(g[inside]))
                if 0 < best < len(t) - 1:
                    raise Asked(float(t[best]))
        hidden = max(hidden, _hidden(samples, g, shifts[:, b], blur))
        for n, k in enumerate(jumps):
            limits = (t[jumps[n - 1] + 1] if n else 0.0, t[jumps[n + 1]] if n + 1 < len(jumps) else 1.0)
            gains = 1 if up[k + 1] else -1
            there = int(k + 1 if up[k + 1] else k)
            if not samples.theta and _is_mirror_image(samples, unstable, int(k), there, b):
                continue
            alike = np.flatnonzero((unstable[k] == up[k]) & (unstable[k + 1] == up[k + 1]))
            found.append((int(k), b, samples.made("crossing", gains, int(k), there, b, limits, alike)))
    crossed = np.zeros(len(t) - 1, int)
    for at_sample, _, change in found:
        crossed[at_sample] += change.gains
    paired = not (samples.theta or samples.cluster.ends[0].is_complex)
    partings = _partings(samples, unstable, blur, crossed) if paired else []
    return [*(c for _, _, c in found), *partings], hidden


def _in_the_law(samples: Samples) -> np.ndarray:
    """Return (s, m) bool, whether an eigenvalue oscillates, of which alone complex stiffness says something."""
    if not samples.cluster.ends[0].is_complex:
        return np.ones(samples.v.shape, bool)
    lam = np.sqrt(-samples.v + 0j) if samples.theta else samples.v
    return np.asarray(np.abs(lam.real) < np.abs(lam.imag))


def _is_mirror_image(samples: Samples, unstable: np.ndarray, k: int, there: int, b: int) -> bool:
    """Whether eigenvalue b, whose stability changes behind sample k, is the mirror image of one that does so too.

    Where a pair with almost no damping meets at λ = 0, one of its eigenvalues goes on along the real axis and grows. It
    may be the one that came from below, and H leaves it beside the axis by its error: then it is real a little later.
    """
    v = samples.v[:, b]
    below = v.imag < -_REAL * np.abs(v) - samples.blur
    if not below[there]:
        return False
    up, at = unstable[:, b], there
    while up[k + 1] and at + 1 < len(v) and up[at + 1]:  # to the end of the stretch in which it grows
        at += 1
    while up[k] and at > 0 and up[at - 1]:
        at -= 1
    stretch = slice(min(at, there), max(at, there) + 1)
    others = (unstable[k] != unstable[k + 1]) & (np.arange(samples.cluster.m) != b)
    mirrored = others & (np.abs(samples.v[there] - v[there].conj()) < np.abs(v[there].imag))
    return bool(mirrored.any() or below[stretch].all())


def _shifts(samples: Samples) -> np.ndarray:
    """Return how far (s, m) each Re λ moves, to first order, if H is changed from the cubic to a parabola."""
    with np.errstate(all="ignore"):
        try:
            inverse = np.linalg.inv(samples.W)
        except np.linalg.LinAlgError:
            inverse = np.linalg.pinv(samples.W)
        shift = diagonals(inverse, samples.cluster.remainder(samples.t), samples.W)
        if samples.theta:
            shift = shift / (2 * np.sqrt(-samples.v + 0j))
    return np.nan_to_num(np.abs(shift.real), nan=np.inf)


def _hidden(samples: Samples, growth: np.ndarray, unsure: np.ndarray, blur: float) -> float:
    """Return the width of the widest window of instability, in t, that errors of one Re λ may hide near its zeros.

    Where Re λ passes zero more steeply than its error can change, it passes zero once, and nothing is hidden.

    Parameters
    ----------
    growth : (s,) float
        Re λ at the samples.
    unsure : (s,) float
        Its error.
    blur : float
        What rounding alone makes of it.

    Raises
    ------
    Asked
        Such a window may be wider than `SETTLED`.
    """
    near = (np.abs(growth) <= unsure) & (unsure > blur)
    k, t, widest = np.flatnonzero(near), samples.t, 0.0
    for run in np.split(k, np.flatnonzero(np.diff(k) > 1) + 1) if len(k) else []:
        before, behind = max(int(run[0]) - 1, 0), min(int(run[-1]) + 1, len(t) - 1)
        steepness = abs(growth[behind] - growth[before]) / (t[behind] - t[before])
        if steepness <= _VARIES * unsure[run].max():
            widest = max(widest, float(t[behind] - t[before]))
            if widest > samples.settled:
                raise Asked(float(t[(before + behind) // 2]))
    return widest


def _partings(samples: Samples, unstable: np.ndarray, blur: float, crossed: np.ndarray) -> list[Change]:
    """Return the changes where a growing pair λ, λ* becomes two growing real λ, or the reverse.

    A pair counts as one unstable mode, two real λ as two, so that the number of unstable modes changes. Where no real λ
    comes or goes nothing parts.

    Parameters
    ----------
    unstable : (s, m) bool
        Which eigenvalues grow at the samples: the verdict that `crossed` is counted by.
    blur : float
        How far Re λ may be off by rounding.
    crossed : (s − 1,) int
        Number of unstable modes gained between two samples by crossings of the imaginary axis.
    """
    real = np.abs(samples.v.imag) <= 1e-9 * np.abs(samples.v) + np.maximum(blur, samples.rounding)[:, None]
    single = (real & unstable).sum(axis=1)
    pairs = (~real & unstable & (samples.v.imag > 0)).sum(axis=1)
    found = []
    rest = np.diff(pairs + single) - crossed
    jumps = np.flatnonzero((np.diff(pairs) != 0) | (np.diff(single) != 0) | (crossed != 0))
    for n, k in enumerate(jumps):
        if pairs[k] == pairs[k + 1] or single[k] == single[k + 1] or not rest[k]:
            continue
        gains = int(rest[k])
        before = samples.t[jumps[n - 1] + 1] if n else 0.0
        limits = (float(before), float(samples.t[jumps[n + 1]]) if n + 1 < len(jumps) else 1.0)
        there = int(k + 1 if pairs[k + 1] > pairs[k] else k)  # the sample at which they are a pair
        upper = np.flatnonzero(~real[there] & unstable[there] & (samples.v[there].imag > 0))
        parted = upper[np.argsort(samples.v[there, upper].imag)][: abs(gains)]
        each = int(np.sign(gains))
        found += [samples.made("parting", each, int(k), there, int(i), limits, parted) for i in parted]
    return found


def _follow(samples: Samples) -> None:
    """Order the eigenvalues of every sample like those of the sample before: each column follows one eigenvalue.

    Samples are added where an eigenvalue crosses the imaginary axis and returns between two of them.
    """
    for _ in range(12):
        for k in range(1, len(samples.t)):
            order = samples.order(k)
            samples.v[k], samples.slope[k] = samples.v[k][order], samples.slope[k][order]
            samples.W[k], samples.condition[k] = samples.W[k][:, order], samples.condition[k][order]
        more = _turning_points(samples)
        if not len(more):
            return
        samples.insert(more)


def _turning_points(samples: Samples) -> np.ndarray:
    """Return values of t between two samples where Re λ may have another sign than at both of them.

    Between two samples Re λ is taken to be the cubic with the values and slopes at both. Since it is not quite that, a
    sample is added too where the cubic turns near zero.
    """
    growth = _growth(samples, samples.v)
    rate = samples.slope.real if not samples.theta else -samples.slope.imag / (2 * np.sqrt(np.abs(samples.v)))
    h = np.diff(samples.t)[:, None]
    g0, g1, d0, d1 = growth[:-1], growth[1:], rate[:-1] * h, rate[1:] * h
    cubic = between((g0, g1), (d0, d1))
    high, low = cubic.max(axis=0), cubic.min(axis=0)
    least, most = np.minimum(g0, g1), np.maximum(g0, g1)
    missed = (most < 0) & (high > most) & (high > -NEAR_ZERO * (high - least))
    missed |= (least > 0) & (low < least) & (low < NEAR_ZERO * (most - low))
    missed &= h > samples.finest
    at = np.where((g0 < 0), cubic.argmax(axis=0), cubic.argmin(axis=0))
    k, b = np.nonzero(missed)
    return np.unique(samples.t[k] + np.diff(samples.t)[k] * (at[k, b] + 1) / 16)


def _towards_a_change(close: np.ndarray) -> bool:
    """Return whether all samples of a stable stretch with Re λ near zero are at its ends, where stability changes."""
    k = np.flatnonzero(close)
    runs = np.split(k, np.flatnonzero(np.diff(k) > 1) + 1)
    return all(int(run[0]) <= 1 or int(run[-1]) >= len(close) - 2 for run in runs)
