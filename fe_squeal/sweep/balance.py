"""Check that onsets explain the number of unstable modes: from value to value of a sweep, and beside each onset."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from .changes import FINEST
from .nodes import Node
from .onset import Onset
from .step import Step

_APART = 0.02  # of a frequency: a mode farther from the limit than this is not expected to pass it within a step
# Times the uncertainty of an onset: the distance at which modes are counted beside it. The next larger one is tried
# while the counts do not agree.
_BESIDE = 4.0, 100.0, 2000.0


def unbalanced(before: np.ndarray, now: np.ndarray, onsets: Sequence[Onset], limit: float) -> str:
    """Return a sentence if the onsets between two values do not explain how many modes are unstable at each, or "".

    The balance is: unstable before + onsets into − onsets out of instability = unstable now. Modes and onsets above
    `limit` are not counted, since modes may enter and leave the range there. The limit is lowered until no unstable
    mode and no onset is near it; if that leaves none, the balance is not checked.

    Parameters
    ----------
    before, now : (k,) and (l,) complex, rad/s
        λ of the unstable modes at the two values.
    onsets : sequence of Onset
        Those between the two values.
    limit : float, rad/s
        Frequency up to which modes are counted.
    """
    lam = [before.imag, now.imag]
    known = np.concatenate([*lam, [2 * np.pi * o.frequency_hz for o in onsets]])
    while np.any(near := np.abs(known - limit) < _APART * limit):
        limit = float(known[near].min()) * (1 - 2 * _APART)
        if limit <= 0:
            return ""
    counts = [int(np.count_nonzero(part < limit)) for part in lam]
    gained = sum(1 if o.direction == "into" else -1 for o in onsets if 2 * np.pi * o.frequency_hz < limit)
    if counts[0] + gained == counts[1]:
        return ""
    return f"{counts[0]} modes become {counts[1]} unstable ones, of which the onsets found explain {gained:+d}"


def unshown(step: Step, onsets: Sequence[Onset], limit: float) -> str:
    """Return a sentence if the unstable modes on both sides of an onset do not differ by this onset, or "".

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
    told = ""
    for multiple in _BESIDE if ordered else ():
        places = _beside(step, ordered, multiple)
        told = _imbalance(step, ordered, [step.end(0), *(step.between(p) for p in places), step.end(1)], limit)
        if not told:
            break
    return told


def _imbalance(step: Step, ordered: list[Onset], nodes: list[Node], limit: float) -> str:
    for before, after in itertools.pairwise(nodes):
        first = before.value == step.ends[0]
        between = [o for o in ordered if before.value < o.value <= after.value or (first and o.value == before.value)]
        if told := unbalanced(_unstable(before), _unstable(after), between, limit):
            return f"between {step.parameter} = {before.value:.10g} and {after.value:.10g} {told}"
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


def _unstable(node: Node) -> np.ndarray:
    return np.asarray(node.lam[node.unstable & (node.lam.imag >= 0)])
