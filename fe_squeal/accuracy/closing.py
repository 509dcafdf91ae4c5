"""Windows of instability that refining the mesh makes narrower, or closes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..sweep.onset import Onset


def with_closing_windows(onsets: Sequence[Onset], change: np.ndarray, bars: np.ndarray) -> np.ndarray:
    """Return the bars (k,) of onsets with those of narrow windows made as long as the law of a window has them.

    Two modes are coupled where the discriminant h² − (p − m)² is positive, so that a window of half width h about m
    has the ends m ∓ h. What a finer mesh changes is smooth in h², and not in h: as the window closes, its ends move the
    faster. With the changes δ of both ends by one refinement, h² and m are taken s times as far as that refinement
    takes them, where s is what the bar of an end is of its change. A window that is closed then may not exist, and
    where its ends are is not known: their bars are infinite.

    Parameters
    ----------
    onsets : sequence of Onset
        By rising value.
    change : (k,) float
        Of each value, by cutting every element into eight; NaN where it is not known.
    bars : (k,) float
    """
    found = bars.copy()
    opened: dict[frozenset[int | None], int] = {}
    for j, onset in enumerate(onsets):
        pair = frozenset((onset.branch_a, onset.branch_b))
        if onset.direction == "into":
            opened[pair] = j
            continue
        i = opened.pop(pair, None)
        if i is None or None in pair:
            continue
        ends, moved = np.array([onsets[i].value, onset.value]), change[[i, j]]
        size = np.abs(moved)
        if not (np.isfinite(bars[[i, j]]).all() and (size > 0).all()):
            continue
        middle, half = _window(ends)
        finer, less = _window(ends + moved)
        s = float((bars[[i, j]] / size).max())
        left = half**2 + s * (less * abs(less) - half**2)
        if left <= 0:
            found[[i, j]] = np.inf
            continue
        likely = middle + s * (finer - middle) + np.array([-1.0, 1.0]) * np.sqrt(left)
        found[[i, j]] = np.maximum(found[[i, j]], np.abs(likely - ends))
    return found


def _window(ends: np.ndarray) -> tuple[float, float]:
    return float(ends.mean()), float(ends[1] - ends[0]) / 2
