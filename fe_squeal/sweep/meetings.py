"""Changes of stability without dampers: two real eigenvalues meet and become a complex pair, or one passes zero."""

from __future__ import annotations

import numpy as np

from .changes import Asked, Change
from .samples import NEAR_ZERO, Samples, between

_ROUNDS = 12  # in which samples are added where a real θ turns, at most


def find_meetings(samples: Samples) -> tuple[list[Change], float]:
    """Return the changes of stability of a group, and the width of the widest window that may have been missed.

    The width is a part of the interval, whose length is 1.

    Raises
    ------
    Asked
        The error of the group matrix is so large that a change cannot be told from none.
    """
    _resolve_turns(samples)
    v, t = samples.v, samples.t
    low = samples.rounding  # a double real eigenvalue may have imaginary parts up to this by rounding
    hidden = _require_settled_pairs(samples, samples.cluster.error(t))
    complex_ = v.imag > low[:, None]
    if samples.turned:  # v = −iλ: those with Re v < 0 have Im λ < 0 and are mirror images of others
        complex_ &= v.real >= -low[:, None]
    pairs = complex_.sum(axis=1)
    negative = ((v.real < -samples.blur) & (np.abs(v.imag) <= low[:, None]) & (not samples.turned)).sum(axis=1)
    # At the ends modes were solved for, and their stability counts, not that of H; but what parts copies is an error.
    for end, at in ((0, 0), (1, -1)):
        if samples.twins(samples.v[[at]], samples.condition[[at]]).any():
            continue
        node, s = samples.cluster.ends[end], samples.cluster.members[end]
        swinging = node.lam[s].imag >= 0 if samples.turned else node.lam[s].imag > 0
        pairs[at] = np.count_nonzero(node.unstable[s] & swinging)
        # In a gyroscopic system those with Re v < 0 are mirror images and do not count.
        negative[at] = 0 if samples.turned else np.count_nonzero(node.unstable[s] & ~swinging)
    jumps = np.flatnonzero((np.diff(pairs) != 0) | (np.diff(negative) != 0))
    found = []
    for n, k in enumerate(jumps):
        limits = (t[jumps[n - 1] + 1] if n else 0.0, t[jumps[n + 1]] if n + 1 < len(jumps) else 1.0)
        found += _change(samples, int(k), int(pairs[k + 1] - pairs[k]), int(negative[k + 1] - negative[k]), limits)
    return found, hidden


def _resolve_turns(samples: Samples) -> None:
    """Add samples where a real θ may pass zero and return between two of them.

    Raises
    ------
    Asked
        The error of the group matrix is larger than a θ that turns beside zero.
    """
    if samples.turned:  # λ = 0 is no edge of stability of these groups
        return
    turns = np.zeros(0)
    for _ in range(_ROUNDS):
        more = _turns(samples)
        if not len(more):
            break
        samples.insert(more)
        turns = np.append(turns, more)
    if len(turns):
        at = np.searchsorted(samples.t, turns)
        unsure = samples.cluster.error(turns)
        nearest = np.abs(samples.v[at]).min(axis=1)
        hides = (nearest <= unsure) & (nearest > samples.blur)
        if hides.any():
            raise Asked(float(turns[np.argmax(hides)]))


def _turns(samples: Samples) -> np.ndarray:
    """Return t between two samples where a real θ, which has one sign at both, turns near zero or beyond it."""
    v, slope, h = samples.v, samples.slope, np.diff(samples.t)
    reach = h * np.maximum(np.abs(slope[:-1]).max(axis=1), np.abs(slope[1:]).max(axis=1))
    least = np.minimum(np.abs(v[:-1]).min(axis=1), np.abs(v[1:]).min(axis=1))
    low, found = samples.rounding, []
    for k in np.flatnonzero((least <= 2 * reach) & (h > samples.finest)).tolist():
        order = samples.order(k + 1)
        g0, g1 = v[k].real, v[k + 1].real[order]
        real = (np.abs(v[k].imag) <= low[k]) & (np.abs(v[k + 1].imag[order]) <= low[k + 1])
        sign = np.where((g0 > samples.blur) & (g1 > samples.blur), 1, 0)
        sign -= (g0 < -samples.blur) & (g1 < -samples.blur)
        rates = slope[k].real * h[k], slope[k + 1].real[order] * h[k]
        cubic = sign * between((g0, g1), rates)
        lowest, ends = cubic.min(axis=0), (sign * g0, sign * g1)
        falls = np.maximum(*ends) - lowest
        turning = real & (sign != 0) & (lowest < np.minimum(*ends)) & (lowest < NEAR_ZERO * falls)
        found += [float(samples.t[k] + h[k] * (i + 1) / 16) for i in cubic.argmin(axis=0)[turning]]
    return np.unique(found)


def _change(samples: Samples, k: int, pairs: int, negative: int, limits: tuple[float, float]) -> list[Change]:
    gains = pairs + negative
    kind = "meeting" if pairs else "zero"
    many = abs(pairs) if pairs else abs(negative)
    there = k + 1 if pairs > 0 or (not pairs and negative > 0) else k  # the sample with more unstable modes
    v = samples.v[there]
    if pairs:
        upper = np.flatnonzero(v.imag > samples.rounding[there])
        chosen = upper[np.argsort(v[upper].imag)][:many]
    else:
        chosen = np.argsort(np.abs(v))[:many]
    if not len(chosen):  # modes at the end are unstable, those of H are not: take the ones nearest to a double one
        chosen = np.argsort(np.abs(v - v.mean()), kind="stable")[:many]
    each = int(np.sign(gains)) if gains else 0
    if pairs and negative:  # a pair becomes two negative θ, or the reverse
        each = gains
    return [samples.made(kind, each, k, there, int(i), limits, chosen) for i in chosen]


def _require_settled_pairs(samples: Samples, error: np.ndarray) -> float:
    """Check that no pair of eigenvalues may meet and part again unseen, or only seems to, by the error of H.

    Returns the width of the widest window, in t, that this error may still hide.

    Raises
    ------
    Asked
        A wider window may be hidden.
    """
    v, t, m = samples.v, samples.t, samples.cluster.m
    hidden = 0.0
    if m == 1:
        near = np.abs(v[:, 0].real) <= error
        if near.any() and np.sign(v[0, 0].real) == np.sign(v[-1, 0].real):
            raise Asked(float(t[np.argmax(near)]))
        return hidden
    i, j = np.triu_indices(m, 1)
    D = ((v[:, i] - v[:, j]) / 2) ** 2
    blurred = samples.blurred(i, j, error)
    drift = np.abs(samples.slope[:, i] - samples.slope[:, j])
    # Two eigenvalues may meet if both are real or they are conjugate to each other: then D is real.
    meant = np.abs(D.imag) <= 1e-6 * np.abs(D) + samples.blur**2
    doubtful = meant & (np.abs(D.real) <= blurred) & (blurred > samples.rounding[:, None] ** 2)
    doubtful &= ~samples.twins(v, samples.condition)[:, i, j]  # copies do not meet, they are equal all along
    for pair in np.flatnonzero(doubtful.any(axis=0)):
        d, unsure = D[:, pair].real, doubtful[:, pair]
        # If D is sure before and behind a run of unsure samples and has different signs there, it passes zero once.
        edges = np.flatnonzero(np.diff(np.concatenate([[0], unsure.astype(int), [0]])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            before = np.sign(d[begin - 1]) if begin else 0
            behind = np.sign(d[end]) if end < len(d) else 0
            if before * behind < 0 or (not before and not behind and len(d) == end):
                continue
            # The two eigenvalues may be a pair as long as their distance, |drift| t, is below twice √(error of D).
            best = begin + int(np.argmin(np.abs(d[begin:end])))
            steep = np.median(drift[max(begin - 1, 0) : end + 1, pair])
            width = 4 * np.sqrt(blurred[best, pair]) / steep if steep > 0 else 1.0
            width = min(float(width), float(t[min(end, len(t) - 1)] - t[max(begin - 1, 0)]))
            if width > samples.settled:
                raise Asked(float(t[best]))
            hidden = max(hidden, width)
    return hidden
