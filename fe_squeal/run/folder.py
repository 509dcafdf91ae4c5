"""What stands in a folder of results: that of an earlier run, removed in time, or of the same one, shown again."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console

from ..errors import OutputError, SceneError
from ..report.tables import print_onsets, print_unstable
from .checkpoint import Checkpoint, read_json
from .covered import covered_text
from .inputs import differences, listed

# Every file and folder that a run or a study of accuracy writes.
RECORD = "run.json"
MODES_TABLE, ONSETS_TABLE, CONTRIBUTIONS_TABLE, SENSITIVITIES_TABLE, PRELOAD_TABLE = TABLES = (
    "modes.csv", "onsets.csv", "contributions.csv", "sensitivities.csv", "preload.csv",
)  # fmt: skip
STABILITY_FIGURE, ROOT_LOCUS_FIGURE, CONTRIBUTIONS_FIGURE = FIGURES = (
    "stability.png", "root_locus.png", "contributions.png",
)  # fmt: skip
PRELOAD_FILES = ("preload.png", "preload.vtu", "preload_contacts.vtu")  # names that `report.preload` gives
SHAPES, CHECKPOINT = "shapes", "checkpoint"
ACCURACY_TABLE, STAGES_TABLE, ACCURACY_FIGURE, ACCURACY_PAGE, MEASUREMENTS = (
    "accuracy.csv", "accuracy_stages.csv", "accuracy.png", "accuracy.md", "measurements",
)  # fmt: skip


def is_finished(out: Path, checkpoint: Checkpoint, inputs: Mapping[str, Any]) -> bool:
    """Return whether the folder holds all results of a run; False where there is something to go on from, or nothing.

    Raises
    ------
    SceneError
        If what is there belongs to another run.
    """
    record = read_json(out / RECORD)
    finished = isinstance(record, dict) and record.get("status") == "complete"
    if finished:
        found, what = differences(record.get("inputs"), inputs), "the finished results are of"
    elif checkpoint.exists:
        found, what = differences(checkpoint.inputs, inputs), "the interrupted run was"
    else:
        return False
    if found:
        raise SceneError(
            f"{out}: {what} another one: {listed(found)}; run without --resume to start anew, or give another folder"
            " by -o"
        )
    if finished:
        checkpoint.remove()
    return finished


def is_estimated(out: Path) -> bool:
    """Return whether the finished results have the errors of the mesh."""
    record = read_json(out / RECORD)
    return isinstance(record, dict) and "estimate" in (record.get("seconds") or {})


def show_finished(out: Path, console: Console) -> int:
    """Print the tables of a finished run once more; return the exit code.

    Raises
    ------
    OutputError
        If a table is missing or cannot be read.
    """
    try:
        onsets, modes = (pd.read_csv(out / name) for name in (ONSETS_TABLE, MODES_TABLE))
        covered = (read_json(out / RECORD) or {}).get("frequency_range_hz")
        print_onsets(onsets, console, covered_text(tuple(covered)) if covered else "")
        print_unstable(modes, console, onsets)
    except (OSError, ValueError, KeyError) as error:
        raise OutputError(
            f"{out}: the results are complete by run.json, but a table cannot be read ({error}); run without --resume"
            " to make them anew"
        ) from error
    console.print(f"results in {out} are complete: nothing is left to resume", markup=False)
    return 0


def remove_results(out: Path) -> None:
    """Remove what an earlier run wrote into the folder, so that results of two runs are never mixed.

    The record goes first: without it nothing passes for complete.

    Raises
    ------
    OutputError
    """
    try:
        for name in (RECORD, *TABLES, *FIGURES, *PRELOAD_FILES):
            (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{error.filename}: cannot be removed ({error.strerror or error})") from error
    remove_shapes(out)


def remove_shapes(out: Path) -> None:
    """Remove the shapes that a run wrote into the folder.

    Raises
    ------
    OutputError
    """
    folder = out / SHAPES
    try:
        for path in [p for kind in ("vtu", "pvd", "png", "npz") for p in folder.glob(f"*_*Hz.{kind}")]:
            path.unlink(missing_ok=True)
        for frames in folder.glob("*_*Hz_frames"):
            shutil.rmtree(frames)
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
    except OSError as error:
        raise OutputError(f"{error.filename}: cannot be removed ({error.strerror or error})") from error
