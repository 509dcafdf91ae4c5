"""Find a mesh that meets a target for the error: solve, see which elements the error comes from, and refine there."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from ..assembly.assembly import Assembly
from ..assembly.swept import keeps_shapes, swept
from ..eigen.memory import memory_text, require_memory
from ..eigen.threads import one_openblas_thread
from ..errors import NotConvergedError, SceneError, SquealError
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
    by_bars : bool
        Whether the error is by the bars of the sweep. By bars to first order it lacks what is of higher order, and
        onsets that only one of the mesh and the refined mesh has.
    """

    mesh: str
    unknowns: int
    error: float
    seconds: float
    by_bars: bool = True

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
class _Tried:
    """A trial, what a `Choice` is made from, and what the next mesh is made from.

    `first` is the largest bar to first order, and `bars_take` the seconds, s, that bars would take if they are not made
    yet.
    """

    trial: Trial
    candidate: Candidate
    result: Sweep
    split: Split
    assembly: Assembly
    first: float
    bars_take: float


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
        The target is not met by the finest mesh that can be solved, or not within the number of meshes that are tried;
        `partial` is the `Choice` nearest to it, or None where a resumed search has solved on no mesh: of those before
        there is no result any more.
    SquealError, MemoryError
        Not even the first mesh of all can be solved, or not refined for the estimate: it does not fit into memory, or
        modes on it are not found.
    KeyboardInterrupt
        Ctrl-C; its argument is the `Choice` nearest to the target so far, if there is one.
    """
    if not 0 < target < 1:
        raise SceneError(f"--accuracy: given {target:g}; expected a relative error between 0 and 1")
    trials, candidate = earlier if earlier is not None else ([], first_candidate(scene))
    before = tuple(trials)
    nearest: _Tried | None = None
    why = f"after {_RUNS} runs"
    try:
        for _ in range(_RUNS):
            keep(trials, candidate)
            try:
                tried = _tried(candidate, target, kinds)
                trials.append(tried.trial)
                tell(str(tried.trial))
                if nearest is None or _is_nearer(tried.trial, nearest.trial):
                    nearest = tried
                if tried.trial.error <= target:
                    return _picked(nearest, trials, kinds)
                candidate = _next(tried, target, tell)
            except (SquealError, MemoryError) as error:
                if nearest is None and not before:
                    raise
                traceback.clear_frames(error.__traceback__)  # which hold what was made of the mesh that failed
                why = str(error) or "the next mesh does not fit into memory"
                break
        if nearest is None:
            best = reduce(lambda one, other: other if _is_nearer(other, one) else one, before)
            raise NotConvergedError(f"{_missing(target)} nearest before the search was resumed: {best} ({why})")
        raise _missed(target, nearest, trials, before, kinds, why)
    except KeyboardInterrupt as stop:
        if nearest is None:
            raise
        raise KeyboardInterrupt(_picked(nearest, trials)) from stop


def _tried(candidate: Candidate, target: float, kinds: Sequence[str]) -> _Tried:
    """Solve on a mesh, and estimate the error; by bars where those to first order do not miss the target already."""
    start = time.perf_counter()
    problem = Assembly(candidate.scene, candidate.loaded).problem({})
    solver = solver_of(candidate.scene)
    with finer_mesh_ahead(problem, *swept(candidate.scene, problem), solver) or nullcontext() as ahead:
        result = _swept(candidate.scene, problem)
        refined = refine_problem(result, solver, ahead)
    clock = time.perf_counter()
    corrections = right_corrections(result, refined)
    bars_take = _BARS * (time.perf_counter() - clock)
    split = split_changes(result, refined, corrections).of(kinds)
    grouped, order = element_groups(refined.coarse), refined.coarse.space.order
    error = first = float(first_order_bars(split, *grouped, order).max(initial=0.0))
    by_bars = first <= _SURELY * target
    if by_bars:
        result = with_changes(result, changes_by(result, refined, solver, corrections))
        error, bars_take = estimated_error(result, kinds), 0.0  # in the seconds of this mesh already
    trial = Trial(candidate.told, result.problem.unknowns, error, time.perf_counter() - start, by_bars)
    return _Tried(trial, candidate, result, split, refined.coarse, first, bars_take)


def _next(tried: _Tried, target: float, tell: Callable[[str], None]) -> Candidate:
    """Return the mesh that comes next, and tell what it takes.

    Raises
    ------
    TooLargeError
        Its modes do not fit into memory.
    """
    trial, before, error = tried.trial, tried.candidate, tried.trial.error
    # The next mesh is made for bars to first order, whose parts are known by element. Where the bars themselves are
    # wider, those to first order have to be smaller than the target by as much.
    aim = _MARGIN * target * min(1.0, tried.first / error if np.isfinite(error) else 1.0)
    # What the refined mesh alone has, such as an onset, no element of this mesh explains.
    unexplained = not len(tried.split.names) or (not np.isfinite(error) and tried.first <= aim)
    candidate = finer_candidate(before) if unexplained else next_candidate(before, tried.assembly, tried.split, aim)
    if candidate.unknowns < _SLACK * before.unknowns and not _moved(before, candidate):
        candidate = finer_candidate(before)
    ratio = candidate.unknowns / before.unknowns
    unknowns, seconds = int(ratio * trial.unknowns), (trial.seconds + tried.bars_take) * ratio**_GROWTH
    memory = int(refined_memory(tried.result) * ratio)
    tell(f"next: {candidate.told}: about {unknowns} unknowns, {seconds:.0f} s, {memory_text(memory)}")
    require_memory(memory, 8 * unknowns, "modes on the refined mesh")
    return candidate


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


def _is_nearer(trial: Trial, other: Trial) -> bool:
    """Return whether a trial is as near to the target as one before it.

    An error by bars to first order may be the smaller one only because it lacks what bars have.
    """
    if trial.by_bars and not other.by_bars and trial.unknowns >= other.unknowns:
        return True
    return _known(trial.error) <= _known(other.error)


def _picked(nearest: _Tried, trials: list[Trial], kinds: Sequence[str] | None = None) -> Choice:
    """Return the choice; with `kinds` its sweep has the error of the mesh, and its trial the error by these bars."""
    trial, result, (scene, loaded) = nearest.trial, nearest.result, (nearest.candidate.scene, nearest.candidate.loaded)
    if kinds is not None and result.points[0].discretisation is None:
        result = with_discretisation(result, solver_of(scene))
        trial = replace(trial, error=estimated_error(result, kinds), by_bars=True)
    return Choice(scene, loaded, result, (*(t for t in trials if t is not nearest.trial), trial), nearest.split)


def _missing(target: float) -> str:
    return f"the target of {100 * target:g} % is not met;"


def _missed(
    target: float, nearest: _Tried, trials: list[Trial], before: Sequence[Trial], kinds: Sequence[str], why: str
) -> NotConvergedError:  # fmt: skip
    """Return the error with the choice; `before` are the trials of the search that is resumed."""
    try:
        choice = _picked(nearest, trials, kinds)
    except (SquealError, MemoryError) as error:
        text = f"the error of the mesh is not known: {str(error) or 'the refined mesh does not fit into memory'}"
        result = replace(nearest.result, warnings=(*nearest.result.warnings, text))
        choice = _picked(replace(nearest, result=result), trials)
    own = choice.trials[-1]
    # Of trials before an interruption there is no result any more, so that one of them may be nearer.
    is_nearest = all(_is_nearer(own, trial) for trial in before)
    which = "nearest" if is_nearest else "nearest since the search was resumed"
    return NotConvergedError(f"{_missing(target)} {which}: {own} ({why})", partial=choice)
