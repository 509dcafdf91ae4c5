"""What `--resume` does where a folder has finished results already: it prints their tables again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from ..errors import OutputError, SceneError
from ..report.table_files import read_table
from ..report.tables import print_onsets, print_unstable
from .checkpoint import Checkpoint, read_json
from .folder import MODES_TABLE, ONSETS_TABLE, RECORD
from .inputs import differences, joined_differences


def is_finished(out: Path, checkpoint: Checkpoint, inputs: Mapping[str, Any]) -> bool:
    """Return whether the folder has all results of the run with these inputs.

    False means that it has a checkpoint of this run, or nothing. Finished results may have a checkpoint beside them,
    too: the run was interrupted behind the last table, and the page may be missing or old.

    Raises
    ------
    SceneError
        It has results or a checkpoint of another run.
    """
    record = read_json(out / RECORD)
    finished = isinstance(record, dict) and record.get("status") == "complete"
    if finished:
        found, what = differences(record.get("inputs"), inputs), "the finished results are of"
    elif checkpoint.exists:
        found, what = differences(checkpoint.inputs, inputs), "the interrupted run was"
    elif isinstance(record, dict):  # of a search for a mesh, which keeps no checkpoint of a run
        found, what = differences(record.get("inputs"), inputs), "the results are of"
    else:
        return False
    if found:
        raise another_run(out, what, found)
    return finished


def another_run(out: Path, what: str, found: list[str]) -> SceneError:
    """Return the error that what a folder has is of another run, which differs in what was `found`."""
    return SceneError(
        f"{out}: {what} another one: {joined_differences(found)}; run without --resume to start anew, or give another"
        " folder by -o"
    )


def is_estimated(out: Path) -> bool:
    """Return whether finished results have estimates of the error of the mesh."""
    record = read_json(out / RECORD)
    seconds = record.get("seconds") if isinstance(record, dict) else None
    return isinstance(seconds, dict) and "estimate" in seconds


def show_finished(out: Path, console: Console) -> int:
    """Print the tables of a finished run again; return the exit code.

    Raises
    ------
    OutputError
        A table is missing or cannot be read.
    """
    try:
        onsets, modes = (read_table(out / name) for name in (ONSETS_TABLE, MODES_TABLE))
        record = read_json(out / RECORD) or {}
        covered, is_open = record.get("frequency_range_hz"), bool((record.get("onsets_complete") or {}).get("open"))
        print_onsets(onsets, console, tuple(covered) if covered else None, is_open, modes["value"].nunique())
        print_unstable(modes, console, onsets)
    except (ArithmeticError, AttributeError, LookupError, OSError, TypeError, ValueError) as error:  # it was changed
        raise OutputError(
            f"{out}: the results are complete by run.json, but a table cannot be read ({error}); run without --resume"
            " to make them anew"
        ) from error
    console.print(f"results in {out} are complete: nothing is left to resume", markup=False)
    return 0
