"""Variations that must not change the verdict of a test: start vectors, numbering of nodes, linear solver, threads.

Variables of the environment, which `tests/again.py` sets, switch them on. `tests/conftest.py` calls `vary` for the
whole process, before any test is imported. Without such a variable nothing is changed.
"""

from __future__ import annotations

import functools
import importlib
import os
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from types import ModuleType
from typing import Any

import pytest
import threadpoolctl

SEED, SHUFFLE, SOLVER, THREADS = (f"FE_SQUEAL_TEST_{what}" for what in ("SEED", "SHUFFLE", "SOLVER", "THREADS"))


def vary(environment: Mapping[str, str]) -> None:
    """Change fe_squeal in this process as the environment says.

    Parameters
    ----------
    environment : mapping
        SEED = "3" adds 3 to the seed of every start vector. SHUFFLE = "3" numbers the nodes and elements of every mesh
        anew, by a permutation with that seed. SOLVER = "superlu" hides PARDISO. THREADS = "4" gives MKL so many
        threads, and OpenBLAS too where there are as many cores, as OPENBLAS_NUM_THREADS does.

    Raises
    ------
    pytest.UsageError
        A variable has another value, or fe_squeal does not have what it changes.
    """
    if seed := _number(environment, SEED):
        found = [m for m in _modules() if "_SEED" in vars(m)]
        if not found:
            raise pytest.UsageError(f"{SEED}: no module of fe_squeal has a _SEED")
        for module in found:
            module._SEED += seed  # type: ignore[attr-defined]
    if seed := _number(environment, SHUFFLE):
        for name in ("from_skfem", "read_mesh"):  # meshes of Python, and of files and geometries
            _replace(name, functools.partial(_shuffled, seed=seed))
    if threads := _number(environment, THREADS):
        from fe_squeal.eigen.linear.pardiso import has_pardiso

        has_pardiso()  # loads MKL, since limits hold only for libraries that are loaded
        libraries = threadpoolctl.ThreadpoolController()
        libraries.limit(limits=threads)
        # Threads of OpenBLAS that have no core wait for each other without rest, which takes up to sixty times as long.
        libraries.select(internal_api="openblas").limit(limits=min(threads, os.cpu_count() or 1))
    solver = environment.get(SOLVER, "")
    if solver not in ("", "superlu"):
        raise pytest.UsageError(f'{SOLVER}: given "{solver}"; expected "superlu" or nothing')
    if solver:
        _replace("has_pardiso", lambda _: lambda: False)


def require_pardiso(environment: Mapping[str, str]) -> None:
    """Skip the test if PARDISO is hidden on purpose, and fail it if PARDISO is missing."""
    from fe_squeal.eigen.linear.pardiso import has_pardiso

    if environment.get(SOLVER) == "superlu":
        pytest.skip(f"the test is about PARDISO, which {SOLVER}=superlu hides")
    if not has_pardiso():
        pytest.fail("PARDISO is a dependency on this machine and cannot be loaded")


def _number(environment: Mapping[str, str], name: str) -> int:
    text = environment.get(name, "") or "0"
    if not text.isdecimal():
        raise pytest.UsageError(f'{name}: given "{text}"; expected a whole number, 0 for no change')
    return int(text)


def _shuffled(read: Callable[..., Any], seed: int) -> Callable[..., Any]:
    """Return a function that reads a mesh and numbers it anew, always in the same way for the same mesh."""
    from meshes import renumbered

    @functools.wraps(read)
    def shuffled(*arguments: Any, **options: Any) -> Any:
        loaded = read(*arguments, **options)
        mesh, cells = renumbered(loaded.mesh, seed)
        return replace(loaded, mesh=mesh, element_labels=loaded.element_labels[cells])

    return shuffled


def _replace(name: str, change: Callable[[Any], Any]) -> None:
    """Replace a function of fe_squeal by a changed one, in every module that has imported it."""
    modules = [m for m in _modules() if name in vars(m)]
    originals = {id(vars(m)[name]): vars(m)[name] for m in modules}
    if len(originals) != 1:
        raise pytest.UsageError(f"fe_squeal has {len(originals)} functions {name}; tests/variations.py expects one")
    changed = change(*originals.values())
    for module in modules:
        setattr(module, name, changed)


@functools.cache
def _modules() -> tuple[ModuleType, ...]:
    import fe_squeal

    return tuple(_walk(fe_squeal))


def _walk(package: ModuleType) -> Iterator[ModuleType]:
    yield package
    for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if not info.name.endswith("__main__"):
            yield importlib.import_module(info.name)
