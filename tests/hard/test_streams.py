"""What is printed and where to: neither decides over what is computed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from interrupted import assert_same_results, sweep_text, write_sweep
from scene_texts import environment, replaced, write_scene
from test_safety import matrix_scene

import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.process.streams import lasting_streams
from fe_squeal.sweep.running import RunningSweep

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="devices and signals of POSIX")
COMMAND = [sys.executable, "-P", "-m", "fe_squeal"]


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_sweep(tmp_path, 3)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of results of the scene, which no other test has touched."""
    folder = tmp_path_factory.mktemp("whole")
    assert main(["run", str(write_sweep(folder, 3)), "-o", str(folder / "out")]) == 0
    return folder / "out"


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1"])
def test_streams_take_every_character(encoding: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """μ, boxes and names of bodies, into a file as Windows redirects to it."""
    name = "Bremsträger 摩擦 μ ±"
    text = replaced('name = "across"', f'name = "{name}"').replace("block on a belt", name)
    path = write_scene(tmp_path, text)
    monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
    with (tmp_path / "out.txt").open("w", encoding=encoding) as stream, monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", stream)
        assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 0
        assert main(["check", str(path)]) == 0
    printed = (tmp_path / "out.txt").read_text(encoding)
    assert "modes found at mu = 0" in printed and "0.40088671" in printed
    assert "Bremstrager" in printed if encoding == "ascii" else "Bremsträger" in printed
    assert "mu +-" in printed if encoding == "ascii" else "±" in printed


@POSIX
def test_a_loss_is_told_and_a_reader_that_went_is_none(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with open("/dev/full", "w") as stream, monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", stream)
        assert main(["info"]) == 2
    assert "error: standard output: No space left on device" in capsys.readouterr().err
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as stream, monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", stream)
        assert main(["info"]) == 0
    assert capsys.readouterr().err == ""


@POSIX
@pytest.mark.slow
@pytest.mark.parametrize("where", ["full", "all closed", "error full", "reading end"])
def test_run_outlives_its_output(where: str, scene: Path, whole: Path) -> None:
    """A full device, closed streams, a reader that went: the results are those of any run."""
    out = scene.parent / "out"
    redirected = {
        "full": ">/dev/full", "all closed": "<&- >&- 2>&-", "error full": ">/dev/full 2>/dev/full",
        "reading end": "| head -n 1",
    }[where]  # fmt: skip
    script = f'"$@" {redirected}; echo ${{PIPESTATUS[0]}} > code'
    command = [*COMMAND, "run", str(scene), "-o", str(out)]
    done = subprocess.run(
        ["bash", "-c", script, "bash", *command], cwd=scene.parent, env=environment(), capture_output=True,
        encoding="utf-8", timeout=100,
    )  # fmt: skip
    assert (scene.parent / "code").read_text() == ("2\n" if "full" in where else "0\n")
    lost = "error: standard output: No space left on device; what belongs into files is written\n"
    assert done.stderr == (lost if where == "full" else "")
    assert_same_results(out, whole)


def test_streams_are_put_back(capsys: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout, sys.stderr
    with lasting_streams() as (out, _):
        print("λ")
        assert sys.stdout is out and not out.isatty()
    assert (sys.stdout, sys.stderr) == before and capsys.readouterr().out == "λ\n"


@pytest.mark.slow
def test_no_control_character_reaches_a_table(tmp_path: Path) -> None:
    """An escape sequence in the name of a parameter would colour, move or rename the terminal that shows the table."""
    name = "\\u001b[2Jmu\\u0007"
    path = matrix_scene(tmp_path, "M.mtx")
    text = f'[parameters]\n"{name}" = 1.0\n{path.read_text()}powers = {{ "{name}" = 1 }}\n'
    path.write_text(f'{text}[sweep]\nparameter = "{name}"\nvalues = [1.0, 2.0]\n')
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 0
    for table in (tmp_path / "out").glob("*.csv"):
        assert all(c.isprintable() or c == "\n" for c in table.read_text("utf-8"))
    assert set(pd.read_csv(tmp_path / "out" / "modes.csv")["parameter"]) == {r"\x1b[2Jmu\x07"}


@pytest.mark.slow
def test_zero_rows_of_matrices(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    """M = I and K = diag(0, 4, 9), written with a row of which nothing is stored: ω = 0, 2 and 3, and no warning."""
    path = matrix_scene(tmp_path, "K.mtx")
    (tmp_path / "K.mtx").write_text("%%MatrixMarket matrix coordinate real general\n3 3 2\n2 2 4.0\n3 3 9.0\n")
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 0
    modes = pd.read_csv(tmp_path / "out" / "modes.csv")
    assert modes["im"].abs().round(9).tolist() in ([0.0, 2.0, 3.0], [0.0, 0.0, 2.0, 3.0]) and not len(recwarn)


@pytest.mark.slow
def test_all_modes_and_their_onset(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], no_figures: None
) -> None:  # fmt: skip
    """The step model is then the problem itself: the same onset as of eight modes, and no words of SciPy."""
    onsets = []
    for modes in (8, 90):
        path = write_scene(tmp_path, replaced("modes = 8", f"modes = {modes}").replace("points = 5", "points = 3"))
        assert main(["run", str(path), "-o", str(tmp_path / f"out_{modes}")]) == 0
        found = pd.read_csv(tmp_path / f"out_{modes}" / "onsets.csv")
        onsets.append(found[found["frequency_hz"] < 1000])
    assert len(onsets[0]) == len(onsets[1]) == 1
    assert onsets[1]["value"].item() == pytest.approx(onsets[0]["value"].item(), rel=1e-7)
    assert "must have different signs" not in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(("points", "told"), [(10_000, True), (12, False)])
def test_long_sweeps_are_forecast(
    points: int, told: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Behind the first values; what takes no time is not."""
    advance, calls = RunningSweep.advance, []

    def stopping(*arguments: object, **options: object) -> object:
        calls.append(1)
        if len(calls) == 9:
            raise KeyboardInterrupt
        return advance(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(RunningSweep, "advance", stopping)
    monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
    path = write_scene(tmp_path, sweep_text(points))
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 130
    said = capsys.readouterr().out
    assert (f"forecast: the other {points - 6} of {points} values take about " in said) == told
