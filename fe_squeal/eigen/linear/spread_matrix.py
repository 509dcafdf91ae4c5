"""Sparse matrices whose rows are kept on all processes under mpiexec, and that are used like those of this process."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from .column_parts import ends, pieces
from .matrix_parts import SpreadRows
from .processes import give_up, new_handle, process_count, together


@dataclass(frozen=True, eq=False)
class Partition:
    """Which process has the rows of which unknowns.

    Attributes
    ----------
    position : (n,) int
        Of each unknown in the order of the processes; those of one process keep their order.
    """

    position: np.ndarray

    @staticmethod
    def by(order: np.ndarray) -> Partition:
        """Return the partition in which each process has as many unknowns, that follow each other in an order (n,)."""
        n = len(order)
        position, at = np.empty(n, np.int32), ends(n, process_count())
        for low, high in itertools.pairwise(at):
            position[np.sort(order[low:high])] = np.arange(low, high)
        return Partition(position)

    @cached_property
    def handle(self) -> int:
        """Its number, with which the others know it."""
        handle = new_handle()
        together("partition", self.position, handle=handle)
        return handle

    @cached_property
    def order(self) -> np.ndarray:
        """The unknowns (n,) in the order of the processes."""
        return np.argsort(self.position)

    def __getstate__(self) -> dict[str, Any]:
        return {"position": self.position}  # a copy is another partition, with a number of its own

    def __del__(self) -> None:
        if "handle" in self.__dict__:
            give_up(self.handle)


class Part:
    """One symmetric matrix (n, n) float with its rows on all processes.

    Parameters
    ----------
    partition : Partition
    handle : int
        Its number, with which the others know it; it is given up with this object.
    told : SpreadRows
    """

    def __init__(self, partition: Partition, handle: int, told: SpreadRows) -> None:
        self.partition, self.handle, self.told = partition, handle, told

    @staticmethod
    def of(partition: Partition, A: sp.csr_array) -> Part:
        """Spread a symmetric matrix (n, n) of this process."""
        handle = new_handle()
        (told,) = together("put rows", A, handle=handle, partition=partition.handle)
        return Part(partition, handle, told)

    def __del__(self) -> None:
        give_up(self.handle)


class SpreadMatrix(sp.csr_array):
    """Σ c A + R (n, n), of symmetric matrices A with their rows on all processes and a matrix R of few entries here.

    The A are real; c and R may be complex.

    It takes the place of a sparse matrix. Sums and multiples, products with vectors, the transposed matrix, the
    diagonal, some rows and factors by MUMPS are made where the rows are. Everything else that SciPy does is done with
    the whole matrix, which is brought here for that time alone.

    Parameters
    ----------
    parts : sequence of (float or complex, Part)
        Each c and A, of one partition; at least one.
    rest : (n, n) sparse float or complex, optional
        R.
    """

    __array_priority__ = 20.0
    whole_count = 0  # how often a whole matrix was brought here

    def __init__(self, parts: Any, rest: sp.csr_array | None = None, **given: Any) -> None:
        if not (isinstance(parts, list | tuple) and parts and isinstance(parts[0][1], Part)):
            # SciPy makes another matrix of the class of this one: that is one of its own.
            self.__class__ = sp.csr_array
            sp.csr_array.__init__(self, parts, *([] if rest is None else [rest]), **given)
            return
        self.parts, self.rest = tuple(parts), rest
        self.partition = self.parts[0][1].partition
        n = len(self.partition.position)
        self._shape, self.maxprint = (n, n), 50

    @property
    def dtype(self) -> np.dtype:
        """The type of the entries: complex where any c is, or R."""
        factors = [c for c, _ in self.parts]
        return np.dtype(complex if any(map(np.iscomplexobj, [*factors, self.rest])) else float)

    @property
    def nnz(self) -> int:
        """Entries that are stored, of summands with theirs at the same places once."""
        every: dict[int, int] = {}
        for _, part in self.parts:
            every[part.told.pattern] = max(part.told.entries, every.get(part.told.pattern, 0))
        return sum(every.values()) + (0 if self.rest is None else int(self.rest.nnz))

    def tocsr(self, copy: bool = False) -> sp.csr_array:
        """Return the whole matrix, on this process."""
        SpreadMatrix.whole_count += 1
        return self._rows(None)

    def asformat(self, format: str | None, copy: bool = False) -> Any:
        """Return the whole matrix in some format of SciPy."""
        return self.tocsr().asformat(format)

    def _rows(self, wanted: np.ndarray | None) -> sp.csr_array:
        found: sp.csr_array = together("some rows", None, rows=wanted, **self.where())
        if self.rest is None:
            return found
        return sp.csr_array(found + (self.rest if wanted is None else self.rest[wanted]))

    def where(self) -> dict[str, Any]:
        """Return how the processes know it: the numbers of partition and A, with each c, and what there is besides."""
        parts = [(c, part.handle) for c, part in self.parts]
        return {
            "partition": self.partition.handle, "parts": parts, "has_rest": self.rest is not None,
            "complex": self.dtype == complex,
        }  # fmt: skip

    def diagonal(self, k: int = 0) -> np.ndarray:
        """Return the diagonal (n,)."""
        if k:
            return np.asarray(self.tocsr().diagonal(k))
        if self.dtype == complex:
            return np.asarray(self.real.diagonal() + 1j * self.imag.diagonal())
        found: np.ndarray = together("diagonal of rows", None, **self.where())
        return found if self.rest is None else found + self.rest.diagonal()

    def __matmul__(self, other: Any) -> Any:
        if sp.issparse(other) or np.ndim(other) not in (1, 2):
            return self.tocsr() @ other
        X = np.asarray(other)
        if X.shape[0] != self.shape[1]:
            raise ValueError(f"shapes {self.shape} and {X.shape} do not belong together")
        if self.dtype == complex:
            return self.real @ X + 1j * (self.imag @ X)
        if np.iscomplexobj(X):
            columns = np.ascontiguousarray(X.reshape(len(X), -1), complex)
            return self._times(columns.view(float)).view(complex).reshape(X.shape)
        return self._times(X.reshape(len(X), -1)).reshape(X.shape)

    def _times(self, X: np.ndarray, sizes: bool = False) -> np.ndarray:
        needed = {part.told.pattern: part.told.columns for _, part in self.parts}
        found = np.empty(X.shape)
        for begin, end in pieces(*X.shape):
            some, k = np.ascontiguousarray(X[:, begin:end], float), end - begin
            found[:, begin:end] = together("product of rows", (some, needed), columns=k, sizes=sizes, **self.where())
        if self.rest is None:
            return found
        return found + (abs(self.rest) if sizes else self.rest) @ X

    def sizes_times(self, x: np.ndarray) -> np.ndarray:
        """Return (Σ |c||A| + |R|) x for x (n,) or (n, k) ≥ 0, which is at least |Σ c A + R| x."""
        return self._times(x.reshape(len(x), -1), sizes=True).reshape(x.shape)

    def scale_of_entries(self) -> SpreadMatrix:
        """Return max(|A_ij|, √(|A_ii A_jj|)) for all i, j with an entry at (i, j) or (j, i), for products alone."""
        rest, handle = self._extended_rest(), new_handle()
        told = together(
            "scale of rows", rest, handle=handle, roots=np.sqrt(np.abs(self.diagonal())), **self.where()
        )
        return SpreadMatrix([(1.0, Part(self.partition, handle, told[0]))])

    def _extended_rest(self) -> sp.csr_array | None:
        """Return R with a zero at (j, i) for each entry at (i, j)."""
        if self.rest is None:
            return None
        R = sp.coo_array(self.rest)
        places = np.hstack([R.coords, R.coords[::-1]])
        return sp.csr_array((np.append(R.data, np.zeros_like(R.data)), tuple(places)), shape=self.shape)

    def __rmatmul__(self, other: Any) -> Any:
        if sp.issparse(other):
            return other @ self.tocsr()
        return (self.T @ np.asarray(other).T).T

    def transpose(self, axes: Any = None, copy: bool = False) -> Any:
        """Return the transposed matrix, spread too."""
        return SpreadMatrix(self.parts, None if self.rest is None else sp.csr_array(self.rest.T))

    def conjugate(self, copy: bool = True) -> Any:
        """Return the conjugate matrix, spread too."""
        return self._by_entries(np.conj)

    conj = conjugate

    @property
    def T(self) -> Any:
        """The transposed matrix, spread too."""
        return self.transpose()

    @property
    def real(self) -> Any:
        """The real parts, spread too."""
        return self._by_entries(np.real)

    @property
    def imag(self) -> Any:
        """The imaginary parts, spread too where there are any."""
        return self._by_entries(np.imag) if self.dtype == complex else sp.csr_array(self.shape)

    def _by_entries(self, function: Callable[[Any], Any]) -> SpreadMatrix:
        """Return what conj, Re or Im makes of it, which act on each c and on R alone."""
        if self.dtype != complex:
            return self
        factors = [(function(np.asarray(c)).item(), part) for c, part in self.parts]
        parts = [(c, part) for c, part in factors if c] or factors[:1]
        rest = self.rest
        if rest is not None:
            rest = sp.csr_array((function(rest.data).copy(), rest.indices, rest.indptr), shape=self.shape)
        return SpreadMatrix(parts, rest)

    def copy(self) -> Any:
        """Return the matrix itself: nothing changes it."""
        return self

    def sum_duplicates(self) -> None:
        """Do nothing: there are none."""

    def __mul__(self, other: Any) -> Any:
        if not np.isscalar(other):
            return self.tocsr() * other
        factor: Any = complex(other) if np.iscomplexobj(other) else float(other)  # type: ignore[arg-type]
        return SpreadMatrix(
            [(factor * c, part) for c, part in self.parts], None if self.rest is None else self.rest * factor
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        return self * (1 / other) if np.isscalar(other) else self.tocsr() / other  # type: ignore[operator]

    def __neg__(self) -> Any:
        return self * -1.0

    def __add__(self, other: Any) -> Any:
        if isinstance(other, SpreadMatrix):
            if other.partition is self.partition:
                factors = {part: c for c, part in self.parts}
                for c, part in other.parts:
                    factors[part] = factors.get(part, 0.0) + c
                rests = [R for R in (self.rest, other.rest) if R is not None]
                rest = sum(rests[1:], rests[0]) if rests else None
                return SpreadMatrix([(c, part) for part, c in factors.items()], rest)
            return self.tocsr() + other.tocsr()
        if sp.issparse(other) and other.shape == self.shape and other.dtype in (float, complex):
            other = sp.csr_array(other)
            return SpreadMatrix(self.parts, other if self.rest is None else sp.csr_array(self.rest + other))
        return self.tocsr() + other

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self + -other if sp.issparse(other) else self.tocsr() - other

    def __rsub__(self, other: Any) -> Any:
        return -self + other if sp.issparse(other) else other - self.tocsr()

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, slice):
            key = np.arange(*key.indices(self.shape[0]))
        if isinstance(key, np.ndarray) and key.ndim == 1 and key.dtype.kind in "bi":
            return self._rows(np.arange(self.shape[0])[key])
        return self.tocsr()[key]

    def __reduce__(self) -> Any:
        A = self.tocsr()
        return sp.csr_array, ((A.data, A.indices, A.indptr), self.shape)

    def largest(self) -> float:
        """Return the largest |entry|."""
        rest = self._extended_rest()
        return float(together("largest of rows", rest, **self.where()))

    def eliminate_zeros(self) -> None:
        """Do nothing: what is stored is what the assembly gave."""

    @property
    def data(self) -> np.ndarray:
        """The stored entries of the whole matrix, to be read only."""
        return _kept_as_it_is(self.tocsr().data)

    @property
    def indices(self) -> np.ndarray:
        """Their columns, to be read only."""
        return _kept_as_it_is(self.tocsr().indices)

    @property
    def indptr(self) -> np.ndarray:
        """Where the rows begin among them, to be read only."""
        return _kept_as_it_is(self.tocsr().indptr)

    def __setitem__(self, key: Any, value: Any) -> None:
        raise TypeError("a matrix on all processes cannot be changed; expected one of this process: A.tocsr()")


def _kept_as_it_is(array: np.ndarray) -> np.ndarray:
    """Return an array that raises where it is written to, since what was written would be lost."""
    array.flags.writeable = False
    return array


def largest(A: sp.csr_array) -> float:
    """Return the largest |entry| of a sparse matrix, 0 without any."""
    return A.largest() if isinstance(A, SpreadMatrix) else float(abs(A).max())


def in_rows(A: Any) -> sp.csr_array:
    """Return a sparse matrix of any format by rows; one whose rows are on all processes stays there."""
    return A if isinstance(A, SpreadMatrix) else sp.csr_array(A)


def sizes_times(A: sp.csr_array, x: np.ndarray) -> np.ndarray:
    """Return |A| x for a sparse A (n, n) and x (n,) or (n, k) ≥ 0; of one on all processes an upper bound."""
    if isinstance(A, SpreadMatrix):
        return A.sizes_times(x)
    A = sp.csr_array(A)
    return np.asarray(sp.csr_array((np.abs(A.data), A.indices, A.indptr), shape=A.shape) @ x)


def _of_the_whole(name: str) -> Callable[..., Any]:
    def method(self: SpreadMatrix, *given: Any, **named: Any) -> Any:
        return getattr(self.tocsr(), name)(*given, **named)

    method.__doc__ = "As of SciPy, of the whole matrix."
    return method


for _name in (
    "__abs__", "__pow__", "__eq__", "__ne__", "__lt__", "__gt__", "__le__", "__ge__", "multiply", "maximum", "minimum",
    "power", "sum", "mean", "max", "min", "argmax", "argmin", "astype", "tocsc", "tocoo", "tobsr", "tolil", "todok",
    "todia", "toarray", "todense", "count_nonzero", "nonzero", "dot", "sqrt", "sign", "_getnnz", "trace", "getnnz",
    "_with_data", "_sub_sparse", "_add_sparse",
):  # fmt: skip
    setattr(SpreadMatrix, _name, _of_the_whole(_name))
SpreadMatrix.__hash__ = object.__hash__  # type: ignore[method-assign]
