"""The variations of `tests/again.py` reach the package, in the tests and in the commands that they start."""

from __future__ import annotations

import functools
import json
import subprocess
import sys

import pytest
from scene_texts import environment
from varied_imports import SEED, SHUFFLE, SOLVER, number, vary_imports

# Every module of the package, with its seed, and by how many names the functions that are changed are known.
_PROGRAM = """
import importlib, json, pkgutil
import fe_squeal
modules = [importlib.import_module(i.name) for i in pkgutil.walk_packages(fe_squeal.__path__, "fe_squeal.")
           if not i.name.endswith("__main__")]
seeds = {m.__name__: m._SEED for m in modules if "_SEED" in vars(m)}
named = {n: [vars(m)[n] for m in modules if n in vars(m)] for n in ("from_skfem", "read_mesh", "has_pardiso")}
changed = {n: [hasattr(f, "__wrapped__") for f in found] for n, found in named.items()}
print(json.dumps([seeds, changed, named["has_pardiso"][0]()]))
"""


@functools.cache
def _package(**variables: str) -> tuple[dict[str, int], dict[str, list[bool]], bool]:
    """Return what a program that tests start sees of the package."""
    none = dict.fromkeys((SEED, SHUFFLE, SOLVER), "")
    values = environment(**{**none, **variables})
    done = subprocess.run([sys.executable, "-c", _PROGRAM], env=values, capture_output=True, text=True, check=True)
    assert not done.stderr
    seeds, changed, pardiso = json.loads(done.stdout)
    return seeds, changed, pardiso


@pytest.mark.slow
def test_nothing_is_changed_without_a_variable() -> None:
    seeds, changed, _ = _package()
    assert len(seeds) > 3 and not any(any(found) for found in changed.values())


@pytest.mark.slow
def test_everything_is_changed_in_every_module() -> None:
    plain, _, _ = _package()
    seeds, changed, pardiso = _package(**{SEED: "7", SHUFFLE: "3", SOLVER: "superlu"})
    assert seeds == {name: seed + 7 for name, seed in plain.items()}
    assert all(len(found) >= 2 and all(found) for found in changed.values()), changed
    assert not pardiso


def test_wrong_variables() -> None:
    with pytest.raises(ValueError, match=SOLVER):
        vary_imports({SOLVER: "umfpack"})
    with pytest.raises(ValueError, match=SEED):
        number({SEED: "-1"}, SEED)
