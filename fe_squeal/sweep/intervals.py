"""Intervals of a step, and which groups stay settled where an interval is divided for the sake of others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .clusters import Group, groups
from .nodes import Node

# Of a group over an interval: not settled, settled without any change, or settled with changes that were found.
State = Literal["open", "idle", "found"]
# In place of a group's position: settled over a wider interval, with changes that were found there or without.
_EARLIER, _IDLE = -1, -2


class MixedError(Exception):
    """Raised where a group of a part of an interval joins others with one whose changes were found on a wider one."""


@dataclass(frozen=True)
class Interval:
    """Two values and the groups between them that are not settled yet.

    Attributes
    ----------
    ends : (Node, Node)
    groups : list of Group
    found : (bool array, bool array)
        At both ends the modes of groups whose changes were found on a wider interval.
    """

    ends: tuple[Node, Node]
    groups: list[Group]
    found: tuple[np.ndarray, np.ndarray]

    @classmethod
    def whole(cls, first: Node, second: Node) -> Interval:
        """Return an interval of which nothing is settled."""
        return cls((first, second), groups(first, second), (np.zeros(len(first), bool), np.zeros(len(second), bool)))

    def divided(self, middle: Node, states: Sequence[State]) -> tuple[Interval, Interval, list[State]]:
        """Return both parts with what is left to settle, and the states of the groups, some of which it opens again.

        A group that is settled over the interval is settled over both parts. Only where a part joins it with one that
        is not are both open: what was found of it no longer counts.

        Raises
        ------
        MixedError
            If changes would have to be taken back that were found on a wider interval.
        """
        (a, b), states = self.ends, list(states)
        parts = groups(a, middle), groups(middle, b)
        own = [_positions(n, self.groups, end, self.found[end]) for end, n in enumerate(self.ends)]
        # Of every mode in the middle the groups of this interval that the parts on both sides join it with.
        joined: list[set[int]] = [set() for _ in range(len(middle))]
        for end, part in enumerate(parts):
            for group in part:
                for i in group.members[1 - end]:
                    joined[i] |= _of(own[end], group.members[end])
        within = [
            [_of(own[end], g.members[end]).union(*(joined[i] for i in g.members[1 - end])) for g in part]
            for end, part in enumerate(parts)
        ]
        while True:
            again = {i for s in (*within[0], *within[1]) if _any(s, states, "open") for i in s if _is_found(i, states)}
            if not again:
                break
            if _EARLIER in again:
                raise MixedError
            states = ["open" if i in again else state for i, state in enumerate(states)]
        found = np.array([_any(s, states, "found") for s in joined], bool)
        # Modes that are known in the middle alone are in no group of this interval.
        left, right = (
            [g for g, s in zip(part, sets, strict=True) if not s or _any(s, states, "open")]
            for part, sets in zip(parts, within, strict=True)
        )
        before, behind = (np.array([_any({int(i)}, states, "found") for i in positions], bool) for positions in own)
        return Interval((a, middle), left, (before, found)), Interval((middle, b), right, (found, behind)), states


def _positions(node: Node, members: list[Group], end: int, found: np.ndarray) -> np.ndarray:
    """Return for each mode at an end the position of its group, or how it was settled earlier."""
    position = np.where(found, _EARLIER, _IDLE)
    for i, group in enumerate(members):
        position[group.members[end]] = i
    return position


def _of(position: np.ndarray, members: np.ndarray) -> set[int]:
    return set(position[members].tolist())


def _is_found(i: int, states: Sequence[State]) -> bool:
    return i == _EARLIER or (i >= 0 and states[i] == "found")


def _any(positions: set[int], states: Sequence[State], state: State) -> bool:
    if state == "found":
        return any(_is_found(i, states) for i in positions)
    return any(i >= 0 and states[i] == state for i in positions)
