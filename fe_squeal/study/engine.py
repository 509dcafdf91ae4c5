"""Solving many places, in this process or in many: chunks that are kept as they are finished."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from ..errors import NotConvergedError, SceneError
from ..process.isolation import isolated_children
from .models import Model, Solver
from .outcome import COLUMNS, MODE_COLUMNS, Outcome

_PATIENCE = 5  # s that a scheduler may take to answer
CHUNK = 32  # places that are sent to a process, and kept, at once: a second or so on a reduced model

Solved = list[Outcome | None]


@dataclass(frozen=True)
class Cluster:
    """Where places are solved beside this process.

    Attributes
    ----------
    workers : int
        Processes that are started on this machine, with one thread each; 0 for none.
    scheduler : str
        Address of a running scheduler of Dask.
    """

    workers: int = 0
    scheduler: str = ""


class Parts(Protocol):
    """Where finished chunks are kept."""

    def load(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """Return rows (m, columns) and unstable modes (k, 1 + columns), with the position first, by chunk."""

    def save(self, chunk: int, rows: np.ndarray, modes: np.ndarray) -> None:
        """Keep a finished chunk."""


def solve_places(
    solver: Solver, places: np.ndarray, cluster: Cluster | None = None, parts: Parts | None = None,
    progress: Callable[[int, int, float], None] = lambda done, total, rate: None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the outcomes of places: rows (m, columns of an outcome) and unstable modes (k, 1 + columns).

    Parameters
    ----------
    places : (m, d) float
    progress : callable of (places done, places in all, places per second)

    Raises
    ------
    NotConvergedError
        A direct solve failed, or the scheduler is gone; what is finished is kept.
    """
    chunks = [np.arange(i, min(i + CHUNK, len(places))) for i in range(0, len(places), CHUNK)]
    done = {} if parts is None else {i: part for i, part in parts.load().items() if i < len(chunks)}
    before = finished = sum(len(chunks[i]) for i in done)
    start = time.perf_counter()
    progress(finished, len(places), 0.0)
    left = [i for i in range(len(chunks)) if i not in done]
    work = ((i, places[chunks[i]]) for i in left)
    with spread(cluster) as call:
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
    """Return the outcomes of some places, None where the model gives none; on one thread."""
    with threadpool_limits(limits=1, user_api="blas"):
        return [model.outcome(p) for p in places]


@contextmanager
def spread(cluster: Cluster | None) -> Iterator[Callable[..., Iterator[tuple[int, Any]]]]:
    """Yield a callable that applies a function to many items, here or on a cluster.

    It takes (function, shared, work), where `work` yields pairs (number, item), and yields (number, function(shared,
    item)) in the order in which items are finished. `shared` is sent to each worker once.

    Raises
    ------
    SceneError
        A cluster is asked for, and dask.distributed is not installed.
    NotConvergedError
        The scheduler does not answer, or is gone.
    """
    if cluster is None or not (cluster.workers or cluster.scheduler):
        yield lambda function, shared, work: ((i, function(shared, item)) for i, item in work)
        return
    try:
        import distributed
    except ImportError as error:
        raise SceneError(
            "--workers and --scheduler need dask.distributed, which is not installed; expected"
            ' pip install "fe-squeal[cluster]"'
        ) from error
    with _client(distributed, cluster) as client:
        yield lambda function, shared, work: _on_cluster(distributed, client, function, shared, work)


@contextmanager
def _client(distributed: Any, cluster: Cluster) -> Iterator[Any]:
    """Yield a client of the scheduler, or of processes that are ended afterwards."""
    if cluster.scheduler:
        try:
            client = distributed.Client(cluster.scheduler, timeout=_PATIENCE)
        except (OSError, ValueError) as error:
            raise NotConvergedError(
                f"--scheduler: no scheduler of Dask answers at {cluster.scheduler} ({type(error).__name__})"
            ) from error
        with client:
            yield client
        return
    settings = {"n_workers": cluster.workers, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    # Without a dashboard too, Dask serves HTTP, at port 8787 unless it is told another one: here any free port.
    free = {"dashboard_address": "127.0.0.1:0"}
    import dask

    with (
        tempfile.TemporaryDirectory(prefix="fe_squeal_", ignore_cleanup_errors=True) as scratch,
        # Profiles of what workers do would take more memory the longer they work.
        dask.config.set({"temporary-directory": scratch, "distributed.worker.profile.enabled": False}),
        isolated_children(),  # for as long as the cluster is there: Dask starts workers again that have died
        distributed.LocalCluster(**settings, scheduler_kwargs=free, silence_logs=50) as local,
        distributed.Client(local) as client,
    ):
        yield client


def _on_cluster(
    distributed: Any, client: Any, function: Callable[[Any, Any], Any], shared: Any, work: Iterable[tuple[int, Any]]
) -> Iterator[tuple[int, Any]]:  # fmt: skip
    """Yield results as workers finish them; if a worker dies, another one does its items."""
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
