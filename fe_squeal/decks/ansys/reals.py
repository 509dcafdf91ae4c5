"""R and RMORE of Ansys archives: real constants that stand in no RLBLOCK."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import MeshError
from ...mesh.raw import Floats
from ...mesh.readers.ansys_forms import is_release
from .content import Line

_IN_A_COMMAND = 6  # constants of R and of each RMORE
_MOST = 10_000  # constants of a set: far more than any element has


def read_real_constants(lines: Sequence[Line], source: str) -> dict[int, Floats]:
    """Return the sets of real constants of R and RMORE by their numbers, blank ones as 0.

    R gives the first six of a set, RMORE the next six each time. In the form of CDWRITE without blocks,
    R,R5.0,5,LOC,3,-1500. or with UNBL, R gives up to three from the third on.

    Raises
    ------
    MeshError
        A value is no number, or at no place in a set, or RMORE follows no R.
    """
    found: dict[int, list[float]] = {}
    number = 0  # of the set that RMORE goes on with
    for fields, where in lines:
        if fields[0] not in ("R", "RMORE"):
            continue
        try:
            if fields[0] == "RMORE":
                given, place = fields[1:], len(found[number])
            elif is_release(fields[1]):
                given, number, place = fields[5:8], int(fields[2]), int(fields[4]) - 1
                found.setdefault(number, [])
            else:
                given, number, place = fields[2:], int(fields[1]), 0
                found[number] = []
            values = [float(text or 0.0) for text in given[:_IN_A_COMMAND]]
            if not 0 <= place < _MOST:
                raise ValueError
            own = found[number]
            own += [0.0] * (place + _IN_A_COMMAND - len(own))
            own[place : place + len(values)] = values
        except (ValueError, IndexError, KeyError):
            raise MeshError(f'{source}: {where}: "{",".join(fields)[:60]}" gives no real constants') from None
    return {key: np.array(values) for key, values in found.items()}
