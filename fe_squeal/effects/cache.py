"""A cache: what was made before is found again by a key of everything that it was made from."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

_KEPT = 4  # versions of one thing that are kept: at a value, beside it for differences, and one more
_Made = TypeVar("_Made")


class Same:
    """An object as part of a key: equal to itself alone. The key holds it, so that no other one takes its place."""

    def __init__(self, thing: object) -> None:
        self.thing = thing

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and self.thing is other.thing

    def __hash__(self) -> int:
        return object.__hash__(self.thing)


class Cache:
    """Things by their kind, each kind in a few versions by their keys.

    Examples
    --------
    >>> cache = Cache()
    >>> made = [cache.get("sum", (2, 3), lambda: [2 + 3]) for _ in range(2)]
    >>> made[0] is made[1], cache.latest("sum"), cache.latest("product")
    (True, [5], None)
    """

    def __init__(self) -> None:
        self._made: dict[str, list[tuple[object, Any]]] = {}

    def get(self, kind: str, key: object, make: Callable[[], _Made]) -> _Made:
        """Return what was made from the same key before, or make it."""
        entries = self._made.setdefault(kind, [])
        for known, thing in entries:
            if known == key:
                return thing
        made = make()
        entries.append((key, made))
        del entries[:-_KEPT]
        return made

    def latest(self, kind: str) -> Any:
        """Return the last thing of a kind that was made; None where there is none."""
        entries = self._made.get(kind)
        return entries[-1][1] if entries else None
