"""Pick mesh size, order, modes and method for a target, from quick runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..assembly.assembly import Assembly
from ..assembly.swept import swept
from ..eigen.memory import TooLargeError
from ..errors import MeshError, NotConvergedError, SceneError
from ..mesh import LoadedMesh
from ..scene import Scene
from ..sweep.onset import Onset
from ..sweep.result import Sweep, SweepPoint
from ..sweep.sweep import sweep
from .bars import BARS
from .estimate import COMPARED, EXTRAPOLATED, SMALLEST, with_discretisation
from .settings import Setting, own_setting, scene_at

_START = 2.0  # times the scene's size: where the search begins
_RATES = (1.0, 4.0)  # powers of the size with which errors fall, from singular stresses to smooth ones
_EXPECTED = {1: 1.5, 2: 2.5}  # the rate that each order is taken to have, until two runs tell
_STEP = (0.4, 0.8)  # of the size of a mesh: between these lies that of the next one
_MARGIN = 0.8  # of the target: the error that is aimed at
_RUNS = 8


@dataclass(frozen=True)
class Trial:
    """One of the runs.

    Attributes
    ----------
    setting : Setting
    unknowns : int
    error : float
        The largest estimated error of what is wanted, relative.
    seconds : float
        With the estimate.
    """

    setting: Setting
    unknowns: int
    error: float
    seconds: float

    def __str__(self) -> str:
        error = f"error about {100 * self.error:.2g} %" if np.isfinite(self.error) else "error not known"
        return f"{self.setting}: {self.unknowns} unknowns, {error}, {self.seconds:.1f} s"


@dataclass(frozen=True)
class Choice:
    """What was picked.

    Attributes
    ----------
    scene : Scene
        With the size and order that meet the target.
    mesh : LoadedMesh
    result : Sweep
        With the errors of the mesh.
    trials : tuple of Trial
        The last is that of the result.
    """

    scene: Scene
    mesh: LoadedMesh
    result: Sweep
    trials: tuple[Trial, ...]


_Results = dict[Trial, tuple[Scene, LoadedMesh, Sweep]]


def choose(scene: Scene, target: float, tell: Callable[[str], None] = lambda text: None) -> Choice:
    """Find the coarsest mesh on which frequencies, growth rates and critical values meet a target.

    Both orders are tried on a coarse mesh; the one that would reach the target with less work goes on, with sizes that
    follow from the errors estimated so far. The number of modes is the scene's: the error of each is estimated by
    itself, and to ask for more would not change it. The method is the reduced one where the parameter allows it.

    Parameters
    ----------
    target : float
        Relative error, see `estimated_error`.
    tell : callable of str
        Gets a line about each run.

    Raises
    ------
    SceneError
        The mesh is a file without a geometry.
    NotConvergedError
        The target is not met by the finest mesh that fits; `partial` is the choice nearest to it.
    KeyboardInterrupt
        With the choice nearest to the target so far as its argument, if there is one.
    """
    if not 0 < target < 1:
        raise SceneError(f"--accuracy: given {target:g}; expected a relative error between 0 and 1")
    if scene.mesh.geometry is None:
        raise SceneError("--accuracy: a mesh file has one size; expected [mesh.disc_pad] or [mesh.block]")
    own = replace(own_setting(scene), method=scene.solve.method)
    trials: list[Trial] = []
    results: _Results = {}

    def run(setting: Setting) -> Trial:
        start = time.perf_counter()
        changed, loaded = scene_at(scene, setting)
        if scene.solve.max_frequency is not None:
            changed = changed.model_copy(update={"solve": scene.solve})
        problem = Assembly(changed, loaded).problem({})
        parameter, grid = swept(changed, problem)
        solve = changed.solve
        result = sweep(
            problem, grid, parameter, modes=solve.modes, max_frequency=solve.max_frequency, tolerance=solve.tolerance,
            keep_shapes=scene.output.shapes == "all", method=solve.method, linear_solver=solve.linear_solver,
        )  # fmt: skip
        result = with_discretisation(result, solve.linear_solver)
        trial = Trial(setting, problem.unknowns, estimated_error(result), time.perf_counter() - start)
        trials.append(trial)
        results[trial] = (changed, loaded, result)
        tell(str(trial))
        return trial

    try:
        return _search(run, own, target, trials, results, tell)
    except KeyboardInterrupt as stop:
        if not trials:
            raise
        nearest = min(results, key=lambda trial: np.nan_to_num(trial.error, nan=np.inf))
        raise KeyboardInterrupt(_picked(nearest, trials, results)) from stop


def _search(
    run: Callable[[Setting], Trial], own: Setting, target: float, trials: list[Trial], results: _Results,
    tell: Callable[[str], None],
) -> Choice:  # fmt: skip
    """Return the choice; `run` adds to trials and results."""
    first: list[Trial] = []
    for order in (1, 2):
        setting = replace(own, order=order, size=_START * own.size / (3 - order))
        try:
            first.append(run(setting))
        except (TooLargeError, NotConvergedError, MeshError) as error:
            if order == 2 and not first:
                raise
            tell(f"{setting}: {error}")
    last, before = min(first, key=lambda trial: _work(trial, target)), None
    while not last.error <= target:
        rate = _EXPECTED[last.setting.order]
        if before is not None and np.isfinite(before.error * last.error):
            seen = np.log(before.error / last.error) / np.log(before.setting.size / last.setting.size)
            rate = np.sqrt(rate * np.clip(seen, *_RATES))  # the largest error changes from one quantity to another
        known = last.error if np.isfinite(last.error) else 1.0
        step = float(np.clip((_MARGIN * target / known) ** (1 / rate), *_STEP))
        nearest = min(trials, key=lambda trial: np.nan_to_num(trial.error, nan=np.inf))
        for other in [t for t in results if t is not nearest]:  # to free their memory
            del results[other]
        if len(trials) == _RUNS:
            raise _missed(target, trials, results, f"after {_RUNS} runs")
        before = last
        try:
            last = run(replace(last.setting, size=step * last.setting.size))
        except (TooLargeError, NotConvergedError) as error:
            raise _missed(target, trials, results, str(error)) from error
    return _picked(last, trials, results)


def estimated_error(result: Sweep) -> float:
    """Return the largest estimated error of a sweep with bars, relative; NaN where one is not known.

    Of the frequencies at all values; of the growth rates relative to the largest one, but for those closer to an onset
    of their branch than its error: there the error of the onset says how far the mode grows, or does not; of critical
    values relative to themselves, or to a tenth of the sweep where they are smaller than that. Above 0.8 of the highest
    frequency what the refined mesh does not have does not count: it may have left the range. It is the
    likely error, not the error bar, which is wider so that it nearly always holds the error.
    """
    highest = max(float(p.modes.lam.imag.max(initial=0.0)) for p in result.points)
    fastest = max(float(p.modes.lam.real.max(initial=0.0)) for p in result.points)
    found: list[float] = []

    def add(error: np.ndarray, frequency: np.ndarray) -> None:
        """Take the errors of what both meshes have; above, a mode may have left the range."""
        found.extend(error[np.isfinite(error) | (frequency <= COMPARED * highest)].tolist())

    for point in result.points:
        assert point.discretisation is not None
        lam, bar = point.modes.lam, point.discretisation
        swinging = lam.imag > 0
        add((bar.imag / np.where(swinging, lam.imag, 1.0))[swinging], lam.imag[swinging])
        growing = swinging & (point.modes.stability == "unstable") & ~_at_onset(point, result.onsets)
        add(bar.real[growing] / fastest, lam.imag[growing])
    width = float(np.ptp([p.value for p in result.points]))
    for o in result.onsets:
        relative = np.array(o.discretisation / max(abs(o.value), SMALLEST * width))
        add(relative[None], np.array([2 * np.pi * o.frequency_hz]))
    source = result.problem.source
    assert isinstance(source, Assembly)
    return float(np.max(found) * EXTRAPOLATED / BARS[source.space.order]) if found else 0.0


def _at_onset(point: SweepPoint, onsets: Sequence[Onset]) -> np.ndarray:
    """Return (k,) which modes are closer to an onset of their branch than its error."""
    found = np.zeros(len(point.modes), dtype=bool)
    for o in onsets:
        if abs(point.value - o.value) <= o.discretisation:
            found |= np.isin(point.branches, [b for b in (o.branch_a, o.branch_b) if b])
    return found


def _work(trial: Trial, target: float) -> float:
    """Return about how many unknowns an order needs for a target; infinity where its error is not known."""
    rate = {1: 2.0, 2: 3.0}[trial.setting.order]
    return float(np.nan_to_num(trial.unknowns * (trial.error / target) ** (3 / rate), nan=np.inf))


def _picked(trial: Trial, trials: list[Trial], results: _Results) -> Choice:
    return Choice(*results[trial], (*(t for t in trials if t is not trial), trial))


def _missed(target: float, trials: list[Trial], results: _Results, why: str) -> NotConvergedError:
    [nearest] = results
    return NotConvergedError(
        f"the target of {100 * target:g} % is not met; nearest: {nearest} ({why})",
        partial=_picked(nearest, trials, results),
    )
