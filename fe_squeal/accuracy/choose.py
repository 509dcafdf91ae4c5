"""Find a mesh that meets a target for the error: solve, see which elements the error comes from, and refine there."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass

import numpy as np

from ..assembly.assembly import Assembly
from ..assembly.swept import keeps_shapes, swept
from ..eigen.memory import TooLargeError, memory_text, require_memory
from ..eigen.threads import one_openblas_thread
from ..errors import NotConvergedError, SceneError
from ..mesh import LoadedMesh
from ..problem.problem import Problem
from ..scene import Scene
from ..scene.solver import solver_of
from ..sweep.result import Sweep
from ..sweep.sweep import sweep
from .candidates import Candidate, finer_candidate, first_candidate, first_order_bars, next_candidate
from .corrections import right_corrections
from .discretisation import with_changes, with_discretisation
from .estimate import changes_by
from .groups import element_groups
from .largest_error import estimated_error
from .quantities import KINDS, Split, split_changes
from .refined import finer_mesh_ahead, refine_problem, refined_memory

_MARGIN = 0.8  # of the target: the error that the next mesh is made for
_SURELY = 1.1  # times the target: where the bar to first order is larger, the bars are not worth their time
_RUNS = 8  # meshes tried, at most
# For forecasts alone: the power of the unknowns by which times grow, and the seconds of the bars over those of the
# right corrections (2.3 and 2.4 where measured, on a disc with two pads), where only the next mesh may need them.
_GROWTH, _BARS = 1.2, 2.4
# Times the unknowns of the mesh before: a mesh with fewer does not count as finer, unless its elements lie elsewhere.
_SLACK = 1.02


@dataclass(frozen=True)
class Trial:
    """One mesh that was tried.

    Attributes
    ----------
    mesh : str
        What the mesh is, in words.
    unknowns : int
        Number of unknowns of the problem on this mesh.
    error : float
        The largest estimated error of the kinds of quantities that are to meet the target, relative; infinite or NaN
        where it is not known.
    seconds : float, s
        For the sweep and the estimate of its errors.
    """

    mesh: str
    unknowns: int
    error: float
    seconds: float

    def __str__(self) -> str:
        error = f"error about {100 * self.error:.2g} %" if np.isfinite(self.error) else "error not known"
        if not self.error:
            error = "nothing there that could miss the target"
        return f"{self.mesh}: {self.unknowns} unknowns, {error}, {self.seconds:.1f} s"


@dataclass(frozen=True)
class Choice:
    """The mesh that a search has found, and the sweep on it.

    Attributes
    ----------
    scene : Scene
        The scene with the order and the numbers of elements of this mesh.
    mesh : LoadedMesh
        The mesh.
    result : Sweep
        The sweep on this mesh, with the error of the mesh on modes and onsets (unless the search was interrupted).
    trials : tuple of Trial
        All meshes that were tried; the last one is the mesh found.
    split : Split or None
        The changes by refinement, by element and axis: where the errors come from.
    """

    scene: Scene
    mesh: LoadedMesh
    result: Sweep
    trials: tuple[Trial, ...]
    split: Split | None = None


@dataclass(frozen=True)
class _Nearest:
    """The trial with the smallest error so far, and what a `Choice` is made from."""

    trial: Trial
    candidate: Candidate
    result: Sweep
    split: Split


@one_openblas_thread()  # for what is made ahead, too
def choose(
    scene: Scene, target: float, tell: Callable[[str], None] = lambda text: None, kinds: Sequence[str] = KINDS,
    earlier: tuple[list[Trial], Candidate] | None = None,
    keep: Callable[[list[Trial], Candidate], None] = lambda trials, candidate: None,
) -> Choice:  # fmt: skip
    """Find a mesh on which frequencies, growth rates and critical values meet a target.

    The first mesh is the scene's own. Each next mesh is finer where the error on the mesh before came from, see
    `shares`. As many modes are solved for as the scene asks for: the error of a mode does not depend on their number.

    Parameters
    ----------
    scene : Scene
    target : float
        For the relative error as `estimated_error` defines it, between 0 and 1.
    tell : callable of str
        Gets a line about each mesh that was tried, and a forecast of the next one.
    kinds : sequence of "frequencies", "growth", "onsets"
        Which quantities are to meet the target.
    earlier : (trials, candidate), optional
        To resume an interrupted search: the meshes it has tried and the one that it was about to try.
    keep : callable of (trials, candidate)
        Gets the trials so far and the mesh that comes next, before this is tried, to save them.

    Raises
    ------
    SceneError
        The target is not between 0 and 1.
    NotConvergedError
        The target is not met by the finest mesh that fits into memory, or not within the number of meshes that are
        tried; `partial` is the `Choice` nearest to it. Or the corrections on a refined mesh were not found.
    TooLargeError
        Not even the first mesh, refined for the estimate, fits into memory.
    KeyboardInterrupt
        Ctrl-C; its argument is the `Choice` nearest to the target so far, if there is one.
    """
    if not 0 < target < 1:
        raise SceneError(f"--accuracy: given {target:g}; expected a relative error between 0 and 1")
    trials, candidate = earlier if earlier is not None else ([], first_candidate(scene))
    nearest: _Nearest | None = None
    try:
        for _ in range(_RUNS):
            keep(trials, candidate)
            start = time.perf_counter()
            problem = Assembly(candidate.scene, candidate.loaded).problem({})
            solver = solver_of(candidate.scene)
            with finer_mesh_ahead(problem) or nullcontext() as ahead:
                result = _swept(candidate.scene, problem)
                refined = refine_problem(result, solver, ahead)
            clock = time.perf_counter()
            corrections = right_corrections(result, refined)
            bars_take = _BARS * (time.perf_counter() - clock)
            split = split_changes(result, refined, corrections).of(kinds)
            grouped, order = element_groups(refined.coarse), refined.coarse.space.order
            error = first = float(first_order_bars(split, *grouped, order).max(initial=0.0))
            if first <= _SURELY * target:
                result = with_changes(result, changes_by(result, refined, solver, corrections))
                error, bars_take = estimated_error(result, kinds), 0.0  # in the seconds of this mesh already
            trial = Trial(candidate.told, result.problem.unknowns, error, time.perf_counter() - start)
            trials.append(trial)
            tell(str(trial))
            if nearest is None or _known(error) <= _known(nearest.trial.error):
                nearest = _Nearest(trial, candidate, result, split)
            if error <= target:
                return _picked(nearest, trials)
            # The next mesh is made for bars to first order, whose parts are known by element. Where the bars themselves
            # are wider, those to first order have to be smaller than the target by as much.
            aim = _MARGIN * target * min(1.0, first / error if np.isfinite(error) else 1.0)
            before, spent = candidate, trial.seconds + bars_take
            candidate = next_candidate(candidate, refined.coarse, split, aim)
            if candidate.unknowns < _SLACK * before.unknowns and not _moved(before, candidate):
                candidate = finer_candidate(before)
            ratio = candidate.unknowns / before.unknowns
            unknowns = int(ratio * trial.unknowns)
            del refined, corrections
            memory = int(refined_memory(result) * ratio)
            tell(
                f"next: {candidate.told}: about {unknowns} unknowns, {spent * ratio**_GROWTH:.0f} s, "
                f"{memory_text(memory)}"
            )
            try:
                require_memory(memory, 8 * unknowns, "modes on the refined mesh")
            except TooLargeError as error_:
                raise _missed(target, nearest, trials, str(error_)) from error_
        assert nearest is not None
        raise _missed(target, nearest, trials, f"after {_RUNS} runs")
    except KeyboardInterrupt as stop:
        if nearest is None:
            raise
        raise KeyboardInterrupt(_picked(nearest, trials, bars=False)) from stop


def _known(error: float) -> float:
    """Return an error so that one that is not known counts as larger than any other."""
    return np.inf if np.isnan(error) else error


def _moved(before: Candidate, then: Candidate) -> bool:
    """Return whether elements of a parametric mesh lie elsewhere than before: graded, or aligned with an edge."""
    own, other = before.scene.mesh.geometry, then.scene.mesh.geometry
    return own is not None and other is not None and own.placing != other.placing


def _swept(scene: Scene, problem: Problem) -> Sweep:
    parameter, grid = swept(scene, problem)
    solve = scene.solve
    return sweep(
        problem, grid, parameter, modes=solve.modes, max_frequency=solve.max_frequency, tolerance=solve.tolerance,
        keep_shapes=keeps_shapes(scene), method=solve.method, linear_solver=solver_of(scene),
    )  # fmt: skip


def _picked(nearest: _Nearest, trials: list[Trial], bars: bool = True) -> Choice:
    """Return the choice; with `bars` the error of the mesh is put on its sweep if it is not there yet."""
    result, (scene, loaded) = nearest.result, (nearest.candidate.scene, nearest.candidate.loaded)
    if bars and result.points[0].discretisation is None:
        result = with_discretisation(result, solver_of(scene))
    return Choice(scene, loaded, result, (*(t for t in trials if t is not nearest.trial), nearest.trial), nearest.split)


def _missed(target: float, nearest: _Nearest, trials: list[Trial], why: str) -> NotConvergedError:
    # Of trials before an interruption there is no result any more, so that one of them may be nearer.
    best = min(_known(trial.error) for trial in trials)
    which = "nearest" if _known(nearest.trial.error) <= best else "nearest since the search was resumed"
    return NotConvergedError(
        f"the target of {100 * target:g} % is not met; {which}: {nearest.trial} ({why})",
        partial=_picked(nearest, trials),
    )
