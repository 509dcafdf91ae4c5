"""Pairs of modes that come so close to each other that rounding hides whether they turn unstable."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from .changes import FINEST, Change
from .nodes import Node
from .onset import Onset
from .step import Step

_ONE = 1e-2  # relative distance of two frequencies up to which neighbouring doubts are about the same pair
_MET = 4.0  # times the rounding of two eigenvalues: if they are nearer to each other they may be one


@dataclass(frozen=True)
class Doubt:
    """An interval of the parameter in which two modes are one within rounding.

    Attributes
    ----------
    low, high : float
    frequency_hz : float
    """

    low: float
    high: float
    frequency_hz: float

    def sentence(self, parameter: str) -> str:
        """Return what is to be told."""
        return (
            f"between {parameter} = {self.low:.6g} and {self.high:.6g} two modes at {self.frequency_hz:.5g} Hz are one"
            " within rounding of the matrices: whether they turn unstable there is not known"
        )

    def joined(self, other: Doubt) -> Doubt | None:
        """Return one doubt over both intervals if they are about the same pair and lie close together, else None."""
        apart = abs(self.frequency_hz - other.frequency_hz) > _ONE * self.frequency_hz
        if apart or other.low > self.high + (self.high - self.low) + (other.high - other.low):
            return None
        return Doubt(min(self.low, other.low), max(self.high, other.high), self.frequency_hz)


def joined(doubts: Iterable[Doubt]) -> list[Doubt]:
    """Return doubts with neighbouring ones about the same pair as one."""
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
    """Return the doubt about a meeting that could not be refined, if rounding hides it also beyond the meeting."""
    if change.kind != "meeting" or step.end(0).C is not None:
        return None
    low, high = (change.low, change.limits[1]) if change.gains > 0 else (change.limits[0], change.high)
    if not _are_one(step.between((low + high) / 2), abs(change.v)):
        return None
    return Doubt(low, high, float(np.sqrt(abs(change.v)) / (2 * np.pi)))


def split_doubtful(step: Step, onsets: Sequence[Onset]) -> tuple[list[Onset], list[Doubt]]:
    """Return the onsets of a step that are sure, and doubts for windows narrower than the uncertainty of their ends.

    Of a window that reaches beyond the step the end of the step tells whether its modes are unstable. Windows so narrow
    that steps are not searched for them are left out.
    """
    kept: list[Onset] = []
    doubts: list[Doubt] = []
    for onset in onsets:
        rising, (low, high) = onset.direction == "into", step.ends
        room = high - onset.value if rising else onset.value - low
        theta = (2 * np.pi * onset.frequency_hz) ** 2
        if step.end(0).C is None and onset.uncertainty >= room and _are_one(step.end(int(rising)), theta):
            doubts.append(Doubt(onset.value if rising else low, high if rising else onset.value, onset.frequency_hz))
        else:
            kept.append(onset)
    for into, out in itertools.combinations(sorted(kept, key=lambda o: o.value), 2):
        pair = {into.branch_a, into.branch_b} & {out.branch_a, out.branch_b} - {None}
        narrow = out.value - into.value <= into.uncertainty + out.uncertainty
        if into in kept and out in kept and pair and narrow and {into.direction, out.direction} == {"into", "out of"}:
            kept = [o for o in kept if o is not into and o is not out]
            if out.value - into.value > FINEST * (step.ends[1] - step.ends[0]):  # narrower ones are not looked for
                doubts.append(Doubt(into.value, out.value, into.frequency_hz))
    return kept, doubts


def _are_one(node: Node, theta: float) -> bool:
    """Whether the two eigenvalues next to θ are stable, and one within rounding."""
    near = np.argsort(np.abs(node.v - theta))[:2]
    apart = float(np.abs(np.diff(node.v[near])).max(initial=0.0))
    return bool(len(near) == 2 and not node.unstable[near].any() and apart <= _MET * node.blur[near].max())
