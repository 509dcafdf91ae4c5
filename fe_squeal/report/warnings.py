"""Warnings for printing: similar ones once, with their number, and the most serious at the end."""

from __future__ import annotations

import re
from collections.abc import Sequence

# A number that is not part of a name such as pad_1.
_NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def told_once(warnings: Sequence[str]) -> list[str]:
    """Return each warning once; of several that differ only in their numbers the last one, and how many there are.

    They keep the order of the last one of each kind, so that the most serious are still at the end.

    Examples
    --------
    >>> told_once(["branch 3 is lost at 0.1", "a spring has no effect", "branch 4 is lost at 0.25"])
    ['a spring has no effect', 'branch 4 is lost at 0.25 (one of 2 such warnings)']
    >>> told_once(["twice", "twice"])
    ['twice (2 times)']
    """
    kinds: dict[str, list[str]] = {}
    for text in warnings:
        kind = _NUMBER.sub("#", text)
        alike = kinds.pop(kind, [])
        kinds[kind] = [*alike, text]
    told = []
    for alike in kinds.values():
        count = len(alike)
        equal = len(set(alike)) == 1
        tail = "" if count == 1 else f" ({count} times)" if equal else f" (one of {count} such warnings)"
        told.append(alike[-1] + tail)
    return told
