"""The main job: from a scene to a folder of results.

This file is longer than others, since the order of everything that a run does and writes is best read in one place.
"""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ..assembly.assembly import assemble
from ..assembly.bodies import scene_mesh
from ..assembly.discretisation import discretisation_of
from ..assembly.forces import force_balance
from ..assembly.swept import keeps_shapes, swept
from ..eigen.linear.factor import LinearSolver
from ..eigen.memory import peak_memory_mib, refuse_shortage, release_freed
from ..eigen.shift import LIGHT_RATIO
from ..errors import INTERRUPTED, InputError, NotConvergedError
from ..problem.problem import Problem
from ..process.signals import signals_deferred
from ..report.tables import print_onsets, print_unstable
from ..report.terminal import print_table
from ..report.warnings import told_once
from ..scene import MatrixScene, Scene
from ..scene.faults import naming_file
from ..scene.solver import note_on_options, solver_of
from ..sweep.forecast import is_reduced, predict_memory
from ..sweep.result import Sweep
from ..sweep.state import Store, SweepState
from ..sweep.sweep import MODES, sweep
from .checkpoint import Checkpoint
from .compared import measured_record
from .covered import above_text, frequency_range, unstable_above
from .folder import REPORT, SHAPES, hold_folder, is_kept, is_result, is_shape, remove_results
from .forces import balance_table, scene_warnings
from .forecast import ForecastLine
from .inputs import input_files, run_inputs
from .manifest import Manifest
from .measured import NOTHING_MEASURED, Measurements, read_measured
from .mesh_error import write_mesh_error
from .outputs import exporting_shapes, write_figures, write_mac, write_modes, write_tables
from .page import write_run_report
from .preload import preload_warnings, write_preload
from .record import record_end, write_record
from .resume import is_estimated, is_finished, show_finished

if TYPE_CHECKING:
    from ..accuracy.quantities import Split


def run_scene(
    scene: Scene | MatrixScene, out: Path, console: Console, resume: bool = False, estimate: bool = False
) -> int:
    """Assemble the problem of a scene, sweep, and write all results into a folder.

    Parameters
    ----------
    scene : Scene or MatrixScene
    out : Path
        The folder.
    console : Console
    resume : bool
        Whether to continue an interrupted run of the same scene: values that are finished are not solved again.
    estimate : bool
        Whether to estimate the error of the mesh too.

    Returns
    -------
    int
        Exit code: 0, or 130 if the user interrupted; what was finished is written then.

    Raises
    ------
    SceneError, MeshError
        The scene or its mesh is wrong; results that the folder had are there as before.
    OutputError
        The folder cannot be used.
    TooLargeError
        The problem does not fit into memory.
    NotConvergedError
        The solver failed; what did converge is in the folder, and run.json says so.
    """
    with hold_folder(out, input_files(scene)) as held:
        return _run(scene, held, console, resume, estimate)


def _run(scene: Scene | MatrixScene, held: Manifest, console: Console, resume: bool, estimate: bool) -> int:
    start, solver, out = time.perf_counter(), solver_of(scene), held.folder
    measured = read_measured(scene)
    said = list(measured.warnings)
    mesh = scene_mesh(scene)
    inputs = run_inputs(scene, mesh)
    checkpoint = Checkpoint(held)
    finished = resume and is_finished(out, checkpoint, inputs)
    if finished and (not estimate or is_estimated(out)):
        if scene.output.report and (checkpoint.exists or not (out / REPORT).exists()):
            write_run_report(out, out / REPORT)  # which an interruption behind the tables has left missing or old
        checkpoint.remove()
        return show_finished(out, console)
    held.check(is_result)
    if not resume:
        held.check(is_kept)
    problem = assemble(scene, mesh)
    parameter, values = swept(scene, problem)
    seconds = {"assembly": time.perf_counter() - start}

    @signals_deferred()  # the folder has what was there or what comes, and nothing between
    def begin() -> None:
        remove_results(held)
        checkpoint.begin(inputs)
        record(None, "running")

    if resume and checkpoint.exists:
        done, spent = checkpoint.progress()
        console.print(f"resuming: {done} of {len(values)} values are finished", markup=False)
    else:
        if finished:
            console.print(f"the results in {out} have no errors of the mesh: the run starts anew", markup=False)
        elif resume:
            console.print(f"nothing to resume in {out}: the run starts anew", markup=False)
        spent = 0.0
        # Earlier results make way when there is something to keep of new ones, so that no bad input removes them.
        if held.names(lambda name: is_result(name) or is_kept(name)):
            checkpoint.postpone(begin)
        else:
            checkpoint.begin(inputs)
    discretisation = discretisation_of(problem)
    if discretisation is not None:
        for text in discretisation.notes:
            console.print(f"note: {text}", markup=False)
        parts = force_balance(problem)
        balance = balance_table(parts, problem)
        if balance is not None:
            print_table(balance, console)
        for text in told_once(scene_warnings(problem, parts)):
            console.print(f"warning: {text}", markup=False)
    for text in measured.notes:
        console.print(f"note: {text}", markup=False)
    console.print(
        f"{problem.unknowns} unknowns, {problem.problem_class} problem; effects on: "
        f"{', '.join(scene.effect_names) or 'none'}",
        markup=False,
    )
    if (note := note_on_options(scene, solver)) is not None:
        console.print(f"note: {note}", markup=False)

    def record(result: Sweep | None, status: str) -> None:
        seconds["total"] = spent + time.perf_counter() - start
        write_record(scene, problem, result, seconds, status, inputs, solver, out, measured, said)

    def keep_tables(state: SweepState) -> None:
        result = state.sweep(problem, parameter)
        write_modes(result, out)
        record(result, "running")

    checkpoint.report = keep_tables
    status, result, failure, split = "complete", None, None, None
    try:
        if checkpoint.begun and checkpoint.is_empty:
            record(None, "running")
        result = sweep_scene(scene, problem, console, store=checkpoint)
    except NotConvergedError as error:
        status, failure, result = "not converged", error, sweep_so_far(error)
        if not checkpoint.begun:
            begin()
    except InputError:
        if checkpoint.begun and checkpoint.is_empty:  # no value of this run was finished: nothing is worth keeping
            remove_results(held)
            checkpoint.remove()
        raise
    except KeyboardInterrupt as stop:
        if not checkpoint.begun:
            print(f"interrupted: nothing was finished, and {out} is as it was", file=sys.stderr)
            return INTERRUPTED
        status, result = "interrupted", sweep_so_far(stop)
    # Where it ended before it had what is kept of the run that it resumes, the tables of that stay as they are.
    kept = 0 if result is not None else checkpoint.progress()[0]
    if result is not None:
        if estimate and status == "complete":
            try:
                result, split = _estimated(result, solver, console)
            except KeyboardInterrupt:
                status = "interrupted"  # all values are finished; --resume continues with the estimate
        seconds |= dict(result.seconds)
        clock = time.perf_counter()
        try:
            said += preload_warnings(result, problem)
            said += write_results(scene, result, held, measured)
            write_mesh_error(split, result, out, scene.title)
        except KeyboardInterrupt:  # now, or before in a step of several processes, which all later ones tell again
            status = "interrupted"
        except NotConvergedError as error:
            status, failure = "not converged", failure or error
        seconds["output"] = time.perf_counter() - clock
    if kept:
        record_end(out, status)
    else:
        record(result, status)
    if result is not None and scene.output.report:
        write_run_report(out, out / REPORT)
    done = len(result.values) if result is not None else kept
    if failure is not None:
        raise NotConvergedError(f"{failure}; {done} values before it are in {out}", failure.partial)
    if result is not None:
        report_sweep(scene, result, out, console, seconds["total"])
        for entry in measured_record(measured, result, frequency_range(scene, result)):
            console.print(entry["sentence"], markup=False)
        for text in said:
            console.print(f"warning: {text}", markup=False)
    if status == "interrupted":
        print(f"interrupted: {done} of {len(values)} values were finished and are in {out}", file=sys.stderr)
        return INTERRUPTED
    checkpoint.remove()
    return 0


def sweep_scene(
    scene: Scene | MatrixScene, problem: Problem, console: Console, precise: bool = False, store: Store | None = None
) -> Sweep:
    """Run the sweep that a scene asks for, and show its progress: a bar on a terminal, plain lines elsewhere.

    Raises
    ------
    SceneError, NotConvergedError, TooLargeError
        As `sweep`; a SceneError names the file of the scene.
    KeyboardInterrupt
        Ctrl-C; its argument is the sweep so far.
    """
    parameter, values = swept(scene, problem)
    solver = solver_of(scene)
    options = {
        "modes": scene.solve.modes, "max_frequency": scene.solve.max_frequency, "tolerance": scene.solve.tolerance,
        "keep_shapes": keeps_shapes(scene), "method": scene.solve.method,
        "precise": precise, "store": store, "linear_solver": solver,
    }  # fmt: skip
    solve = scene.solve
    shortage = refuse_shortage(
        "the sweep", problem.unknowns,
        lambda: predict_memory(problem, parameter, len(values), solve.modes or MODES, solve.method, solver).total,
        "" if is_reduced(problem, parameter, len(values), solve.method) or len(values) == 1
        else ', or solve.method = "reduced"',
    )  # fmt: skip
    forecast = ForecastLine(len(values), console, store is not None)
    if not console.is_terminal:
        marks = {max(1, round(len(values) * part / 4)) for part in range(1, 5)}

        def report(done: int, total: int) -> None:
            forecast.tell(done)
            if done in marks:
                console.print(f"{parameter} = {values[done - 1]:.4g}: {done} of {total} values solved", markup=False)

        with naming_file(scene), shortage:
            return _explained(sweep(problem, values, parameter, progress=report, **options), scene)  # type: ignore[arg-type]
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(f"sweep over {parameter}", total=len(values))

        def advance(done: int, total: int) -> None:
            forecast.tell(done)
            bar.update(task, completed=done)

        with naming_file(scene), shortage:
            return _explained(sweep(problem, values, parameter, progress=advance, **options), scene)  # type: ignore[arg-type]


def write_results(
    scene: Scene | MatrixScene, result: Sweep, held: Manifest, measured: Measurements = NOTHING_MEASURED
) -> list[str]:
    """Write tables, figures and shapes; return sentences on measurements that could not be compared."""
    out = held.folder
    held.remove(is_shape)  # shapes of an interrupted run may be those of other values: of the fastest growth so far
    write_tables(result, out)
    which = scene.output.shapes
    release_freed()  # what the sweep has freed, before the libraries for figures and shapes are loaded
    with ExitStack() as drawing:
        try:
            if which != "none":
                drawing.enter_context(exporting_shapes(result, out / SHAPES, which))
        finally:  # the figures do not depend on shapes, which may take more memory than there is
            write_figures(result, out, scene.title, frequency_range(scene, result), measured.frequencies)
            if isinstance(scene, Scene):
                write_preload(scene, result.problem, out)
    return write_mac(result, measured, out, scene.title)


def _explained(result: Sweep, scene: Scene | MatrixScene) -> Sweep:
    """Return the sweep, with a warning if its range of frequencies has no mode."""
    if any(len(point.modes) for point in result.points):
        return result
    limit = scene.solve.max_frequency
    asked = f"solve.max_frequency: given {limit:g} Hz; no mode lies below it" if limit else "no mode is determined"
    warning = f"{asked}, so nothing is shown"
    return replace(result, warnings=(*result.warnings, warning))


def _estimated(result: Sweep, solver: LinearSolver, console: Console) -> tuple[Sweep, Split | None]:
    """Return the sweep with the error of the mesh, and where it comes from; if that fails, with a warning, and None."""
    from ..accuracy.corrections import right_corrections
    from ..accuracy.discretisation import with_changes
    from ..accuracy.estimate import changes_by
    from ..accuracy.quantities import split_changes
    from ..accuracy.refined import refine_problem

    clock = time.perf_counter()
    console.print("the error of the mesh is estimated on the mesh refined once")
    split = None
    try:
        refined = refine_problem(result, solver)
        corrections = right_corrections(result, refined)
        result = with_changes(result, changes_by(result, refined, solver, corrections))
        split = split_changes(result, refined, corrections)
    except (NotConvergedError, InputError) as error:
        result = replace(result, warnings=(*result.warnings, f"the error of the mesh is not known: {error}"))
    return replace(result, seconds={**result.seconds, "estimate": time.perf_counter() - clock}), split


def sweep_so_far(stop: NotConvergedError | KeyboardInterrupt) -> Sweep | None:
    """Return what had been solved for when `sweep` raised this; None if no value was finished."""
    found = stop.partial if isinstance(stop, NotConvergedError) else next(iter(stop.args), None)
    return found if isinstance(found, Sweep) else None


def report_sweep(scene: Scene | MatrixScene, result: Sweep, out: Path, console: Console, seconds: float) -> None:
    """Print what a run has found."""
    covered = frequency_range(scene, result)
    print_onsets(result.onsets_dataframe(), console, covered, bool(result.unsettled), len(result.values))
    print_unstable(result.to_dataframe(), console, result.onsets_dataframe())
    c = result.completeness
    how = "LAPACK finds all modes" if result.points[0].modes.exhaustive else "by the inertia of K − σM"
    counted = "counted without damping and friction, and followed from there by a reduced model"
    is_quadratic = result.problem.problem_class == "quadratic" and not result.points[0].modes.exhaustive
    if is_quadratic and result.reduced_model is None:
        counted = "not proven; searched for again around another shift"
    proof = f"proven: {how}" if c.proven else counted if c.expected is not None else "not proven"
    if is_quadratic:
        proof += f"; of damping ratios above {LIGHT_RATIO:g} only those near others"
    console.print(
        f"{c.found} of {c.expected if c.expected is not None else '?'} modes found at {result.parameter} = "
        f"{result.points[0].value:g} ({proof})",
        markup=False,
    )
    memory = peak_memory_mib()
    peak = f", {memory:.0f} MiB" if memory is not None else ""
    shapes = ", shapes/" if scene.output.shapes != "none" and (out / SHAPES).is_dir() else ""
    page = "report.html, " if scene.output.report else ""
    files = f"{page}stability.png, root_locus.png{shapes}"
    console.print(f"results in {out}: {files} ({seconds:.1f} s{peak})", markup=False)
    above = unstable_above(result)
    if above is not None:
        console.print(f"note: {above_text(above, result.parameter)}", markup=False)
    for warning in told_once(result.warnings):  # the most serious ones, about onsets not found, come last
        console.print(f"warning: {warning}", markup=False)
