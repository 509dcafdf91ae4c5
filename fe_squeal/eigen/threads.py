"""Threads of the two BLAS libraries in one process."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from threadpoolctl import ThreadpoolController

_limited = ContextVar("_limited", default=False)  # whether a block around this one has set one thread already


@contextmanager
def one_openblas_thread() -> Iterator[None]:
    """Let NumPy's and SciPy's OpenBLAS work on one thread; MKL under PARDISO keeps all. Also a decorator.

    The dense matrices here are small: all eigenvalues of 500 unknowns take the same time on one thread and on two.
    Where other programs or MKL want the same cores, threads of OpenBLAS wait for each other, and take ten times as
    long.
    """
    if _limited.get():  # the number of threads is of the whole program, and the outermost block gives it back
        yield
        return
    thread_count()  # while OpenBLAS still knows
    token = _limited.set(True)
    try:
        with _openblas().limit(limits=1):
            yield
    finally:
        _limited.reset(token)


@functools.cache
def thread_count() -> int:
    """Return the number of threads that OpenBLAS was started with: all cores, or OPENBLAS_NUM_THREADS."""
    return max((library["num_threads"] for library in _openblas().info()), default=1)


@functools.cache
def _openblas() -> ThreadpoolController:
    return ThreadpoolController().select(internal_api="openblas")
