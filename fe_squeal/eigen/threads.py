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
    limit: AbstractContextManager[object] = _openblas().limit(limits=1)
    return limit


@functools.cache
def _openblas() -> ThreadpoolController:
    return ThreadpoolController().select(internal_api="openblas")
