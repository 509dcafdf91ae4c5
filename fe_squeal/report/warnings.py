"""Warnings as they are printed: those that say the same once, with how many there are, the gravest at the end."""

from __future__ import annotations

import re
from collections.abc import Sequence

# A number that stands alone; those in names, pad_1 and pad_2, are other things.
_NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def told_once(warnings: Sequence[str]) -> list[str]:
    """Return each warning once; of those that differ in numbers alone the last, with how many there are.

    They stay in the order of the last one of each kind, so that the list still ends with the gravest.

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
