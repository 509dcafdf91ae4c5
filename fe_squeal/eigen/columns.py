"""Many columns of a problem's length, kept in this process or, under mpiexec, with their rows on all processes."""

from __future__ import annotations

import tempfile
from typing import Any

import numpy as np

from ..process.ranks import process_count
from .linear.column_parts import pieces
from .linear.processes import give_up, local_count, new_handle, together
from .pages import empty_pages, give_back

_LEAST = 20_000  # rows from which they are spread: a step of all processes costs up to some milliseconds of waiting


class LocalStore:
    """Room for columns of n numbers in this process.

    Parameters
    ----------
    n : int
    room : int
        For so many columns; pages that are not written to take no memory.
    """

    def __init__(self, n: int, room: int = 0) -> None:
        self._array = empty_pages(room, n)  # a column in each row

    @staticmethod
    def of(rows: np.ndarray) -> LocalStore:
        """Return a store that is full with the rows (r, n) of an array as its columns, without a copy."""
        store = LocalStore(0)
        store._array = rows
        return store

    @property
    def room(self) -> int:
        """How many columns it holds at most."""
        return len(self._array)

    def columns(self, count: int) -> np.ndarray:
        """Return the first columns (n, count), which share the memory of the store."""
        return self._array[:count].T

    def put(self, first: int, X: np.ndarray, rows: slice = slice(None)) -> None:
        """Put columns X (n, k) behind the first ones, in place of what is there; or some of their rows."""
        self._array[first : first + X.shape[1], rows] = X.T

    def keep(self, count: int) -> None:
        """Give back the memory of all columns behind the first ones, as far as the system takes it."""
        give_back(self._array, count)


class SpreadStore:
    """The same with the rows of the columns on all processes.

    Parameters
    ----------
    n : int
    room : int
        For so many columns.
    """

    def __init__(self, n: int, room: int = 0) -> None:
        self.n, self.room, self.handle = n, room, new_handle()
        together("make columns", None, handle=self.handle, n=n, room=room)

    @staticmethod
    def of(rows: np.ndarray) -> SpreadStore:
        """Return a store that is full with the rows (r, n) of an array as its columns."""
        store = SpreadStore(rows.shape[1], len(rows))
        store.put(0, rows.T)
        return store

    def columns(self, count: int) -> SpreadColumns:
        """Return the first columns (n, count)."""
        return SpreadColumns(self, 0, count)

    def put(self, first: int, X: np.ndarray) -> None:
        """Put columns X (n, k) behind the first ones, in place of what is there."""
        for begin, end in pieces(self.n, X.shape[1]):
            together("put columns", X[:, begin:end], handle=self.handle, n=self.n, first=first + begin,
                     columns=end - begin)  # fmt: skip

    def put_mixed(self, first: int, V: SpreadColumns, W: np.ndarray | None) -> None:
        """Put V W, of columns V (n, r) of this or another store and W (r, k), behind the first ones; V without W."""
        together("mix columns", None, handle=self.handle, first=first, source=V.store.handle, begin=V.begin, end=V.end,
                 W=W)  # fmt: skip

    def keep(self, count: int) -> None:
        """Give back the memory of all columns behind the first ones, as far as the system takes it."""
        together("keep columns", None, handle=self.handle, count=count)

    def __del__(self) -> None:
        if hasattr(self, "handle"):
            give_up(self.handle)


class SpreadColumns:
    """Some columns V (n, r) float of a `SpreadStore`, which are used like an array; what is asked for is sent.

    `V[rows]` is an array of the rows (l,) int that are asked for, `V[:, a:b]` are some of the columns. Products with a
    basis, `cross` and `combine` of `fe_squeal.eigen.blocks`, are formed where the rows are. Everything else that takes
    an array gets all of V.
    """

    dtype, ndim = np.dtype(float), 2

    def __init__(self, store: SpreadStore, begin: int, end: int) -> None:
        self.store, self.begin, self.end = store, begin, end

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.store.n, self.end - self.begin

    def __len__(self) -> int:
        return self.store.n

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, tuple):
            rows, columns = key
            assert rows == slice(None) and columns.step is None
            begin, end, _ = columns.indices(self.shape[1])
            return SpreadColumns(self.store, self.begin + begin, self.begin + max(begin, end))
        return together("rows of columns", None, rows=np.asarray(key), **self._own())

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        whole = np.empty((self.shape[1], len(self))).T  # contiguous columns, as those of a store in one process
        for begin, end in pieces(*self.shape):
            whole[:, begin:end] = self.combine(np.eye(self.shape[1])[:, begin:end])
        return whole if dtype is None else whole.astype(dtype, copy=False)

    def combine(self, y: np.ndarray) -> np.ndarray:
        """Return V y (n, k) for y (r, k) float or complex."""
        if np.iscomplexobj(y):
            return np.ascontiguousarray(self.combine(np.ascontiguousarray(y).view(float))).view(complex)
        parts = [
            together("combine columns", None, y=np.ascontiguousarray(y[:, begin:end]), **self._own())
            for begin, end in pieces(len(self), y.shape[1])
        ]
        return np.asarray(parts[0] if len(parts) == 1 else np.hstack([np.zeros((len(self), 0)), *parts]))

    def cross(self, X: np.ndarray) -> np.ndarray:
        """Return VᵀX (r, k) for X (n, k) float."""
        parts = [
            together("cross columns", X[:, begin:end], columns=end - begin, **self._own())
            for begin, end in pieces(*X.shape)
        ]
        return np.asarray(parts[0] if len(parts) == 1 else np.hstack([np.zeros((self.shape[1], 0)), *parts]))

    def _own(self) -> dict[str, Any]:
        return {"handle": self.store.handle, "n": self.store.n, "begin": self.begin, "end": self.end}


Columns = np.ndarray | SpreadColumns
ColumnStore = LocalStore | SpreadStore


def are_spread(n: int, processes: int) -> bool:
    """Return whether columns of n numbers are spread over so many processes."""
    return processes > 1 and n >= _LEAST


def part_here(n: int) -> float:
    """Return the part of columns of n numbers that the processes of this machine hold."""
    return local_count() / process_count() if are_spread(n, process_count()) else 1.0


def store_for(n: int) -> type[LocalStore] | type[SpreadStore]:
    """Return the kind of store for columns of n numbers."""
    return SpreadStore if are_spread(n, process_count()) else LocalStore


def transposed(V: Columns) -> np.ndarray:
    """Return Vᵀ (r, n) of columns V (n, r), to be read only: a view, or a temporary file where V is spread."""
    if isinstance(V, np.ndarray):
        return V.T
    if not V.shape[1]:
        return np.zeros(V.shape[::-1])
    with tempfile.TemporaryFile() as file:
        whole = np.memmap(file, float, "w+", shape=V.shape[::-1])
        for begin, end in pieces(*V.shape):
            whole[begin:end] = np.asarray(V[:, begin:end]).T
            whole.flush()
    return whole
