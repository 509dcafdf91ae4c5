"""Places that the model leaves to direct solves: where these are done, and what is kept when they are interrupted."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chains import rising_oscillators, stiffening_chain
from selection import some

from fe_squeal import scatter
from fe_squeal.eigen.pencil import Modes
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.eigen.unsearched import Unsearched
from fe_squeal.errors import NotConvergedError, SceneError
from fe_squeal.study import engine, models
from fe_squeal.study.models import DirectModel, Solver, make_solver
from fe_squeal.study.outcome import Outcome
from fe_squeal.study.pools import Here, Processes, pool_of
from fe_squeal.study.solving import Solving
from tests.studies import two_modes

PLACES = np.arange(80.0)[:, None]  # two chunks of 32 and one of 16


def answer(place: np.ndarray, direct: bool) -> Outcome:
    """Return an outcome that names its place, and the process that found it."""
    row = np.array([0.0, float(place[0]), 0.0, 0.0, 0.0, os.getpid(), direct, np.inf, 0.0])
    return Outcome(row, np.full((int(place[0]) % 3, 4), float(place[0])))


@dataclass
class Sparing:
    """A model that gives no outcome at every fifth place."""

    asked: list[int] = field(default_factory=list)

    def outcome(self, values: np.ndarray) -> Outcome | None:
        """Return the outcome at a place, or None."""
        self.asked.append(int(values[0]))
        return None if int(values[0]) % 5 == 0 else answer(values, False)


@dataclass
class Thorough:
    """A model that gives an outcome everywhere, and stands for direct solves."""

    memory: float = 0.0
    asked: list[int] = field(default_factory=list)
    stop: int = -1

    def outcome(self, values: np.ndarray) -> Outcome:
        """Return the outcome at a place; an interruption at one of them."""
        if int(values[0]) == self.stop:
            raise KeyboardInterrupt
        self.asked.append(int(values[0]))
        return answer(values, True)


@dataclass
class Kept:
    """Keeps finished chunks in memory."""

    parts: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=dict)

    def load(self) -> dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return what is kept."""
        return dict(self.parts)

    def save(self, chunk: int, places: np.ndarray, rows: np.ndarray, modes: np.ndarray) -> None:
        """Keep a chunk."""
        self.parts[chunk] = places, rows, modes


def check_tables(rows: np.ndarray, modes: np.ndarray) -> None:
    """Every place has its own outcome, and every fifth that of a direct solve."""
    assert rows[:, 1].tolist() == PLACES[:, 0].tolist()
    assert rows[:, 6].tolist() == (PLACES[:, 0] % 5 == 0).tolist()
    assert modes[:, 0].tolist() == modes[:, 1].tolist() == np.repeat(np.arange(80), np.arange(80) % 3).tolist()


def test_places_without_an_outcome_are_solved_directly() -> None:
    model, direct, seen = Sparing(), Thorough(), []
    solver = Solver(model, direct, None, "")
    check_tables(*engine.solve_places(solver, PLACES, progress=lambda done, total, rate: seen.append(done)))
    assert direct.asked == list(range(0, 80, 5)) and model.asked == list(range(80))
    assert seen == [0, 32, 64, 80]


def test_an_interrupted_direct_solve_loses_its_own_chunk_alone() -> None:
    """Chunks that are whole are kept; what is gone on with solves no place of them again."""
    kept, model, direct = Kept(), Sparing(), Thorough(stop=45)
    with pytest.raises(KeyboardInterrupt):
        engine.solve_places(Solver(model, direct, None, ""), PLACES, parts=kept)
    assert list(kept.parts) == [0] and max(model.asked) < 64  # the direct solves of a chunk come before the next chunk
    again, exact = Sparing(), Thorough()
    check_tables(*engine.solve_places(Solver(again, exact, None, ""), PLACES, parts=kept))
    assert min(again.asked) == 32 and min(exact.asked) == 35


def test_chunks_of_other_places_are_solved_again() -> None:
    """As of a study whose parameters stand in another order: what is kept belongs to the places that it came from."""
    kept = Kept()
    engine.solve_places(Solver(Sparing(), Thorough(), None, ""), PLACES[::-1].copy(), parts=kept)
    kept.parts[1] = PLACES[32:64], *kept.parts[1][1:]
    again = Sparing()
    rows, _ = engine.solve_places(Solver(again, Thorough(), None, ""), PLACES, parts=kept)
    assert again.asked == [*range(32), *range(64, 80)]
    assert rows[:32, 1].tolist() == PLACES[:32, 0].tolist() and rows[32:64, 1].tolist() == PLACES[47:15:-1, 0].tolist()


def test_work_that_is_added_last_is_done_first() -> None:
    pool, done = Here(), []
    pool.add(pow, 2, ((k, k) for k in range(3)))
    for key, result in pool:
        done.append((key, result))
        if isinstance(key, int):
            pool.add(pow, 3, [((key, 0), key)])
    assert done == [(0, 1), ((0, 0), 1), (1, 2), ((1, 0), 3), (2, 4), ((2, 0), 9)]


def test_the_memory_of_a_direct_solve_is_that_of_a_process_at_least() -> None:
    model = DirectModel(two_modes(), ("mu",), Request(2, None, 1e-6))
    assert 2**27 < model.memory < 2**30


@pytest.fixture
def by_value() -> object:
    """Have workers get the classes and functions of this file with the work, as they cannot import it."""
    cloudpickle = pytest.importorskip("cloudpickle")
    pytest.importorskip("distributed")
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    yield
    cloudpickle.unregister_pickle_by_value(sys.modules[__name__])


@pytest.mark.slow
@pytest.mark.usefixtures("by_value")
@pytest.mark.parametrize("memory", [0.0, 2.0**60])
def test_workers_solve_directly_where_they_have_the_memory(memory: float) -> None:
    """Otherwise the process of the command does."""
    solver = Solver(Sparing(), Thorough(memory), None, "")
    rows, modes = engine.solve_places(solver, PLACES, Processes(workers=2))
    check_tables(rows, modes)
    reduced, direct = (set(rows[rows[:, 6] == d, 5].astype(int)) for d in (0, 1))
    assert os.getpid() not in reduced
    assert direct == {os.getpid()} if memory else os.getpid() not in direct


def die(shared: None, item: int) -> None:
    """End the process, as the system does with one that takes too much memory."""
    os._exit(1)


def die_once(path: str, item: int) -> int:
    """End the process at the first call."""
    if not os.path.exists(path):
        with open(path, "x"):
            os._exit(1)
    return item


@pytest.mark.slow
@pytest.mark.usefixtures("by_value")
def test_the_only_worker_dies_once(tmp_path: Path) -> None:
    """Another one is started, and gets what is shared, too."""
    with pool_of(Processes(workers=1)) as pool:
        pool.add(die_once, str(tmp_path / "died"), ((k, k) for k in range(5)))
        assert sorted(pool) == [(k, k) for k in range(5)]
    assert (tmp_path / "died").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("by_value")
def test_large_things_are_shared_without_a_word(recwarn: pytest.WarningsRecorder) -> None:
    with pool_of(Processes(workers=1)) as pool:
        pool.add(np.take, np.arange(4e6), [(0, 3)])
        assert list(pool) == [(0, 3.0)]
    assert not [str(w.message) for w in recwarn if "large" in str(w.message)]


@pytest.mark.slow
@pytest.mark.usefixtures("by_value")
def test_work_that_kills_every_worker_ends_in_one_sentence() -> None:
    with pool_of(Processes(workers=1)) as pool:
        pool.add(die, None, [(0, 0)])
        with pytest.raises(NotConvergedError, match="start fewer of them"):
            list(pool)


@pytest.mark.slow
@pytest.mark.usefixtures("by_value")
def test_workers_that_are_not_started_again_are_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fe_squeal.study.pools._RESTART", 0.5)

    async def left_dead(nanny: object, code: int) -> None:
        """What Dask does of a worker that dies before it is known to run."""

    monkeypatch.setattr("distributed.nanny.Nanny._on_worker_exit", left_dead)
    with pool_of(Processes(workers=1)) as pool:
        pool.add(die, None, [(0, 0)])
        with pytest.raises(NotConvergedError, match="all workers died"):
            list(pool)


@pytest.mark.parametrize("most", some([10.0, 1e6], lambda most: most > 10))
def test_places_where_stiffness_is_far_larger_have_all_modes(most: float) -> None:
    """Modes 7 and 8 of a chain are coupled by friction: from p = 8 on one is unstable, out of the range at p = 1.

    Where stiffness grows a million times, the places are solved directly.
    """
    problem, _ = stiffening_chain(500, 8.0, {"p": 3, "q": 1})
    low, high = np.array([1.0, 1.0]), np.array([most, 1.1])
    rng = np.random.default_rng(0)
    solver = make_solver(
        problem, ("p", "q"), low, high, lambda i: [tuple(x) for x in rng.uniform(low, high, (8, 2))], Request(count=8)
    )
    assert (solver.box is None) == (most > 10)
    if solver.box is None:
        assert solver.why.startswith("direct solves: at p = 1e+06, q = ")
        assert "fewer than 8 modes in the range in which it knows all at p = 1, q = 1" in solver.why
    for place in ([1.0, 1.0], [7.9, 1.0], [8.1, 1.0], [10.0, 1.0], [5.0, 1.1]):
        found = solver.outcome(np.array(place))
        assert found.unstable == (place[0] > 8)


@pytest.mark.parametrize(("powers", "low", "high"), [({1: 1.0}, 1.0, 4.0), ({0: 1.0, 2: 3.0}, -1.0, 1.0)])
def test_modes_above_the_range_that_is_known_do_not_count(powers: dict[int, float], low: float, high: float) -> None:
    """Ten modes rise past the highest one of the start, where others, which do not rise, are missing.

    The basis is made wider where a corner is the stiffest one, else the place is solved directly.
    """
    rising, still = 1 + 0.002 * np.arange(10), 1.2 + 0.1 * np.arange(410)
    problem, request = rising_oscillators(rising, still, powers), Request(count=10, tolerance=1e-6)

    def draw(i: int) -> list[tuple[float, ...]]:
        return [(float(p),) for p in np.random.default_rng(i).uniform(low, high, 8)]

    solver = make_solver(problem, ("p",), np.array([low]), np.array([high]), draw, request)
    outcome = solver.outcome([high])
    assert outcome.row[6] == (low < 0) and solver.outcome([max(low, 0.0)]).row[6] == 0
    assert solver.box is not None
    if low > 0:
        exact = np.sort(np.append(2 * rising, still))[:10]
        np.testing.assert_allclose(np.sort(solver.box.modes((high,)).lam.imag), exact, rtol=1e-6)


def test_the_method_that_is_asked_for_is_taken() -> None:
    """A reduced model would do for 500 unknowns; direct solves find the same."""
    problem, _ = stiffening_chain(500, 8.0, {"p": 3, "q": 1})
    low, high, rng = np.array([1.0, 1.0]), np.array([10.0, 1.1]), np.random.default_rng(0)
    reduced, direct = (
        make_solver(problem, ("p", "q"), low, high, lambda i: [tuple(x) for x in rng.uniform(low, high, (8, 2))],
                    Request(count=8), method=method) for method in ("reduced", "direct")
    )  # fmt: skip
    assert reduced.box is not None and direct.box is None and "asks for" in direct.why
    one, other = (solver.outcome(np.array([8.1, 1.0])) for solver in (reduced, direct))
    assert one.unstable and other.unstable and (one.row[6], other.row[6]) == (0, 1)
    assert one.modes[:, 0] == pytest.approx(other.modes[:, 0], rel=1e-6)
    with pytest.raises(SceneError, match='method: given "modal"'):
        Solving(problem, ("p", "q"), low, high, lambda i: np.zeros((0, 2)), method="modal")


def test_modes_that_direct_solves_have_not_looked_for_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are not at every place; the answer of the study says it once."""
    box = {"mu": {"uniform": {"low": 0.0, "high": 0.4}}}
    whole = scatter(two_modes(), box, samples=16, indices=False)
    calls = []

    def incomplete(*given: Any, **more: Any) -> Modes:
        calls.append(given)
        modes = solve_modes(*given, **more)
        return replace(modes, unsearched=Unsearched(low=1.0)) if len(calls) % 3 == 0 else modes

    monkeypatch.setattr(models, "solve_modes", incomplete)
    study = scatter(two_modes(), box, samples=16, indices=False)
    assert study.solver.why.count("not all kinds of modes were looked for") == 1
    assert "looked for" not in whole.solver.why and study.samples.equals(whole.samples)
