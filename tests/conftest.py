"""Being here, this file makes pytest put the folder `tests` on sys.path, so that tests can `import meshes`."""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# Before NumPy is imported: the dense references are small, and OpenBLAS's threads wait for those of MKL and of whatever
# else runs on the machine, which makes them up to twenty times slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# PARDISO's threads sleep between its calls instead of spinning, since the other processes of pytest want the cores. MKL
# takes GNU's OpenMP instead of Intel's where gmsh was imported first; its threads take thrice as long spinning.
os.environ.setdefault("KMP_BLOCKTIME", "0")
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# Formulas and smallest rungs of the benchmarks are tested; names of the tests' own modules come first.
sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))


def pytest_configure(config: pytest.Config) -> None:
    """Draw the same examples in every run, and vary what `make test-again` asks for."""
    drawn_anew = config.getoption("--hypothesis-seed", None) is not None
    settings.register_profile("tests", derandomize=not drawn_anew, deadline=None, database=None)
    settings.load_profile("tests")
    import variations  # tests are on sys.path by now

    variations.vary(os.environ)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest tests: one of them at the end leaves all cores but one idle."""
    items.sort(key=lambda item: item.get_closest_marker("long") is None)  # the others keep their order


@pytest.fixture(scope="session")
def other_seed() -> int:
    """Return what random inputs of tests without Hypothesis add to their seeds: 0, but in `make test-again`."""
    import variations

    return int(os.environ.get(variations.SEED) or 0)


@pytest.fixture
def needs_pardiso() -> None:
    """Skip a test of PARDISO where PARDISO is hidden on purpose, fail it where PARDISO is missing."""
    import variations

    variations.require_pardiso(os.environ)
