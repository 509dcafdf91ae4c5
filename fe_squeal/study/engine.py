"""Solve many places, in this process or in many, in chunks that are kept as they are finished."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from .models import DirectModel, Model, Solver
from .outcome import COLUMNS, MODE_COLUMNS, Outcome
from .pools import Pool, Processes, pool_of

CHUNK = 32  # places that are sent to a process, and kept, together: about a second of work on a reduced model

Solved = list[Outcome | None]


class Parts(Protocol):
    """Keeps finished chunks, so that a study can be resumed."""

    def load(self) -> dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return the places (m, d) and the tables of each finished chunk, by its number.

        The tables are rows (m, columns), see `Outcome.row`, and unstable modes (k, 1 + columns): the number of the
        place, and `Outcome.modes`.
        """

    def save(self, chunk: int, places: np.ndarray, rows: np.ndarray, modes: np.ndarray) -> None:
        """Keep places and tables of a finished chunk, (m, d), (m, columns) and (k, 1 + columns), under its number."""


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
        Keeps finished chunks, and may have some already. Those that were solved at other places are solved again.
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
    kept = {} if parts is None else {i: part for i, part in parts.load().items() if i < len(chunks)}
    done = {i: (rows, modes) for i, (at, rows, modes) in kept.items() if np.array_equal(at, places[chunks[i]])}
    before = finished = sum(len(chunks[i]) for i in done)
    start = time.perf_counter()
    progress(finished, len(places), 0.0)
    open_chunks: dict[int, Solved] = {}  # those with places that are left to direct solves
    with pool_of(processes) as pool:
        pool.add(solve_chunk, solver.model, ((i, places[chunks[i]]) for i in range(len(chunks)) if i not in done))
        for key, result in pool:
            if isinstance(key, tuple):  # one place of a chunk, solved directly
                i, k = key
                open_chunks[i][k] = result
            else:
                i, open_chunks[key] = key, result
                _add_missed(pool, solver.direct, i, places[chunks[i]], result)
            whole = [found for found in open_chunks[i] if found is not None]
            if len(whole) < len(chunks[i]):
                continue
            done[i] = _tables(whole, chunks[i])
            del open_chunks[i]
            if parts is not None:
                parts.save(i, places[chunks[i]], *done[i])
            finished += len(whole)
            progress(finished, len(places), (finished - before) / max(time.perf_counter() - start, 1e-9))
    rows = [done[i][0] for i in range(len(chunks))] or [np.zeros((0, len(COLUMNS)))]
    modes = [done[i][1] for i in range(len(chunks))] or [np.zeros((0, 1 + len(MODE_COLUMNS)))]
    return np.concatenate(rows), np.concatenate(modes)


def _add_missed(pool: Pool, direct: DirectModel | None, chunk: int, places: np.ndarray, outcomes: Solved) -> None:
    """Have the places of a chunk solved directly for which the model gave no outcome.

    Where the workers have not enough memory for a direct solve this process does it, and puts it into `outcomes`.
    """
    missed = [k for k, found in enumerate(outcomes) if found is None]
    if not missed:
        return
    assert direct is not None
    if pool.has_room(direct.memory):
        pool.add(solve_place, direct, (((chunk, k), places[k]) for k in missed))
        return
    for k in missed:
        outcomes[k] = direct.outcome(places[k])


def _tables(outcomes: Sequence[Outcome], numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rows = np.stack([o.row for o in outcomes])
    modes = [np.column_stack([np.full(len(o.modes), n), o.modes]) for o, n in zip(outcomes, numbers, strict=True)]
    return rows, np.concatenate(modes)


def solve_chunk(model: Model, places: np.ndarray) -> Solved:
    """Return the outcomes of some places (m, d), None where the model gives none; runs on one thread."""
    with threadpool_limits(limits=1, user_api="blas"):
        return [model.outcome(p) for p in places]


def solve_place(model: Model, place: np.ndarray) -> Outcome | None:
    """Return the outcome of one place (d,), on all threads of the process."""
    return model.outcome(place)
