"""Folders of results in which files were damaged or changed by hand: one message or a note, never a traceback."""

from __future__ import annotations

import hashlib
import json
import shutil
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from interrupted import sweep_text
from scene_texts import replaced, write_scene
from test_folders import content, refused

import fe_squeal.report.export
import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.report.results import read_results, read_shape
from fe_squeal.study import engine

STUDY = "[study]\nsamples = 70\nindices = false\n[study.parameters]\nmu = { uniform = { low = 0.1, high = 0.5 } }\n"
TABLES = {n: f"{n}.csv" for n in ("modes", "onsets", "contributions", "sensitivities")}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run with a shape in `out`."""
    folder = tmp_path_factory.mktemp("damaged")
    text = replaced("points = 5", "points = 2").replace('shapes = "none"', 'shapes = "unstable"')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
        patch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
        assert main(["run", str(write_scene(folder, text)), "-o", str(folder / "out")]) == 0
    return folder


@pytest.fixture
def place(results: Path, tmp_path: Path) -> Path:
    shutil.copytree(results, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_a_refused_run_leaves_the_manifest(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It lists a file that is gone, and does so still when another one was the reason to refuse."""
    out = place / "out"
    (out / "onsets.csv").unlink()
    (out / "run.json").write_text("{}")
    before = content(place)
    assert "run.json" in refused(["run", str(place / "block.toml"), "-o", str(out)], capsys)
    assert content(place) == before


@pytest.mark.parametrize("column", ["re", "branch", "damping_ratio", "stability"])
def test_tables_with_other_things_in_them(column: str, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The page is made without the table, and says so."""
    path = place / "out" / "modes.csv"
    head, first, *rest = path.read_text("utf-8").splitlines()
    cells = first.split(",")
    cells[head.split(",").index(column)] = {"branch": "1.5", "stability": ""}.get(column, "much")
    path.write_text("\n".join([head, ",".join(cells), *rest, ""]), encoding="utf-8")
    assert main(["report", str(place / "out")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"modes.csv cannot be read (column {column} does not hold what it should); it is left out" in said


@pytest.mark.parametrize(
    ("key", "value"),
    [("axis", [0, 0, 1]), ("axis", {"direction": [0, 0, 0]}), ("contacts", {"belt": 3}), ("seconds", "long"),
     ("measured", [7]), ("frequency_range_hz", [1.0]), ("inputs", {"content": 5})],
)  # fmt: skip
def test_records_with_other_things_in_them(key: str, value: Any, place: Path) -> None:
    path = place / "out" / "run.json"
    path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | {key: value}), encoding="utf-8")
    found = read_results(place / "out", "run.json", TABLES, "shapes")
    assert key not in found.record and "title" in found.record
    assert f"run.json: {key}: not as fe-squeal writes it; it is left out." in found.lacks


def test_the_scene_in_a_record(place: Path) -> None:
    """A list of tables with something else in it is shown as it is; so is a number that no column can hold."""
    path = place / "out" / "run.json"
    record = json.loads(path.read_text("utf-8"))
    record["inputs"]["scene"]["springs"].append(1.5)
    path.write_text(json.dumps(record), encoding="utf-8")
    (place / "out" / "onsets.csv").write_text(f"value,frequency_hz\n{'1' * 500},2\n0.5,3.0\n")
    assert main(["report", str(place / "out")]) == 0
    page = (place / "out" / "report.html").read_text("utf-8")
    assert "onsets.csv cannot be read" in page and "springs = [{" in page


def test_damaged_shapes(results: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Every single byte of the arrays at which VTK's reader prints pages, or ends the process: ValueError, no word."""
    good = next((results / "out" / "shapes").glob("*.vtu"))
    grid, shape = read_shape(good)
    data = good.read_bytes()
    start, wrong = data.index(b"_", data.index(b"<AppendedData")) + 1, 0
    for at in range(start, len(data) - 40, 101):
        path = tmp_path / "a.vtu"
        path.write_bytes(data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :])
        try:
            other, u = read_shape(path)
        except ValueError as error:
            assert str(error).isprintable()
            wrong += 1
        else:  # in an array that is not read, or between arrays
            np.testing.assert_array_equal(other.points, grid.points)
            np.testing.assert_array_equal(u.u, shape.u)
    assert wrong > 10 and capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_damaged_parts_of_a_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Found before anything is written."""
    solve, calls = engine.solve_chunk, []

    def stop(*arguments: Any) -> Any:
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return solve(*arguments)

    scene, out = write_scene(tmp_path, sweep_text(2) + STUDY), tmp_path / "out"
    monkeypatch.setattr(engine, "solve_chunk", stop)
    assert main(["study", str(scene), "-o", str(out)]) == 130
    [part] = (out / "parts").glob("*.npz")
    data, manifest = part.read_bytes(), out / "manifest.sha256"
    listed = "".join(line for line in manifest.read_text("utf-8").splitlines(keepends=True) if part.name not in line)
    for bad in (data[: len(data) // 2], data[:-400] + b"x" + data[-399:], b""):
        part.write_bytes(bad)
        digest = hashlib.sha256(bad).hexdigest()
        manifest.write_text(f"{listed}{digest}  parts/{part.name}\n", encoding="utf-8")
        before = content(tmp_path)
        said = refused(["study", str(scene), "-o", str(out), "--resume"], capsys)
        assert part.name in said and "start anew without --resume" in said
        assert content(tmp_path) == before
