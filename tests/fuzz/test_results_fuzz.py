"""Anybody may change any entry in a folder of results: the page is written without it and says so, or is refused."""

from __future__ import annotations

import copy
import csv
import io
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from interrupted import sweep_text
from scene_texts import write_scene
from selection import amount, some
from trust_signals import MAP, STUDY
from undrawn import without_figures

from fe_squeal.cli import main
from fe_squeal.errors import OutputError
from fe_squeal.run.page import write_report

ENTRIES = [None, "0.3", "x", [1, 2], {"a": 1}, float("nan"), 1e308, -1, True, [], {}, "<b>"]
CELLS = ["", "x", "1e308", "-1e308", "nan", "inf", "-inf", "-1", "0", "0.5", "True", "1e-320"]
SHOWN = sweep_text(3).replace('shapes = "none"\nreport = false', 'shapes = "unstable"')
ACCURACY = """\
order,size,modes,method,tolerance,unknowns,seconds,peak_memory_mib,error_frequency,error_growth,error_onset,knob
2,0.04,8,reduced,1e-08,135,0.4,130.5,0.00015,0.0003,0.0008,size
1,0.04,8,reduced,1e-08,36,0.2,128.1,0.0015,0.0019,0.0065,size
2,0.04,8,modal,1e-08,135,0.3,130.5,0.01,,,method
"""


def _run(place: Path) -> None:
    with without_figures():  # the page has its own
        assert main(["run", str(write_scene(place, SHOWN, "shapes.toml")), "-o", str(place / "out")]) == 0


def _difference(place: Path) -> None:
    (place / "runs").mkdir()
    _run(place / "runs")
    assert main(["diff", *[str(place / "runs/out")] * 2, "-o", str(place / "out")]) == 0


def _study(table: str) -> Callable[[Path], None]:
    def make(place: Path) -> None:
        scene = write_scene(place, sweep_text(3) + table.replace("128", "32"), "study.toml")
        assert main(["study", str(scene), "-o", str(place / "out")]) == 0

    return make


def _accuracy(place: Path) -> None:
    (place / "out").mkdir()
    (place / "out/accuracy.csv").write_text(ACCURACY)


FOLDERS = {"run": _run, "diff": _difference, "scatter": _study(STUDY), "map": _study(MAP), "accuracy": _accuracy}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """A function that returns the folder of results of a kind, made once."""
    known: dict[str, Path] = {}

    def folder(kind: str) -> Path:
        if kind not in known:
            place = tmp_path_factory.mktemp(kind)
            FOLDERS[kind](place)
            known[kind] = place / "out"
        return known[kind]

    return folder


@contextmanager
def changed(file: Path, text: str) -> Iterator[None]:
    """Let a file have another text for some time."""
    whole = file.read_text("utf-8")
    file.write_text(text, encoding="utf-8")
    try:
        yield
    finally:
        file.write_text(whole, encoding="utf-8")


def page(folder: Path) -> str:
    """Return the page that is written, or the message that refuses it; NumPy's warnings are errors here."""
    path = folder.parent / "page.html"
    try:
        write_report(folder, path)
    except OutputError as error:
        assert "\n" not in str(error)
        return str(error)
    told = path.read_text("utf-8")
    assert told.endswith("</html>\n")
    return told


def entries(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the places of all entries of a record; of a list, of the first item alone."""
    items = data.items() if isinstance(data, dict) else enumerate(data[:1]) if isinstance(data, list) else ()
    return [path] * bool(path) + [place for key, item in items for place in entries(item, (*path, key))]


def with_entry(record: dict[str, Any], place: tuple[Any, ...], value: object) -> str:
    """Return the text of a record with another value at a place."""
    damaged = copy.deepcopy(record)
    inside = damaged
    for key in place[:-1]:
        inside = inside[key]
    inside[place[-1]] = value
    return json.dumps(damaged)


def with_cell(rows: list[list[str]], row: int, column: int, cell: str) -> str:
    """Return the text of a table with another cell."""
    text = io.StringIO()
    csv.writer(text).writerows(
        [[cell if (i, j) == (row, column) else old for j, old in enumerate(r)] for i, r in enumerate(rows)]
    )
    return text.getvalue()


def rows_of(file: Path) -> list[list[str]]:
    """Return the cells of a table."""
    return list(csv.reader(io.StringIO(file.read_text("utf-8"))))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["run", "diff", "scatter", "map"])
def test_every_entry_of_the_records(kind: str, made: Callable[[str], Path], other_seed: int) -> None:
    """Each entry has one wrong value, drawn anew for another seed; in `make test-all` every third has."""
    rng = np.random.default_rng(other_seed)
    [file] = [path for path in made(kind).glob("*.json") if path.name != "inputs.json"]
    record = json.loads(file.read_text("utf-8"))
    places = [place for place in entries(record) if place[0] not in ("inputs", "terms") or len(place) < 3]
    assert len(places) > 4
    for number in rng.permutation(len(places))[:: amount(3, 1)]:
        place = places[number]
        with changed(file, with_entry(record, place, ENTRIES[rng.integers(len(ENTRIES))])):
            page(made(kind))


@pytest.mark.slow
@pytest.mark.parametrize("kind", FOLDERS)
def test_every_column_of_the_tables(kind: str, made: Callable[[str], Path], other_seed: int) -> None:
    """Each column has wrong cells, one at a time, in some row."""
    rng = np.random.default_rng(other_seed)
    files = sorted(made(kind).glob("*.csv"))
    assert files
    for file in files:
        rows = rows_of(file)
        for column in range(len(rows[0]) if len(rows) > 1 else 0):
            for cell in rng.permutation(CELLS)[: amount(1, 3)]:
                with changed(file, with_cell(rows, int(rng.integers(1, len(rows))), column, str(cell))):
                    page(made(kind))


@pytest.mark.slow
def test_numbers_that_are_texts(made: Callable[[str], Path]) -> None:
    """The page shows what the file holds, so that a text cannot stand for a number; what is left out is said."""
    file = made("run") / "run.json"
    record = json.loads(file.read_text("utf-8"))
    with changed(file, with_entry(record, ("contacts", "belt", "area_m2"), "0.3")):
        assert "contacts: not as fe-squeal writes it" in page(made("run"))


@pytest.mark.parametrize(("kind", "table", "column", "cell"), some([
    ("run", "modes", "nodal_diameters", "inf"), ("run", "onsets", "branch_a", "inf"),
    ("run", "onsets", "value", "1e308"), ("map", "boundaries", "frequency_hz", "x"),
    ("accuracy", "accuracy", "seconds", "x"),
], lambda kind, *_: kind == "accuracy"))  # fmt: skip
def test_cells_that_are_no_such_numbers(
    kind: str, table: str, column: str, cell: str, made: Callable[[str], Path]
) -> None:  # fmt: skip
    file = made(kind) / f"{table}.csv"
    rows = rows_of(file)
    with changed(file, with_cell(rows, 1, rows[0].index(column), cell)):
        assert f"column {column} does not hold what it should" in page(made(kind))
