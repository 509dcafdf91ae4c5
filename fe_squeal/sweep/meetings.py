"""Changes of stability without dampers: two real eigenvalues meet and become a complex pair, or one passes zero."""

from __future__ import annotations

import numpy as np

from .changes import Asked, Change
from .samples import Samples


def find_meetings(samples: Samples) -> tuple[list[Change], float]:
    """Return the changes of stability of a group, and the width of the widest window that may have been missed.

    The width is a part of the interval, whose length is 1.

    Raises
    ------
    Asked
        The error of the group matrix is so large that a change cannot be told from none.
    """
    v, t = samples.v, samples.t
    low = samples.rounding  # a double real eigenvalue may have imaginary parts up to this by rounding
    hidden = _require_settled_pairs(samples, samples.cluster.error(t))
    complex_ = v.imag > low[:, None]
    if samples.turned:  # v = −iλ: those with Re v < 0 have Im λ < 0 and are mirror images of others
        complex_ &= v.real >= -low[:, None]
    pairs = complex_.sum(axis=1)
    negative = ((v.real < -samples.blur) & (np.abs(v.imag) <= low[:, None]) & (not samples.turned)).sum(axis=1)
    for end, at in ((0, 0), (1, -1)):  # at the ends modes were solved for, and their stability counts, not that of H
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
    if not len(chosen):  # the modes at the end are unstable, those of H are not: take the one nearest to a double one
        chosen = np.argsort(np.abs(v - v.mean()))[:1]
    each = int(np.sign(gains)) if gains else 0
    if pairs and negative:  # a pair becomes two negative θ, or the reverse
        each = gains
    return [samples.made(kind, each, k, there, int(i), limits) for i in chosen]


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
