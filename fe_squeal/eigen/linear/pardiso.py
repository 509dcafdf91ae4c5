"""PARDISO of the Math Kernel Library."""

from __future__ import annotations

import ctypes
import functools
import sys
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import NotConvergedError
from ..memory import require_memory
from ..mkl import library
from .factor import DefiniteFactor, Factor, LinearSolver, SingularError, solve_real_parts
from .refinement import RANGE, largest_part, residual_of_products

# PARDISO's numbers of the matrix types, by (symmetric, complex).
_TYPES = {(True, False): -2, (False, False): 11, (True, True): 6, (False, True): 13}
_DEFINITE = 2
# By (complex, single precision).
_KINDS: dict[tuple[bool, bool], type[np.inexact]] = {
    (False, False): np.float64, (True, False): np.complex128, (False, True): np.float32, (True, True): np.complex64,
}  # fmt: skip
_OUT_OF_MEMORY, _ZERO_PIVOT = -2, -4  # PARDISO's errors
_SMALL_PIVOT = 13  # 10 to minus this of the norm: which pivots are perturbed at the second attempt
_ADJOINT, _TRANSPOSED = 1, 2  # of iparm(12)


def _integer(value: int) -> Any:
    return ctypes.byref(ctypes.c_int32(value))


_ONE, _ZERO = _integer(1), _integer(0)


def has_pardiso() -> bool:
    """Whether MKL's PARDISO can be loaded."""
    return _pardiso() is not None


@functools.cache
def _pardiso() -> Any:
    """Return MKL's pardiso routine, or None."""
    if (mkl := library()) is None:
        return None
    routine = mkl.pardiso
    routine.argtypes = [ctypes.c_void_p] * 16  # addresses: typed pointers take longer to make than a small solve
    return routine


def _with_every_row(A: sp.csr_array, symmetric: bool) -> sp.csr_array:
    """Return A (n, n) with the zeros of its diagonal stored, where PARDISO needs them.

    It asks for them in symmetric matrices. In others a row or a column without entries lets a solve with the adjoint
    write beyond the end of its memory.
    """
    n = A.shape[0]
    if symmetric:
        first = A.indptr[:-1]
        complete = A.indptr[-1] > first[-1] and bool((A.indices[first] == np.arange(n)).all())
    else:
        complete = bool((np.diff(A.indptr) > 0).all() and np.bincount(A.indices[: A.nnz], minlength=n).all())
    if complete:
        return A
    coo, every = A.tocoo(), np.arange(n)
    rows, columns = (np.append(own, every) for own in coo.coords)
    whole = sp.csr_array((np.append(coo.data, np.zeros(n, A.dtype)), (rows, columns)), shape=A.shape)
    whole.sum_duplicates()  # which SciPy 1.13 leaves, and which PARDISO does not take
    return whole


class PardisoFactor:
    """LU or LDLᵀ factors by PARDISO, in single precision if asked for.

    pypardiso finds the library; its own `solve` takes real matrices only, compares the whole matrix with the last one
    and rebuilds its index arrays at every call, which takes longer than the solve, so here they are kept and the solve
    step is called directly. A matrix in the precision of its factors, all of which is stored (not a triangle), shares
    its arrays with PARDISO; they must not change.
    """

    def __init__(
        self, A: sp.csr_array, symmetric: bool, definite: bool = False, analyse_only: bool = False,
        single: bool = False,
    ) -> None:  # fmt: skip
        self.negative_pivots = None
        self._dtype = _KINDS[np.iscomplexobj(A), single]
        own = sp.csr_array(sp.triu(A, format="csr") if symmetric else A)
        own = _with_every_row(own if own.has_sorted_indices else own.sorted_indices(), symmetric)
        largest = largest_part(own) if single else 1.0
        # In single precision numbers end at 1e38 and fade below 1e-38.
        self._scale = 1.0 if 1 / RANGE < largest < RANGE else largest or 1.0
        data = own.data[: own.nnz]  # what the matrix and PARDISO can share is not copied
        self._data = np.ascontiguousarray(data if self._scale == 1 else data / self._scale, self._dtype)
        self._n = A.shape[0]
        self._symmetric = symmetric
        self._mtype = _DEFINITE if definite else _TYPES[symmetric, np.iscomplexobj(A)]
        self._handle = np.zeros(64, dtype=np.int64)
        self._iparm = np.zeros(64, dtype=np.int32)
        self._perm = np.zeros(0, dtype=np.int32)
        # PARDISO's own defaults for the type, stated because the zero in iparm(1) that would fill them in also switches
        # two steps of iterative refinement on, which treble the time of a solve. Refinement stays for perturbed pivots.
        iparm = self._iparm
        iparm[0], iparm[1], iparm[7] = 1, 3, 0
        iparm[9], iparm[10], iparm[12], iparm[20] = (8, 0, 0, 1) if symmetric else (13, 1, 1, 0)
        iparm_before = int(iparm[9])
        iparm[27], iparm[34] = single, 1  # rows are numbered from zero
        diagonal = np.abs(A.diagonal())
        if symmetric and not definite and diagonal.min() <= 10.0 ** -iparm[9] * diagonal.max():
            # Pivots this far below the norm are perturbed, all of them beside a penalty of 1e20, unless scaling comes
            # before; matching besides prepares pivots of two rows where the diagonal is zero (Lagrange multipliers).
            iparm[10] = iparm[12] = 1
        self._ia, self._ja = (np.ascontiguousarray(x, np.int32) for x in (own.indptr, own.indices[: own.nnz]))
        del own, data
        arrays = (self._data, self._ia, self._ja, self._perm)
        self._fixed = (_integer(self._mtype), _integer(self._n), *(a.ctypes.data for a in arrays))
        self._settings = self._handle.ctypes.data, self._iparm.ctypes.data
        self._call(11, np.zeros((self._n, 1)))
        if analyse_only:
            return
        require_memory(1024 * int(self._iparm[16]), self._n)  # the analysis has the rest already
        self._call(22, np.zeros((self._n, 1)))
        if symmetric and not definite and self._iparm[13]:
            # A soft spring behind a stiff one leaves small pivots that are right: they are kept unless smaller ones are
            # left and solves become worse. A free body leaves one that is zero but for rounding, beside right ones.
            before = self._unsolved(A)
            self._iparm[9] = _SMALL_PIVOT
            self._call(22, np.zeros((self._n, 1)))
            if self._iparm[13] and self._unsolved(A) > before:
                self._iparm[9] = iparm_before
                self._call(22, np.zeros((self._n, 1)))
        # A perturbed pivot (iparm(14)) leaves its sign open.
        counts = symmetric and not np.iscomplexobj(A) and not self._iparm[13]
        self.negative_pivots = int(self._iparm[22]) if counts else None

    @property
    def memory(self) -> int:
        """Bytes at the peak of the factorisation, by the analysis."""
        analysis, kept, factors = (1024 * int(self._iparm[i]) for i in (14, 15, 16))
        return max(analysis, kept + factors)

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b."""
        return self._apply(0, b)

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""
        return self._apply(0 if self._symmetric else _TRANSPOSED, b)

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b."""
        if self._symmetric:
            return self._apply(0, b.conj()).conj()
        return self._apply(_ADJOINT, b)

    def _unsolved(self, A: sp.csr_array) -> float:
        """Return what solves leave of right-hand sides that a singular matrix has solutions for as well."""
        try:
            return residual_of_products(A, self.solve)
        except SingularError:
            return np.inf

    def _apply(self, which: int, b: np.ndarray) -> np.ndarray:
        self._iparm[11] = which
        if self._iparm[27]:
            size = np.abs(b).max(axis=0, initial=0.0)
            size = np.where(size > 0, size, 1.0)
            return self._solved(b / size).astype(np.result_type(b, self._dtype)) * (size / self._scale)
        return self._solved(b)

    def _solved(self, b: np.ndarray) -> np.ndarray:
        solve = functools.partial(self._call, 33)
        return solve(b) if np.issubdtype(self._dtype, np.complexfloating) else solve_real_parts(solve, b)

    def _call(self, phase: int, b: np.ndarray) -> np.ndarray:
        b = np.asfortranarray(b, dtype=self._dtype)
        x, error = np.zeros_like(b, order="F"), ctypes.c_int32(0)
        handle, iparm = self._settings
        mtype, *matrix = self._fixed
        _pardiso()(
            handle, _ONE, _ONE, mtype, _integer(phase), *matrix, _integer(1 if b.ndim == 1 else b.shape[1]), iparm,
            _ZERO, b.ctypes.data, x.ctypes.data, ctypes.byref(error),
        )  # fmt: skip
        if error.value == _OUT_OF_MEMORY:
            raise MemoryError(f"PARDISO at phase {phase}")
        if error.value:
            kind = SingularError if error.value == _ZERO_PIVOT else NotConvergedError
            raise kind(f"PARDISO failed with error {error.value} at phase {phase}")
        if not np.isfinite(x).all():
            raise SingularError("PARDISO: the shifted matrix is singular to working precision")
        return x

    def __del__(self) -> None:
        if getattr(self, "_settings", None) is not None and not sys.is_finalizing():
            self._call(-1, np.zeros((self._n, 1)))


class PardisoCholesky(PardisoFactor):
    """LLᵀ by PARDISO."""

    def __init__(self, A: sp.csr_array, single: bool = False) -> None:
        super().__init__(A, symmetric=True, definite=True, single=single)

    def half_solve(self, b: np.ndarray) -> np.ndarray:
        """Return L⁻ᵀ b."""
        self._iparm[11] = 0
        return self._call(333, b).astype(float) / self._scale**0.5


class Pardiso:
    """PARDISO as a `LinearSolver`; only where `has_pardiso()`.

    Parameters
    ----------
    single : bool
        Whether factors are in single precision, which take about two thirds of the memory and of the time of a solve.
    """

    name = "PARDISO (MKL)"

    def __init__(self, single: bool = False) -> None:
        self._single = single

    @property
    def rough(self) -> LinearSolver:
        """The solver with factors in single precision."""
        return Pardiso(single=True)

    def factorize(self, A: sp.csr_array, symmetric: bool) -> Factor:
        """Return LU or LDLᵀ factors; those of a real symmetric matrix know its inertia."""
        return PardisoFactor(A, symmetric, single=self._single)

    def factorize_definite(self, A: sp.csr_array) -> DefiniteFactor:
        """Return Cholesky factors."""
        return PardisoCholesky(A, self._single)

    def memory(self, A: sp.csr_array, symmetric: bool, definite: bool = False) -> int:
        """Return the bytes that PARDISO's analysis tells."""
        return PardisoFactor(A, symmetric, definite, analyse_only=True, single=self._single).memory


PARDISO = Pardiso()
