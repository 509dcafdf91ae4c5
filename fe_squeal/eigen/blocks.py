"""Products of blocks of tall vectors: sparse ones by MKL, others with a slice of the rows on each thread or process."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
import scipy.sparse as sp

from .columns import Columns, ColumnStore, SpreadColumns, SpreadStore
from .linear.spread_matrix import SpreadMatrix
from .mkl import multiply
from .threads import thread_count

_TALL = 5000  # rows from which the work of slicing them pays
_ROWS = 2**15  # rows that are combined at once where all of them would be a copy of a large basis
# Of all rows: if a term acts in fewer than the first part, these rows of a basis are copied for its projection; if in
# more than the second, never; between them if the copy takes at most so many bytes.
_FEW, _MANY, _COPIED = 0.1, 0.75, 2**28
_PIECE = 64  # vectors that are multiplied at once: products of all of them may not fit into memory
_Part = TypeVar("_Part")


def faster(A: sp.csr_array) -> sp.csr_array | np.ndarray:
    """Return a matrix as an array if more than half of its entries are stored: products with blocks are faster so."""
    return np.asarray(A.toarray()) if A.nnz > A.shape[0] * A.shape[1] / 2 else A


def with_short_indices(A: sp.csr_array) -> sp.csr_array:
    """Return a matrix whose indices are 32-bit numbers where they fit: MKL takes no others, and half as much is read.

    SciPy keeps the type of the index arrays that a matrix was made of, in what is made of the matrix, too.

    Examples
    --------
    >>> with_short_indices(sp.csr_array((np.ones(2), (np.arange(2), np.arange(2))))).indices.dtype
    dtype('int32')
    """
    if isinstance(A, SpreadMatrix) or A.indices.dtype == np.int32 or max(*A.shape, A.nnz) > np.iinfo(np.int32).max:
        return A
    return sp.csr_array((A.data, A.indices.astype(np.int32), A.indptr.astype(np.int32)), shape=A.shape)


def times(A: sp.csr_array, X: np.ndarray) -> np.ndarray:
    """Return A X for a sparse A (m, n) and X (n, k)."""
    if isinstance(A, SpreadMatrix):
        return np.asarray(A @ X)
    if A.shape[0] < _TALL:
        return np.asarray((faster(A) if X.ndim > 1 else A) @ X)

    X = np.ascontiguousarray(X)  # or SciPy makes a copy of it in each thread
    out = np.empty((A.shape[0], *X.shape[1:]), np.result_type(A.dtype, X))
    if multiply(A, X.reshape(len(X), -1), out.reshape(len(out), -1)):
        return out

    def part(rows: slice) -> None:
        first, last = A.indptr[rows.start], A.indptr[rows.stop]
        pointers = A.indptr[rows.start : rows.stop + 1] - first
        size = (rows.stop - rows.start, A.shape[1])
        out[rows] = sp.csr_array((A.data[first:last], A.indices[first:last], pointers), shape=size) @ X

    _in_slices(part, A.shape[0])
    return out


def cross(X: Columns, Y: np.ndarray) -> np.ndarray:
    """Return XᵀY for X (n, k) and Y (n, l), either of them complex or not, without a complex copy of X."""
    if np.iscomplexobj(Y) and not np.iscomplexobj(X):
        return np.ascontiguousarray(cross(X, np.ascontiguousarray(Y).view(float))).view(complex)
    if isinstance(X, SpreadColumns):
        return X.cross(Y)
    if len(X) < _TALL:
        return np.asarray(X.T @ Y)
    return np.asarray(sum(_in_slices(lambda rows: X[rows].T @ Y[rows], len(X))))


def cross_in(X: Columns, rows: np.ndarray | None, *blocks: np.ndarray) -> list[np.ndarray]:
    """Return X[rows]ᵀY for X (n, k), rows (m,) int or None for all, and each Y (m, l).

    The rows of a few columns are gathered at once: those of all columns of a large basis would take gigabytes.
    """
    if rows is None:
        return [cross(X, Y) for Y in blocks]
    parts = [[np.zeros((0, Y.shape[1]), np.result_type(X, Y)) for Y in blocks]]
    for i in range(0, X.shape[1], _PIECE):
        few = X[:, i : i + _PIECE]
        gathered = few.T.take(rows, axis=1).T if isinstance(few, np.ndarray) else few[rows]
        parts.append([cross(gathered, Y) for Y in blocks])
    return [np.vstack(own) for own in zip(*parts, strict=True)]


def form(U: Columns, A: sp.csr_array, V: Columns) -> np.ndarray:
    """Return UᵀAV (k, r) for a sparse A (m, n), U (m, k) and V (n, r), a few vectors V after the others."""
    return np.hstack([np.zeros((U.shape[1], 0)), *(cross(U, times(A, X)) for X in pieces(V))])


def projected(V: Columns, A: sp.csr_array, sign: int = 0) -> np.ndarray:
    """Return VᵀAV (r, r) for a sparse A (n, n) and V (n, r), a few vectors after the others.

    Products are formed in the rows in which A has entries: a term of one body has them in the rows of this body alone.

    Parameters
    ----------
    sign : 1, -1 or 0
        1 where A is symmetric and -1 where it is skew-symmetric: then half of the products suffice.
    """
    (n, r), here = V.shape, V
    rows = np.arange(n) if isinstance(A, SpreadMatrix) else np.flatnonzero(np.diff(A.indptr))
    is_worth_a_copy = isinstance(V, np.ndarray) and len(rows) <= _MANY * n and 8 * len(rows) * r <= _COPIED
    if len(rows) < n and (len(rows) < _FEW * n or is_worth_a_copy):
        here = V.T.take(rows, axis=1).T if isinstance(V, np.ndarray) else V[rows]
        A = _without_empty(A, rows)
    out = np.empty((r, r))
    for first in range(0, r, _PIECE):
        own = slice(first, min(first + _PIECE, r))
        upper = here[:, : own.stop] if sign else here
        out[: upper.shape[1], own] = cross(upper, times(A, np.asarray(V[:, own])))
        if sign:
            out[own, :first] = sign * out[:first, own].T
            out[own, own] = (out[own, own] + sign * out[own, own].T) / 2
    return out


def _without_empty(A: sp.csr_array, rows: np.ndarray) -> sp.csr_array:
    """Return A[rows] of those rows (m,) that have entries, all of them, without a copy of the entries."""
    return sp.csr_array((A.data, A.indices, np.append(A.indptr[rows], A.indptr[-1:])), shape=(len(rows), A.shape[1]))


def pieces(V: Columns) -> Iterator[np.ndarray]:
    """Return columns V (n, r), a few after the others."""
    return (np.asarray(V[:, i : i + _PIECE]) for i in range(0, V.shape[1], _PIECE))


def combine(V: Columns, y: np.ndarray) -> np.ndarray:
    """Return V y for V (n, r) and y (r, k)."""
    if isinstance(V, SpreadColumns):
        return V.combine(y)
    if len(V) < _TALL:
        return np.asarray(V @ y)
    out = np.empty((len(V), *y.shape[1:]), np.result_type(V, y))

    def part(rows: slice) -> None:
        np.matmul(V[rows], y, out=out[rows])

    _in_slices(part, len(V))
    return out


def put_combined(store: ColumnStore, first: int, V: Columns, y: np.ndarray | None = None) -> None:
    """Put V y, of columns V (n, r) of this store or another and y (r, k), behind the first ones; V without y."""
    if isinstance(store, SpreadStore):
        assert isinstance(V, SpreadColumns)
        store.put_mixed(first, V, y)
    else:
        for begin in range(0, len(V), _ROWS):  # V may be columns of the store that are overwritten
            rows = slice(begin, begin + _ROWS)
            store.put(first, np.asarray(V[rows]) if y is None else combine(V[rows], y), rows)


def lift(V: sp.csr_array | Columns, y: np.ndarray) -> np.ndarray:
    """Return V y for V (n, r), sparse or not, and y (r,) or (r, k), complex or not, without a complex copy of V."""
    if isinstance(V, SpreadColumns):
        return V.combine(y.reshape(len(y), -1)).reshape(len(V), *y.shape[1:])
    product = combine if isinstance(V, np.ndarray) else times
    if not np.iscomplexobj(y) or np.iscomplexobj(V):
        return product(V, y)
    columns = np.ascontiguousarray(y.reshape(len(y), -1), dtype=complex)
    sparse = not isinstance(V, np.ndarray)
    if V.shape[0] < _TALL or (sparse and columns.imag.any(axis=0).all()):
        # Real and imaginary parts side by side are twice as many real columns.
        return np.asarray(product(V, columns.view(float))).view(complex).reshape(V.shape[0], *y.shape[1:])
    lifted = product(V, np.ascontiguousarray(columns.real)).astype(complex)
    mixed = np.flatnonzero(columns.imag.any(axis=0))  # most vectors are real
    if len(mixed):
        lifted[:, mixed] += 1j * product(V, np.ascontiguousarray(columns.imag[:, mixed]))
    return lifted.reshape(len(lifted), *y.shape[1:])


def _in_slices(work: Callable[[slice], _Part], n: int) -> list[_Part]:
    count = thread_count()
    edges = [n * i // count for i in range(count + 1)]
    parts = [slice(a, b) for a, b in itertools.pairwise(edges)]
    return [work(parts[0])] if count == 1 else list(_pool(count).map(work, parts))


@functools.cache
def _pool(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count)
