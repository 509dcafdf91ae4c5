"""The page report.html of a folder of results, which every command writes at its end, and `fe-squeal report` anew."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from ..errors import OutputError
from .folder import (
    ACCURACY_TABLE,
    BANDS_TABLE,
    BOUNDARIES_TABLE,
    CONTRIBUTIONS_TABLE,
    DIFFERENCE_RECORD,
    DIFFERENCE_TABLE,
    INDICES_FIGURE,
    INDICES_TABLE,
    MAC_TABLE,
    MAP_FIGURE,
    MAP_TABLE,
    MESH_ERROR_PICTURE,
    MESH_ERROR_TABLE,
    MODES_TABLE,
    ONSETS_TABLE,
    PROBABILITY_FIGURE,
    RECORD,
    REPORT,
    RESULTS,
    SAMPLES_TABLE,
    SCATTER_FIGURE,
    SENSITIVITIES_TABLE,
    SHAPES,
    STUDY_RECORD,
    hold_folder,
)
from .manifest import Manifest

if TYPE_CHECKING:
    from ..report.results import Results

_TABLES = {
    "modes": MODES_TABLE, "onsets": ONSETS_TABLE, "contributions": CONTRIBUTIONS_TABLE,
    "sensitivities": SENSITIVITIES_TABLE,
}  # fmt: skip
_SCATTER_TABLES = {"bands": BANDS_TABLE, "indices": INDICES_TABLE, "samples": SAMPLES_TABLE}
_SCATTER_FIGURES = {"probability": PROBABILITY_FIGURE, "scatter": SCATTER_FIGURE, "indices": INDICES_FIGURE}
_MARK = b'<meta name="generator" content="fe-squeal">'


def read_run(folder: Path) -> Results:
    """Read the results of a run from its folder."""
    from ..report.results import read_results

    return read_results(folder, RECORD, _TABLES, SHAPES, MAC_TABLE, MESH_ERROR_TABLE, MESH_ERROR_PICTURE)


def write_run_report(folder: Path, path: Path) -> tuple[str, ...]:
    """Write the page of a run from its folder, and return sentences on what it could not show."""
    from ..report.page.build import write_run_page

    results = read_run(folder)
    write_run_page(results, path)
    return results.lacks


def write_report(folder: Path, path: Path) -> tuple[str, ...]:
    """Write the page of a folder with results of any command; return sentences on what it could not show.

    Of several commands in one folder, the page is that of the one whose record was written last, as report.html is.

    Raises
    ------
    OutputError
        The folder has no results.
    """
    run = RECORD if (folder / RECORD).exists() else MODES_TABLE
    writers = {
        run: write_run_report, STUDY_RECORD: write_study_report, ACCURACY_TABLE: write_accuracy_report,
        DIFFERENCE_TABLE: write_difference_report,
    }  # fmt: skip
    found = [name for name in writers if (folder / name).exists()]
    if not found:
        raise OutputError(
            f"{folder}: holds no results to show; expected a folder with {RECORD} and {MODES_TABLE}, with"
            f" {STUDY_RECORD}, with {ACCURACY_TABLE}, or with {DIFFERENCE_TABLE}"
        )
    last = max(found, key=lambda name: (folder / name).stat().st_mtime_ns)
    lacks = writers[last](folder, path)
    if len(found) == 1:
        return lacks
    others = ", ".join(name for name in found if name != last)
    return (*lacks, f"{folder} has results of several commands; the page is of {last}, the last one, not of {others}")


def write_study_report(folder: Path, path: Path) -> tuple[str, ...]:
    """Write the page of a scatter or a map."""
    from ..report.page.study import write_study_page
    from .checkpoint import read_json

    record = read_json(folder / STUDY_RECORD)
    kind = record.get("kind") if isinstance(record, dict) else None
    is_map = kind == "map" if kind in ("map", "scatter") else (folder / MAP_TABLE).exists()
    tables = {"boundaries": BOUNDARIES_TABLE, "map": MAP_TABLE} if is_map else _SCATTER_TABLES
    figures = {"map": MAP_FIGURE} if is_map else _SCATTER_FIGURES
    read, shown = ({name: folder / file for name, file in files.items()} for files in (tables, figures))
    return write_study_page(folder / STUDY_RECORD, read, shown, path)


def write_accuracy_report(folder: Path, path: Path) -> tuple[str, ...]:
    """Write the page of a study of accuracy."""
    from ..report.page.accuracy import write_accuracy_page

    return write_accuracy_page(folder / ACCURACY_TABLE, path)


def write_difference_report(folder: Path, path: Path) -> tuple[str, ...]:
    """Write the page of a comparison of folders, from its table and record."""
    from ..report.page.difference import read_and_write_page

    return read_and_write_page(folder / DIFFERENCE_TABLE, folder / DIFFERENCE_RECORD, path)


def report_folder(folder: Path, file: Path | None, console: Console) -> int:
    """Write the page of a folder of results, into the folder or to `file`, and print what it could not show; return 0.

    Where `file` is the page of a folder of results, that folder's manifest lists what is written.

    Raises
    ------
    OutputError
        The folder has no results, or there is a file that this program did not write.
    """
    if not folder.is_dir():
        raise OutputError(f"{folder}: is no folder; expected one that fe-squeal run has written")
    if file is None:
        file = folder / REPORT
        if not any(folder.iterdir()):
            raise OutputError(f"{folder}: is empty; expected a folder with the results of fe-squeal run")
        holding: AbstractContextManager[object] = hold_folder(folder, expected=f"{RESULTS}, or -o FILE.html elsewhere")
    else:
        if file.suffix.lower() not in (".html", ".htm"):
            raise OutputError(f"{file}: given by -o; expected a name that ends in .html")
        refuse_foreign(file)
        listed = file.name == REPORT and Manifest.marks(file.parent)
        holding = hold_folder(file.parent) if listed else nullcontext()
    with holding:
        lacks = write_report(folder, file)
    tell(lacks, console)
    console.print(f"wrote {file} ({file.stat().st_size / 1e6:.1f} MB)", markup=False)
    return 0


def tell(lacks: Iterable[str], console: Console) -> None:
    """Print what could not be shown."""
    for sentence in lacks:
        console.print(f"note: {sentence}", markup=False)


def refuse_foreign(file: Path) -> None:
    """Check that a file may be replaced: it does not exist, or is a page that this program wrote.

    Raises
    ------
    OutputError
        It is another file, or cannot be read.
    """
    if not file.exists():
        return
    try:
        with file.open("rb") as stream:
            ours = _MARK in stream.read(4000)
    except OSError as error:
        raise OutputError(f"{file}: cannot be written ({error.strerror or error})") from error
    if not ours:
        raise OutputError(f"{file}: is no page that fe-squeal wrote; it is not replaced: give another file by -o")
