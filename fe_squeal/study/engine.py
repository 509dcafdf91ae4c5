"""Solve many places, in this process or in many, in chunks that are kept as they are finished."""

from __future__ import annotations

import gc
import logging
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from ..errors import NotConvergedError, SceneError
from ..process.isolation import isolated_children
from ..process.signals import signals_deferred
from .models import Model, Solver
from .outcome import COLUMNS, MODE_COLUMNS, Outcome

_PATIENCE = 5  # s: a scheduler has to answer within this time
CHUNK = 32  # places that are sent to a process, and kept, together: about a second of work on a reduced model

Solved = list[Outcome | None]


@dataclass(frozen=True)
class Processes:
    """The processes that solve places, if not this one.

    Attributes
    ----------
    workers : int
        Processes that are started on this machine, with one thread each; 0 for none.
    scheduler : str
        Address of a running scheduler of Dask; "" for none.
    """

    workers: int = 0
    scheduler: str = ""


class Parts(Protocol):
    """Keeps finished chunks, so that a study can be resumed."""

    def load(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """Return the tables of each finished chunk, by its number.

        These are rows (m, columns), see `Outcome.row`, and unstable modes (k, 1 + columns): the number of the place,
        and `Outcome.modes`.
        """

    def save(self, chunk: int, rows: np.ndarray, modes: np.ndarray) -> None:
        """Keep the tables of a finished chunk, (m, columns) and (k, 1 + columns), under its number."""


def solve_places(
    solver: Solver, places: np.ndarray, processes: Processes | None = None, parts: Parts | None = None,
    progress: Callable[[int, int, float], None] = lambda done, total, rate: None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Solve the modes at many places and return what is kept of them.

    Parameters
    ----------
    solver : Solver
    places : (m, d) float
        Values of the d parameters at each place.
    processes : Processes, optional
        The processes to use; by default this one.
    parts : Parts, optional
        Keeps finished chunks, and may have some already.
    progress : callable of (int, int, float)
        Gets the places done, all places, and places per second.

    Returns
    -------
    rows : (m, columns) float
        See `Outcome.row`.
    modes : (k, 1 + columns) float
        The number of the place and `Outcome.modes`, for every unstable mode.

    Raises
    ------
    SceneError
        Other processes are asked for, and dask.distributed is not installed.
    NotConvergedError
        A direct solve failed, or the scheduler is gone; finished chunks are kept.
    """
    chunks = [np.arange(i, min(i + CHUNK, len(places))) for i in range(0, len(places), CHUNK)]
    done = {} if parts is None else {i: part for i, part in parts.load().items() if i < len(chunks)}
    before = finished = sum(len(chunks[i]) for i in done)
    start = time.perf_counter()
    progress(finished, len(places), 0.0)
    left = [i for i in range(len(chunks)) if i not in done]
    work = ((i, places[chunks[i]]) for i in left)
    with spread(processes) as call:
        for i, outcomes in call(solve_chunk, solver.model, work):
            here = zip(outcomes, places[chunks[i]], strict=True)
            whole = [solver.outcome(place) if found is None else found for found, place in here]
            done[i] = _tables(whole, chunks[i])
            if parts is not None:
                parts.save(i, *done[i])
            finished += len(whole)
            progress(finished, len(places), (finished - before) / max(time.perf_counter() - start, 1e-9))
    rows = [done[i][0] for i in range(len(chunks))] or [np.zeros((0, len(COLUMNS)))]
    modes = [done[i][1] for i in range(len(chunks))] or [np.zeros((0, 1 + len(MODE_COLUMNS)))]
    return np.concatenate(rows), np.concatenate(modes)


def _tables(outcomes: Sequence[Outcome], numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rows = np.stack([o.row for o in outcomes])
    modes = [np.column_stack([np.full(len(o.modes), n), o.modes]) for o, n in zip(outcomes, numbers, strict=True)]
    return rows, np.concatenate(modes)


def solve_chunk(model: Model, places: np.ndarray) -> Solved:
    """Return the outcomes of some places (m, d), None where the model gives none; runs on one thread."""
    with threadpool_limits(limits=1, user_api="blas"):
        return [model.outcome(p) for p in places]


@contextmanager
def spread(processes: Processes | None) -> Iterator[Callable[..., Iterator[tuple[int, Any]]]]:
    """Yield a callable that applies a function to many items, in this process or in others.

    The callable takes (function, shared, work), where `work` yields pairs (number, item). It yields pairs
    (number, function(shared, item)) in the order in which items are finished. `shared` is sent to each process once.

    Raises
    ------
    SceneError
        Other processes are asked for, and dask.distributed is not installed.
    NotConvergedError
        The scheduler does not answer, or is gone.
    """
    if processes is None or not (processes.workers or processes.scheduler):
        yield lambda function, shared, work: ((i, function(shared, item)) for i, item in work)
        return
    try:
        import distributed
    except ImportError as error:
        raise SceneError(
            "--workers and --scheduler need dask.distributed, which is not installed; expected"
            ' pip install "fe-squeal[cluster]"'
        ) from error
    with _client(distributed, processes) as client:
        yield lambda function, shared, work: _on_cluster(distributed, client, function, shared, work)


@contextmanager
def _client(distributed: Any, processes: Processes) -> Iterator[Any]:
    """Yield a client of the scheduler, or of processes that are started for the block and ended after it."""
    if processes.scheduler:
        try:
            client = distributed.Client(processes.scheduler, timeout=_PATIENCE)
        except (OSError, ValueError) as error:
            raise NotConvergedError(
                f"--scheduler: no scheduler of Dask answers at {processes.scheduler} ({type(error).__name__})"
            ) from error
        with client:
            yield client
        return
    settings = {"n_workers": processes.workers, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    # Dask serves HTTP even without a dashboard, by default at port 8787, which may be taken: any free port is used.
    free = {"dashboard_address": "127.0.0.1:0"}
    import dask

    with (
        tempfile.TemporaryDirectory(prefix="fe_squeal_", ignore_cleanup_errors=True) as scratch,
        # Profiles of what workers do would take more memory the longer they work.
        dask.config.set({"temporary-directory": scratch, "distributed.worker.profile.enabled": False}),
        isolated_children(),  # for as long as the cluster is there: Dask starts workers again that have died
        _quiet_asyncio(),
        ExitStack() as opened,
    ):
        with signals_deferred():  # a cluster that is only half there cannot be closed
            local = opened.enter_context(distributed.LocalCluster(**settings, scheduler_kwargs=free, silence_logs=50))
            client = opened.enter_context(distributed.Client(local))
        yield client


@contextmanager
def _quiet_asyncio() -> Iterator[None]:
    """Keep errors of Dask's own tasks, which lose their workers when a study is interrupted, from the terminal."""
    logger = logging.getLogger("asyncio")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        gc.collect()  # a task tells what became of it when it is collected
        logger.setLevel(level)


def _on_cluster(
    distributed: Any, client: Any, function: Callable[[Any, Any], Any], shared: Any, work: Iterable[tuple[int, Any]]
) -> Iterator[tuple[int, Any]]:  # fmt: skip
    """Yield results as processes finish them; if one dies, another one does its items."""
    lost = distributed.client
    gone = (OSError, TimeoutError, distributed.core.CommClosedError, lost.CancelledError, lost.FuturesCancelledError)
    try:
        sent = client.scatter(shared, broadcast=True, hash=False)
        futures = {client.submit(function, sent, item, pure=False, retries=2): i for i, item in work}
        for future in distributed.as_completed(list(futures)):
            number, result = futures.pop(future), future.result()
            future.release()  # or workers would keep all results to the end
            yield number, result
    except gone as error:
        raise NotConvergedError(f"the scheduler is gone ({type(error).__name__})") from error
