"""Helpers of the tests of interrupted runs: scenes, interruptions, and comparison of folders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scene_texts import SCENE, replaced, write_scene

from fe_squeal.cli import main
from fe_squeal.sweep.running import RunningSweep

TABLES = ("modes", "onsets", "contributions", "sensitivities")
FIGURES = ("stability.png", "root_locus.png", "contributions.png")
NEAR = 1e-9  # of the largest number in a column: an interruption may change numbers by no more


def sweep_text(points: int, method: str = "direct", text: str = SCENE) -> str:
    """Return a scene with another number of values and another method."""
    return replaced("modes = 8", f'modes = 8\nmethod = "{method}"', replaced("points = 5", f"points = {points}", text))


def write_sweep(folder: Path, points: int, method: str = "direct") -> Path:
    """Write the scene of `sweep_text`, named after the method."""
    return write_scene(folder, sweep_text(points, method), f"{method}.toml")


def stop_at(call: int, monkeypatch: pytest.MonkeyPatch, error: type[BaseException] = KeyboardInterrupt) -> None:
    """Interrupt the sweep before its nth value."""
    advance, calls = RunningSweep.advance, []

    def stopping(*arguments: Any, **options: Any) -> Any:
        calls.append(1)
        if len(calls) == call:
            raise error("the end")
        return advance(*arguments, **options)

    monkeypatch.setattr(RunningSweep, "advance", stopping)


def interrupt(path: Path, out: Path, call: int, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        stop_at(call, patched)
        assert main(["run", str(path), "-o", str(out)]) == 130


def refused(path: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ") and said.count("\n") == 1
    return said


def assert_same_results(found: Path, whole: Path, tables: tuple[str, ...] = TABLES) -> None:
    """Assert that tables agree (words and whole numbers exactly, others to NEAR), and that there is no other file."""
    for table in tables:
        a, b = (pd.read_csv(folder / f"{table}.csv") for folder in (found, whole))
        assert list(a.columns) == list(b.columns) and len(a) == len(b), table
        for column in a.columns:
            if a[column].dtype.kind != "f" or column in ("backward_error", "re_uncertainty", "uncertainty"):
                continue  # bounds of errors consist of rounding, and may differ
            scale = np.abs(b[column]).max()
            np.testing.assert_allclose(a[column], b[column], rtol=NEAR, atol=NEAR * scale, err_msg=f"{table}.{column}")
        words = [c for c in a.columns if a[c].dtype.kind != "f"]
        pd.testing.assert_frame_equal(a[words], b[words])
    # The small real part of a complex λ is only as accurate as |λ|, so growth is compared relative to |λ|.
    a, b = (pd.read_csv(folder / "modes.csv") for folder in (found, whole))
    np.testing.assert_allclose(a["re"], b["re"], rtol=NEAR, atol=NEAR * np.abs(b["im"]).max())
    names = [{str(p.relative_to(folder)) for p in folder.rglob("*")} for folder in (found, whole)]
    assert names[0] == names[1], names[0] ^ names[1]
    record, other = (json.loads((folder / "run.json").read_text("utf-8")) for folder in (found, whole))
    assert record["status"] == other["status"] == "complete"
    assert record["values"] == other["values"] and record["completeness"] == other["completeness"]


def assert_valid(out: Path, whole: Path) -> str:
    """Assert that every file in a folder is complete and its tables agree with the whole run; return the status."""
    for table in TABLES:
        path = out / f"{table}.csv"
        if path.exists():
            text = path.read_text("utf-8")
            assert text.endswith("\n") and text.split("\n")[0] == (whole / path.name).read_text("utf-8").split("\n")[0]
            pd.read_csv(path)
    for figure in FIGURES:
        if (out / figure).exists():
            content = (out / figure).read_bytes()
            assert content.startswith(b"\x89PNG") and content[-8:-4] == b"IEND"
    for path in out.glob("checkpoint/[!.]*.npz"):
        with np.load(path, allow_pickle=False) as file:
            assert all(np.asarray(file[name]).dtype.kind in "fciU" for name in file.files)
    if (out / "checkpoint" / "inputs.json").exists():
        assert json.loads((out / "checkpoint" / "inputs.json").read_text("utf-8"))["version"]
    if not (out / "run.json").exists():
        assert not (out / "modes.csv").exists()
        return "none"
    record = json.loads((out / "run.json").read_text("utf-8"))
    if (out / "modes.csv").exists():
        part, all_ = (pd.read_csv(folder / "modes.csv") for folder in (out, whole))
        head = all_.iloc[: len(part)]
        assert sorted(part["value"].unique()) == sorted(head["value"].unique())
        np.testing.assert_allclose(part["im"], head["im"], rtol=NEAR, atol=NEAR * head["im"].max())
        assert set(record["values"]) <= set(part["value"])
        if record["status"] == "complete":
            assert len(part) == len(all_)
    return str(record["status"])
