"""What is kept of a run that is interrupted or does not converge."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from scene_texts import TABLES_AND_FIGURES, environment, read_rows, replaced, write_scene

from fe_squeal.cli import main
from fe_squeal.errors import NotConvergedError
from fe_squeal.sweep import solving


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of the whole run."""
    folder = tmp_path_factory.mktemp("run")
    assert main(["run", str(write_scene(folder)), "-o", str(folder / "out")]) == 0
    return folder / "out"


def fail_at(call: int, error: Callable[[], BaseException], monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the eigen-solver raise at its nth call."""
    solve, calls = solving.solve_modes, []

    def failing(*arguments: Any) -> Any:
        calls.append(1)
        if len(calls) == call:
            raise error()
        return solve(*arguments)

    monkeypatch.setattr(solving, "solve_modes", failing)


def kept(folder: Path) -> tuple[str, list[float], list[float]]:
    """Return status and values of run.json, and the values in modes.csv."""
    record = json.loads((folder / "run.json").read_text())
    rows = read_rows(folder / "modes.csv") if (folder / "modes.csv").exists() else []
    return record["status"], record["values"], sorted({float(r["value"]) for r in rows})


@pytest.mark.slow
def test_interrupted_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], out: Path
) -> None:
    """At the third value: the first two are written, with the same numbers as in the whole run."""
    fail_at(3, KeyboardInterrupt, monkeypatch)
    assert main(["run", str(write_scene(tmp_path)), "-o", str(tmp_path / "out")]) == 130
    assert capsys.readouterr().err == f"interrupted: 2 of 5 values were finished and are in {tmp_path / 'out'}\n"
    status, recorded, written = kept(tmp_path / "out")
    assert status == "interrupted"
    assert recorded == written == [0.0, 0.2]
    whole = read_rows(out / "modes.csv")
    part = read_rows(tmp_path / "out" / "modes.csv")
    assert [float(r["im"]) for r in part] == pytest.approx([float(r["im"]) for r in whole[: len(part)]], rel=1e-12)
    assert {p.name for p in (tmp_path / "out").iterdir()} == TABLES_AND_FIGURES | {"checkpoint"}


def test_interrupted_before_anything_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fail_at(1, KeyboardInterrupt, monkeypatch)
    assert main(["run", str(write_scene(tmp_path)), "-o", str(tmp_path / "out")]) == 130
    assert capsys.readouterr().err == f"interrupted: 0 of 5 values were finished and are in {tmp_path / 'out'}\n"
    assert kept(tmp_path / "out") == ("interrupted", [], [])
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"run.json", "checkpoint", "manifest.sha256"}


@pytest.mark.slow
@pytest.mark.parametrize(("call", "done"), [(3, [0.0, 0.2]), (1, [])])
def test_not_converged_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], call: int, done: list[float]
) -> None:
    fail_at(call, lambda: NotConvergedError("backward error 0.1 of a mode exceeds the tolerance 1e-08"), monkeypatch)
    assert main(["run", str(write_scene(tmp_path)), "-o", str(tmp_path / "out")]) == 3
    assert capsys.readouterr().err == (
        f"not converged: mu = {0.2 * (call - 1):g}: backward error 0.1 of a mode exceeds the tolerance 1e-08;"
        f" {len(done)} values before it are in {tmp_path / 'out'}\n"
    )
    assert kept(tmp_path / "out") == ("not converged", done, done)


def test_tolerance_out_of_reach(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rounding alone leaves more than 1e-20: no mode may be returned as if it had converged."""
    path = write_scene(tmp_path, replaced("modes = 8", "modes = 8\ntolerance = 1e-20"))
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 3
    assert "exceeds the tolerance 1e-20" in capsys.readouterr().err
    assert kept(tmp_path / "out") == ("not converged", [], [])


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT for a child alone")
def test_ctrl_c(tmp_path: Path) -> None:
    """A real Ctrl-C in a sweep of many values: exit code 130, and the finished values are kept."""
    write_scene(tmp_path, replaced("points = 5", "points = 400"))
    program = (  # where the tests run in the background, the shell has SIGINT ignored
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"
        "from fe_squeal.cli import main; sys.exit(main(['run', 'block.toml', '-o', 'out']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8", env=environment(), cwd=tmp_path,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if "100 of 400 values solved" in line:
                break
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    status, recorded, written = kept(tmp_path / "out")
    assert status == "interrupted"
    assert 100 <= len(recorded) < 400
    assert recorded == written
    assert errors == f"interrupted: {len(recorded)} of 400 values were finished and are in out\n"
