"""What all kinds of studies share: which modes are asked for, how they are solved for, and how progress is reported."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from ..eigen.request import Request
from ..errors import SceneError
from ..problem.parameters import paths_of
from ..problem.problem import Problem
from ..problem.terms import check_terms
from ..scene import Scene
from ..scene.numbers import with_numbers
from ..sweep.sweep import MODES
from .engine import Parts, solve_places
from .models import make_solver
from .outcome import COLUMNS
from .pools import Processes

if TYPE_CHECKING:
    from ..eigen.linear.factor import LinearSolver

_LOSSES = "loss factors say nothing of what grows without swinging or as fast as it swings, which counts as stable"
_UNSEARCHED = "at some places not all kinds of modes were looked for everywhere, and an unstable one may be missing"
METHODS = ("auto", "direct", "reduced")
TRAINED = 200  # points for which a reduced model is made, and at which it is checked

Progress = Callable[[str, int, int, float], None]  # stage, places done, places in all, places per second


class Options(TypedDict, total=False):
    """The options that `scatter` and `stability_map` both take by name.

    Attributes
    ----------
    modes : int, optional
        Number of modes, those of the lowest frequencies (default 20).
    max_frequency : float, Hz, optional
        All modes up to this frequency, instead of a number of modes.
    tolerance : float
        Relative error of every λ (default 1e-6); close to a double eigenvalue this error times its condition.
    workers : int
        Processes on this machine, by dask.distributed; 0 (default) to use this process.
    scheduler : str
        Address of a running scheduler of Dask, instead of `workers`.
    linear_solver : "auto", "pardiso", "superlu", "mumps" or LinearSolver
        As for `sweep`.
    method : "auto", "direct" or "reduced"
        "direct" solves directly at every place; the others make a reduced model where there can be one that pays.
    scene : Scene, optional
        The scene of the problem; needed if a parameter is a number of its geometry.
    parts : callable of str, optional
        Returns, by the name of a stage, an object that keeps its finished chunks, see `Parts`.
    progress : callable of (str, int, int, float)
        Gets the stage, the places done, all places, and places per second.
    """

    modes: int | None
    max_frequency: float | None
    tolerance: float
    workers: int
    scheduler: str
    linear_solver: LinearSolver | str
    method: str
    scene: Scene | None
    parts: Callable[[str], Parts] | None
    progress: Progress


def check_method(method: str, key: str = "method") -> None:
    """Refuse a method that studies do not have, and name the key that it was given by.

    Raises
    ------
    SceneError
        It is none of `METHODS`.
    """
    if method not in METHODS:
        raise SceneError(f'{key}: given "{method}", which studies do not have; expected {", ".join(METHODS)}')


def check_value(problem: Problem, name: str, value: float, scene: Scene | None = None) -> None:
    """Refuse a value of a parameter that the scene, by default the one that the problem was assembled from, refuses.

    There 0 is allowed for what multiplies terms, whatever the scene says: with it a term is not there.

    Raises
    ------
    SceneError
    """
    values = dict.fromkeys(paths_of(name), value)
    if scene is not None:
        with_numbers(scene, values)
    elif problem.source is not None and (value or not problem.is_affine(name)):
        problem.source.check(values)


def check_together(scene: Scene, names: Sequence[str], places: np.ndarray) -> None:
    """Refuse places (m, d) at which several numbers of one table do not fit together, such as two Poisson ratios.

    Raises
    ------
    SceneError
        The scene does not allow what a place has.
    """
    tables: dict[str, dict[str, int]] = {}
    for i, name in enumerate(names):
        for path in paths_of(name):
            tables.setdefault(".".join(path.split(".")[:2]), {})[path] = i
    for columns in tables.values():
        if len(set(columns.values())) < 2:
            continue
        for place in places:
            with_numbers(scene, {path: float(place[i]) for path, i in columns.items()})


class Solving:
    """Solves the places of one study, stage by stage.

    Parameters
    ----------
    problem : Problem
    names : sequence of str
        The d parameters.
    low, high : (d,) float
        The box that contains all places.
    draw : callable of int
        Returns (TRAINED, d) points that fill the box, different ones for each number.
    modes, max_frequency, tolerance, workers, scheduler, linear_solver, method, scene, parts, progress
        See `Options`.

    Raises
    ------
    SceneError
        The problem does not have a parameter, nothing depends on it, its matrices are faulty, or the method is none.

    Attributes
    ----------
    request : Request
        Which modes are asked for, and to what tolerance.
    solver : Solver
        How the places are solved; `why` also tells, once they are, if not all modes were looked for.
    """

    def __init__(
        self, problem: Problem, names: Sequence[str], low: np.ndarray, high: np.ndarray,
        draw: Callable[[int], np.ndarray], *, modes: int | None = None, max_frequency: float | None = None,
        tolerance: float = 1e-6, workers: int = 0, scheduler: str = "", linear_solver: LinearSolver | str = "auto",
        method: str = "auto", scene: Scene | None = None, parts: Callable[[str], Parts] | None = None,
        progress: Progress = lambda stage, done, total, rate: None,
    ) -> None:  # fmt: skip
        check_method(method)
        if problem.source is None:
            check_terms(problem.terms, problem.parameters)
        self.request = Request(None if max_frequency else modes or MODES, max_frequency, tolerance)
        self.solver = make_solver(
            problem, names, low, high, lambda i: [tuple(map(float, point)) for point in draw(i)], self.request,
            linear_solver, method, scene, lambda text: progress(text, 0, 0, 0.0),
        )  # fmt: skip
        if problem.problem_class == "complex":
            self.solver = replace(self.solver, why=f"{self.solver.why}; {_LOSSES}")
        self._processes, self._parts, self._progress = Processes(workers, scheduler), parts, progress

    def places(self, stage: str, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows and the unstable modes of places (m, d), see `solve_places`.

        Places that are equal, as of numbers with few values, are solved once; progress is that of different ones.

        Raises
        ------
        NotConvergedError
            A direct solve failed, or the scheduler is gone; finished chunks are kept.
        """
        kept = None if self._parts is None else self._parts(stage.replace(" ", "_"))
        _, first, which = np.unique(places, axis=0, return_index=True, return_inverse=True)
        order = np.argsort(first)  # of the different places, as they come: by places that all differ nothing is moved
        which = np.argsort(order)[which.reshape(-1)]
        rows, modes = solve_places(
            self.solver, places[first[order]], self._processes, kept, lambda *numbers: self._progress(stage, *numbers)
        )
        if rows[:, COLUMNS.index("unsearched")].any() and _UNSEARCHED not in self.solver.why:
            self.solver = replace(self.solver, why=f"{self.solver.why}; {_UNSEARCHED}: a sweep there tells more")
        return rows[which], _repeated(modes, which)

    def tell(self, stage: str, done: int, total: int) -> None:
        """Report the progress of a stage that does not solve places."""
        self._progress(stage, done, total, 0.0)


def _repeated(modes: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Return the modes (k, 1 + columns) of places (m,), given those of different ones and which of these each place is.

    The number of the place stands first, in ascending order in both.
    """
    count = np.bincount(modes[:, 0].astype(int), minlength=which.max(initial=-1) + 1)
    begin, own = np.cumsum(count) - count, count[which]
    within = np.arange(own.sum()) - np.repeat(np.cumsum(own) - own, own)
    repeated = modes[np.repeat(begin[which], own) + within]
    repeated[:, 0] = np.repeat(np.arange(len(which)), own)
    return repeated
