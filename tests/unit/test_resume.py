"""What `--resume` takes up, what it refuses, and that one run at a time has a folder."""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pandas as pd
import pytest
from interrupted import assert_same_results, assert_valid, interrupt, refused, stop_at, sweep_text, write_sweep
from matrix_scenes import sites, terms_of
from matrix_scenes import sweep_text as sweep_of
from matrix_scenes import write_scene as write_matrix_scene
from scene_texts import environment, replaced, write_scene

import fe_squeal.report.export
import fe_squeal.run.inputs
import fe_squeal.run.lock
import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.errors import NotConvergedError, OutputError, TooLargeError
from fe_squeal.geometry import Block, write_mesh
from fe_squeal.run.folder import hold_folder
from fe_squeal.run.inputs import differences
from fe_squeal.sweep.result import Sweep
from fe_squeal.sweep.running import RunningSweep

PRELOAD = "[effects.preload]\npressures = { top = 1.0e5 }\n[effects.friction]"
LOSS = "density = 7800.0\nloss_factor = 0.01"


@pytest.fixture(autouse=True)
def _no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take most of the time of such small runs; tests/hard/test_interruptions.py has them."""
    monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)


SCENES = {
    "direct": sweep_text(6),
    "reduced": sweep_text(6, "reduced"),
    "modal": sweep_text(6, "modal"),
    "pressed": sweep_text(6, text=replaced("[effects.friction]", PRELOAD)),
    "structural": sweep_text(6, text=replaced("[effects.fr", "[effects.structural_damping]\n[effects.fr",
                                              replaced("density = 7800.0", LOSS))),
    "damped": sweep_text(6, text=replaced('name = "across"', 'name = "across"\ndamping = 50.0')),
    "shapes": sweep_text(6, text=replaced('"none"', '"all"')),
}  # fmt: skip


@pytest.fixture(scope="module")
def wholes(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return a function that returns the results of a kind of problem, solved once without an interruption."""

    @functools.cache
    def whole(kind: str) -> Path:
        folder = tmp_path_factory.mktemp(kind)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
            assert main(["run", str(write_scene(folder, SCENES[kind])), "-o", str(folder / "whole")]) == 0
        return folder / "whole"

    return whole


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "call"), [*((kind, 6) for kind in SCENES), ("direct", 2), ("reduced", 2)])
def test_every_kind_of_problem_goes_on(
    kind: str, call: int, wholes: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Real and complex shapes, left ones, reduced models and static states come back from the files.

    Behind the last value but one there are unstable modes of all kinds.
    """
    # Pictures are tested elsewhere.
    monkeypatch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
    path, out, whole = write_scene(tmp_path, SCENES[kind]), tmp_path / "out", wholes(kind)
    interrupt(path, out, call, monkeypatch)
    assert assert_valid(out, whole) == "interrupted"
    solved = []
    advance = RunningSweep.advance
    monkeypatch.setattr(RunningSweep, "advance", lambda *a, **k: (solved.append(a), advance(*a, **k)))
    capsys.readouterr()
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 0
    assert len(solved) == 6 - (call - 1)
    assert f"resuming: {call - 1} of 6 values are finished" in capsys.readouterr().out
    assert_same_results(out, whole)
    if kind == "pressed":
        # Static states are found with the factors of those before, of which a resumed run has others.
        ours, theirs = (pd.read_csv(folder / "preload.csv") for folder in (out, whole))
        pd.testing.assert_frame_equal(ours, theirs, rtol=1e-11)


@pytest.mark.slow
def test_matrices_go_on_and_are_told_from_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The content of a file counts, whatever its name."""
    terms, out = terms_of(*sites(4, 2, 0), "undamped"), tmp_path / "out"
    path = write_matrix_scene(tmp_path, terms, {"mu": 0.0}, sweep_of("mu", 0, 0.9, 4, 8) + '[output]\nshapes="none"\n')
    assert main(["run", str(path), "-o", str(tmp_path / "whole")]) == 0
    interrupt(path, out, 3, monkeypatch)
    file = next(tmp_path.glob("mass_*"))
    content = file.read_bytes()
    file.write_bytes(content + b"\n")
    assert f"the content of file {file.name} is another" in refused(path, out, capsys)
    file.write_bytes(content)
    capsys.readouterr()
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 0
    # Of the first value that is known from the files alone.
    assert "(proven: LAPACK finds all modes)" in capsys.readouterr().out
    assert_same_results(out, tmp_path / "whole")


@pytest.mark.slow
def test_value_that_did_not_converge_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write_sweep(tmp_path, 5), tmp_path / "out"
    assert main(["run", str(path), "-o", str(tmp_path / "whole")]) == 0
    with monkeypatch.context() as patched:
        stop_at(3, patched, NotConvergedError)
        assert main(["run", str(path), "-o", str(out)]) == 3
    assert assert_valid(out, tmp_path / "whole") == "not converged"
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 0
    assert_same_results(out, tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize("earlier", [False, True])
def test_the_page_that_an_interruption_has_left_out_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, earlier: bool
) -> None:
    """Behind the last table: the page is missing, or that of an earlier interruption, which has fewer values."""
    scene, out = replaced("report = false", "report = true", replaced("points = 5", "points = 3")), tmp_path / "out"
    path, page = write_scene(tmp_path, scene), tmp_path / "out" / "report.html"
    command = ["run", str(path), "-o", str(out), "--resume"]
    if earlier:
        interrupt(path, out, 3, monkeypatch)
    before = page.read_text("utf-8") if earlier else ""
    with monkeypatch.context() as patched:
        patched.setattr(fe_squeal.run.run, "write_run_report", lambda *_: exec("raise KeyboardInterrupt"))
        assert main(command) == 130
    assert json.loads((out / "run.json").read_text("utf-8"))["status"] == "complete"
    monkeypatch.setattr(fe_squeal.run.run, "assemble", lambda *_: pytest.fail("assembled again"))
    assert main(command) == 0
    assert page.read_text("utf-8") != before
    assert not (out / "checkpoint").exists()


def test_finished_run_is_shown_and_not_solved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write_sweep(tmp_path, 3), tmp_path / "out"
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 0  # nothing is there yet: a run like any other
    said = capsys.readouterr().out
    assert f"nothing to resume in {out}: the run starts anew" in said
    before = {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in out.iterdir()}
    monkeypatch.setattr(fe_squeal.run.run, "assemble", lambda *_: pytest.fail("assembled again"))
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 0
    again = capsys.readouterr().out
    assert "are complete" in again
    table = said[said.index("Onsets") : said.index(" modes found")].rsplit("\n", 1)[0]
    assert table in again and "flutter" in table
    assert {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in out.iterdir()} == before


@pytest.mark.slow
def test_another_scene_is_refused_and_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = write_sweep(tmp_path, 5), tmp_path / "out"
    interrupt(path, out, 3, monkeypatch)
    kept = {p: p.read_bytes() for p in (out / "checkpoint").iterdir()}
    write_sweep(tmp_path, 7)
    assert "sweep.points is 5 there and 7 here; run without --resume" in refused(path, out, capsys)
    write_scene(tmp_path, sweep_text(5).replace("2.0e11", "2.1e11"), "direct.toml")
    said = refused(path, out, capsys)
    assert "materials.steel.youngs_modulus is 200000000000.0 there and 210000000000.0 here" in said
    assert f"error: {out}: the interrupted run was another one" in said
    write_sweep(tmp_path, 5)
    mesh = (tmp_path / "block.msh").read_bytes()
    write_mesh(Block(length=0.08, width=0.04, height=0.020001, size=0.02), tmp_path / "block.msh")
    assert "the content of mesh block.msh is another" in refused(path, out, capsys)
    (tmp_path / "block.msh").write_bytes(mesh)
    with monkeypatch.context() as patched:
        patched.setattr(fe_squeal.run.inputs, "__version__", "99")
        assert "the version is" in refused(path, out, capsys)
    assert {p: p.read_bytes() for p in (out / "checkpoint").iterdir()} == kept
    # Without --resume the new scene runs, and the old checkpoint is gone.
    write_sweep(tmp_path, 3)
    assert main(["run", str(path), "-o", str(out)]) == 0
    assert not (out / "checkpoint").exists()
    write_sweep(tmp_path, 5)
    assert "the finished results are of another one: sweep.points is 3" in refused(path, out, capsys)


def test_scene_that_fails_leaves_an_older_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A misspelled group is found at the assembly: what a long run had finished must not be gone for it."""
    path, out = write_sweep(tmp_path, 5), tmp_path / "out"
    interrupt(path, out, 3, monkeypatch)
    bad = write_scene(tmp_path, sweep_text(5).replace('"bottom"', '"botom"'), "bad.toml")
    assert main(["run", str(bad), "-o", str(out)]) == 2
    assert main(["run", str(path), "-o", str(out), "--resume"]) == 0
    assert "resuming: 2 of 5 values" in capsys.readouterr().out


def test_older_checkpoint_stays_until_there_is_something_to_keep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run of another scene that is refused as its sweep begins, or stopped there, leaves it, and does not read it."""
    path, out = write_sweep(tmp_path, 5, "reduced"), tmp_path / "out"
    interrupt(path, out, 3, monkeypatch)
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
    stiffer = sweep_text(5, "reduced").replace("2.0e11", "2.1e11")
    other = write_scene(tmp_path, stiffer, "other.toml")
    monkeypatch.setattr(fe_squeal.run.run, "sweep", refusing := Refusing())
    assert main(["run", str(other), "-o", str(out)]) == 2
    refusing.error = KeyboardInterrupt()
    assert main(["run", str(other), "-o", str(out)]) == 130
    assert capsys.readouterr().err.endswith(f"interrupted: nothing was finished, and {out} is as it was\n")
    assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before
    monkeypatch.undo()
    for folder in (out, tmp_path / "whole"):
        assert main(["run", str(other), "-o", str(folder)]) == 0
    assert_same_results(out, tmp_path / "whole")


class Refusing:
    """In place of the sweep: it ends with an error before it has kept anything."""

    error: BaseException = TooLargeError("the sweep does not fit into memory")

    def __call__(self, *arguments: object, **options: object) -> None:
        raise self.error


def test_differences_are_counted() -> None:
    known = {"version": "1", "scene": {"a": [{"b": k} for k in range(6)]}, "content": {}}
    given = {"version": "1", "scene": {"a": [{"b": -k} for k in range(6)]}, "content": {}}
    assert len(differences(known, given)) == 5
    told = fe_squeal.run.inputs.joined_differences(differences(known, given))
    assert told.endswith("a[3].b is 3 there and -3 here; and 2 more")
    assert differences(known, known) == []


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
