"""Find the mesh for a target: solve, see where the error comes from, refine there."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..assembly.assembly import Assembly
from ..assembly.swept import swept
from ..eigen.memory import TooLargeError, memory_text, require_memory
from ..errors import NotConvergedError, SceneError
from ..mesh import LoadedMesh
from ..scene import Scene
from ..sweep.result import Sweep
from ..sweep.sweep import sweep
from .bars import BARS
from .candidates import ORDER, Candidate, finer_candidate, first_candidate, next_candidate
from .estimate import COMPARED, SMALLEST, changes_by, with_changes, with_discretisation
from .quantities import KINDS, Split, split_changes
from .refined import refine_problem, refined_memory

_MARGIN = 0.8  # of the target: the error that is aimed at
_SURELY = 1.5  # times the target: beyond it the changes to first order suffice, and bars are not worth their time
_RUNS = 8
_GROWTH = 1.2  # power of the unknowns with which times grow
_SLACK = 1.02  # times the unknowns: less is no finer mesh


@dataclass(frozen=True)
class Trial:
    """One of the runs.

    Attributes
    ----------
    mesh : str
        In words.
    unknowns : int
    error : float
        The largest estimated error of what is wanted, relative.
    seconds : float
        With the estimate.
    """

    mesh: str
    unknowns: int
    error: float
    seconds: float

    def __str__(self) -> str:
        error = f"error about {100 * self.error:.2g} %" if np.isfinite(self.error) else "error not known"
        return f"{self.mesh}: {self.unknowns} unknowns, {error}, {self.seconds:.1f} s"


@dataclass(frozen=True)
class Choice:
    """What was picked.

    Attributes
    ----------
    scene : Scene
        With the order and the numbers of elements that meet the target.
    mesh : LoadedMesh
    result : Sweep
        With the errors of the mesh.
    trials : tuple of Trial
        The last is that of the result.
    split : Split or None
        Where the errors come from.
    """

    scene: Scene
    mesh: LoadedMesh
    result: Sweep
    trials: tuple[Trial, ...]
    split: Split | None = None


@dataclass(frozen=True)
class _Nearest:
    trial: Trial
    candidate: Candidate
    result: Sweep
    split: Split


def choose(
    scene: Scene, target: float, tell: Callable[[str], None] = lambda text: None, kinds: Sequence[str] = KINDS,
    earlier: tuple[list[Trial], Candidate] | None = None,
    keep: Callable[[list[Trial], Candidate], None] = lambda trials, candidate: None,
) -> Choice:  # fmt: skip
    """Find a mesh on which frequencies, growth rates and critical values meet a target.

    The first mesh is the scene's own; each next one is finer where the error of the one before came from, see `shares`.
    The number of modes is the scene's: the error of each is estimated by itself, and to ask for more would not change
    it.

    Parameters
    ----------
    target : float
        Relative error, see `estimated_error`.
    tell : callable of str
        Gets a line about each run, and a forecast of the next one.
    kinds : sequence of "frequencies", "growth", "onsets"
        What is to meet the target.
    earlier : (trials, candidate), optional
        Those of an interrupted search, and the mesh that it was at.
    keep : callable of trials and candidate
        Gets the trials so far and the mesh that comes next, before it is tried.

    Raises
    ------
    SceneError
    NotConvergedError
        The target is not met by the finest mesh that fits; `partial` is the choice nearest to it.
    KeyboardInterrupt
        With the choice nearest to the target so far as its argument, if there is one.
    """
    if not 0 < target < 1:
        raise SceneError(f"--accuracy: given {target:g}; expected a relative error between 0 and 1")
    trials, candidate = earlier if earlier is not None else ([], first_candidate(scene))
    nearest: _Nearest | None = None
    try:
        for _ in range(_RUNS):
            keep(trials, candidate)
            start = time.perf_counter()
            result = _swept(candidate)
            solver = candidate.scene.solve.linear_solver
            refined = refine_problem(result, solver)
            split = split_changes(result, refined).of(kinds)
            error = first = BARS[ORDER] * float(np.abs(split.changes / split.scales).max(initial=0.0))
            if first <= _SURELY * target:
                result = with_changes(result, changes_by(result, refined, solver))
                error = estimated_error(result, kinds)
            trial = Trial(candidate.told, result.problem.unknowns, error, time.perf_counter() - start)
            trials.append(trial)
            tell(str(trial))
            if nearest is None or not nearest.trial.error <= error:
                nearest = _Nearest(trial, candidate, result, split)
            if error <= target:
                return _picked(nearest, trials)
            # Bars may be wider than the changes to first order say; these are what the next mesh is to bring down.
            aim = _MARGIN * target * min(1.0, first / error if np.isfinite(error) else 1.0) / BARS[ORDER]
            before, spent = candidate, trial.seconds
            candidate = next_candidate(candidate, refined.coarse, split, aim)
            if candidate.unknowns < _SLACK * before.unknowns:
                candidate = finer_candidate(before)
            ratio = candidate.unknowns / before.unknowns
            unknowns = int(ratio * trial.unknowns)
            del refined
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


def _swept(candidate: Candidate) -> Sweep:
    scene = candidate.scene
    problem = Assembly(scene, candidate.loaded).problem({})
    parameter, grid = swept(scene, problem)
    solve = scene.solve
    return sweep(
        problem, grid, parameter, modes=solve.modes, max_frequency=solve.max_frequency, tolerance=solve.tolerance,
        keep_shapes=scene.output.shapes == "all", method=solve.method, linear_solver=solve.linear_solver,
    )  # fmt: skip


def estimated_error(result: Sweep, kinds: Sequence[str] = KINDS) -> float:
    """Return the largest error of a sweep by its bars, relative; NaN where one is not known.

    Of the frequencies at all values; of the growth rate of each branch where it grows fastest, relative to the largest
    of all; of critical values relative to themselves, or to a tenth of the sweep where they are smaller than that.
    Above 0.8 of the highest frequency what the refined mesh does not have does not count: it may have left the range.
    Close to an onset growth is as unsure as the onset, which stands for it.
    """
    highest = max(float(p.modes.lam.imag.max(initial=0.0)) for p in result.points)
    found: list[float] = []

    def add(kind: str, error: np.ndarray, frequency: np.ndarray) -> None:
        """Take the errors of what both meshes have; above, a mode may have left the range."""
        if kind in kinds:
            found.extend(error[np.isfinite(error) | (frequency <= COMPARED * highest)].tolist())

    peaks: dict[int, tuple[float, float, float]] = {}  # growth, its bar and the frequency, by branch
    for point in result.points:
        assert point.discretisation is not None
        lam, bar = point.modes.lam, point.discretisation
        swinging = lam.imag > 0
        add("frequencies", (bar.imag / np.where(swinging, lam.imag, 1.0))[swinging], lam.imag[swinging])
        for i in np.flatnonzero(swinging & (point.modes.stability == "unstable")).tolist():
            branch, own = int(point.branches[i]), (float(lam[i].real), float(bar[i].real), float(lam[i].imag))
            peaks[branch] = max(peaks.get(branch, own), own)
    if peaks:
        growth, bars, frequencies = np.array(list(peaks.values())).T
        add("growth", bars / growth.max(), frequencies)
    width = float(np.ptp([p.value for p in result.points]))
    for o in result.onsets:
        relative = np.array([o.discretisation / max(abs(o.value), SMALLEST * width)])
        add("onsets", relative, np.array([2 * np.pi * o.frequency_hz]))
    return float(np.max(found)) if found else 0.0


def _picked(nearest: _Nearest, trials: list[Trial], bars: bool = True) -> Choice:
    """Return the choice, with bars unless there is no time for them."""
    result, (scene, loaded) = nearest.result, (nearest.candidate.scene, nearest.candidate.loaded)
    if bars and result.points[0].discretisation is None:
        result = with_discretisation(result, scene.solve.linear_solver)
    return Choice(scene, loaded, result, (*(t for t in trials if t is not nearest.trial), nearest.trial), nearest.split)


def _missed(target: float, nearest: _Nearest, trials: list[Trial], why: str) -> NotConvergedError:
    return NotConvergedError(
        f"the target of {100 * target:g} % is not met; nearest: {nearest.trial} ({why})",
        partial=_picked(nearest, trials),
    )
