"""Sparse matrices whose rows are spread over the processes under mpiexec: what each process does with its own rows.

Each function is called on all processes together with the same `what`, see `processes.together`; `data` is there on
process 0 alone, which also gets the result. Without other processes `comm` is None.

A process keeps of each matrix its rows, in the columns that have entries there. Numbers of a vector are sent for these
columns alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from .column_parts import ends

_TAG = 9  # of messages with numbers of a vector


@dataclass(frozen=True)
class _Partition:
    """Which unknowns this process has the rows of.

    Attributes
    ----------
    own : (m,) int
        In rising order.
    position : (n,) int
        Of each unknown in the order of the processes.
    """

    own: np.ndarray
    position: np.ndarray


@dataclass(frozen=True)
class _Rows:
    """Rows (m, n) of this process of a matrix.

    Attributes
    ----------
    columns : (c,) int
        Those with entries, in rising order.
    matrix : (m, c) sparse float
    pattern : int
        The same number, on all processes, for matrices that have the same columns on each.
    """

    columns: np.ndarray
    matrix: sp.csr_array
    pattern: int


class SpreadRows(NamedTuple):
    """What process 0 knows of a matrix whose rows are spread.

    Attributes
    ----------
    pattern : int
        Of `_Rows`.
    columns : list of (c,) int
        The columns in which each process has entries.
    entries : int
        Stored ones, on all processes.
    """

    pattern: int
    columns: list[np.ndarray]
    entries: int


_partitions: dict[int, _Partition] = {}
_rows: dict[int, _Rows] = {}


def release(handle: int) -> None:
    """Forget the rows of one matrix, or one partition, if there is any."""
    _partitions.pop(handle, None)
    _rows.pop(handle, None)


def own_unknowns(handle: int) -> np.ndarray:
    """Return the unknowns (m,) whose rows this process has in a partition."""
    return _partitions[handle].own


def partition(comm: Any, what: dict[str, Any], position: np.ndarray | None) -> None:
    """Agree on who has which rows: position (n,) of each unknown in the order of the processes."""
    known = position if comm is None else comm.bcast(position, root=0)
    assert known is not None
    size, rank = (1, 0) if comm is None else (comm.size, comm.rank)
    low, high = ends(len(known), size)[rank : rank + 2]
    _partitions[what["handle"]] = _Partition(np.flatnonzero((known >= low) & (known < high)), known)


def keep_rows(comm: Any, handles: Sequence[int], found: Sequence[sp.csr_array]) -> list[SpreadRows] | None:
    """Keep this process's rows (m, n) of some matrices; process 0 is told of each."""
    told, pattern, columns = [], 0, np.zeros(0, np.int32)
    for handle, A in zip(handles, found, strict=True):
        used = np.zeros(A.shape[1], bool)
        used[A.indices] = True
        before, columns = columns, np.flatnonzero(used).astype(np.int32)
        # Mass and stiffness of a body have their entries at the same places, and need the same numbers of a vector.
        same = bool(pattern) and np.array_equal(columns, before)
        if not (same if comm is None else all(comm.allgather(same))):
            pattern = handle
        number = np.zeros(A.shape[1], np.int32)
        number[columns] = np.arange(len(columns), dtype=np.int32)
        matrix = sp.csr_array((A.data, number[A.indices], A.indptr.astype(np.int32)), shape=(A.shape[0], len(columns)))
        _rows[handle] = _Rows(columns, matrix, pattern)
        own = columns, int(matrix.nnz)
        every = [own] if comm is None else comm.gather(own, root=0)
        if every is not None:
            told.append(SpreadRows(pattern, [c for c, _ in every], sum(count for _, count in every)))
    return told if comm is None or comm.rank == 0 else None


def put_rows(comm: Any, what: dict[str, Any], A: sp.csr_array | None) -> list[SpreadRows] | None:
    """Spread the rows of a matrix (n, n) that process 0 has; returns what `keep_rows` does."""
    own = _own_rows(comm, _partitions[what["partition"]], A)
    assert own is not None
    return keep_rows(comm, [what["handle"]], [own])


def product(comm: Any, what: dict[str, Any], data: Any) -> np.ndarray | None:
    """Return Σ c A X (n, k), or Σ |c||A| X, for some matrices with factors c and X (n, k) float.

    `data` are X and, by the pattern of a matrix, the columns that each process needs.
    """
    at, k = _partitions[what["partition"]], what["columns"]
    X, needed = (None, None) if data is None else data
    total, known = np.zeros((len(at.own), k)), {}
    for factor, handle in what["parts"]:
        rows = _rows[handle]
        if rows.pattern not in known:
            known[rows.pattern] = _received(comm, X, None if needed is None else needed[rows.pattern], rows.columns, k)
        if what["sizes"]:
            total += abs(factor) * (abs(rows.matrix) @ known[rows.pattern])
        else:
            total += factor * (rows.matrix @ known[rows.pattern])
    return _gathered(comm, len(at.position), total, at.position)


def _received(
    comm: Any, X: np.ndarray | None, needed: list[np.ndarray] | None, columns: np.ndarray, k: int
) -> np.ndarray:  # fmt: skip
    """Return the rows of X (n, k), which process 0 has, at the columns (c,) of this process's rows of a matrix."""
    if comm is None or comm.rank == 0:
        assert X is not None and needed is not None
        for other in range(1, len(needed)):
            comm.Send(np.ascontiguousarray(X[needed[other]]), dest=other, tag=_TAG)
        return X[columns]
    found = np.empty((len(columns), k))
    comm.Recv(found, source=0, tag=_TAG)
    return found


def diagonal(comm: Any, what: dict[str, Any], data: None) -> np.ndarray | None:
    """Return the diagonal (n,) of Σ c A."""
    at = _partitions[what["partition"]]
    total = np.zeros((len(at.own), 1))
    for factor, handle in what["parts"]:
        rows = _rows[handle]
        place = np.searchsorted(rows.columns, at.own)
        here = np.flatnonzero(np.isin(at.own, rows.columns, assume_unique=True))
        total[here, 0] += factor * np.asarray(rows.matrix[here, place[here]])
    found = _gathered(comm, len(at.position), total, at.position)
    return None if found is None else found[:, 0]


def some_rows(comm: Any, what: dict[str, Any], data: None) -> sp.csr_array | None:
    """Return rows (l, n) of Σ c A, those of the unknowns (l,) int that are asked for, or all."""
    at, wanted = _partitions[what["partition"]], what["rows"]
    whole = wanted is None
    wanted = np.arange(len(at.position)) if whole else wanted
    place = np.searchsorted(at.own, wanted)
    here = np.flatnonzero(np.isin(wanted, at.own))
    found = sp.csr_array(summed(what["parts"], len(at.own), len(at.position))[place[here]])
    if comm is None:
        return found
    if comm.rank:
        comm.send(here, dest=0, tag=_TAG)
        send_rows(comm, found, 0)
        return None
    places, rows = [here], [found]
    for other in range(1, comm.size):
        places.append(comm.recv(source=other, tag=_TAG))
        rows.append(received_rows(comm, other, len(at.position)))
    order = np.argsort(np.concatenate(places))
    return sp.csr_array(sp.csr_array(sp.vstack(rows, format="csr"))[order])


def summed(parts: Sequence[tuple[complex, int]], m: int, n: int) -> sp.csr_array:
    """Return this process's rows (m, n) of Σ c A."""
    total = sp.csr_array((m, n))
    for factor, handle in parts:
        rows = _rows[handle]
        A = rows.matrix
        total = total + sp.csr_array((factor * A.data, rows.columns[A.indices], A.indptr), shape=(m, n))
    return sp.csr_array(total)


def scale(comm: Any, what: dict[str, Any], rest: sp.csr_array | None) -> list[SpreadRows] | None:
    """Keep max(|A_ij|, √(|A_ii A_jj|)) for the entries of A = Σ c A + R; those of R that are zero count."""
    total, at, roots = _with_rest(comm, what, rest), _partitions[what["partition"]], what["roots"]
    products = np.repeat(roots[at.own], np.diff(total.indptr)) * roots[total.indices]
    sizes = sp.csr_array((np.maximum(np.abs(total.data), products), total.indices, total.indptr), shape=total.shape)
    return keep_rows(comm, [what["handle"]], [sizes])


def largest(comm: Any, what: dict[str, Any], rest: sp.csr_array | None) -> float:
    """Return the largest |entry| of Σ c A + R on process 0."""
    own = float(np.abs(_with_rest(comm, what, rest).data).max(initial=0.0))
    return own if comm is None else max(comm.gather(own, root=0) or [own])


def _with_rest(comm: Any, what: dict[str, Any], rest: sp.csr_array | None) -> sp.csr_array:
    """Return this process's rows (m, n) of Σ c A + R, with those entries of R that are zero."""
    at = _partitions[what["partition"]]
    total = summed(what["parts"], len(at.own), len(at.position))
    if (R := _own_rows(comm, at, rest, what["has_rest"])) is not None:
        parts = [sp.coo_array(total), sp.coo_array(R)]  # sums of SciPy's matrices would leave the zeros out
        data, (i, j) = (np.concatenate([A.data for A in parts]), np.hstack([A.coords for A in parts]))
        total = sp.csr_array((data, (i, j)), shape=total.shape)
        total.sum_duplicates()  # SciPy 1.13 leaves them
    return total


def rows_to_factorise(comm: Any, what: dict[str, Any], rest: sp.csr_array | None) -> sp.csr_array:
    """Return this process's rows (m, n) of Σ c A + R, rows and columns in the order of the processes.

    `rest` is R (n, n) on process 0, of few entries. Of a complex A + iB it returns rows (2m, 2n) of [[A, −B], [B, A]]:
    each process has both rows of its unknowns, those of the real parts first.
    """
    at = _partitions[what["partition"]]
    n = len(at.position)
    total = summed(what["parts"], len(at.own), n)
    if (R := _own_rows(comm, at, rest, what["has_rest"])) is not None:
        total = sp.csr_array(total + R)
    total.sum_duplicates()
    if not what["complex"]:
        return _in_columns(total, total.data, at.position, n)
    starts = ends(n, 1 if comm is None else comm.size)
    process = np.searchsorted(starts, at.position, side="right") - 1
    real = at.position + starts[process]  # the columns of real parts; those of imaginary parts follow
    imaginary = real + np.diff(starts)[process]
    A, B = total.data.real, total.data.imag
    upper = _in_columns(total, A, real, 2 * n) - _in_columns(total, B, imaginary, 2 * n)
    lower = _in_columns(total, B, real, 2 * n) + _in_columns(total, A, imaginary, 2 * n)
    return sp.csr_array(sp.vstack([upper, lower], format="csr"))


def _in_columns(rows: sp.csr_array, data: np.ndarray, column: np.ndarray, n: int) -> sp.csr_array:
    """Return rows (m, n) with other entries, each in another column."""
    found = sp.csr_array((data.copy(), column[rows.indices], rows.indptr), shape=(rows.shape[0], n))  # sorted in place
    found.has_sorted_indices = False
    found.sort_indices()
    return found


def _own_rows(
    comm: Any, at: _Partition, A: sp.csr_array | None, is_there: bool = True
) -> sp.csr_array | None:  # fmt: skip
    """Return this process's rows (m, n) of a matrix (n, n) that process 0 has, if it has one."""
    if not is_there:
        return None
    if comm is None or comm.rank == 0:
        assert A is not None
        for other in range(1, 1 if comm is None else comm.size):
            low, high = ends(len(at.position), comm.size)[other : other + 2]
            send_rows(comm, sp.csr_array(A[(at.position >= low) & (at.position < high)]), other)
        return sp.csr_array(A[at.own])
    return received_rows(comm, 0, len(at.position))


def send_rows(comm: Any, A: sp.csr_array, to: int) -> None:
    """Send a matrix by its arrays: a message that is pickled holds no more than two gigabytes."""
    entries = complex if np.iscomplexobj(A) else float
    comm.send((len(A.indptr), len(A.data), entries), dest=to, tag=_TAG)
    for array, kind in ((A.indptr, np.int64), (A.indices, np.int32), (A.data, entries)):
        comm.Send(np.ascontiguousarray(array, kind), dest=to, tag=_TAG)


def received_rows(comm: Any, source: int, n: int) -> sp.csr_array:
    """Return the rows (m, n) that a process sends by `send_rows`."""
    count, entries, kind = comm.recv(source=source, tag=_TAG)
    indptr, indices, data = np.empty(count, np.int64), np.empty(entries, np.int32), np.empty(entries, kind)
    for array in (indptr, indices, data):
        comm.Recv(array, source=source, tag=_TAG)
    return sp.csr_array((data, indices, indptr), shape=(count - 1, n))


def _gathered(comm: Any, n: int, own: np.ndarray, position: np.ndarray) -> np.ndarray | None:
    """Return on process 0 the array (n, k) of which each process has the rows (m, k) of its unknowns."""
    if comm is None:
        return own[position]
    k = own.shape[1]
    whole = np.empty((n, k)) if comm.rank == 0 else None
    comm.Gatherv(own, [whole, np.diff(ends(n, comm.size)) * k], root=0)
    return None if whole is None else whole[position]
