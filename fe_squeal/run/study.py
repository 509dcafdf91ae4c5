"""What `fe-squeal study` does."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from ..assembly.assembly import assemble
from ..assembly.bodies import scene_mesh
from ..eigen.memory import peak_memory_mib
from ..errors import INTERRUPTED, MeshError, NotConvergedError, SceneError
from ..process.signals import signals_deferred
from ..report.files import write_json
from ..report.warnings import told_once
from ..scene import MatrixScene, Scene
from ..scene.solver import solver_of
from ..scene.study import StudySection
from ..study.pools import Processes, require_processes
from ..study.solving import check_method
from ..version import __version__
from .checkpoint import read_json
from .folder import (
    REPORT,
    STUDY_RECORD,
    hold_folder,
    is_part,
    is_study_result,
)
from .forces import scene_warnings
from .inputs import differences, input_files, joined_differences, run_inputs
from .manifest import Manifest
from .mapped import mapped
from .page import write_study_report
from .parts import StudyParts
from .scattered import scattered

_TELLING = 10.0  # s between lines of progress, where the output is not a terminal


def study(
    scene: Scene | MatrixScene, out: Path, console: Console, resume: bool = False, workers: int = 0, scheduler: str = ""
) -> int:
    """Run the study that `[study]` of a scene asks for, and write its results into a folder.

    Parameters
    ----------
    scene : Scene or MatrixScene
    out : Path
        The folder.
    console : Console
    resume : bool
        Whether to continue an interrupted study of the same scene.
    workers : int
        Processes on this machine, by dask.distributed; 0 to use this process.
    scheduler : str
        Address of a running scheduler of Dask, instead of `workers`.

    Returns
    -------
    int
        Exit code: 0, or 130 if the user interrupted.

    Raises
    ------
    SceneError, MeshError
        The scene has no study, asks for a method that studies do not have, or is wrong, also at one of the places of
        the study, or the options contradict each other. What was finished before is kept, and so are the results of
        another study if no chunk was finished.
    OutputError
        The folder cannot be used.
    NotConvergedError
        A direct solve failed, or the scheduler is gone; what was finished is kept.
    """
    if scene.study is None:
        raise SceneError(f"{scene.source}: study: is missing; expected a table, written [study]")
    check_method(scene.solve.method, f"{scene.source}: solve.method")
    if workers < 0:
        raise SceneError(f"--workers: given {workers}; expected 0 or more")
    if workers and scheduler:
        raise SceneError("--workers: given with --scheduler; expected one of them")
    with hold_folder(out, input_files(scene)) as held:
        return _study(scene, scene.study, held, console, resume, workers, scheduler)


def _study(
    scene: Scene | MatrixScene, section: StudySection, held: Manifest, console: Console, resume: bool, workers: int,
    scheduler: str,
) -> int:  # fmt: skip
    start, out, solver = time.perf_counter(), held.folder, solver_of(scene)
    clock = StageClock()
    mesh = scene_mesh(scene)
    inputs, parts = run_inputs(scene, mesh), StudyParts(held)
    record = read_json(out / STUDY_RECORD)
    if resume and isinstance(record, dict) and record.get("status") == "complete":
        found = differences(record.get("inputs"), inputs)
        if found:
            raise SceneError(
                f"{out}: the finished study is another one: {joined_differences(found)}; expected the same one: start"
                " anew without --resume, or give another folder by -o"
            )
        if scene.output.report and (parts.exists or not (out / REPORT).exists()):
            write_study_report(out, out / REPORT)  # which an interruption behind the tables has left missing or old
        parts.remove()
        console.print(f"results in {out} are complete: nothing is left to resume", markup=False)
        return 0
    held.check(is_study_result)
    require_processes(Processes(workers, scheduler))
    problem = assemble(scene, mesh)
    for text in told_once(scene_warnings(problem)):
        console.print(f"warning: {text}", markup=False)
    about = {
        "version": __version__, "title": scene.title, "scene": str(scene.source) if scene.source else None,
        "kind": "scatter" if section.parameters else "map", "unknowns": problem.unknowns,
        "problem_class": problem.problem_class, "effects": list(scene.effect_names), "linear_solver": solver.name,
        "inputs": inputs,
    }  # fmt: skip
    options: dict[str, Any] = {
        "modes": scene.solve.modes, "max_frequency": scene.solve.max_frequency, "tolerance": section.tolerance,
        "workers": workers, "scheduler": scheduler, "linear_solver": solver, "method": scene.solve.method,
        "parts": lambda name: parts.stage(name, begin), "scene": scene if isinstance(scene, Scene) else None,
    }  # fmt: skip

    @signals_deferred()  # the folder has what was there or what comes, and nothing between
    def begin() -> None:
        """Remove what another study has left; the page of other results stays until there is a new one."""
        own_page = (out / STUDY_RECORD).exists()
        held.remove(lambda name: is_study_result(name) and (own_page or name != REPORT), first=STUDY_RECORD)
        parts.begin(inputs)
        write_json({**about, "status": "running"}, out / STUDY_RECORD)

    if resume and parts.exists:
        parts.go_on(inputs)
        write_json({**about, "status": "running"}, out / STUDY_RECORD)
        console.print("going on from what was finished", markup=False)
    else:
        held.check(is_part)
        # Earlier results make way when the first chunk of new ones is there, so that no bad input removes them.
        if not held.names(lambda name: is_study_result(name) or is_part(name)):
            begin()
    try:
        with _shown(console) as progress:
            finish = scattered if section.parameters else mapped
            said = finish(scene, section, problem, {**options, "progress": clock.beside(progress)}, out, console)
    except KeyboardInterrupt:
        if parts.begun:
            write_json({**about, "status": "interrupted"}, out / STUDY_RECORD)
        print(f"interrupted: {_finished(parts)}", file=sys.stderr)
        return INTERRUPTED
    except NotConvergedError as error:
        if parts.begun:
            write_json({**about, "status": "not converged"}, out / STUDY_RECORD)
        raise NotConvergedError(f"{error}; {_finished(parts)}") from error
    except (SceneError, MeshError) as error:
        where = f"{scene.source}: " if scene.source is not None else ""
        told = f"{where}{str(error).removeprefix(where)}"
        if parts.has_chunks:
            write_json({**about, "status": "not converged"}, out / STUDY_RECORD)
            told += f"; what was finished before is in {parts.folder}"
        elif parts.begun:
            held.remove(is_study_result, first=STUDY_RECORD)
            parts.remove()
        raise type(error)(told) from error
    seconds = time.perf_counter() - start
    write_json(
        {**about, "status": "complete", **said, "seconds": seconds, "cpu_seconds": clock.seconds(),
         "peak_memory_mib": peak_memory_mib()},
        out / STUDY_RECORD,
    )
    if scene.output.report:
        write_study_report(out, out / REPORT)
    parts.remove()
    console.print(f"results in {out}: {REPORT if scene.output.report else STUDY_RECORD}; {seconds:.0f} s", markup=False)
    return 0


def _finished(parts: StudyParts) -> str:
    """Return what there is of a study that has ended early."""
    if parts.has_chunks:
        return f"what was finished is in {parts.results.folder}, --resume goes on from there"
    return "nothing was finished" if parts.begun else f"nothing was finished, and {parts.results.folder} is as it was"


class StageClock:
    """CPU seconds of this process by stage; the time of other processes does not count."""

    def __init__(self) -> None:
        self._begun = [("model", time.process_time())]

    def beside(self, progress: Callable[[str, int, int, float], None]) -> Callable[[str, int, int, float], None]:
        """Return a callable that passes progress on, and notes the time whenever another stage begins."""

        def tell(stage: str, done: int, total: int, rate: float) -> None:
            name = stage.split(" ")[0]
            if total and self._begun[-1][0] != name:
                self._begun.append((name, time.process_time()))
            progress(stage, done, total, rate)

        return tell

    def seconds(self) -> dict[str, float]:
        """Return the seconds by stage."""
        ends = [t for _, t in self._begun[1:]] + [time.process_time()]
        return {name: end - t for (name, t), end in zip(self._begun, ends, strict=True)}


@contextmanager
def _shown(console: Console) -> Iterator[Callable[[str, int, int, float], None]]:
    """Yield a callable that shows progress, rate and time left: as a bar on a terminal, in plain lines elsewhere."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    last_stage, told_at = "", 0.0
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("begins", total=None)

        def tell(stage: str, done: int, total: int, rate: float) -> None:
            nonlocal last_stage, told_at
            speed = f", {rate:.3g} a second" if rate else ""
            bar.update(task, completed=done, total=total or None, description=f"{stage}{speed}")
            now = time.perf_counter()
            last = done == total and total > 0
            if console.is_terminal or (last_stage == stage and now - told_at < _TELLING and not last):
                return
            last_stage, told_at = stage, now
            left = f", {(total - done) / rate:.0f} s left" if rate and not last else ""
            text = f"{stage}: {done} of {total}{speed}{left}" if total else stage
            console.print(text, markup=False)

        yield tell
