"""A sweep over one parameter: modes at every value, followed into branches, with the onsets between them.

The name `fe_squeal.sweep` is that of the function and of this folder. So that it always means the function, the package
imports this file at once; solvers are therefore imported inside the function.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import NotConvergedError, SceneError, TooLargeError

if TYPE_CHECKING:
    from ..eigen.linear.factor import LinearSolver
    from ..problem.problem import Problem
    from .onset import Onset
    from .result import Sweep
    from .state import Store

MODES = 20  # asked for where nothing is said


def sweep(
    problem: Problem,
    values: Sequence[float] | np.ndarray,
    parameter: str = "mu",
    modes: int | None = None,
    max_frequency: float | None = None,
    tolerance: float = 1e-8,
    keep_shapes: bool = False,
    method: str = "auto",
    precise: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
    store: Store | None = None,
    linear_solver: LinearSolver | str = "auto",
) -> Sweep:
    """Solve for the complex modes at every value of a parameter, track them, and find the onsets.

    Parameters
    ----------
    values : (m,) float, increasing
    modes : int, optional
        Number of lowest modes (default 20).
    max_frequency : float, Hz, optional
        All modes up to here instead.
    keep_shapes : bool
        Keep the shapes of all modes at the last value, not of the unstable ones alone.
    method : "auto", "direct", "reduced" or "modal"
        A solve at every value; a reduced model that holds over the sweep within the tolerance; or a projection on the
        modes without friction and damping, whatever its error. "auto" takes the reduced model where that pays.
    precise : bool
        Refine onsets on the problem itself, a few factorisations each, also where the problem is large and those of
        the reduced model are sure to 1e-7 of the value.
    progress : callable of (values done, values in all)
    store : Store, optional
        Where every finished value is kept, and from which the sweep goes on if it holds some.
    linear_solver : "auto", "pardiso", "superlu" or LinearSolver
        What factorises sparse matrices, see `fe_squeal.eigen.linear`; "auto" is PARDISO where it can be loaded, else
        SuperLU. Static states under preload that the sweep solves anew take it too.

    Raises
    ------
    SceneError
        Values that are empty, not finite or not increasing; a parameter that the problem does not have; no static state
        at the first value; a linear solver that is not there.
    NotConvergedError
        `partial` is the sweep so far (None if no value was finished).
    KeyboardInterrupt
        With the sweep so far as its argument.
    """
    from ..eigen.linear.choice import choose
    from ..eigen.request import Request
    from ..eigen.threads import one_openblas_thread
    from .running import RunningSweep

    values, solver = _checked(problem, parameter, values), choose(linear_solver)
    if len(values) == 1 and not problem.has(parameter):  # a scene without friction has no mu, and needs none
        problem = replace(problem, parameters={**problem.parameters, parameter: float(values[0])})
    problem = problem.solved_with(solver).prepared(parameter, values)
    request = Request(None if max_frequency else modes or MODES, max_frequency, tolerance)
    tracker = RunningSweep(problem, parameter, request, values, precise, solver)
    known = None if store is None else store.load()
    tracker.reduce(values, method, store, known)
    if known is not None:
        tracker.restore(known)
        progress(sum(not p.between for p in known.points), len(values))
    for i, value in enumerate(values):
        if i < sum(not p.between for p in tracker.points):
            continue
        try:
            with one_openblas_thread():
                tracker.advance(float(value), keep_all=keep_shapes and i == len(values) - 1)
            if store is not None:
                store.save(tracker.state())
            progress(i + 1, len(values))
        except (NotConvergedError, SceneError) as error:
            if store is not None:
                store.flush()
            # A scene may cease to make sense at some value (a contact opens): the sweep ends there and keeps the rest.
            text = f"{parameter} = {value:g}: {error}"
            if isinstance(error, SceneError) and not tracker.points:
                raise SceneError(text) from error
            raise NotConvergedError(text, partial=tracker.result() if tracker.points else None) from error
        except (TooLargeError, MemoryError):
            if store is not None:
                store.flush()
            raise
        except KeyboardInterrupt as stop:
            if store is not None:
                store.flush()
            raise KeyboardInterrupt(tracker.result() if tracker.points else None) from stop
    if store is not None:
        store.flush()
    return tracker.result()


def find_onsets(
    problem: Problem, values: np.ndarray, parameter: str = "mu", modes: int = 20,
    linear_solver: LinearSolver | str = "auto",
) -> tuple[Onset, ...]:  # fmt: skip
    """Return the critical values of a parameter between the first and the last of the given values, to full precision.

    Parameters
    ----------
    values : (m,) float, increasing
        Where modes are solved for; critical values are refined between them.
    linear_solver : "auto", "pardiso", "superlu" or LinearSolver
        As of `sweep`.
    """
    return sweep(problem, values, parameter, modes=modes, precise=True, linear_solver=linear_solver).onsets


def _checked(problem: Problem, parameter: str, values: Sequence[float] | np.ndarray) -> np.ndarray:
    grid = np.atleast_1d(np.asarray(values, dtype=float))
    if grid.ndim != 1 or not len(grid) or not np.isfinite(grid).all() or (np.diff(grid) <= 0).any():
        raise SceneError(f"sweep: given the values {values}; expected finite numbers that increase, at least one")
    if len(grid) > 1:
        problem.value(parameter)  # raises where there is none
    return grid
