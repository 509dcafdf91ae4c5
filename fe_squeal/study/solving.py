"""What every kind of study shares: which modes are wanted, how they are solved for, and where progress is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from ..eigen.request import Request
from ..problem.problem import Problem
from ..scene import Scene
from ..sweep.sweep import MODES
from .engine import Cluster, Parts, solve_places
from .models import make_solver

if TYPE_CHECKING:
    from ..eigen.linear.factor import LinearSolver

TRAINED = 200  # points for which a reduced model is made, and at which it is checked

Progress = Callable[[str, int, int, float], None]  # stage, places done, places in all, places per second


class Options(TypedDict, total=False):
    """What `scatter` and `stability_map` both take by name; the defaults are those of `Solving`.

    Attributes
    ----------
    modes, max_frequency
        As of `sweep`.
    tolerance : float
        Relative error of every λ, next to a double one times its condition.
    workers : int
        Processes on this machine, by dask.distributed; 0 for none.
    scheduler : str
        Address of a running scheduler of Dask.
    linear_solver : LinearSolver or str
        As of `sweep`.
    scene : Scene, optional
        Of the problem; needed where parameters are numbers of its geometry.
    parts : callable of str, optional
        Returns where finished chunks of a stage are kept.
    progress : callable of (stage, places done, places in all, places per second)
    """

    modes: int | None
    max_frequency: float | None
    tolerance: float
    workers: int
    scheduler: str
    linear_solver: LinearSolver | str
    scene: Scene | None
    parts: Callable[[str], Parts] | None
    progress: Progress


class Solving:
    """Solves the places of one study, stage by stage.

    Parameters
    ----------
    names : d str
        Of the parameters.
    low, high : (d,) float
        The box that holds all places.
    draw : callable of int
        Returns points that fill the box, other ones for each number: (TRAINED, d) float.

    Raises
    ------
    SceneError
        There is no such parameter, or nothing depends on it.

    Attributes
    ----------
    request : Request
    solver : Solver
    """

    def __init__(
        self, problem: Problem, names: Sequence[str], low: np.ndarray, high: np.ndarray,
        draw: Callable[[int], np.ndarray], *, modes: int | None = None, max_frequency: float | None = None,
        tolerance: float = 1e-6, workers: int = 0, scheduler: str = "", linear_solver: LinearSolver | str = "auto",
        scene: Scene | None = None, parts: Callable[[str], Parts] | None = None,
        progress: Progress = lambda stage, done, total, rate: None,
    ) -> None:  # fmt: skip
        self.request = Request(None if max_frequency else modes or MODES, max_frequency, tolerance)
        self.solver = make_solver(
            problem, names, low, high, lambda i: [tuple(map(float, point)) for point in draw(i)], self.request,
            linear_solver, scene, lambda text: progress(text, 0, 0, 0.0),
        )  # fmt: skip
        self._cluster, self._parts, self._progress = Cluster(workers, scheduler), parts, progress

    def places(self, stage: str, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rows (m, columns of an outcome) and unstable modes (k, 1 + columns) of places (m, d).

        Raises
        ------
        NotConvergedError
            A direct solve failed, or the scheduler is gone; what is finished is kept.
        """
        kept = None if self._parts is None else self._parts(stage.replace(" ", "_"))
        return solve_places(
            self.solver, places, self._cluster, kept, lambda *numbers: self._progress(stage, *numbers)
        )

    def tell(self, stage: str, done: int, total: int) -> None:
        """Tell the progress of a stage that is not one of places."""
        self._progress(stage, done, total, 0.0)
