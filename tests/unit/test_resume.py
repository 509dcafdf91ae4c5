"""What `--resume` takes up, and what it refuses."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pandas as pd
import pytest
from interrupted import assert_same_results, assert_valid, interrupt, refused, stop_at, sweep_text, write_sweep
from matrix_scenes import sites, terms_of
from matrix_scenes import sweep_text as sweep_of
from matrix_scenes import write_scene as write_matrix_scene
from scene_texts import replaced, write_scene

import fe_squeal.report.export
import fe_squeal.run.inputs
import fe_squeal.run.lock
import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.errors import NotConvergedError, TooLargeError
from fe_squeal.geometry import Block, write_mesh
from fe_squeal.run.inputs import differences
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


@pytest.mark.slow
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
