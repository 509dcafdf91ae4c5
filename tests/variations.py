"""Variations that must not change the verdict of a test: start vectors, numbering of nodes, linear solver, threads.

Variables of the environment, which `tests/again.py` sets, switch them on. `tests/conftest.py` calls `vary` for the
whole process, before any test is imported. Without such a variable nothing is changed.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import pytest
import threadpoolctl
from varied_imports import SEED, SHUFFLE, SOLVER, number, vary_imports

THREADS = "FE_SQUEAL_TEST_THREADS"
__all__ = ["SEED", "SHUFFLE", "SOLVER", "THREADS", "require_pardiso", "vary"]


def vary(environment: Mapping[str, str]) -> None:
    """Change fe_squeal in this process as the environment says.

    Parameters
    ----------
    environment : mapping
        As for `vary_imports`, and THREADS = "4" gives MKL so many threads, and OpenBLAS too where there are as many
        cores, as OPENBLAS_NUM_THREADS does.

    Raises
    ------
    pytest.UsageError
        A variable has another value.
    """
    try:
        vary_imports(environment)
        threads = number(environment, THREADS)
    except ValueError as error:
        raise pytest.UsageError(str(error)) from None
    if threads:
        from fe_squeal.eigen.linear import pardiso

        # Limits hold only for libraries that are loaded. The original function is asked where PARDISO is hidden, too.
        getattr(pardiso.has_pardiso, "__wrapped__", pardiso.has_pardiso)()
        libraries = threadpoolctl.ThreadpoolController()
        libraries.limit(limits=threads)
        # Threads of OpenBLAS that have no core wait for each other without rest, which takes up to sixty times as long.
        libraries.select(internal_api="openblas").limit(limits=min(threads, os.cpu_count() or 1))


def require_pardiso(environment: Mapping[str, str]) -> None:
    """Skip the test if PARDISO is hidden on purpose, and fail it if PARDISO is missing."""
    from fe_squeal.eigen.linear.pardiso import has_pardiso

    if environment.get(SOLVER) == "superlu":
        pytest.skip(f"the test is about PARDISO, which {SOLVER}=superlu hides")
    if not has_pardiso():
        pytest.fail("PARDISO is a dependency on this machine and cannot be loaded")
