"""Pairs of modes that come so close to each other that, because of rounding, it is not known if they turn unstable."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from .changes import FINEST, Change
from .nodes import Node
from .onset import Onset
from .step import Step

_ONE = 1e-2  # of a frequency: neighbouring doubts whose frequencies are closer together are about the same pair
_ROUNDED = 1e-8  # of a frequency: one of a double eigenvalue may be off by this
_MET = 4.0  # times the rounding of two eigenvalues: if they are closer together, they may be one double eigenvalue
# Times the uncertainty of an onset: at this distance behind it the modes have to have become unstable.
_SHOWN = 4.0
_VAGUE = 0.1  # of the length of a doubt: an onset of the same modes is part of it if it is less certain than this


@dataclass(frozen=True)
class Doubt:
    """An interval of the parameter in which two eigenvalues are equal up to rounding.

    Attributes
    ----------
    low, high : float
        The ends of the interval.
    frequency_hz : float, Hz
        Frequency of the two modes.
    """

    low: float
    high: float
    frequency_hz: float

    def sentence(self, parameter: str) -> str:
        """Return the warning about it; `parameter` is the name of the parameter."""
        return (
            f"between {parameter} = {self.low:.6g} and {self.high:.6g} two modes at {self.frequency_hz:.5g} Hz are one"
            " within rounding of the matrices: whether they turn unstable there is not known"
        )

    def joined(self, other: Doubt) -> Doubt | None:
        """Return one doubt over both intervals if they are close together and about the same two modes, else None."""
        reach = (self.high - self.low) + (other.high - other.low)
        if not self._is_about(other.frequency_hz) or max(self.low, other.low) > min(self.high, other.high) + reach:
            return None
        return Doubt(min(self.low, other.low), max(self.high, other.high), self.frequency_hz)

    def covers(self, onset: Onset) -> bool:
        """Return whether an onset may lie inside, is at the same frequency, and is nearly as uncertain as the interval.

        A more certain onset is kept, wherever it lies: other modes of nearly the same frequency may have it.
        """
        inside = self.low - onset.uncertainty <= onset.value <= self.high + onset.uncertainty
        return self._is_about(onset.frequency_hz) and inside and onset.uncertainty > _VAGUE * (self.high - self.low)

    def _is_about(self, frequency_hz: float) -> bool:
        return abs(self.frequency_hz - frequency_hz) <= _ONE * self.frequency_hz


def joined(doubts: Iterable[Doubt]) -> list[Doubt]:
    """Return the doubts, with neighbouring ones about the same pair of modes joined to one."""
    merged: list[Doubt] = []
    for doubt in sorted(doubts, key=lambda d: (d.low, d.high)):
        for i, known in enumerate(merged):
            if (both := known.joined(doubt)) is not None:
                merged[i] = both
                break
        else:
            merged.append(doubt)
    return merged


def lost_in_rounding(step: Step, change: Change) -> Doubt | None:
    """Return the doubt about a meeting of two modes that could not be refined, or None.

    There is a doubt if the two eigenvalues are still equal up to rounding in the interval in which they should have
    become a growing pair.
    """
    if change.kind != "meeting" or step.end(0).C is not None:
        return None
    low, high = (change.low, change.limits[1]) if change.gains > 0 else (change.limits[0], change.high)
    if not _are_one(step.between((low + high) / 2), abs(change.v)):
        return None
    return Doubt(low, high, float(np.sqrt(abs(change.v)) / (2 * np.pi)))


def one_in_rounding(step: Step, low: float, high: float, omega: float) -> Doubt | None:
    """Return the doubt about an interval in which modes near a frequency, rad/s, could not be followed, or None.

    There is a doubt if two eigenvalues there are equal up to rounding, which then moves them at random from value to
    value, and may show one of them as unstable.
    """
    middle = step.between((low + high) / 2)
    if step.end(0).C is not None or not _are_one(middle, omega**2, growing_too=True):
        return None
    return Doubt(low, high, omega / (2 * np.pi))


def split_doubtful(step: Step, onsets: Sequence[Onset], halved: bool, starts: bool) -> tuple[list[Onset], list[Doubt]]:
    """Return the onsets of a step that are sure, and doubts in place of the others.

    A window of instability inside the step is doubtful if it is narrower than the uncertainty of its two onsets. A
    window that reaches beyond the step is doubtful if its onset is so near to the end of the step that no unstable mode
    can show it, and the modes there are equal up to rounding. If the step can be `halved`, only an onset that may lie
    beyond its end counts as so near: a smaller step may show the others. A mode may be unstable at the end of a step
    because of rounding. If the sweep `starts` there, nothing before it can tell, and there is a doubt too.
    """
    # Windows first, since an onset that is hidden at the end of the step may be one end of a narrow window.
    length = step.ends[1] - step.ends[0]
    sure, doubts = without_narrow_windows(onsets, FINEST * length, length)
    kept: list[Onset] = []
    reach = 1.0 if halved else _SHOWN
    for onset in sure:
        rising, (low, high) = onset.direction == "into", step.ends
        room = high - onset.value if rising else onset.value - low
        theta = (2 * np.pi * onset.frequency_hz) ** 2
        hidden = step.end(0).C is None and reach * onset.uncertainty >= room
        if hidden and _are_one(step.end(int(rising)), theta, growing_too=starts and not rising):
            doubts.append(Doubt(onset.value if rising else low, high if rising else onset.value, onset.frequency_hz))
        else:
            kept.append(onset)
    return kept, doubts


def without_narrow_windows(
    onsets: Sequence[Onset], finest: float, length: float, decided: int = 0
) -> tuple[list[Onset], list[Doubt]]:  # fmt: skip
    """Return the onsets without those of windows of instability that are narrower than the uncertainty of their ends.

    There is a doubt in place of each such window, unless it is narrower than `finest`, in the unit of the parameter:
    steps are not searched for narrower ones. `length` is that of the step that was searched, in the same unit. The
    first `decided` onsets are those of steps before: two of them were judged by the lengths of their own steps.
    """
    taken: set[int] = set()  # positions of ends of such windows
    doubts = []
    order = sorted(range(len(onsets)), key=lambda k: onsets[k].value)
    for i, j in itertools.combinations(order, 2):
        into, out = onsets[i], onsets[j]
        if out.value - into.value > into.uncertainty + out.uncertainty or {i, j} & taken or max(i, j) < decided:
            continue
        pair = {into.branch_a, into.branch_b} & {out.branch_a, out.branch_b} - {None}
        if pair and into.direction != out.direction and _is_one_mode(into, out, length):
            taken |= {i, j}
            if out.value - into.value > finest:
                doubts.append(Doubt(into.value, out.value, into.frequency_hz))
    return [o for k, o in enumerate(onsets) if k not in taken], doubts


def _is_one_mode(first: Onset, second: Onset, length: float) -> bool:
    """Return whether two onsets that may be at one value have the frequency of one mode.

    Two modes that cross the axis at one value, in opposite directions, are no window. A frequency changes by no more
    than itself in a step of this length, and beside an onset no faster than growth does. For each of the two a margin
    is left.
    """
    unsure = (first, second)
    near = sum(o.uncertainty for o in unsure) / length + _ROUNDED
    reach = _SHOWN * (near * first.frequency_hz + sum(o.growth_within(o.uncertainty) for o in unsure) / (2 * np.pi))
    most = _ONE * first.frequency_hz
    return bool(abs(first.frequency_hz - second.frequency_hz) <= (reach if reach < most else most))


def pairs_in_rounding(v: np.ndarray, blur: np.ndarray) -> np.ndarray:
    """Return the pairs of eigenvalues that are equal up to rounding, (m, 2) int; each eigenvalue is in one at most.

    Parameters
    ----------
    v : (k,) complex
        Eigenvalues θ = −λ² of a problem without dampers.
    blur : (k,) float
        How far each may be off, in the same unit.
    """
    order = np.argsort(v.real, kind="stable")
    apart, most = np.abs(np.diff(v[order])), _MET * np.maximum(blur[order][:-1], blur[order][1:])
    found: list[tuple[int, int]] = []
    taken = -1
    for i in np.flatnonzero(apart <= most):
        if i != taken:
            found.append((int(order[i]), int(order[i + 1])))
            taken = int(i) + 1
    return np.array(found, dtype=int).reshape(-1, 2)


def _are_one(node: Node, theta: float, growing_too: bool = False) -> bool:
    """Return whether the two eigenvalues nearest to θ are equal up to rounding and, unless `growing_too`, stable."""
    near = np.argsort(np.abs(node.v - theta))[:2]
    apart = float(np.abs(np.diff(node.v[near])).max(initial=0.0))
    stable = growing_too or not node.unstable[near].any()
    return bool(len(near) == 2 and stable and apart <= _MET * node.blur[near].max())
