"""Columns whose rows are spread over the processes under mpiexec: what each process does with its own rows.

Each function is called on all processes together with the same `what`, see `processes.together`; `data` is there on
process 0 alone, which also gets the result. Without other processes `comm` is None.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..pages import empty_pages, give_back

_MOST = 2**27  # numbers that are sent at once: process 0 has these beside what it keeps; MPI counts to 2³¹ − 1
_parts: dict[int, np.ndarray] = {}  # by handle the rows of this process, a column in each row of the array: (room, m)


def ends(n: int, parts: int) -> np.ndarray:
    """Return where the rows (n,) of each process begin, and the end of the last one's: (parts + 1,)."""
    return np.array([n * i // parts for i in range(parts + 1)])


def pieces(n: int, columns: int) -> Iterator[tuple[int, int]]:
    """Return where the columns of an array (n, columns) begin and end that are sent at once."""
    step = max(1, _MOST // max(n, 1))
    return ((begin, min(begin + step, columns)) for begin in range(0, columns, step))


def scattered(comm: Any, n: int, columns: int, whole: np.ndarray | None, rows: int = 1) -> np.ndarray:
    """Return this process's rows (m, k) of an array (n, k) float that process 0 has, so many for each unknown."""
    if comm is None:
        assert whole is not None
        return whole
    at = rows * ends(n // rows, comm.size)
    own = np.empty((int(np.diff(at)[comm.rank]), columns))
    comm.Scatterv([None if whole is None else np.ascontiguousarray(whole, float), np.diff(at) * columns], own, root=0)
    return own


def gathered(comm: Any, n: int, own: np.ndarray, rows: int = 1) -> np.ndarray | None:
    """Return on process 0 the array (n, k) float that each process has rows (m, k) of, so many for each unknown."""
    if comm is None:
        return own
    columns = own.shape[1]
    whole = np.empty((n, columns)) if comm.rank == 0 else None
    counts = rows * np.diff(ends(n // rows, comm.size)) * columns
    comm.Gatherv(np.ascontiguousarray(own), [whole, counts], root=0)
    return whole


def release(handle: int) -> None:
    """Forget the rows of one set of columns, if there is any."""
    _parts.pop(handle, None)


def make(comm: Any, what: dict[str, Any], data: None) -> None:
    """Set room aside for so many columns; pages that are not written to take no memory."""
    size, rank = (1, 0) if comm is None else (comm.size, comm.rank)
    _parts[what["handle"]] = empty_pages(what["room"], int(np.diff(ends(what["n"], size))[rank]))


def put(comm: Any, what: dict[str, Any], data: np.ndarray | None) -> None:
    """Put columns X (n, k) behind the first ones."""
    first, count = what["first"], what["columns"]
    _parts[what["handle"]][first : first + count] = scattered(comm, what["n"], count, data).T


def keep(comm: Any, what: dict[str, Any], data: None) -> None:
    """Give back the memory of all columns behind the first ones."""
    give_back(_parts[what["handle"]], what["count"])


def mix(comm: Any, what: dict[str, Any], data: None) -> None:
    """Put combinations V W of columns V of one set, or these themselves, behind the first ones of another or the same.

    Needs no message but the small W (r, k).
    """
    V = _parts[what["source"]][what["begin"] : what["end"]]
    mixed = V if what["W"] is None else what["W"].T @ V
    _parts[what["handle"]][what["first"] : what["first"] + len(mixed)] = mixed


def combine(comm: Any, what: dict[str, Any], data: None) -> np.ndarray | None:
    """Return V y (n, k) of some columns V for y (r, k)."""
    V = _parts[what["handle"]][what["begin"] : what["end"]]
    return gathered(comm, what["n"], V.T @ what["y"])


def cross(comm: Any, what: dict[str, Any], data: np.ndarray | None) -> np.ndarray | None:
    """Return VᵀX (r, k) of some columns V for X (n, k)."""
    V = _parts[what["handle"]][what["begin"] : what["end"]]
    own = V @ scattered(comm, what["n"], what["columns"], data)
    if comm is None:
        return own
    total = np.empty_like(own) if comm.rank == 0 else None
    comm.Reduce(own, total, root=0)
    return total


def rows(comm: Any, what: dict[str, Any], data: None) -> np.ndarray | None:
    """Return some rows (l, r) of some columns."""
    V, at = _parts[what["handle"]][what["begin"] : what["end"]], what["rows"]
    if comm is None:
        return V[:, at].T
    low, high = ends(what["n"], comm.size)[comm.rank : comm.rank + 2]
    here = np.flatnonzero((at >= low) & (at < high))
    found = comm.gather((here, V[:, at[here] - low].T), root=0)
    if comm.rank:
        return None
    whole = np.empty((len(at), len(V)))
    for positions, values in found:
        whole[positions] = values
    return whole
