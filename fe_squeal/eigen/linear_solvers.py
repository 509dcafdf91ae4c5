"""Sparse direct factorisations behind one small interface: PARDISO where it is there, SuperLU otherwise."""

from __future__ import annotations

import ctypes
import functools
import sys
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ..errors import NotConvergedError

Solve = Callable[[np.ndarray], np.ndarray]

_SYMMETRIC_INDEFINITE, _NONSYMMETRIC = -2, 11


class Factor(Protocol):
    """A factorised real matrix A."""

    negative_pivots: int | None
    """Number of negative eigenvalues of a symmetric A (Sylvester's law of inertia); None where it is not known."""

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b for b (n,) or (n, k), real or complex."""

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""


def factorize(A: sp.csr_array, symmetric: bool) -> Factor:
    """Factorise a real sparse matrix with the best solver that is installed.

    Raises
    ------
    NotConvergedError
        If A is singular to working precision.
    """
    return PardisoFactor(A, symmetric) if has_pardiso() else SuperLUFactor(A, symmetric)


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
    """Return functions that apply A⁻¹ and A⁻ᴴ of a complex matrix, through the real matrix [[Re, −Im], [Im, Re]].

    Twice the size, and real factors: the transpose of the real form is that of the conjugate transpose.
    """
    n = A.shape[0]
    factor = factorize(sp.csr_array(sp.block_array([[A.real, -A.imag], [A.imag, A.real]])), symmetric=False)

    def through(solve: Solve) -> Solve:
        def apply(b: np.ndarray) -> np.ndarray:
            x = solve(np.concatenate([b.real, b.imag]))
            return np.asarray(x[:n] + 1j * x[n:])

        return apply

    return through(factor.solve), through(factor.solve_transposed)


class SuperLUFactor:
    """LU factors by SuperLU."""

    negative_pivots: int | None = None

    def __init__(self, A: sp.csr_array, symmetric: bool) -> None:
        try:
            ordering = "MMD_AT_PLUS_A" if symmetric else "COLAMD"
            self._lu = splu(sp.csc_array(A), permc_spec=ordering, options={"SymmetricMode": symmetric})
        except RuntimeError as error:
            raise NotConvergedError(f"SuperLU: the shifted matrix cannot be factorised: {error}") from error

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b."""
        return _by_parts(self._lu.solve, b)

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""
        return _by_parts(lambda x: self._lu.solve(x, trans="T"), b)


class PardisoFactor:
    """LU or LDLᵀ factors by PARDISO.

    pypardiso finds the library; its own `solve` compares the whole matrix with the last one and rebuilds its index
    arrays at
    every call, which takes longer than the solve, so here they are kept and the solve step is called directly.
    """

    def __init__(self, A: sp.csr_array, symmetric: bool) -> None:
        self._matrix = sp.csr_array(sp.triu(A, format="csr") if symmetric else A, copy=True)
        self._matrix.sort_indices()
        self._n = A.shape[0]
        self._mtype = _SYMMETRIC_INDEFINITE if symmetric else _NONSYMMETRIC
        self._handle = np.zeros(64, dtype=np.int64)
        self._iparm = np.zeros(64, dtype=np.int32)
        self._perm = np.zeros(0, dtype=np.int32)
        # PARDISO's own defaults for the type, stated because the zero in iparm(1) that would fill them in also switches
        # two steps of iterative refinement on, which treble the time of a solve. Refinement stays for perturbed pivots.
        iparm = self._iparm
        iparm[0], iparm[1], iparm[7] = 1, 3, 0
        iparm[9], iparm[10], iparm[12], iparm[20] = (8, 0, 0, 1) if symmetric else (13, 1, 1, 0)
        self._ia = self._matrix.indptr.astype(np.int32) + 1
        self._ja = self._matrix.indices.astype(np.int32) + 1
        self._call(12, np.zeros((self._n, 1)))
        # A perturbed pivot (iparm(14)) leaves its sign open.
        self.negative_pivots = int(self._iparm[22]) if symmetric and not self._iparm[13] else None

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b."""
        return _by_parts(functools.partial(self._call, 33), b)

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""
        self._iparm[11] = 2
        try:
            return _by_parts(functools.partial(self._call, 33), b)
        finally:
            self._iparm[11] = 0

    def _call(self, phase: int, b: np.ndarray) -> np.ndarray:
        b = np.asfortranarray(b, dtype=np.float64)
        x, error = np.zeros_like(b, order="F"), ctypes.c_int32(0)
        doubles = ctypes.POINTER(ctypes.c_double)
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
        if error.value:
            raise NotConvergedError(f"PARDISO failed with error {error.value} at phase {phase}")
        if not np.isfinite(x).all():
            raise NotConvergedError("PARDISO: the shifted matrix is singular to working precision")
        return x

    def __del__(self) -> None:
        if getattr(self, "_ja", None) is not None and not sys.is_finalizing():
            self._call(-1, np.zeros((self._n, 1)))


def _by_parts(solve: Solve, b: np.ndarray) -> np.ndarray:
    """Solve for real and imaginary parts as columns of one real right-hand side."""
    if not np.iscomplexobj(b):
        return np.asarray(solve(b))
    columns = b.reshape(len(b), -1)
    x = solve(np.hstack([columns.real, columns.imag]))
    k = columns.shape[1]
    return np.asarray(x[:, :k] + 1j * x[:, k:]).reshape(b.shape)
