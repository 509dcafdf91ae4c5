"""All changes of stability inside one step of a sweep, with values added where the modes of the ends do not suffice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from .changes import FINEST, SETTLED, Asked, Change
from .clusters import Group, cluster_of
from .crossings import find_crossings
from .intervals import Interval, MixedError, State
from .meetings import find_meetings
from .nodes import Node
from .samples import Samples
from .scale import LINEAR, Scale

_NODES = 24  # values besides the ends at which modes are asked for in a step
_RIM = 0.9  # of the highest |λ| known: a mode above may be known at one value and not at the next


@dataclass(frozen=True)
class Open:
    """A group with more modes at one value than at the other."""

    nodes: tuple[Node, Node]
    members: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Scan:
    """The changes of stability of a step, and what stays open.

    Attributes
    ----------
    changes : list of Change, by rising value
    open : list of Open
        Groups that have lost or gained modes.
    unsettled : list of (float, float, float)
        Intervals with a frequency, rad/s, in which stability could not be told with as many values as are allowed.
    width : float
        Every window of instability wider than this was found, in the parameter.
    nodes : int
        Values at which modes were asked for.
    """

    changes: list[Change]
    open: list[Open]
    unsettled: list[tuple[float, float, float]]
    width: float
    nodes: int


def scan(
    first: Node, second: Node, modes: Callable[[float], Node], below: float = np.inf, scale: Scale = LINEAR
) -> Scan:
    """Find the changes of stability between two values.

    Parameters
    ----------
    first, second : Node
        At the ends of a step.
    modes : callable
        Returns the node of a value between.
    below : float, rad/s
        What lies above as a whole is left out.
    scale : Scale
        Of the sweep.
    """
    try:
        return _Scanner(first, second, modes, below, scale, shared=True).run()
    except MixedError:
        return _Scanner(first, second, modes, below, scale, shared=False).run()


@dataclass
class _Part:
    """What a group of an interval holds: its changes, or a value at which modes are asked for."""

    group: Group
    changes: list[Change] = field(default_factory=list)
    open: Open | None = None
    hidden: float = 0.0
    asked: float | None = None

    @property
    def state(self) -> State:
        """Whether the group is settled over the interval."""
        if self.asked is not None:
            return "open"
        return "found" if self.changes or self.open else "idle"


class _Scanner:
    """Divides a step into ever smaller intervals, as far as their groups ask for.

    Attributes
    ----------
    shared : bool
        Whether a group that is settled over an interval stays so where others have that interval divided.
    """

    def __init__(
        self, first: Node, second: Node, modes: Callable[[float], Node], below: float, scale: Scale, shared: bool
    ) -> None:  # fmt: skip
        self.ends, self.modes, self.below, self.scale, self.shared = (first, second), modes, below, scale, shared
        self.step = scale.x(second.value) - scale.x(first.value)

    def run(self) -> Scan:
        """Return the changes of stability of the step.

        Raises
        ------
        MixedError
            If groups cannot be told apart any more that were settled one by one.
        """
        first, second = self.ends
        result = Scan([], [], [], 0.0, 0)
        width, count = FINEST * self.step * self.scale.slope(second.value), 0
        todo = [Interval.whole(first, second)]
        while todo:
            interval = todo.pop()
            begin, end = (self.scale.x(n.value) for n in interval.ends)
            share = (end - begin) / self.step
            parts = [self._look(interval, group, share) for group in interval.groups]
            asked = sorted(p.asked for p in parts if p.asked is not None)
            if asked and count < _NODES and share > SETTLED:
                rim = 0.05 * (end - begin)
                middle = self.modes(self.scale.p(float(np.clip(asked[len(asked) // 2], begin + rim, end - rim))))
                count += 1
                left, right, states = interval.divided(middle, [p.state if self.shared else "open" for p in parts])
                todo += [right, left]
                parts = [p for p, state in zip(parts, states, strict=True) if state != "open"]
            for p in parts:
                if p.asked is not None:
                    a, b = interval.ends
                    lam = np.concatenate([n.lam[s] for n, s in zip(interval.ends, p.group.members, strict=True)])
                    result.unsettled.append((a.value, b.value, float(lam.imag.mean())))
                result.changes.extend(p.changes)
                result.open.extend([p.open] if p.open else [])
                width = max(width, p.hidden)
        changes = sorted(result.changes, key=lambda c: (c.low, c.high))
        return replace(result, changes=changes, width=width, nodes=count)

    def _look(self, interval: Interval, group: Group, share: float) -> _Part:
        """Look for changes of a group over an interval, which is a share of the step."""
        a, b = interval.ends
        part = _Part(group)
        if group.idle:
            return part
        members = _without_rim(a, b, *group.members)
        if _is_idle(a, b, members) or _lowest(a, b, members) > self.below:
            return part
        if len(members[0]) != len(members[1]):
            part.open = Open((a, b), members)
            return part
        cluster = cluster_of((a, b), members, self.scale)
        if not cluster.is_smooth:
            part.asked = (self.scale.x(a.value) + self.scale.x(b.value)) / 2
            return part
        try:
            samples = Samples(cluster, share, a is self.ends[0])
            pairs = a.paired or a.conservative
            part.changes, hidden = find_meetings(samples) if pairs else find_crossings(samples)
            part.hidden = cluster.extent(hidden)
        except Asked as more:
            part.asked = self.scale.x(cluster.value(more.t))
        return part


def _lowest(a: Node, b: Node, members: tuple[np.ndarray, np.ndarray]) -> float:
    return float(min(np.abs(n.lam[s]).min(initial=np.inf) for n, s in zip((a, b), members, strict=True)))


def _is_idle(a: Node, b: Node, members: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether the stability of a group cannot change: symmetric matrices without θ < 0 at either end.

    The lowest θ of symmetric matrices that are linear in the parameter is concave: it lies above its chord.
    """
    v = np.concatenate([a.v[members[0]], b.v[members[1]]])
    return not len(v) or (a.symmetric and b.symmetric and bool((v.real > 0).all()))


def _without_rim(a: Node, b: Node, s0: np.ndarray, s1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a group without modes that are missing at one value because they lie beyond the highest known there."""
    reach = _RIM * min(float(np.abs(n.lam).max(initial=0.0)) for n in (a, b))
    while len(s0) != len(s1):
        more, node = (s0, a) if len(s0) > len(s1) else (s1, b)
        size = np.abs(node.lam[more])
        if size.max() < reach:
            break
        kept = more[size < (1 - 1e-6) * size.max()]  # of mirror images both or none
        s0, s1 = (kept, s1) if more is s0 else (s0, kept)
    return s0, s1
