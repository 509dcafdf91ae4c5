"""Find all changes of stability in one step of a sweep, from the modes at its ends and at further values as needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .changes import FINEST, SETTLED, Asked, Change
from .clusters import cluster_of, groups
from .crossings import find_crossings
from .meetings import find_meetings
from .nodes import Node
from .samples import Samples
from .scale import LINEAR, Scale

# Values besides the ends at which modes of the step model are taken, at most. A step that may be halved is left after a
# few: narrower steps need fewer values, and their step models are more exact.
_NODES, _NODES_IF_HALVED = 24, 8
# A group of more modes than this is parted first, as long as further values may be asked for: each of the many samples
# of a group of m costs 25 m³ operations, a further value about as much as a single sample of all modes.
_CROWD = 64
# A group of more modes than this is never sampled, and its stability is told not to be decided: some hundred samples of
# one of 244 modes took 54 s. Dampers that come with the parameter make hundreds of modes creep over a narrow part of a
# step, and of all modes at its ends nearly all are one group then.
_LARGEST = 200
_RIM = 0.9  # of the highest |λ| known: a mode above this may be known at one value and not at the next
_NEAR = 0.1  # of a frequency: the same modes are taken to be meant in neighbouring intervals


@dataclass(frozen=True)
class Open:
    """A group with more modes at one of two values than at the other; `members` are positions in `nodes`."""

    nodes: tuple[Node, Node]
    members: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Scan:
    """The changes of stability of a step, and what was not decided.

    Attributes
    ----------
    changes : list of Change
        Sorted by rising value.
    open : list of Open
        Groups with more modes at one value than at the next.
    unsettled : list of (float, float, float)
        Both ends of an interval, and the lowest frequency of a group, rad/s, whose stability there could not be decided
        with `_NODES` values.
    width : float
        Every window of instability wider than this, in the parameter, was found.
    nodes : int
        Number of values, besides the ends, at which modes were taken.
    """

    changes: list[Change]
    open: list[Open]
    unsettled: list[tuple[float, float, float]]
    width: float
    nodes: int


def scan(
    first: Node, second: Node, modes: Callable[[float], Node], below: float = np.inf, scale: Scale = LINEAR,
    halved: float | None = None, linear: bool = False, known: float = 0.0, apart: float = 0.0, curved: bool = False,
) -> Scan:  # fmt: skip
    """Find the changes of stability between two values.

    Parameters
    ----------
    first, second : Node
        The modes at both ends of the step.
    modes : callable
        Returns the node of a value between them.
    below : float, rad/s
        Groups whose |λ| are all above this are left out.
    scale : Scale
        Whether steps go along the parameter or its logarithm.
    halved : float, rad/s, optional
        If stability up to this frequency is not decided with a few values, the step is halved and searched again: the
        search then ends, with what is not decided so far. None if the step is not halved.
    linear : bool
        Whether K is linear in the parameter.
    known : float, rad/s
        Frequency up to which all modes are known at every value, if it is higher than those of the modes there.
    apart : float
        See `Samples`.
    curved : bool
        Whether matrices bend within the step. Modes at its ends and their slopes do not show that, so that the search
        begins with the modes half way.
    """
    step = scale.x(second.value) - scale.x(first.value)
    width, count = FINEST * step * scale.slope(second.value), 0
    result = Scan([], [], [], width, 0)
    todo = [(first, second)]
    if curved:
        middle, count = modes(scale.p(scale.x(first.value) + step / 2)), 1
        todo = [(middle, second), (first, middle)]
    while todo:
        a, b = todo.pop()
        asked: list[float] = []
        found: list[Change] = []
        opened: list[Open] = []
        begin, end = scale.x(a.value), scale.x(b.value)
        share = (end - begin) / step
        may_ask = count < _NODES and share > SETTLED
        unsettled = []
        for members in (_without_rim(a, b, *g, known) for g in groups(a, b)):
            if (linear and _is_idle(a, b, members)) or _lowest(a, b, members) > below:
                continue
            if len(members[0]) != len(members[1]):
                opened.append(Open((a, b), members))
                continue
            size = len(members[0])
            crowded = size > _LARGEST or (size > _CROWD and may_ask)
            if crowded or not (cluster := cluster_of((a, b), members, scale)).is_smooth:
                asked.append((begin + end) / 2)
                unsettled.append(members)
                continue
            try:
                samples = Samples(cluster, share, a is first, apart)
                if samples.cut > samples.settled:
                    raise Asked(samples.cut_at)
                pairs = a.paired or a.conservative
                changes, hidden = find_meetings(samples) if pairs else find_crossings(samples)
                found += changes
                width = max(width, cluster.extent(max(hidden, samples.cut)))
            except Asked as more:
                asked.append(scale.x(cluster.value(more.t)))
                unsettled.append(members)
        lams = [np.concatenate([a.lam[s0], b.lam[s1]]) for s0, s1 in unsettled]
        told = [(a.value, b.value, float(lam.imag[lam.imag >= 0].min(initial=np.inf))) for lam in lams]
        if halved is not None and count >= _NODES_IF_HALVED and any(omega <= halved for *_, omega in told):
            return Scan([], [], told, width, count)
        if asked and may_ask:
            rim = 0.05 * (end - begin)
            middle = modes(scale.p(float(np.clip(sorted(asked)[len(asked) // 2], begin + rim, end - rim))))
            count += 1
            todo += [(middle, b), (a, middle)]
            continue
        result.unsettled.extend(told)
        result.changes.extend(found)
        result.open.extend(opened)
    changes = sorted(result.changes, key=lambda c: (c.low, c.high))
    return Scan(changes, result.open, result.unsettled, width, count)


def joined(intervals: list[tuple[float, float, float]]) -> list[tuple[float, float, float]]:
    """Return intervals (a, b, ω) with one for each run of those that follow each other at nearly the same ω."""
    runs: list[tuple[float, float, float]] = []
    for a, b, omega in sorted(intervals):
        for i, (first, last, low) in enumerate(runs):
            if last == a and abs(omega - low) <= _NEAR * max(omega, low):
                runs[i] = first, b, min(low, omega)
                break
        else:
            runs.append((a, b, omega))
    return runs


def _lowest(a: Node, b: Node, members: tuple[np.ndarray, np.ndarray]) -> float:
    return float(min(np.abs(n.lam[s]).min(initial=np.inf) for n, s in zip((a, b), members, strict=True)))


def _is_idle(a: Node, b: Node, members: tuple[np.ndarray, np.ndarray]) -> bool:
    """Return whether the stability of a group cannot change if K is linear: it is symmetric, and θ > 0 at both ends.

    A symmetric K that is positive definite at both ends is so between them, as a sum of both with positive weights.
    Beside a θ < 0, whose mode a group need not have, other modes may become unstable between the ends.
    """
    if not len(members[0]) + len(members[1]):
        return True
    return a.symmetric and b.symmetric and all(bool((n.v.real > 0).all()) for n in (a, b))


def _without_rim(
    a: Node, b: Node, s0: np.ndarray, s1: np.ndarray, known: float
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return a group without those modes that the other value lacks because they are above the highest known there."""
    reach = _RIM * max(known, min(float(np.abs(n.lam).max(initial=0.0)) for n in (a, b)))
    while len(s0) != len(s1):
        more, node = (s0, a) if len(s0) > len(s1) else (s1, b)
        size = np.abs(node.lam[more])
        if size.max() < reach:
            break
        kept = more[size < (1 - 1e-6) * size.max()]  # a mode and its mirror image have equal |λ|: both are dropped
        s0, s1 = (kept, s1) if more is s0 else (s0, kept)
    return s0, s1
