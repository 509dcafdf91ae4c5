"""Settings of all tests. Because of this file pytest puts the folder `tests` on sys.path: tests can `import meshes`."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# One thread for OpenBLAS, set before NumPy is imported. The dense references are small, and OpenBLAS's threads wait for
# those of MKL and of other programs, which makes the tests up to twenty times slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# PARDISO's threads sleep between its calls instead of spinning, since other processes of pytest need the cores. If gmsh
# was imported first, MKL uses GNU's OpenMP instead of Intel's, whose spinning threads take three times as long.
os.environ.setdefault("KMP_BLOCKTIME", "0")
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# Some tests import benchmarks. The folder is the last on the path, so that modules of the tests are found first.
sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add an option that chooses some of the files of tests."""
    told = "every N-th file of tests from the K-th on, counted round: any K will do"
    parser.addoption("--part", default="1/1", metavar="K/N", help=told)


def pytest_configure(config: pytest.Config) -> None:
    """Let Hypothesis draw the same examples in every run, and vary what `make test-again` asks for."""
    drawn_anew = config.getoption("--hypothesis-seed", None) is not None
    settings.register_profile("tests", derandomize=not drawn_anew, deadline=None, database=None)
    settings.load_profile("tests")
    import variations  # the folder `tests` is on sys.path only now

    variations.vary(os.environ)
    # A shell lets its background jobs, and what they start, ignore SIGINT. Tests interrupt themselves and others.
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what `make test` leaves to `make test-all` as slow, and run the longest tests first; leave other parts out.

    It leaves pages, decks and folders to it, and combinations of parameters whose values are all in others. A long test
    at the end would leave all cores but one idle.
    """
    from selection import covering, in_part, is_mathematics, parameters  # the folder `tests` is on sys.path only now

    for item in items:
        if not is_mathematics(item.path):
            item.add_marker(pytest.mark.slow)
    combinations: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("slow") is None and hasattr(item, "callspec"):
            combinations.setdefault(item.nodeid.split("[")[0], []).append(item)
    for some in combinations.values():
        for k in set(range(len(some))).difference(covering([parameters(item) for item in some])):
            some[k].add_marker(pytest.mark.slow)
    files = in_part(sorted({item.path for item in items}), config.getoption("--part"))
    config.hook.pytest_deselected(items=[item for item in items if item.path not in files])
    items[:] = [item for item in items if item.path in files]
    items.sort(key=lambda item: item.get_closest_marker("long") is None)  # a stable sort: the others keep their order


@pytest.fixture(scope="session")
def other_seed() -> int:
    """Return a number that tests without Hypothesis add to their seeds: 0, except in `make test-again`."""
    import variations

    return int(os.environ.get(variations.SEED) or 0)


@pytest.fixture
def needs_pardiso() -> None:
    """Skip a test of PARDISO if PARDISO is hidden on purpose, and fail it if PARDISO is missing."""
    import variations

    variations.require_pardiso(os.environ)


@pytest.fixture
def no_figures() -> Iterator[None]:
    """Leave out the figures of commands in this process, where a test looks at tables and words alone."""
    import undrawn  # with all commands, which few tests need

    with undrawn.without_figures():
        yield


@pytest.fixture(scope="session")
def browser() -> Iterator[object]:
    """The browser of all tests of the page."""
    from opened import chromium  # with Playwright, which no other test needs

    with chromium() as found:
        yield found
