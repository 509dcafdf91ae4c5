"""Changes of fe_squeal that must not change a verdict, made where a module is imported: in tests, and what they start.

Imports nothing that takes time, since commands import it before anything else.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from types import ModuleType
from typing import Any

SEED, SHUFFLE, SOLVER = (f"FE_SQUEAL_TEST_{what}" for what in ("SEED", "SHUFFLE", "SOLVER"))
_READERS = "from_skfem", "read_mesh"  # of meshes of Python, and of files and geometries


def vary_imports(environment: Mapping[str, str]) -> None:
    """Change fe_squeal, which has not been imported yet, as the environment says.

    Parameters
    ----------
    environment : mapping
        SEED = "3" adds 3 to the seed of every start vector. SHUFFLE = "3" numbers the nodes and elements of every mesh
        anew, by a permutation with that seed. SOLVER = "superlu" hides PARDISO, and MKL altogether.

    Raises
    ------
    ValueError
        A variable has another value.
    """
    solver = environment.get(SOLVER, "")
    if solver not in ("", "superlu"):
        raise ValueError(f'{SOLVER}: given "{solver}"; expected "superlu" or nothing')
    seed, shuffle = number(environment, SEED), number(environment, SHUFFLE)
    if seed or shuffle or solver:
        sys.meta_path.insert(0, _Finder(seed, shuffle, solver))


def number(environment: Mapping[str, str], name: str) -> int:
    """Return the whole number that a variable of the environment has, 0 where it is not set."""
    text = environment.get(name, "") or "0"
    if not text.isdecimal():
        raise ValueError(f'{name}: given "{text}"; expected a whole number, 0 for no change')
    return int(text)


class _Finder(MetaPathFinder):
    """Finds the modules of fe_squeal as Python would, to change them when they are loaded."""

    def __init__(self, seed: int, shuffle: int, solver: str) -> None:
        self._seed, self._shuffle, self._solver = seed, shuffle, solver

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:  # fmt: skip
        if fullname.split(".")[0] != "fe_squeal":
            return None
        for finder in sys.meta_path:
            spec = None if finder is self else finder.find_spec(fullname, path, target)
            if spec is not None:
                if isinstance(spec.loader, SourceFileLoader):
                    spec.loader = _Loader(spec.loader.name, spec.loader.path, self._change)
                return spec
        return None

    def _change(self, module: ModuleType) -> None:
        """Change what a module defines, before another module imports it from there."""
        own: dict[str, Any] = vars(module)
        if "_SEED" in own:
            own["_SEED"] += self._seed
        for name in _READERS if self._shuffle else ():
            if getattr(own.get(name), "__module__", "") == module.__name__:
                own[name] = _shuffled(own[name], self._shuffle)
        if self._solver and getattr(own.get("has_pardiso"), "__module__", "") == module.__name__:
            own["has_pardiso"] = functools.wraps(own["has_pardiso"])(lambda: False)
        if self._solver and module.__name__ == "fe_squeal.eigen.mkl":
            own["library"] = lambda: None  # products are those of SciPy, too


class _Loader(SourceFileLoader):
    def __init__(self, name: str, path: str, change: Callable[[ModuleType], None]) -> None:
        super().__init__(name, path)
        self._change = change

    def exec_module(self, module: ModuleType) -> None:
        super().exec_module(module)
        self._change(module)


def _shuffled(read: Callable[..., Any], seed: int) -> Callable[..., Any]:
    """Return a function that reads a mesh and numbers it anew, always in the same way for the same mesh."""

    @functools.wraps(read)
    def shuffled(*arguments: Any, **options: Any) -> Any:
        from renumbering import renumbered

        loaded = read(*arguments, **options)
        mesh, cells = renumbered(loaded.mesh, seed)
        return replace(loaded, mesh=mesh, element_labels=loaded.element_labels[cells])

    return shuffled
