"""Check that onsets explain the number of unstable modes: from value to value of a sweep, and beside each onset."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..eigen.pencil import Modes
from .changes import FINEST
from .doubts import Doubt, pairs_in_rounding
from .nodes import Node
from .onset import Onset
from .point import SweepPoint
from .step import Step

_APART = 0.02  # of a frequency: a mode farther from the limit than this is not expected to pass it within a step
_ONE = 1e-2  # of a frequency: a mode whose frequency is closer than this to that of a pair may belong to it
# Times the uncertainty of an onset: the distance at which modes are counted beside it. The next larger one is tried
# while the counts do not agree.
_BESIDE = 4.0, 100.0, 2000.0
_CAME = "came into the range that was asked for"
_LEAVES = 0.7  # of the highest frequency listed: a mode above this may be beyond the range at the next value
_COPY = 1e-6  # of |λ|: two unstable modes that are closer are copies of one another
_NEAR = 1e-4  # of the step: within it what one node tells of another is right to the square of this


@dataclass(frozen=True)
class Census:
    """The unstable modes at one value of the parameter, and the pairs of which rounding hides whether one is unstable.

    Attributes
    ----------
    value : float
    lam : (k,) complex, rad/s
        λ of the unstable modes, Im λ ≥ 0.
    unsure : (m,) float, rad/s
        |λ| of the pairs of modes that are equal up to rounding. One mode of each may be unstable.
    counted : (m,) bool
        Whether an unstable mode is in the pair.
    """

    value: float
    lam: np.ndarray
    unsure: np.ndarray
    counted: np.ndarray

    @staticmethod
    def of_node(node: Node) -> Census:
        """Return the census of a node."""
        upper = node.unstable & (node.lam.imag >= 0)
        pairs = pairs_in_rounding(node.v, node.blur) if node.C is None else np.zeros((0, 2), int)
        return Census(node.value, node.lam[upper], np.abs(node.lam[pairs[:, 0]]), upper[pairs].any(axis=1))

    @staticmethod
    def of_modes(value: float, modes: Modes, damped: bool) -> Census:
        """Return the census of modes; no pair of damped ones is unsure."""
        own = (modes.lam.imag > 0) | (modes.lam.real > 0)
        lam, spread, unstable = modes.lam[own], modes.re_uncertainty[own], modes.stability[own] == "unstable"
        blur = np.maximum(2 * np.abs(lam) * spread, spread**2)
        pairs = np.zeros((0, 2), int) if damped else pairs_in_rounding(-(lam**2), blur)
        return Census(value, lam[unstable], np.abs(lam[pairs[:, 0]]), unstable[pairs].any(axis=1))

    def near(self, limit: float, actors: np.ndarray) -> tuple[int, int, np.ndarray]:
        """Return the least and the largest number of unstable modes below `limit`, and |λ| of the pairs that decide.

        Only a pair at the frequency of one of the `actors` (l,), rad/s, can be at fault where numbers do not agree.
        """
        count = int(np.count_nonzero(self.lam.imag < limit))
        nearest = np.abs(self.unsure[:, None] - actors[None, :]).min(axis=1, initial=np.inf)
        at_fault = (self.unsure < limit) & (nearest <= _ONE * self.unsure)
        inside = int(np.count_nonzero(self.counted[at_fault]))
        return count - inside, count - inside + int(np.count_nonzero(at_fault)), self.unsure[at_fault]


def unbalanced(
    parameter: str, before: Census, now: Census, onsets: Sequence[Onset], limit: float
) -> str | Doubt:  # fmt: skip
    """Return a sentence if the onsets between two values do not explain how many modes are unstable at each, or "".

    The balance is: unstable before + onsets into − onsets out of instability = unstable now. Modes and onsets above
    `limit` are not counted, since modes may enter and leave the range there. The limit is lowered until no unstable
    mode and no onset is near it. If pairs of modes that are equal up to rounding can explain the difference, the doubt
    about such a pair is returned instead of a sentence.

    Parameters
    ----------
    parameter : str
        Its name.
    before, now : Census
        The unstable modes at the two values.
    onsets : sequence of Onset
        Those between the two values.
    limit : float, rad/s
        Frequency up to which modes are counted.
    """
    known = np.concatenate([before.lam.imag, now.lam.imag, [2 * np.pi * o.frequency_hz for o in onsets]])
    limit = _clear_of(known, limit)
    counts = [int(np.count_nonzero(part.lam.imag < limit)) for part in (before, now)]
    gained = sum(1 if o.direction == "into" else -1 for o in onsets if 2 * np.pi * o.frequency_hz < limit)
    if counts[0] + gained == counts[1]:
        return ""
    (least, most, first), (fewest, largest, second) = (part.near(limit, known) for part in (before, now))
    if least + gained <= largest and fewest <= most + gained:
        return Doubt(before.value, now.value, float(np.append(first, second)[0]) / (2 * np.pi))
    return (
        f"between {parameter} = {before.value:.10g} and {now.value:.10g} {counts[0]} modes become {counts[1]} unstable"
        f" ones, of which the onsets found explain {gained:+d}"
    )


def _clear_of(known: np.ndarray, limit: float) -> float:
    """Return the highest frequency up to a limit that is far (`_APART`) from all that are known (k,), rad/s.

    Examples
    --------
    >>> [_clear_of(np.array([90.0, 95.0, 100.0]), limit) for limit in (110.0, 99.0, 93.0)]
    [110.0, 97.5, 93.0]
    """
    edges = np.append(np.sort(known[known < (1 + _APART) * limit])[::-1], 0.0)
    if len(edges) == 1 or limit - edges[0] >= _APART * limit:
        return limit
    clear = np.flatnonzero(edges[:-1] - edges[1:] >= 2 * _APART * edges[:-1])
    between = (edges[clear] + edges[clear + 1]) / 2
    between = between[between <= limit]
    return float(between.max(initial=0.0))


def entered(parameter: str, points: Sequence[SweepPoint], onsets: Sequence[Onset]) -> list[str]:
    """Return a sentence for each mode that is unstable at the last point, and came into the range as it is.

    Its onset lies above the range, or where it was not followed yet, and it is in the balance of no step. A mode that
    is known is one that is unstable at the first point, or takes part in an onset into instability before, and has not
    left the range upwards. Where more modes are unstable than are known, those of other branches came in. Modes that
    the point before had already are left out.
    """
    new = _unexplained(points, onsets)
    before = _unexplained(points[:-1], onsets) if len(points) > 1 else []
    return [
        f"at {parameter} = {points[-1].value:.6g} the unstable mode of {hz:.5g} Hz {_CAME} as an unstable one: its"
        " onset is not listed; ask for more modes, or for a higher solve.max_frequency"
        for branch, hz in new if branch not in {b for b, _ in before}
    ]


def _unexplained(points: Sequence[SweepPoint], onsets: Sequence[Onset]) -> list[tuple[int, float]]:
    """Return branch and frequency, Hz, of the unstable modes at the last point that no onset before explains."""
    first, point = points[0], points[-1]
    unstable, lam = point.modes.stability == "unstable", point.modes.lam
    known = [({int(b)}, 0.0) for b in first.branches[first.modes.stability == "unstable"]]
    for onset in sorted(onsets, key=lambda o: o.value):
        own = {b for b in (onset.branch_a, onset.branch_b) if b is not None}
        if onset.value > point.value:
            break
        if onset.direction == "into":
            known.append((own, onset.frequency_hz))
        elif (same := next((k for k in known if k[0] & own), None)) is not None:
            known.remove(same)
    here = [own for own, hz in known if not _has_left(points, own, hz)]
    # A mode with λ = 0 at the first value, and not here, may diverge from there on, which is told.
    started = max(int(np.count_nonzero(first.modes.lam == 0)) - int(np.count_nonzero(lam == 0)), 0)
    more = int(np.count_nonzero(unstable)) - len(here) - started
    named = np.isin(point.branches, list(set().union(*here)))
    others, explained = np.flatnonzero(unstable & ~named), np.flatnonzero(unstable & named)
    # Copies of a mode that is explained, as of equal pads, have onsets, whose branches likeness may have exchanged.
    apart = np.abs(lam[others][:, None] - lam[explained][None, :]).min(axis=1, initial=np.inf)
    others = others[apart > _COPY * np.abs(lam[others])]
    highest = others[np.argsort(-point.modes.frequency_hz[others], kind="stable")][: max(more, 0)]
    return [(int(point.branches[i]), float(point.modes.frequency_hz[i])) for i in highest]


def _has_left(points: Sequence[SweepPoint], own: set[int], hz: float) -> bool:
    """Return whether a mode of some branches is not in the range of the last point, and was near its end before.

    One that was far below it is still there, by another number. `hz` is its frequency where no point has it.
    """
    for back, point in enumerate(reversed(points)):
        there = np.isin(point.branches, list(own))
        if there.any():
            hz = float(point.modes.frequency_hz[there].max())
            return back > 0 and hz >= _LEAVES * float(point.modes.frequency_hz.max())
    return hz >= _LEAVES * float(points[-1].modes.frequency_hz.max(initial=0.0))


def unshown(step: Step, onsets: Sequence[Onset], limit: float) -> str | Doubt:
    """Return a sentence, or a doubt, if the unstable modes on both sides of an onset do not differ by it, or "".

    Unstable modes of the step model are counted below and above each onset, at a multiple of its uncertainty, or half
    way to the next onset if that is nearer. With the counts at both ends of the step this is a balance along the whole
    step. Close to an onset the growth rate may be smaller than its rounding; then modes are counted farther away.

    Parameters
    ----------
    step : Step
    onsets : sequence of Onset
        All onsets of the step.
    limit : float, rad/s
        Frequency up to which modes are counted.
    """
    ordered = sorted(onsets, key=lambda o: o.value)
    told: str | Doubt = ""
    # What would be told is first checked with the modes at each value itself, of matrices that are made there.
    for near in (_NEAR, 0.0) if ordered else ():
        known: list[Node] = []
        for multiple in _BESIDE:
            between = [_node(step, p, known, near) for p in _beside(step, ordered, multiple)]
            told = _imbalance(step, ordered, [step.end(0), *between, step.end(1)], limit)
            if not told:
                return ""
    return told


def _node(step: Step, p: float, known: list[Node], near: float) -> Node:
    """Return the node of a value, from one of those known if that is within a part `near` of the step; else add it.

    With `near` = 0 its matrices are not interpolated. Both sides of an onset, at several distances, are as near to each
    other as that.
    """
    reach = near * abs(step.ends[1] - step.ends[0])
    for node in known:
        if abs(p - node.value) <= reach and (moved := node.moved(p)) is not None:
            return moved
    known.append(step.between(p) if near else step.exact(p))
    return known[-1]


def _imbalance(step: Step, ordered: list[Onset], nodes: list[Node], limit: float) -> str | Doubt:
    for before, after in itertools.pairwise([Census.of_node(n) for n in nodes]):
        first = before.value == step.ends[0]
        between = [o for o in ordered if before.value < o.value <= after.value or (first and o.value == before.value)]
        if told := unbalanced(step.parameter, before, after, between, limit):
            return told
    return ""


def _beside(step: Step, ordered: list[Onset], multiple: float) -> list[float]:
    """Return the values at which modes are counted: on both sides of each onset, inside the step."""
    least = FINEST * abs(step.ends[1] - step.ends[0])
    reach = [multiple * max(o.uncertainty, least / _BESIDE[0]) for o in ordered]
    places = [ordered[0].value - reach[0]] if ordered else []
    for (a, b), (before, after) in zip(itertools.pairwise(ordered), itertools.pairwise(reach), strict=True):
        if a.value + before < b.value - after:
            places += [a.value + before, b.value - after]
        elif b.value - a.value > 2 * (a.uncertainty + b.uncertainty):
            places.append((a.value + b.value) / 2)
    places += [ordered[-1].value + reach[-1]] if ordered else []
    return [p for p in places if step.ends[0] < p < step.ends[1]]
