"""Commands that solve a scene: run, onset, accuracy."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from ..errors import INTERRUPTED, NotConvergedError, SceneError
from .shared import SceneOrDeck, load_scene_or_deck, make_console, out_option


def run(
    scene: SceneOrDeck,
    out: Annotated[Path | None, out_option("SCENE_results")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from what an interrupted run left there.")] = False,
    estimate: Annotated[bool, typer.Option("--estimate", help="Estimate the error of the mesh, too.")] = False,
    accuracy: Annotated[
        float | None,
        typer.Option(metavar="TARGET", help="Choose the mesh for this error, 0.05 for 5 %.", show_default=False),
    ] = None,
    accuracy_of: Annotated[
        str, typer.Option(metavar="WHAT", help="What --accuracy is for: onsets, growth, frequencies or all.")
    ] = "all",
) -> int:
    """Solve for the complex modes over the sweep and write tables, figures and shapes into a folder."""
    loaded = load_scene_or_deck(scene)
    folder = out or Path(f"{scene.stem}_results")
    if accuracy is not None:
        from ..run.accuracy import run_to_accuracy

        return run_to_accuracy(loaded, folder, make_console(), accuracy, accuracy_of, resume)
    if accuracy_of != "all":
        raise SceneError(f"--accuracy-of: given {accuracy_of} without --accuracy; expected a target, too")
    from ..run.run import run_scene

    return run_scene(loaded, folder, make_console(), resume, estimate)


def onset(scene: SceneOrDeck) -> int:
    """Print the critical values of the sweep parameter alone, to full precision."""
    from ..assembly.assembly import assemble
    from ..report.tables import print_onsets
    from ..report.warnings import told_once
    from ..run.covered import frequency_range
    from ..run.forces import scene_warnings
    from ..run.preload import preload_warnings
    from ..run.run import sweep_scene, sweep_so_far

    loaded = load_scene_or_deck(scene)
    if loaded.sweep is None:
        raise SceneError(f"{scene}: sweep: is missing; expected a table, written [sweep]: the interval to look in")
    console = make_console()
    problem = assemble(loaded)
    stopped: NotConvergedError | KeyboardInterrupt | None = None
    try:
        result = sweep_scene(loaded, problem, console, precise=True)
    except (NotConvergedError, KeyboardInterrupt) as stop:
        if (found := sweep_so_far(stop)) is None:
            raise
        result, stopped = found, stop
    print_onsets(result.onsets_dataframe(), console, frequency_range(loaded, result), bool(result.unsettled))
    for o in result.onsets:
        console.print(f"{o.parameter} = {o.value!r} ± {o.uncertainty:.1g}, {o.frequency_hz!r} Hz", markup=False)
    for warning in told_once([*scene_warnings(problem), *preload_warnings(result, problem), *result.warnings]):
        console.print(f"warning: {warning}", markup=False)
    if stopped is None:
        return 0
    reached = f"the onsets are those up to {result.parameter} = {result.values[-1]:.6g}"
    if isinstance(stopped, NotConvergedError):
        raise NotConvergedError(f"{stopped}; {reached}", result) from stopped
    print(f"interrupted: {reached}", file=sys.stderr)
    return INTERRUPTED


def study(
    scene: SceneOrDeck,
    out: Annotated[Path | None, out_option("SCENE_study")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from what an interrupted study left there.")] = False,
    workers: Annotated[
        int, typer.Option(metavar="N", help="Solve in so many processes, by dask.distributed.", show_default=False)
    ] = 0,
    scheduler: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Solve on a running cluster of Dask.", show_default=False)
    ] = "",
) -> int:
    """Do the scene's [study]: how probable squeal is where numbers scatter, or where it lies in a map over two."""
    from ..run.study import study as study_of_scene

    loaded = load_scene_or_deck(scene)
    return study_of_scene(loaded, out or Path(f"{scene.stem}_study"), make_console(), resume, workers, scheduler)


def accuracy(
    scene: SceneOrDeck,
    out: Annotated[Path | None, out_option("SCENE_accuracy")] = None,
    budget: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Spend at most so long.", show_default=False)
    ] = None,
) -> int:
    """Show what accuracy costs: error against time over mesh size, order, number of modes and method."""
    from ..run.accuracy import study_scene

    return study_scene(load_scene_or_deck(scene), out or Path(f"{scene.stem}_accuracy"), make_console(), budget)
