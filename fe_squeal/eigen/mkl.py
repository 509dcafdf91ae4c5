"""The Math Kernel Library, which comes with PARDISO: where it is, and its products of sparse matrices with blocks."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import importlib.metadata
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

_PLACE = "PYPARDISO_MKL_RT"  # where pypardiso looks first
# Milliseconds that a thread of MKL waits for more work before it sleeps. As it is delivered these are 200, in which it
# takes a core from the threads of OpenBLAS and of `blocks`, whose turn mostly comes next.
_WAIT, _AT_ONCE = "KMP_BLOCKTIME", "0"
_LETTERS = {np.dtype(np.float64): ("d", ctypes.c_double), np.dtype(np.float32): ("s", ctypes.c_float)}
_DONE, _AS_IT_IS, _GENERAL, _BY_ROWS = 0, 10, 20, 101  # numbers that MKL has for these


class _Kind(ctypes.Structure):
    _fields_ = (("type", ctypes.c_int), ("mode", ctypes.c_int), ("diagonal", ctypes.c_int))


@functools.cache
def library() -> Any:
    """Return MKL as loaded by pypardiso, or None where it is not installed."""
    os.environ.setdefault(_WAIT, _AT_ONCE)
    try:
        with _known_place():
            from pypardiso import PyPardisoSolver

            mkl = PyPardisoSolver().libmkl
    except (ImportError, OSError):
        return None
    # With its first product MKL loads the libraries that do the work, and ends the process where these do not fit into
    # memory any more: so that comes at once.
    one = np.ones((2, 2))
    _multiply(mkl, sp.csr_array(one), one, np.empty_like(one))
    return mkl


def multiply(A: sp.csr_array, X: np.ndarray, out: np.ndarray) -> bool:
    """Write A X to `out` on all threads of MKL, and return whether that was done; nothing is copied.

    It is not where MKL is absent, does not know the types, or would need arrays without gaps: those of the real parts
    of a complex matrix have gaps.

    Parameters
    ----------
    A : (m, n) sparse
    X : (n, k)
    out : (m, k)
        Of the type of X.

    Raises
    ------
    ValueError
        The shapes do not belong together.
    """
    if X.shape != (A.shape[1], out.shape[1]) or out.shape[0] != A.shape[0]:
        raise ValueError(f"shapes {A.shape}, {X.shape} and {out.shape} do not belong together")
    indices = A.indices, A.indptr
    if A.dtype not in _LETTERS or not X.dtype == out.dtype == A.dtype or any(i.dtype != np.int32 for i in indices):
        return False
    if not all(a.flags.c_contiguous for a in (A.data, *indices, X, out)) or (mkl := library()) is None:
        return False
    return _multiply(mkl, A, X, out)


def _multiply(mkl: Any, A: sp.csr_array, X: np.ndarray, out: np.ndarray) -> bool:
    letter, number = _LETTERS[A.dtype]
    k, handle = ctypes.c_int32(X.shape[1]), ctypes.c_void_p()
    begins, ends = (ctypes.c_void_p(A.indptr.ctypes.data + shift) for shift in (0, A.indptr.itemsize))
    columns, entries = (ctypes.c_void_p(a.ctypes.data) for a in (A.indices, A.data))
    rows, width = (ctypes.c_int32(n) for n in A.shape)
    create, product = (getattr(mkl, f"mkl_sparse_{letter}_{name}") for name in ("create_csr", "mm"))
    if create(ctypes.byref(handle), 0, rows, width, begins, ends, columns, entries) != _DONE:
        return False
    try:
        return bool(
            product(
                _AS_IT_IS, number(1.0), handle, _Kind(_GENERAL, 0, 0), _BY_ROWS, ctypes.c_void_p(X.ctypes.data), k, k,
                number(0.0), ctypes.c_void_p(out.ctypes.data), k,
            ) == _DONE
        )  # fmt: skip
    finally:
        mkl.mkl_sparse_destroy(handle)


@contextlib.contextmanager
def _known_place() -> Iterator[None]:
    """Tell pypardiso where the library is if the wheel of MKL says so.

    Without that it asks the compiler, and then looks through all files of the environment, twice: half a second.
    """
    if _PLACE in os.environ or not (found := _mkl_rt()):
        yield
        return
    os.environ[_PLACE] = str(found)
    try:
        yield
    finally:
        del os.environ[_PLACE]


def _mkl_rt() -> Path | None:
    """Return the library of MKL that chooses among the others, from the list of files of MKL's wheel."""
    try:
        files = importlib.metadata.files("mkl") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    libraries = (Path(str(f.locate())) for f in files if "mkl_rt" in f.name and f.suffix != ".lib")
    return next((path for path in libraries if path.exists()), None)
