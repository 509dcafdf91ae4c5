"""The main job: from a scene to a folder of results."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from . import __version__
from .assembly import assemble
from .errors import InputError, NotConvergedError, OutputError, SceneError
from .preload_results import write_preload
from .problem import Problem
from .report import print_onsets, print_unstable
from .results import export_shapes, peak_memory_mib, write_figures, write_record, write_tables
from .scene import MU, MatrixScene, Scene
from .sweep import sweep
from .sweep_result import Sweep

INTERRUPTED = 130


def run_scene(scene: Scene | MatrixScene, out: Path, console: Console, estimate: bool = False) -> int:
    """Assemble, sweep, and write every result into a folder.

    Parameters
    ----------
    estimate : bool
        Estimate the error of the mesh, too.

    Returns
    -------
    int
        0, or 130 if the user interrupted; what was finished is written then.

    Raises
    ------
    InputError, NotConvergedError
        After a failure of the solver, what did converge is in the folder, and run.json says so.
    """
    start = time.perf_counter()
    existed = out.exists()
    prepare_folder(out)
    try:
        problem = assemble(scene)
    except (InputError, NotConvergedError):
        if not existed:
            out.rmdir()
        raise
    remove_results(out)
    seconds = {"assembly": time.perf_counter() - start}
    if problem.model is not None:
        for text in problem.model.notes:
            console.print(f"note: {text}", markup=False)
        for text in problem.model.warnings:
            console.print(f"warning: {text}", markup=False)
    console.print(
        f"{problem.unknowns} unknowns, {problem.problem_class} problem; effects on: "
        f"{', '.join(scene.effect_names) or 'none'}",
        markup=False,
    )
    status, result, failure = "complete", None, None
    try:
        result = sweep_scene(scene, problem, console)
    except NotConvergedError as error:
        status, failure, result = "not converged", error, _partial(error)
    except SceneError as error:
        raise SceneError(f"{scene.source}: {error}" if scene.source is not None else str(error)) from error
    except KeyboardInterrupt as stop:
        status, result = "interrupted", stop.args[0] if stop.args else None
    if result is not None:
        if estimate and status == "complete":
            result = _estimated(result, console)
        seconds |= dict(result.seconds)
        clock = time.perf_counter()
        write_results(scene, result, out)
        seconds["output"] = time.perf_counter() - clock
    seconds["total"] = time.perf_counter() - start
    write_record(scene, problem, result, seconds, status, out, __version__)
    done = len(result.points) if result is not None else 0
    if failure is not None:
        raise NotConvergedError(f"{failure}; {done} values before it are in {out}", failure.partial)
    if result is not None:
        _report(scene, result, out, console, seconds["total"])
    if status == "interrupted":
        total = len(_values(scene, problem))
        print(f"interrupted: {done} of {total} values were finished and are in {out}", file=sys.stderr)
        return INTERRUPTED
    return 0


def sweep_scene(scene: Scene | MatrixScene, problem: Problem, console: Console, precise: bool = False) -> Sweep:
    """Run the sweep that the scene asks for, with a progress bar on a terminal and plain lines elsewhere.

    Raises
    ------
    KeyboardInterrupt
        With the sweep so far as its argument.
    """
    values = _values(scene, problem)
    parameter = MU if scene.sweep is None else scene.sweep.parameter
    options = {
        "modes": scene.solve.modes, "max_frequency": scene.solve.max_frequency, "tolerance": scene.solve.tolerance,
        "keep_shapes": scene.output.shapes == "all", "method": scene.solve.method,
        "precise": precise,
    }  # fmt: skip
    if not console.is_terminal:
        marks = {max(1, round(len(values) * part / 4)) for part in range(1, 5)}

        def report(done: int, total: int) -> None:
            if done in marks:
                console.print(f"{parameter} = {values[done - 1]:.4g}: {done} of {total} values solved", markup=False)

        return _explained(sweep(problem, values, parameter, progress=report, **options), scene)  # type: ignore[arg-type]
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(f"sweep over {parameter}", total=len(values))

        def advance(done: int, total: int) -> None:
            bar.update(task, completed=done)

        return _explained(sweep(problem, values, parameter, progress=advance, **options), scene)  # type: ignore[arg-type]


def write_results(scene: Scene | MatrixScene, result: Sweep, out: Path) -> None:
    """Write tables, figures and shapes."""
    write_tables(result, out)
    write_figures(result, out, scene.title)
    if isinstance(scene, Scene):
        write_preload(scene, result.problem, out)
    if scene.output.shapes != "none":
        export_shapes(result, out / "shapes", scene.output.shapes)


def prepare_folder(out: Path) -> None:
    """Make the output folder and see that files can be written there, before anything is solved.

    Raises
    ------
    OutputError
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=out)
        os.close(handle)
        os.unlink(name)
    except OSError as error:
        raise OutputError(
            f"{out}: cannot write results here: {error.strerror or error}; expected a folder that can be written,"
            " given by -o"
        ) from error


def remove_results(out: Path) -> None:
    """Remove what an earlier run wrote into the folder, so that results of two runs are never mixed."""
    tables = ["modes.csv", "onsets.csv", "contributions.csv", "sensitivities.csv", "preload.csv", "run.json"]
    figures = ["stability.png", "root_locus.png", "contributions.png", "preload.png"]
    figures += ["preload.vtu", "preload_contacts.vtu"]
    shapes = [p for kind in ("vtu", "pvd", "png", "npz") for p in (out / "shapes").glob(f"*_*Hz.{kind}")]
    for path in [out / name for name in tables + figures] + shapes:
        path.unlink(missing_ok=True)
    for frames in (out / "shapes").glob("*_*Hz_frames"):
        shutil.rmtree(frames)
    if (out / "shapes").is_dir() and not any((out / "shapes").iterdir()):
        (out / "shapes").rmdir()


def _values(scene: Scene | MatrixScene, problem: Problem) -> list[float]:
    if scene.sweep is None:
        return [problem.parameters.get(MU, 0.0)]
    return [float(v) for v in scene.sweep.grid]


def _explained(result: Sweep, scene: Scene | MatrixScene) -> Sweep:
    """Add the doubt that a range without any mode leaves."""
    if any(len(point.modes) for point in result.points):
        return result
    doubt = f"solve.max_frequency: given {scene.solve.max_frequency:g} Hz; no mode lies below it, so nothing is shown"
    return replace(result, doubts=(*result.doubts, doubt))


def _estimated(result: Sweep, console: Console) -> Sweep:
    """Add the errors of the mesh; where that fails, the doubt that it leaves."""
    from .accuracy import with_discretisation

    clock = time.perf_counter()
    console.print("the error of the mesh is estimated on the mesh refined once")
    try:
        result = with_discretisation(result)
    except (NotConvergedError, InputError) as error:
        result = replace(result, doubts=(*result.doubts, f"the error of the mesh is not known: {error}"))
    return replace(result, seconds={**result.seconds, "estimate": time.perf_counter() - clock})


def _partial(error: NotConvergedError) -> Sweep | None:
    return error.partial if isinstance(error.partial, Sweep) else None


def _report(scene: Scene | MatrixScene, result: Sweep, out: Path, console: Console, seconds: float) -> None:
    print_onsets(result.onsets_dataframe(), console)
    print_unstable(result.to_dataframe(), console)
    c = result.completeness
    how = "LAPACK finds all modes" if result.method.startswith("dense") else "by the inertia of K − σM"
    counted = "counted without damping and friction, and followed from there by a small model"
    proof = f"proven: {how}" if c.proven else counted if c.expected is not None else "not proven"
    console.print(
        f"{c.found} of {c.expected if c.expected is not None else '?'} modes found at {result.parameter} = "
        f"{result.points[0].value:g} ({proof})",
        markup=False,
    )
    for doubt in result.doubts:
        console.print(f"warning: {doubt}", markup=False)
    memory = peak_memory_mib()
    peak = f", {memory:.0f} MiB" if memory is not None else ""
    shapes = ", shapes/" if scene.output.shapes != "none" and (out / "shapes").is_dir() else ""
    console.print(f"results in {out}: stability.png, root_locus.png{shapes} ({seconds:.1f} s{peak})", markup=False)
