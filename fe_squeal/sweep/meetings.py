"""Changes of stability without dampers: real eigenvalues that meet and become a pair, or that pass zero."""

from __future__ import annotations

import numpy as np

from .changes import Asked, Change
from .samples import Samples


def find_meetings(samples: Samples) -> tuple[list[Change], float]:
    """Return what changes, and up to which share of the interval a window may have been hidden.

    Raises
    ------
    Asked
    """
    v, t = samples.v, samples.t
    low = samples.rounding  # D of a complex pair is −Im²
    hidden = _require_settled_pairs(samples, samples.cluster.error(t))
    complex_ = v.imag > low[:, None]
    if samples.turned:  # without mirror images below the real axis of λ
        complex_ &= v.real >= -low[:, None]
    pairs = complex_.sum(axis=1)
    negative = ((v.real < -samples.blur) & (np.abs(v.imag) <= low[:, None]) & (not samples.turned)).sum(axis=1)
    for end, at in ((0, 0), (1, -1)):  # at the ends the modes themselves say what they are
        node, s = samples.cluster.ends[end], samples.cluster.members[end]
        swinging = node.lam[s].imag >= 0 if samples.turned else node.lam[s].imag > 0
        pairs[at] = np.count_nonzero(node.unstable[s] & swinging)
        negative[at] = np.count_nonzero(node.unstable[s] & ~swinging)
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
    there = k + 1 if pairs > 0 or (not pairs and negative > 0) else k  # the end where there are more of them
    v = samples.v[there]
    if pairs:
        upper = np.flatnonzero(v.imag > samples.rounding[there])
        chosen = upper[np.argsort(v[upper].imag)][:many]
    else:
        chosen = np.argsort(np.abs(v))[:many]
    if not len(chosen):  # the modes at the end say more than H: nearest to a double eigenvalue or to zero
        chosen = np.argsort(np.abs(v - v.mean()))[:1]
    each = int(np.sign(gains)) if gains else 0
    if pairs and negative:  # a pair parts on the negative axis, or two of it couple
        each = gains
    return [samples.made(kind, each, k, there, int(i), limits) for i in chosen]


def _require_settled_pairs(samples: Samples, error: np.ndarray) -> float:
    """Ask for a value where an error of H could make a pair that stays apart meet, or undo a window."""
    v, t, m = samples.v, samples.t, samples.cluster.m
    hidden = 0.0
    if m == 1:
        near = np.abs(v[:, 0].real) <= error
        if near.any() and np.sign(v[0, 0].real) == np.sign(v[-1, 0].real):
            raise Asked(float(t[np.argmax(near)]))
        return hidden
    i, j = np.triu_indices(m, 1)
    D = ((v[:, i] - v[:, j]) / 2) ** 2
    doubt = samples.doubt(i, j, error)
    drift = np.abs(samples.slope[:, i] - samples.slope[:, j])
    for pair in range(len(i)):
        # The real part counts of pairs that are both real or conjugate to each other; others do not meet.
        d = D[:, pair].real
        meant = np.abs(D[:, pair].imag) <= 1e-6 * np.abs(D[:, pair]) + samples.blur**2
        unsure = meant & (np.abs(d) <= doubt[:, pair]) & (doubt[:, pair] > samples.rounding**2)
        if not unsure.any():
            continue
        # A run of unsure samples between sure ones of different sign is one change, which is there in any case.
        edges = np.flatnonzero(np.diff(np.concatenate([[0], unsure.astype(int), [0]])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            before = np.sign(d[begin - 1]) if begin else 0
            behind = np.sign(d[end]) if end < len(d) else 0
            if before * behind < 0 or (not before and not behind and len(d) == end):
                continue
            # How wide a window may hide: where |slope| t equals the root of what D may be off.
            best = begin + int(np.argmin(np.abs(d[begin:end])))
            steep = np.median(drift[max(begin - 1, 0) : end + 1, pair])
            width = 4 * np.sqrt(doubt[best, pair]) / steep if steep > 0 else 1.0
            width = min(float(width), float(t[min(end, len(t) - 1)] - t[max(begin - 1, 0)]))
            if width > samples.settled:
                raise Asked(float(t[best]))
            hidden = max(hidden, width)
    return hidden
