"""What `fe-squeal accuracy` and `fe-squeal run --accuracy` do."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from ..accuracy.choose import Choice, choose
from ..accuracy.quantities import KINDS
from ..accuracy.study import Study, run_study
from ..errors import INTERRUPTED, NotConvergedError, SceneError
from ..mesh.writing import write_loaded
from ..report.accuracy import accuracy_page, plot_accuracy
from ..report.advice import QUANTITIES, advice, size_text
from ..report.files import encodable, replace_atomically, write_csv
from ..report.warnings import told_once
from ..scene import MatrixScene, Scene
from ..scene.solver import solver_of
from .accuracy_checks import checked_mesh, with_mesh
from .folder import (
    ACCURACY_FIGURE,
    ACCURACY_PAGE,
    ACCURACY_TABLE,
    MEASUREMENTS,
    MESH,
    REPORT,
    STAGES_TABLE,
    STUDY_FILES,
    hold_folder,
    is_kept,
    is_result,
    remove_results,
)
from .forces import scene_warnings
from .found_mesh import print_trials, used_again
from .inputs import input_files, run_inputs
from .measured import read_measured
from .measurements import MeasurementFolder
from .mesh_error import write_mesh_error
from .page import write_accuracy_report, write_run_report
from .preload import preload_warnings
from .record import write_record
from .resume import show_finished
from .run import report_sweep, write_results
from .search import KeptSearch, search_inputs


def study_scene(scene: Scene | MatrixScene, out: Path, console: Console, budget: float | None) -> int:
    """Measure error against time and memory, and write accuracy.csv, accuracy.png and accuracy.md.

    Measurements that the folder already has are not made again.

    Parameters
    ----------
    scene : Scene or MatrixScene
    out : Path
        The folder.
    console : Console
    budget : float, s, optional
        Time that the study may take.

    Returns
    -------
    int
        Exit code: 0, or 130 if the user interrupted.

    Raises
    ------
    SceneError
        The scene has no mesh, its numbers cannot be in SI units, or the budget is not above 0.
    OutputError
        The folder cannot be used.
    NotConvergedError
        No setting could be measured within the budget.
    """
    whole = with_mesh(scene, "accuracy")
    solver_of(whole)  # raises SceneError if the solver is not installed, before anything is measured
    checked_mesh(whole, lambda text: console.print(text, markup=False))
    if budget is not None and not budget > 0:
        raise SceneError(f"--budget: given {budget:g}; expected a number of seconds above 0")
    with hold_folder(out, input_files(whole)) as held:
        held.check(lambda name: name in STUDY_FILES)
        columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
        with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
            task = bar.add_task("measuring", total=None)

            def report(done: int, total: int, text: str, stays: bool) -> None:
                bar.update(task, completed=done, total=total, description=text)
                if stays or not console.is_terminal:
                    console.print(f"{done} of {total} measured; {text}" if done else text, markup=False)

            stopped = False
            try:
                study = run_study(whole, MeasurementFolder(out / MEASUREMENTS), budget, progress=report)
            except KeyboardInterrupt as stop:
                if not stop.args or stop.args[0] is None:
                    raise
                study, stopped = stop.args[0], True
        write_study(study, out, whole.title)
        if whole.output.report and study.settings:
            write_accuracy_report(out, out / REPORT)
    if stopped:
        print(f"interrupted: {len(study.settings)} settings were measured and are in {out}", file=sys.stderr)
        return INTERRUPTED
    frame = study.to_dataframe()
    for quantity in QUANTITIES:
        for sentence in advice(frame, quantity):
            console.print(sentence, markup=False)
    for setting, why in study.left_out:
        console.print(f"left out: {setting}: {why}", markup=False)
    page = f"{REPORT}, " if whole.output.report else ""
    console.print(f"results in {out}: {page}{ACCURACY_PAGE}, {ACCURACY_FIGURE}, {ACCURACY_TABLE}", markup=False)
    return 0


def write_study(study: Study, out: Path, title: str) -> None:
    """Write accuracy.csv, the seconds of every stage into accuracy_stages.csv, accuracy.png and accuracy.md."""
    frame, own, finest = study.to_dataframe(), uncertainty(study), study.finest
    write_csv(frame, out / ACCURACY_TABLE)
    write_csv(study.stages(), out / STAGES_TABLE)
    plot_accuracy(frame, own, out / ACCURACY_FIGURE, title)
    left_out = [f"{setting}: {why}" for setting, why in study.left_out]
    size = size_text(finest.size, finest.units)
    page = accuracy_page(frame, own, f"order {finest.order}, {size}", study.exact, left_out, title)
    with replace_atomically(out / ACCURACY_PAGE) as temporary:
        temporary.write_text(encodable(page), encoding="utf-8")


def uncertainty(study: Study) -> dict[str, float]:
    """Return the uncertainty of the reference of a study, by the columns of its table."""
    own = study.reference.uncertainty
    return {"error_frequency": own.frequency, "error_growth": own.growth, "error_onset": own.onset}


def run_to_accuracy(
    scene: Scene | MatrixScene, out: Path, console: Console, target: float, what: str = "all", resume: bool = False
) -> int:  # fmt: skip
    """Find a mesh that meets a target for the error, and write its results, the mesh, and what the search cost.

    Parameters
    ----------
    scene : Scene or MatrixScene
    out : Path
        The folder.
    console : Console
    target : float
        For the relative error, between 0 and 1.
    what : "onsets", "growth", "frequencies" or "all"
        Which quantities are to meet the target.
    resume : bool
        Whether to continue an interrupted search with the mesh that it was about to try, or to show a finished one.

    Returns
    -------
    int
        Exit code: 0, or 130 if the user interrupted.

    Raises
    ------
    SceneError
        The scene has no mesh, its numbers cannot be in SI units, or `target` or `what` is wrong. With `resume`: what
        the folder has is of another scene or target.
    OutputError
        The folder cannot be used.
    NotConvergedError
        The target is not met; the results of the mesh that comes nearest are in the folder. Where a resumed search can
        solve on no further mesh, the folder is as it was.
    """
    whole = with_mesh(scene, "--accuracy")
    if what not in ("all", *KINDS):
        raise SceneError(f"--accuracy-of: given {what}; expected one of onsets, growth, frequencies, all")
    kinds = KINDS if what == "all" else (what,)
    solver, measured = solver_of(whole), read_measured(whole)
    start = time.perf_counter()

    def tell(text: str) -> None:
        console.print(text, markup=False)

    own = checked_mesh(whole, tell, nested=True)
    with hold_folder(out, input_files(whole)) as held:
        inputs = search_inputs(whole, own, target, what)
        kept = KeptSearch(held, inputs)
        if resume and kept.is_finished():
            if whole.output.report and not (out / REPORT).exists():
                write_run_report(out, out / REPORT)
            held.remove(is_kept)
            return show_finished(out, console)
        held.check(is_result)
        held.check(is_kept)
        failure, stopped = None, False
        earlier = kept.load(whole) if resume else None
        if resume and earlier is None:
            tell(f"nothing to resume in {out}: the search starts anew")
        for trial in earlier[0] if earlier is not None else ():
            tell(str(trial))
        try:
            choice = choose(whole, target, tell, kinds, earlier, kept.save)
        except NotConvergedError as error:
            if not isinstance(error.partial, Choice):
                raise
            choice, failure = error.partial, error
        except KeyboardInterrupt as stop:
            if not stop.args or not isinstance(stop.args[0], Choice):
                raise
            choice, stopped = stop.args[0], True
        remove_results(held)
        problem = choice.result.problem
        said = [*measured.warnings, *preload_warnings(choice.result, problem)]
        said += write_results(choice.scene, choice.result, held, measured)
        write_mesh_error(choice.split, choice.result, out, whole.title)
        with replace_atomically(out / MESH) as temporary:
            write_loaded(choice.mesh, temporary, choice.scene.mesh.length_unit)
        seconds = {f"trial {i}": trial.seconds for i, trial in enumerate(choice.trials, 1)}
        seconds |= {**choice.result.seconds, "total": time.perf_counter() - start}
        status = "interrupted" if stopped else "complete" if failure is None else "not converged"
        search = {"target": target, "of": what, "trials": [asdict(t) for t in choice.trials], "inputs": inputs}
        found = run_inputs(choice.scene, choice.mesh)
        write_record(
            choice.scene, problem, choice.result, seconds, status, found, solver, out, measured, said, search
        )
        if choice.scene.output.report:
            write_run_report(out, out / REPORT)
        if not stopped:
            held.remove(is_kept)
        report_sweep(choice.scene, choice.result, out, console, seconds["total"])
        warnings = told_once([*scene_warnings(problem), *said])
        for text in (*(f"note: {note}" for note in measured.notes), *(f"warning: {warning}" for warning in warnings)):
            tell(text)
        print_trials(choice, target, console)
        console.print(used_again(choice, whole, out), markup=False)
    if stopped:
        print(f"interrupted: what came nearest to the target until then is in {out}", file=sys.stderr)
        return INTERRUPTED
    if failure is not None:
        raise NotConvergedError(f"{failure}; what comes nearest is in {out}")
    return 0
