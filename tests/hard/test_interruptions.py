"""Runs that end at any moment: what was finished is there and valid, and --resume ends as an unbroken run does."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from interrupted import assert_same_results, assert_valid, write_sweep
from scene_texts import environment

import fe_squeal.report.files as files
from fe_squeal.cli import main

METHODS = ("direct", "reduced")
POINTS, KILLS = 24, 1  # values of the sweep, and kills of each method
# tests/unit/test_resume.py has the shorter ones.
pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform == "win32", reason="no signals as on POSIX")]


SECONDS: dict[str, float] = {}  # that an unbroken run takes


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with both scenes, and the results of unbroken runs."""
    folder = tmp_path_factory.mktemp("runs")
    for method in METHODS:
        write_sweep(folder, POINTS, method)
        child = start(folder, method, folder / f"whole_{method}")
        begun = time.perf_counter()
        said = child.communicate()
        assert child.returncode == 0, said
        SECONDS[method] = time.perf_counter() - begun
    return folder


@pytest.fixture(scope="module")
def moments(place: Path) -> dict[str, np.ndarray]:
    """Seconds behind the start of the work, KILLS random ones spread over an unbroken run."""
    rng = np.random.default_rng(20251121)
    return {m: SECONDS[m] * (np.arange(KILLS) + rng.uniform(size=KILLS)) / KILLS for m in METHODS}


def start(place: Path, method: str, out: Path, *options: str) -> subprocess.Popen[str]:
    """Start the command and return once it has the folder."""
    child = subprocess.Popen(
        [sys.executable, "-m", "fe_squeal", "run", f"{method}.toml", "-o", str(out), *options],
        cwd=place, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8",
    )  # fmt: skip
    while not (out / ".lock").exists():
        assert child.poll() is None, child.communicate()
        time.sleep(0.002)
    return child


def resume(place: Path, method: str, out: Path) -> None:
    """Let the command go on to its end: it has as many threads as the others, so that their rounding is the same."""
    said = (child := start(place, method, out, "--resume")).communicate()
    assert child.returncode == 0, said


@pytest.mark.parametrize("number", range(KILLS))
@pytest.mark.parametrize("method", METHODS[1:])  # the other one is killed below
def test_kill(place: Path, moments: dict[str, np.ndarray], tmp_path: Path, method: str, number: int) -> None:
    """SIGKILL, which no program hears, at a random moment of the work."""
    out = tmp_path / "out"
    child = start(place, method, out)
    time.sleep(moments[method][number])
    child.kill()
    child.communicate()
    whole = place / f"whole_{method}"
    assert assert_valid(out, whole) in ("none", "running", "complete")
    resume(place, method, out)
    assert_same_results(out, whole)


def test_killed_again_and_again(place: Path, tmp_path: Path) -> None:
    """The first --resume is killed as well, after some more values; none starts from nothing."""
    out, state = tmp_path / "out", tmp_path / "out" / "checkpoint" / "state.npz"
    options: list[str] = []
    finished = [0]
    for _ in range(2):
        child = start(place, "direct", out, *options)
        before = state.stat().st_mtime_ns if state.exists() else 0
        while child.poll() is None and not (state.exists() and state.stat().st_mtime_ns > before):
            time.sleep(0.002)
        child.kill()
        child.communicate()
        with np.load(state, allow_pickle=False) as file:
            finished.append(json.loads(str(file["json"]))["points"])
        assert finished[-2] < finished[-1] < POINTS
        options = ["--resume"]
    resume(place, "direct", out)
    assert_same_results(out, place / "whole_direct")


@pytest.mark.parametrize("method", METHODS[1:])  # the other one is in tests/unit/test_run_files.py
def test_ctrl_c_and_resume(place: Path, tmp_path: Path, method: str) -> None:
    """A real SIGINT in the sweep: exit code 130, tables of what was finished, and --resume goes on from them."""
    out = tmp_path / "out"
    program = (  # where the tests run in the background, the shell has SIGINT ignored
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"
        f"from fe_squeal.cli import main; sys.exit(main(['run', '{method}.toml', '-o', sys.argv[1]]))"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", program, str(out)], cwd=place, env=environment(), stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, encoding="utf-8",
    )  # fmt: skip
    assert child.stdout is not None
    for line in child.stdout:
        if "6 of 24 values solved" in line:
            break
    child.send_signal(signal.SIGINT)
    _, errors = child.communicate(timeout=60)
    assert child.returncode == 130 and errors.startswith("interrupted: ")
    assert assert_valid(out, place / f"whole_{method}") == "interrupted"
    resume(place, method, out)
    assert_same_results(out, place / f"whole_{method}")


@pytest.mark.parametrize("method", METHODS)
def test_full_disc(
    place: Path, tmp_path: Path, method: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every so many files the disc is full, until a run gets through: exit code 2, and nothing is lost or broken."""
    out, whole = tmp_path / "out", tmp_path / "whole"
    # In this process too, which may have another number of threads than the commands.
    assert main(["run", str(place / f"{method}.toml"), "-o", str(whole)]) == 0
    capsys.readouterr()
    replace, done = os.replace, 0

    def full(source: Path, target: Path, **folders: int | None) -> None:
        nonlocal done
        done += 1
        if done % 6 == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(source))
        replace(source, target, **folders)

    monkeypatch.setattr(files.os, "replace", full)
    codes = []
    options: list[str] = []
    while not codes or codes[-1]:
        codes.append(main(["run", str(place / f"{method}.toml"), "-o", str(out), *options]))
        said = capsys.readouterr().err
        assert (codes[-1], said == "") in ((0, True), (2, False)) and len(codes) < 40
        if codes[-1]:
            assert said.startswith(f"error: {out}") and said.endswith("cannot be written (No space left on device)\n")
            assert assert_valid(out, whole) in ("none", "running")
            assert not list(out.rglob(".*"))
        options = ["--resume"]
        monkeypatch.undo() if len(codes) == 8 else None  # room is made at last
    assert codes.count(2) >= 4
    assert_same_results(out, whole)


def test_limit_of_file_size(place: Path, tmp_path: Path) -> None:
    """A real limit of the system on the size of files, which the figures exceed and the tables before them do not."""
    program = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (45_000, 45_000));"
        "from fe_squeal.cli import main; sys.exit(main(['run', 'direct.toml', '-o', sys.argv[1]]))"
    )
    out = tmp_path / "out"
    child = subprocess.run(
        [sys.executable, "-c", program, str(out)], cwd=place, env=environment(), capture_output=True, encoding="utf-8",
        timeout=60,
    )  # fmt: skip
    assert child.returncode == 2
    assert child.stderr.startswith(f"error: {out}") and "File too large" in child.stderr
    assert child.stderr.count("\n") == 1
    assert assert_valid(out, place / "whole_direct") == "running"
    resume(place, "direct", out)
    assert_same_results(out, place / "whole_direct")
