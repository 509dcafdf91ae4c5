"""What a run tells and leaves that is interrupted before its first new value, behind its last, or while it writes."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from interrupted import stop_at, sweep_text, write_sweep
from scene_texts import replaced, write_scene

import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.errors import NotConvergedError
from fe_squeal.sweep.result import Sweep
from fe_squeal.sweep.running import RunningSweep

pytestmark = pytest.mark.usefixtures("no_figures")


def first_time(monkeypatch: pytest.MonkeyPatch, owner: object, name: str) -> None:
    """Have the first call of a function interrupted."""
    function, calls = getattr(owner, name), []

    def stopping(*arguments: object, **options: object) -> object:
        calls.append(1)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return function(*arguments, **options)

    monkeypatch.setattr(owner, name, stopping)


def test_an_interruption_before_the_first_new_value_leaves_what_there_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a run that was killed: it is said how far it has come, and run.json says how it ended."""
    path, out = write_sweep(tmp_path, 5), tmp_path / "out"
    with monkeypatch.context() as patched, pytest.raises(SystemExit):
        stop_at(4, patched, SystemExit)  # nothing in the program takes it up
        main(["run", str(path), "-o", str(out)])
    before = json.loads((out / "run.json").read_text("utf-8"))
    modes, kept = (out / "modes.csv").read_bytes(), len(before["values"])
    assert before["status"] == "running" and 0 < kept < 4
    capsys.readouterr()
    for error, code, said in (
        (KeyboardInterrupt(), 130, f"interrupted: {kept} of 5 values were finished and are in {out}\n"),
        (NotConvergedError("no"), 3, f"not converged: no; {kept} values before it are in {out}\n"),
    ):
        with monkeypatch.context() as patched:
            patched.setattr(RunningSweep, "reduce", lambda *_, error=error: (_ for _ in ()).throw(error))
            assert main(["run", str(path), "-o", str(out), "--resume"]) == code
        assert capsys.readouterr().err == said
        status = "interrupted" if code == 130 else "not converged"
        assert json.loads((out / "run.json").read_text("utf-8")) == {**before, "status": status}
        assert (out / "modes.csv").read_bytes() == modes
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 0
    assert f"resuming: {kept} of 5 values are finished" in capsys.readouterr().out


@pytest.mark.parametrize(("owner", "name"), [(RunningSweep, "result"), (fe_squeal.run.run, "write_results")])
def test_an_interruption_behind_the_last_value_keeps_all(
    owner: object, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write_sweep(tmp_path, 3), tmp_path / "out"
    with monkeypatch.context() as patched:
        first_time(patched, owner, name)
        assert main(["run", str(path), "-o", str(out)]) == 130
    assert capsys.readouterr().err == f"interrupted: 3 of 3 values were finished and are in {out}\n"
    record = json.loads((out / "run.json").read_text("utf-8"))
    assert (record["status"], len(record["values"])) == ("interrupted", 3)
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 0
    assert "resuming: 3 of 3 values are finished" in capsys.readouterr().out
    assert json.loads((out / "run.json").read_text("utf-8"))["status"] == "complete"


@pytest.mark.parametrize(("error", "code", "status"), [
    (KeyboardInterrupt, 130, "interrupted"), (NotConvergedError, 3, "not converged"),
])  # fmt: skip
def test_shapes_that_a_broken_step_of_several_processes_does_not_give(
    error: type[BaseException], code: int, status: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Every later step of them raises the same again; tables need none, and run.json says how the run ended."""
    path, out = write_scene(tmp_path, replaced('"none"', '"unstable"', sweep_text(5))), tmp_path / "out"
    stop_at(5, monkeypatch, error)
    monkeypatch.setattr(Sweep, "exact_shapes", lambda *_: (_ for _ in ()).throw(error("broken")))
    assert main(["run", str(path), "-o", str(out)]) == code
    record = json.loads((out / "run.json").read_text("utf-8"))
    assert (record["status"], len(record["values"])) == (status, 4)
    assert sorted(pd.read_csv(out / "modes.csv")["value"].unique()) == record["values"]
    assert "4 of 5 values were finished" in (said := capsys.readouterr().err) or "the end; 4 values before it" in said
