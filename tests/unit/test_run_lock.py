"""One run at a time has a folder, and what killed runs have left goes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from interrupted import write_sweep
from scene_texts import environment

import fe_squeal.run.lock
from fe_squeal.cli import main
from fe_squeal.errors import OutputError
from fe_squeal.run.folder import hold_folder

pytestmark = pytest.mark.usefixtures("no_figures")


@pytest.mark.slow
def test_second_run_into_a_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """While the first one has it, and not after it was killed."""
    path, out = write_sweep(tmp_path, 3), tmp_path / "out"
    program = (
        "import sys, time; from pathlib import Path; from fe_squeal.run.folder import hold_folder\n"
        "with hold_folder(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", program, str(out)], stdout=subprocess.PIPE, env=environment(), encoding="utf-8"
    )
    try:
        assert child.stdout is not None and child.stdout.readline() == "held\n"
        for options in ([], ["--resume"]):
            assert main(["run", str(path), "-o", str(out), *options]) == 2
            said = capsys.readouterr().err
            assert said.startswith(f"error: {out}: is held by another run (process {child.pid} since 20")
            assert said.endswith("given by -o\n") and said.count("\n") == 1
        assert {p.name for p in out.iterdir()} == {".lock"}
    finally:
        child.kill()
        child.wait()
    assert main(["run", str(path), "-o", str(out)]) == 0
    assert not (out / ".lock").exists()


def test_folder_is_free_behind_the_block(tmp_path: Path) -> None:
    with hold_folder(tmp_path), pytest.raises(OutputError, match="held by another run"), hold_folder(tmp_path):
        pass
    with hold_folder(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="a process sends signals to itself")
@pytest.mark.parametrize("step", ["_lock", "_is_still", "_release"])
def test_a_signal_while_the_lock_is_taken_or_given_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    """Nothing is left, at whatever step it comes; the folder that was made is gone, too."""
    whole = getattr(fe_squeal.run.lock, step)

    def with_signal(*given: object) -> object:
        signal.raise_signal(signal.SIGINT)
        return whole(*given)

    monkeypatch.setattr(fe_squeal.run.lock, step, with_signal)
    with pytest.raises(KeyboardInterrupt), hold_folder(tmp_path / "out"):
        pass
    assert not list(tmp_path.iterdir())
    monkeypatch.undo()
    with hold_folder(tmp_path / "out"):  # and it is free
        pass


@pytest.mark.slow
def test_temporary_files_of_killed_runs_are_removed(tmp_path: Path) -> None:
    path, out = write_sweep(tmp_path, 3), tmp_path / "out"
    assert main(["run", str(path), "-o", str(out)]) == 0
    token = (out / "manifest.sha256").read_text().split()[3].rstrip(":")
    scratch = out / f".{token}.partial"
    scratch.mkdir()
    left = [scratch / "a.csv", out / f".manifest.{token}.partial.sha256"]
    mine = out / ".x.1.partial.csv"
    for file in (*left, mine):
        file.write_text("half")
    assert main(["run", str(path), "-o", str(out)]) == 0
    assert not any(file.exists() for file in left) and mine.read_text() == "half"


@pytest.mark.slow
def test_an_older_record_goes_before_anything_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed while it clears the folder, a run must not leave a record that calls what is left complete."""
    path, out = write_sweep(tmp_path, 3), tmp_path / "out"
    assert main(["run", str(path), "-o", str(out)]) == 0
    removed: list[str] = []
    unlink = os.unlink

    def watched(path: str, **folder: int | None) -> None:
        removed.append(os.path.basename(path))
        unlink(path, **folder)

    monkeypatch.setattr(os, "unlink", watched)
    assert main(["run", str(path), "-o", str(out)]) == 0
    removed = [name for name in removed if (out / name).exists()]  # again: no temporary files
    assert removed[0] == "run.json" and "modes.csv" in removed
    assert json.loads((out / "run.json").read_text())["status"] == "complete"
