"""Curves of the growth rate between the points of a branch: values of the sweep, and onsets."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.interpolate import Akima1DInterpolator

from fe_squeal.report.branches import Branch, Floats, collect_branches, numbers

_DENSE = np.linspace(0.0, 1.0, 33)  # of a step: points at which a curve is evaluated
_LARGEST = 1e6  # of a neighbour's growth to that of a step: beyond that it has nothing to say there
_SLOWEST = 0.5  # of the growth at the next value: what would grow to less than this by its speed is drawn as a line


def growth_curves(branch: Branch) -> list[Floats]:
    """Return the curve of the growth rate from each point of a branch to the next, (m, 2): parameter, and Re λ in 1/s.

    With s the distance from an onset and c its crossing speed, growth from an onset to the next value begins as c√s if
    two modes meet there, and as cs otherwise, and ends at the next value, see `_beginning`. In a window of
    width w between two onsets it is c√(s(w − s)/w) or c s(w − s)/w. Between two values of a branch that has met another
    one (Re λ)² is interpolated, which is linear beyond a square root, see `_squares`. All other points are joined by
    straight lines.
    """
    points = np.column_stack([branch.value, branch.re])
    curves = list(segments(points))
    for i in np.flatnonzero(branch.joined).tolist():
        (p0, r0), (p1, r1) = points[i : i + 2]
        width = p1 - p0
        if branch.windows[i]:
            s = width * _DENSE
            c0, c1 = branch.speed[i : i + 2]
            c0, c1 = (c if np.isfinite(c) else other for c, other in ((c0, c1), (c1, c0)))
            bump = s * (width - s) / width
            bump = np.sqrt(bump) if branch.rooted[i] else bump
            curves[i] = np.column_stack([p0 + s, bump * np.nan_to_num(c0 + (c1 - c0) * _DENSE)])
        elif branch.onset[i] == 1 and branch.onset[i + 1] == 0:
            s, r = _beginning(width, r1, branch.speed[i], _is_rooted(branch, i, width, r1))
            curves[i] = np.column_stack([p0 + s, r])
        elif branch.onset[i + 1] == -1 and branch.onset[i] == 0:
            s, r = _beginning(width, r0, branch.speed[i + 1], _is_rooted(branch, i + 1, width, r0))
            curves[i] = np.column_stack([p1 - s, r])[::-1]
        elif branch.rooted.any() and np.sign(r0) * np.sign(r1) > 0 and np.isfinite([r0, r1]).all():
            curves[i] = np.column_stack([p0 + width * _DENSE, _squares(branch, i)])
    return curves


def _squares(branch: Branch, i: int) -> Floats:
    """Return Re λ between points i and i + 1, as the root of a curve through the squares at these and their neighbours.

    Akima's curve has no kink at a point. It is exact where the squares lie on a line (beyond a square root) or, with
    equal steps, on a parabola (growth that begins at μ = 0). It is kept within the two values that it joins.
    """
    counts = (np.sign(branch.re) == np.sign(branch.re[i])) | (branch.onset != 0)  # an onset's growth is zero
    first, last = i, i + 1
    while first > 0 and branch.onset[first] == 0 and branch.joined[first - 1] and counts[first - 1]:
        first -= 1
    while last < len(counts) - 1 and branch.onset[last] == 0 and branch.joined[last] and counts[last + 1]:
        last += 1
    run = np.arange(first, last + 1)
    run = run[np.isin(run, [i, i + 1]) | (np.diff(branch.value[run], prepend=-np.inf) > 0)]
    most = np.abs(branch.re[i : i + 2]).max()  # read from a table, the square of a number may be no number any more
    growth = np.clip(np.where(branch.onset[run] == 0, np.abs(branch.re[run]) / most, 0.0), 0.0, _LARGEST)
    begin, end = (branch.re[i : i + 2] / most) ** 2
    at = branch.value[i] + (branch.value[i + 1] - branch.value[i]) * _DENSE
    if len(run) == 2 or not np.diff(branch.value[run]).min() > 0:
        square = begin + (end - begin) * _DENSE
    else:
        curve = Akima1DInterpolator(branch.value[run], growth**2)
        square = np.clip(curve(at), min(begin, end), max(begin, end))
    return np.asarray(np.sign(branch.re[i]) * most * np.sqrt(square))


def _is_rooted(branch: Branch, i: int, width: float, last: float) -> bool:
    """Return whether growth begins like a square root at onset i; for divergence the law that fits the next value.

    Tables of earlier versions do not tell the law of a divergence.
    """
    if branch.told[i] or branch.frequency_hz[i] or not (branch.speed[i] > 0 and last):
        return bool(branch.rooted[i])
    root, line = (abs(np.log(branch.speed[i] * width**power / abs(last))) for power in (0.5, 1.0))
    return bool(root <= line)


def onset_laws(modes: pd.DataFrame, onsets: pd.DataFrame) -> list[str]:
    """Return by which law growth begins at each onset: `root`, `linear`, `parting`, or "" where it is not known.

    Tables of earlier versions have no laws. There two branches that meet in flutter have a root, one that crosses alone
    has a line, and a divergence has the law that fits the growth of its branch at the next value.
    """
    if "law" in onsets:
        return [str(law) for law in onsets["law"].astype(object).fillna("")]
    paired, hz = np.isfinite(numbers(onsets, "branch_b")), numbers(onsets, "frequency_hz")
    branches = {branch.number: branch for branch in collect_branches(modes, onsets)}
    fits = [
        _fitting(branches.get(int(number)), value) if np.isfinite([number, value]).all() else ""
        for number, value in zip(numbers(onsets, "branch_a"), numbers(onsets, "value"), strict=True)
    ]
    kinds = onsets["kind"] if "kind" in onsets else pd.Series("flutter", index=onsets.index)
    swings = (np.asarray(kinds) != "divergence") & (hz != 0)
    return [("root" if pair else "linear") if s else fit for s, pair, fit in zip(swings, paired, fits, strict=True)]


def _fitting(branch: Branch | None, value: float) -> str:
    """Return the law that fits the growth of a branch at the value of the sweep next to its onset; "" if none tells."""
    at = [] if branch is None else np.flatnonzero((branch.onset != 0) & (branch.value == value)).tolist()
    if branch is None or len(at) != 1:
        return ""
    i, step = at[0], int(branch.onset[at[0]])
    k = i + step  # where it grows
    if not 0 <= k < len(branch.value) or branch.onset[k] or not branch.joined[min(i, k)]:
        return ""
    width, last = abs(branch.value[k] - branch.value[i]), branch.re[k]
    if not (branch.speed[i] > 0 and last > 0 and width > 0):
        return ""
    return "root" if _is_rooted(branch, i, width, last) else "linear"


def _beginning(width: float, last: float, speed: float, rooted: bool) -> tuple[Floats, Floats]:
    """Return distances s from an onset, up to a width, and the growth rates there; the last one is `last`.

    They begin as c√s or cs, with the speed c of the onset. What grows less on the way is c√s/(1 + βs). What grows more
    is √(c²s + κs²), or cs + κs², and a line where its speed at the onset says nothing of what follows.
    """
    s = width * _DENSE**2  # points are closer together near the onset, where a square root is steep
    first = np.sqrt(s) if rooted else s
    if not (np.isfinite(speed) and speed > 0 and width > 0 and last):
        return s[[0, -1]], np.array([0.0, last])
    ratio = speed * first[-1] / abs(last)  # 1 + β width
    if ratio >= 1:
        return s, np.sign(last) * speed * first / (1 + (ratio - 1) * s / width)
    if not rooted and ratio < _SLOWEST:
        return s[[0, -1]], np.array([0.0, last])
    part, power = s / width, 2.0 if rooted else 1.0
    return s, last * (ratio**power * part + (1 - ratio**power) * part**2) ** (1 / power)


def segments(points: Floats) -> Floats:
    """Return the segments (k − 1, 2, 2) between neighbouring points (k, 2)."""
    return np.stack([points[:-1], points[1:]], axis=1)
