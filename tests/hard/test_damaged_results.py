"""Every entry of a folder of results may have been changed by hand: the page is written and tells what it lacks."""

from __future__ import annotations

import copy
import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from interrupted import sweep_text
from scene_texts import write_scene

from fe_squeal.cli import main
from fe_squeal.report.page.build import write_run_page
from fe_squeal.report.results import read_results

TABLES = {name: f"{name}.csv" for name in ("modes", "onsets", "contributions", "sensitivities")}
ENTRIES = [None, "0.3", "x", [1, 2], {"a": 1}, float("nan"), 1e308, -1, True, [], {}, "<b>"]
CELLS = ["", "x", "1e308", "-1e308", "nan", "inf", "-inf", "-1", "0", "0.5", "True", "1e-320"]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results with an onset."""
    place = tmp_path_factory.mktemp("damaged")
    text = sweep_text(3).replace('shapes = "none"\nreport = false', 'shapes = "unstable"')
    scene = write_scene(place, text, "shapes.toml")
    assert main(["run", str(scene), "-o", str(place / "out")]) == 0
    return place / "out"


def entries(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the places of all entries of a record; of a list, of the first item alone."""
    items = data.items() if isinstance(data, dict) else enumerate(data[:1]) if isinstance(data, list) else ()
    return [path] * bool(path) + [place for key, item in items for place in entries(item, (*path, key))]


def page(results: Path) -> str:
    """Return the page that is written; NumPy's warnings are errors here."""
    path = results.parent / "page.html"
    write_run_page(read_results(results, "run.json", TABLES, "shapes"), path)
    return path.read_text("utf-8")


@pytest.mark.slow
def test_every_entry_of_the_record(results: Path, other_seed: int) -> None:
    """Each entry has one wrong value, drawn anew for another seed."""
    file = results / "run.json"
    whole = file.read_text("utf-8")
    record = json.loads(whole)
    rng = np.random.default_rng(other_seed)
    places = [place for place in entries(record) if place[0] not in ("inputs", "terms") or len(place) < 3]
    assert len(places) > 100
    try:
        for place in places:
            damaged = copy.deepcopy(record)
            inside = damaged
            for key in place[:-1]:
                inside = inside[key]
            inside[place[-1]] = ENTRIES[rng.integers(len(ENTRIES))]
            file.write_text(json.dumps(damaged), encoding="utf-8")
            assert page(results).endswith("</html>\n"), (place, inside[place[-1]])
    finally:
        file.write_text(whole, encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_every_column_of_the_tables(name: str, results: Path, other_seed: int) -> None:
    """Each column has two wrong cells at a time, in some row."""
    file = results / TABLES[name]
    whole = file.read_text("utf-8")
    rows = list(csv.reader(io.StringIO(whole)))
    assert len(rows) > 1
    rng = np.random.default_rng(other_seed)
    try:
        for column in range(len(rows[0])):
            for cell in rng.permutation(CELLS)[:3]:
                damaged = copy.deepcopy(rows)
                damaged[rng.integers(1, len(rows))][column] = str(cell)
                text = io.StringIO()
                csv.writer(text).writerows(damaged)
                file.write_text(text.getvalue(), encoding="utf-8")
                assert page(results).endswith("</html>\n"), (rows[0][column], cell)
    finally:
        file.write_text(whole, encoding="utf-8")


def test_numbers_that_are_texts(results: Path) -> None:
    """The page shows what the file holds, so that a text cannot stand for a number; what is left out is said."""
    file = results / "run.json"
    whole = file.read_text("utf-8")
    record = json.loads(whole)
    record["contacts"]["belt"]["area_m2"] = "0.3"
    try:
        file.write_text(json.dumps(record), encoding="utf-8")
        assert "contacts: not as fe-squeal writes it" in page(results)
    finally:
        file.write_text(whole, encoding="utf-8")


@pytest.mark.parametrize(("table", "column"), [("modes", "nodal_diameters"), ("onsets", "branch_a")])
def test_counts_that_are_infinite(table: str, column: str, results: Path) -> None:
    file = results / TABLES[table]
    whole = file.read_text("utf-8")
    rows = list(csv.reader(io.StringIO(whole)))
    rows[1][rows[0].index(column)] = "inf"
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    try:
        file.write_text(text.getvalue(), encoding="utf-8")
        assert f"column {column} does not hold what it should" in page(results)
    finally:
        file.write_text(whole, encoding="utf-8")
