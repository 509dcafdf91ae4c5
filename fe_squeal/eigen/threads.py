"""Threads of the two BLAS libraries in one process."""

from __future__ import annotations

import functools
from contextlib import AbstractContextManager

from threadpoolctl import ThreadpoolController


def one_openblas_thread() -> AbstractContextManager[object]:
    """Return a context in which NumPy's and SciPy's OpenBLAS work on one thread; MKL under PARDISO keeps all.

    The dense products here are small. On several threads OpenBLAS and MKL wait for each other's cores in turn, which
    makes an Arnoldi iteration up to ten times slower than on one.
    """
    thread_count()  # while OpenBLAS still knows
    limit: AbstractContextManager[object] = _openblas().limit(limits=1)
    return limit


@functools.cache
def thread_count() -> int:
    """Return the number of threads that OpenBLAS was started with: all cores, or OPENBLAS_NUM_THREADS."""
    return max((library["num_threads"] for library in _openblas().info()), default=1)


@functools.cache
def _openblas() -> ThreadpoolController:
    return ThreadpoolController().select(internal_api="openblas")
