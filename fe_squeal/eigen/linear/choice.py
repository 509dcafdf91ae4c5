"""Sparse direct factorisations behind one small interface: PARDISO where it is there, SuperLU otherwise."""

from __future__ import annotations

import ctypes
import functools
import sys
import warnings
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ...errors import NotConvergedError
from ..memory import require_memory

Solve = Callable[[np.ndarray], np.ndarray]

_FULL = 1000  # unknowns up to which a full matrix goes to LAPACK
# Entries of SuperLU's factors of solids over n to the 4/3, by whether the matrix is symmetric.
_FILL = {True: 13.0, False: 45.0}
# PARDISO's numbers of the matrix types, by (symmetric, complex).
_TYPES = {(True, False): -2, (False, False): 11, (True, True): 6, (False, True): 13}
_DEFINITE = 2
_OUT_OF_MEMORY, _ZERO_PIVOT = -2, -4  # PARDISO's errors
_SMALL_PIVOT = 13  # 10 to minus this of the norm: which pivots are perturbed at the second attempt
_ADJOINT, _TRANSPOSED = 1, 2  # of iparm(12)


class SingularError(NotConvergedError):
    """A matrix is singular to working precision; versions of PARDISO tell it at a solve only."""


class Factor(Protocol):
    """A factorised real or complex matrix A."""

    negative_pivots: int | None
    """Number of negative eigenvalues of a real symmetric A (Sylvester's law of inertia); None where not known."""

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b for b (n,) or (n, k), real or complex."""

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b."""


def factorize(A: sp.csr_array, symmetric: bool) -> Factor:
    """Factorise a sparse matrix with the best solver that is installed.

    Parameters
    ----------
    A : (n, n) sparse, real or complex
    symmetric : bool
        Whether A = Aᵀ, also where it is complex.

    Raises
    ------
    NotConvergedError
        If a pivot is zero. PARDISO perturbs what rounding leaves of a singular matrix, which backward errors then show.
    TooLargeError
        If the factors do not fit into memory.
    """
    if A.shape[0] <= _FULL and A.nnz > A.shape[0] ** 2 / 2 and not symmetric:
        return DenseFactor(A)
    return PardisoFactor(A, symmetric) if has_pardiso() else SuperLUFactor(A, symmetric)


def factor_memory(A: sp.csr_array, symmetric: bool, definite: bool = False) -> int:
    """Return the bytes that the factors of a matrix will take, without computing them.

    PARDISO's analysis knows; for SuperLU it is what factors of meshes of solids take, to a factor of three.
    """
    if has_pardiso():
        return PardisoFactor(A, symmetric, definite, analyse_only=True).memory
    return superlu_memory(A, symmetric)


def solver_name() -> str:
    """Return the name of the sparse solver that `factorize` takes."""
    return "PARDISO (MKL)" if has_pardiso() else "SuperLU (SciPy)"


def has_pardiso() -> bool:
    """Whether MKL's PARDISO can be loaded."""
    return _pardiso() is not None


@functools.cache
def _pardiso() -> Any:
    """Return MKL's pardiso routine, or None. pypardiso finds it by a search of the disk, so once is enough."""
    try:
        from pypardiso import PyPardisoSolver

        return PyPardisoSolver()._mkl_pardiso
    except (ImportError, OSError):
        return None


def factorize_complex(A: sp.csr_array) -> tuple[Solve, Solve]:
    """Return functions that apply A⁻¹ and A⁻ᴴ of a complex matrix."""
    factor = factorize(sp.csr_array(A, dtype=complex), symmetric=False)
    return factor.solve, factor.solve_adjoint


class DenseFactor:
    """LU factors by LAPACK of a small matrix that is full, as projections are."""

    negative_pivots: int | None = None

    def __init__(self, A: sp.csr_array) -> None:
        full = A.toarray()
        # Units may differ by any factor: without scaling the pivots would be chosen by them.
        self._rows = _unit_of(np.abs(full).max(axis=1))
        self._columns = _unit_of((self._rows[:, None] * np.abs(full)).max(axis=0))
        with warnings.catch_warnings():
            warnings.simplefilter("error", la.LinAlgWarning)
            try:
                self._lu = la.lu_factor(self._rows[:, None] * full * self._columns)
            except (la.LinAlgWarning, ValueError) as error:
                raise NotConvergedError(f"LAPACK: the matrix cannot be factorised: {error}") from error

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b."""
        return self._apply(self._rows, b, 0, self._columns)

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""
        return self._apply(self._columns, b, 1, self._rows)

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b."""
        return self._apply(self._columns, b, 2, self._rows)

    def _apply(self, before: np.ndarray, b: np.ndarray, which: int, after: np.ndarray) -> np.ndarray:
        shape = (-1, *[1] * (b.ndim - 1))
        return np.asarray(after.reshape(shape) * la.lu_solve(self._lu, before.reshape(shape) * b, trans=which))


class SuperLUFactor:
    """LU factors by SuperLU."""

    negative_pivots: int | None = None

    def __init__(self, A: sp.csr_array, symmetric: bool) -> None:
        self._complex = np.iscomplexobj(A)
        require_memory(superlu_memory(A, symmetric), A.shape[0])
        try:
            ordering = "MMD_AT_PLUS_A" if symmetric else "COLAMD"
            self._lu = splu(sp.csc_array(A), permc_spec=ordering, options={"SymmetricMode": symmetric})
        except RuntimeError as error:
            raise SingularError(f"SuperLU: the shifted matrix cannot be factorised: {error}") from error

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b."""
        return self._apply("N", b)

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""
        return self._apply("T", b)

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b."""
        return self._apply("H", b)

    def _apply(self, trans: str, b: np.ndarray) -> np.ndarray:
        if self._complex:
            return np.asarray(self._lu.solve(np.asarray(b, dtype=complex), trans=trans))
        return _by_parts(lambda x: self._lu.solve(x, trans=trans), b)


class PardisoFactor:
    """LU or LDLᵀ factors by PARDISO.

    pypardiso finds the library; its own `solve` takes real matrices only, compares the whole matrix with the last one
    and rebuilds its index arrays at every call, which takes longer than the solve, so here they are kept and the solve
    step is called directly.
    """

    def __init__(
        self, A: sp.csr_array, symmetric: bool, definite: bool = False, analyse_only: bool = False
    ) -> None:
        self.negative_pivots = None
        self._dtype = np.complex128 if np.iscomplexobj(A) else np.float64
        self._matrix = sp.csr_array(sp.triu(A, format="csr") if symmetric else A, dtype=self._dtype, copy=True)
        self._matrix.sort_indices()
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
        diagonal = np.abs(A.diagonal())
        if symmetric and not definite and diagonal.min() <= 10.0 ** -iparm[9] * diagonal.max():
            # Pivots this far below the norm are perturbed, all of them beside a penalty of 1e20, unless scaling comes
            # before; matching besides prepares pivots of two rows where the diagonal is zero (Lagrange multipliers).
            iparm[10] = iparm[12] = 1
        self._ia = self._matrix.indptr.astype(np.int32) + 1
        self._ja = self._matrix.indices.astype(np.int32) + 1
        self._call(11, np.zeros((self._n, 1)))
        if analyse_only:
            return
        require_memory(self.memory, self._n)
        self._call(22, np.zeros((self._n, 1)))
        if symmetric and not definite and self._iparm[13]:
            # A soft spring behind a stiff one leaves small pivots that are right: keep them, unless that does not help.
            self._iparm[9] = _SMALL_PIVOT
            self._call(22, np.zeros((self._n, 1)))
            if self._iparm[13]:
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

    def _apply(self, which: int, b: np.ndarray) -> np.ndarray:
        self._iparm[11] = which
        solve = functools.partial(self._call, 33)
        return solve(b) if self._dtype is np.complex128 else _by_parts(solve, b)

    def _call(self, phase: int, b: np.ndarray) -> np.ndarray:
        b = np.asfortranarray(b, dtype=self._dtype)
        x, error = np.zeros_like(b, order="F"), ctypes.c_int32(0)
        doubles = ctypes.POINTER(ctypes.c_double)  # a complex number is two of them
        ints = ctypes.POINTER(ctypes.c_int32)

        def integer(value: int) -> Any:
            return ctypes.byref(ctypes.c_int32(value))

        _pardiso()(
            self._handle.ctypes.data_as(ctypes.POINTER(ctypes.c_int64)), integer(1), integer(1), integer(self._mtype),
            integer(phase), integer(self._n), self._matrix.data.ctypes.data_as(doubles),
            self._ia.ctypes.data_as(ints), self._ja.ctypes.data_as(ints), self._perm.ctypes.data_as(ints),
            integer(1 if b.ndim == 1 else b.shape[1]), self._iparm.ctypes.data_as(ints), integer(0),
            b.ctypes.data_as(doubles), x.ctypes.data_as(doubles), ctypes.byref(error),
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
        if getattr(self, "_ja", None) is not None and not sys.is_finalizing():
            self._call(-1, np.zeros((self._n, 1)))


def _unit_of(size: np.ndarray) -> np.ndarray:
    """Return powers of two, which add no rounding, that make sizes one."""
    return np.asarray(2.0 ** -np.round(np.log2(np.where(size > 0, size, 1.0))))


def superlu_memory(A: sp.csr_array, symmetric: bool) -> int:
    """Return the bytes that SuperLU's factors of a solid's matrix take, to a factor of three."""
    entries = _FILL[symmetric] * A.shape[0] ** (4 / 3)
    return int(entries * (A.dtype.itemsize + 4))


def _by_parts(solve: Solve, b: np.ndarray) -> np.ndarray:
    """Solve for real and imaginary parts as columns of one real right-hand side."""
    if not np.iscomplexobj(b):
        return np.asarray(solve(b))
    columns = b.reshape(len(b), -1)
    x = solve(np.hstack([columns.real, columns.imag]))
    k = columns.shape[1]
    return np.asarray(x[:, :k] + 1j * x[:, k:]).reshape(b.shape)
