"""All changes of stability between two values of a sweep, with values added where they are in doubt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .changes import FINEST, SETTLED, Asked, Change
from .clusters import Cluster, groups
from .crossings import find_crossings
from .meetings import find_meetings
from .nodes import Node
from .samples import Samples

_NODES = 24  # values besides the ends at which modes are asked for in a step
_RIM = 0.9  # of the highest |λ| known: a mode beyond may leave what is known by itself


@dataclass(frozen=True)
class Open:
    """Modes of one end that have no counterpart at the other."""

    nodes: tuple[Node, Node]
    members: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Scan:
    """What was found in a step.

    Attributes
    ----------
    changes : list of Change, by rising value
    open : list of Open
    unsettled : list of (float, float, float)
        Intervals with a frequency, rad/s, where more values were asked for than are allowed.
    width : float
        Windows of instability wider than this would have been seen, in the parameter.
    nodes : int
        Values at which modes were asked for.
    """

    changes: list[Change]
    open: list[Open]
    unsettled: list[tuple[float, float, float]]
    width: float
    nodes: int


def scan(first: Node, second: Node, modes: Callable[[float], Node], below: float = np.inf) -> Scan:
    """Find what changes between two values.

    Parameters
    ----------
    first, second : Node
        At the ends of a step.
    modes : callable
        Returns the node of a value between.
    below : float, rad/s
        What lies above as a whole is left out.
    """
    step = abs(second.value - first.value)
    result = Scan([], [], [], FINEST * step, 0)
    width, count = FINEST * step, 0
    todo = [(first, second)]
    while todo:
        a, b = todo.pop()
        asked: list[float] = []
        found: list[Change] = []
        opened: list[Open] = []
        scale = abs(b.value - a.value) / step
        doubted = []
        for members in (_without_rim(a, b, *g) for g in groups(a, b)):
            if _is_idle(a, b, members) or _lowest(a, b, members) > below:
                continue
            if len(members[0]) != len(members[1]):
                opened.append(Open((a, b), members))
                continue
            cluster = Cluster((a, b), members)
            if not cluster.is_smooth:
                asked.append(0.5)
                doubted.append(members)
                continue
            try:
                samples = Samples(cluster, scale, a is first)
                pairs = a.paired or a.conservative
                changes, hidden = find_meetings(samples) if pairs else find_crossings(samples)
                found += changes
                width = max(width, hidden * abs(b.value - a.value))
            except Asked as more:
                asked.append(more.t)
                doubted.append(members)
        if asked and count < _NODES and scale > SETTLED:
            t = float(np.clip(sorted(asked)[len(asked) // 2], 0.05, 0.95))
            middle = modes(a.value + t * (b.value - a.value))
            count += 1
            todo += [(middle, b), (a, middle)]
            continue
        for s0, s1 in doubted:
            lam = np.concatenate([a.lam[s0], b.lam[s1]])
            result.unsettled.append((a.value, b.value, float(lam.imag.mean())))
        result.changes.extend(found)
        result.open.extend(opened)
    changes = sorted(result.changes, key=lambda c: (c.low, c.high))
    return Scan(changes, result.open, result.unsettled, width, count)


def _lowest(a: Node, b: Node, members: tuple[np.ndarray, np.ndarray]) -> float:
    return float(min(np.abs(n.lam[s]).min(initial=np.inf) for n, s in zip((a, b), members, strict=True)))


def _is_idle(a: Node, b: Node, members: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether there is nothing in a group that could change: symmetric matrices without θ < 0 at either end.

    The lowest θ of symmetric matrices that are linear in the parameter is concave: it lies above its chord.
    """
    v = np.concatenate([a.v[members[0]], b.v[members[1]]])
    return not len(v) or (a.symmetric and b.symmetric and bool((v.real > 0).all()))


def _without_rim(a: Node, b: Node, s0: np.ndarray, s1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return as many members of a group at both ends: without the highest, which pass the end of what is known."""
    reach = _RIM * min(float(np.abs(n.lam).max(initial=0.0)) for n in (a, b))
    while len(s0) != len(s1):
        more, node = (s0, a) if len(s0) > len(s1) else (s1, b)
        size = np.abs(node.lam[more])
        if size.max() < reach:
            break
        kept = more[size < (1 - 1e-6) * size.max()]  # of mirror images both or none
        s0, s1 = (kept, s1) if more is s0 else (s0, kept)
    return s0, s1
