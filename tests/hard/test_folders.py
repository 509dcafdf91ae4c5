"""Files of the user are never touched: other files in a folder of results, links, inputs, and refused commands.

This file is longer than others, since it is a list of situations with one promise.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest
from interrupted import assert_same_results, write_sweep
from scene_texts import replaced, write_scene
from selection import some
from test_safety import matrix_scene

import fe_squeal.report.export
import fe_squeal.run.manifest
import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.sweep.running import RunningSweep


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take most of the time and are written as all other files."""
    monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
    monkeypatch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene with shapes and the results of its run in `out`."""
    folder = tmp_path_factory.mktemp("results")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
        patch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
        text = replaced("points = 5", "points = 3").replace('shapes = "none"', 'shapes = "unstable"')
        assert main(["run", str(write_scene(folder, text)), "-o", str(folder / "out")]) == 0
    return folder


@pytest.fixture
def place(results: Path, tmp_path: Path) -> Path:
    shutil.copytree(results, tmp_path, dirs_exist_ok=True)
    return tmp_path


def content(folder: Path) -> dict[str, tuple[object, ...]]:
    """Return what is in a folder: bytes of files, targets of links, times of all."""
    found = {}
    for path in [folder, *folder.rglob("*")]:
        what = os.readlink(path) if path.is_symlink() else path.read_bytes() if path.is_file() else b""
        found[str(path)] = (what, path.lstat().st_mtime_ns if not path.is_dir() else 0)
    return found


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    capsys.readouterr()
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ") and said.count("\n") == 1
    return said


FOREIGN = (
    "run.json", "modes.csv", "notes.txt", "preload.png", "checkpoint/state.npz", "checkpoint/mine.txt",
    "shapes/my_5Hz.vtu", "shapes/x_3Hz_frames/a.vtu", ".lock", ".x.1.partial.csv", "manifest.sha256", "accuracy.csv",
)  # fmt: skip


@pytest.mark.parametrize(
    "name", some(FOREIGN, lambda name: name in ("run.json", "notes.txt", "checkpoint/mine.txt", ".lock"))
)
def test_folder_of_somebody_else(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Not empty, and no manifest: exit code 2, and not a byte or a time is another, for every command that writes."""
    scene, out = write_sweep(tmp_path, 3), tmp_path / "out"
    (out / name).parent.mkdir(parents=True)
    (out / name).write_text("mine")
    before = content(tmp_path)
    for command in (["run"], ["run", "--resume"], ["accuracy"], ["run", "--accuracy", "0.1"]):
        assert f"error: {out}" in refused([*command, str(scene), "-o", str(out)], capsys)
        assert content(tmp_path) == before
    assert str(out) in refused(["lumped", "oscillator", "--study", "noise-map", "-o", str(out)], capsys)
    assert content(tmp_path) == before


@pytest.mark.parametrize("command", ["study", "study --resume", "report", "animate", "diff", "new"])
def test_no_command_takes_what_is_somebody_elses(
    command: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, foreign = place / "block.toml", place / "foreign"
    study = "[study]\nsamples = 8\n[study.parameters]\nmu = { uniform = { low = 0.1, high = 0.2 } }\n"
    scene.write_text(scene.read_text() + study)
    foreign.mkdir()
    (foreign / "notes.toml").write_text("mine")
    before = content(place)
    arguments = {
        "study": [scene, "-o", foreign], "study --resume": [scene, "-o", foreign], "report": [foreign],
        "animate": [foreign], "diff": [place / "out", place / "out", "-o", foreign],
        "new": [place / "block.msh", "-o", foreign / "notes.toml"],
    }[command]  # fmt: skip
    assert "foreign" in refused([*command.split(), *map(str, arguments)], capsys)
    assert content(place) == before


def test_scene_beside_its_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Called like a file of the results, and with these in its own folder."""
    scene = write_sweep(tmp_path, 3).rename(tmp_path / "run.json")
    before = content(tmp_path)
    refused(["run", str(scene), "-o", str(tmp_path)], capsys)
    assert content(tmp_path) == before


def test_manifest_lists_every_file(place: Path) -> None:
    out = place / "out"
    lines = (out / "manifest.sha256").read_text("utf-8").splitlines()
    assert lines[0].startswith("# fe-squeal ")
    listed = {line[66:]: line[:64] for line in lines[1:]}
    files = {p.relative_to(out).as_posix(): p for p in out.rglob("*") if p.is_file() and p.name != "manifest.sha256"}
    assert listed == {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()}
    assert len([name for name in listed if name.startswith("shapes/")]) > 10 and len(lines) == len(listed) + 1


@pytest.mark.slow
def test_files_of_the_user_beside_results_stay(place: Path) -> None:
    """Those that no run writes: they are no reason to refuse, and they are there afterwards."""
    out = place / "out"
    mine = [out / name for name in FOREIGN if (out / name).parent.name in ("shapes", "x_3Hz_frames")]
    mine += [out / "notes.txt", out / ".x.1.partial.csv", out / "checkpoint" / "mine.txt"]
    for path in mine:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    assert main(["run", str(place / "block.toml"), "-o", str(out)]) == 0
    assert all(path.read_text() == "mine" for path in mine)
    text = (place / "block.toml").read_text().replace('"unstable"', '"none"')
    assert main(["run", str(write_scene(place, text)), "-o", str(out)]) == 0
    assert {p for p in (out / "shapes").rglob("*") if p.is_file()} == {p for p in mine if "shapes" in p.parts}


@pytest.mark.parametrize(
    "name",
    some(["modes.csv", "run.json", "shapes", "preload.png", "checkpoint/state.npz", ".lock"],
         lambda name: name in ("modes.csv", "preload.png")),
)  # fmt: skip
def test_file_that_was_changed_or_is_foreign_is_not_replaced(
    name: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = place / "out"
    path = out / name if name != "shapes" else next((out / "shapes").glob("*.vtu"))
    path.parent.mkdir(exist_ok=True)
    path.write_text("mine")
    before = content(place)
    assert str(path) in refused(["run", str(place / "block.toml"), "-o", str(out)], capsys)
    assert content(place) == before
    path.unlink()
    assert main(["run", str(place / "block.toml"), "-o", str(out)]) == 0


def test_page_that_is_written_by_its_name_is_listed(place: Path) -> None:
    """`report OUT -o OUT/report.html`, also into another folder of results, leaves folders that commands go on with."""
    out, other = place / "out", place / "other"
    shutil.copytree(out, other)
    text = (place / "block.toml").read_text().replace("block on a belt", "another title")
    assert main(["run", str(write_scene(place, text)), "-o", str(other)]) == 0
    for file in (out / "report.html", other / "report.html", place / "report.html"):
        for folder in (out, other, out):  # of which pages are unlike
            assert main(["report", str(folder), "-o", str(file)]) == 0
    for folder in (out, other):
        assert main(["report", str(folder)]) == 0
    assert "report.html" in (out / "manifest.sha256").read_text() and not (place / "manifest.sha256").exists()


def test_foreign_shape_of_a_name_that_will_be_written(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The names of shapes follow from the sweep; a file that has one is found before the older results are removed."""
    out = place / "out"
    lines = (out / "manifest.sha256").read_text("utf-8").splitlines(keepends=True)
    name = next(line[66:].strip() for line in lines if "_frames/" in line)
    (out / "manifest.sha256").write_text("".join(line for line in lines if name not in line), encoding="utf-8")
    before = content(place)
    assert name in refused(["run", str(place / "block.toml"), "-o", str(out)], capsys)
    assert content(place) == before


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links")
@pytest.mark.parametrize(
    "name",
    some(["shapes", "checkpoint", ".lock", "modes.csv", "manifest.sha256", "measurements"],
         lambda name: name in ("shapes", ".lock")),
)  # fmt: skip
def test_links_are_not_followed(name: str, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A link to files elsewhere under a name of the results, in a folder with a manifest."""
    out, other = place / "out", place / "elsewhere"
    if (out / name).exists():
        (out / name).rename(other)  # what is behind the link is what was written
    elif name == ".lock":
        other.write_text("")
    else:
        other.mkdir()
        (other / "state.npz").write_text("mine")
    (out / name).symlink_to(other)
    before = content(place)
    assert str(out) in refused(["run", str(place / "block.toml"), "-o", str(out)], capsys)
    assert content(place) == before


def test_manifest_of_a_stranger(place: Path) -> None:
    """It names files outside of its folder, with the right digests: they are not removed."""
    out, precious = place / "out", place / "precious.txt"
    precious.write_text("mine")
    digest = hashlib.sha256(b"mine").hexdigest()
    with (out / "manifest.sha256").open("a") as file:
        names = ("../precious.txt", str(precious), "shapes/../../precious.txt")
        file.writelines(f"{digest}  {name}\n" for name in names)
    assert main(["run", str(place / "block.toml"), "-o", str(out)]) == 0
    assert precious.read_text() == "mine"


def test_inputs_are_never_outputs(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The mesh of a scene is a shape of the run whose results it replaces; a matrix is a link to one."""
    out = place / "out"
    shape = next((out / "shapes").glob("*.vtu"))
    text = (place / "block.toml").read_text().replace('"block.msh"', f'"{shape.relative_to(place).as_posix()}"')
    scene = write_scene(place, text, "other.toml")
    (place / "K.mtx").symlink_to(out / "modes.csv")
    before = content(out)
    assert "is an input of this command" in refused(["run", str(scene), "-o", str(out)], capsys)
    assert "is an input of this command" in refused(["run", str(matrix_scene(place, "K.mtx")), "-o", str(out)], capsys)
    assert content(out) == before


def test_refused_scene_leaves_no_folders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = write_scene(tmp_path, replaced('"bottom"', '"botom"'))
    before = content(tmp_path)
    for _ in range(2):
        refused(["run", str(scene), "-o", str(tmp_path / "q1" / "q2" / "out")], capsys)
        assert content(tmp_path) == before


def test_empty_folders_of_an_early_interruption_are_used_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Stopped between the making of a folder and its first file; what somebody has put there is not touched."""
    scene, out = write_sweep(tmp_path, 3), tmp_path / "out"
    (out / "checkpoint").mkdir(parents=True)
    (out / "shapes").mkdir()
    (out / "shapes" / "mine.txt").touch()
    assert "holds what fe-squeal did not write (shapes)" in refused(["run", str(scene), "-o", str(out)], capsys)
    (out / "shapes" / "mine.txt").unlink()
    assert main(["run", str(scene), "-o", str(out)]) == 0


def test_refused_scene_leaves_older_results(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Whatever is wrong, and wherever it is found: before the assembly, in it, and as the sweep begins."""
    before = content(place / "out")
    text = (place / "block.toml").read_text()
    cases = (
        ('"bottom"', '"botom"'), ("[solve]", "[slove]"), ("modes = 8", "modes = 8\ntolerance = -1.0"),
        ('"mu"\nfrom = 0.0\nto = 0.8', '"contacts.belt.sliding.speed"\nfrom = -1.0\nto = 1.0'),  # 0 is among them
    )  # fmt: skip
    for old, new in cases:
        bad = write_scene(place, replaced(old, new, text), "bad.toml")
        refused(["run", str(bad), "-o", str(place / "out")], capsys)
        assert content(place / "out") == before


def without_manifest(out: Path) -> None:
    for name in ("manifest.sha256", "report.html"):  # that version wrote neither
        (out / name).unlink(missing_ok=True)


def test_results_of_a_version_without_manifests(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They are taken for what they are, as long as nothing else lies among them."""
    scene, out = str(place / "block.toml"), place / "out"
    without_manifest(out)
    assert main(["run", scene, "-o", str(out), "--resume"]) == 0
    assert main(["run", scene, "-o", str(out)]) == 0
    assert (out / "manifest.sha256").exists()
    without_manifest(out)
    for name in ("notes.txt", "shapes/notes.txt", "checkpoint/a.npz"):
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text("mine")
        before = content(place)
        refused(["run", scene, "-o", str(out)], capsys)
        assert content(place) == before
        (out / name).unlink()
    (out / "run.json").write_text(json.dumps({"scripts": {}}))
    refused(["run", scene, "-o", str(out)], capsys)


def stop(monkeypatch: pytest.MonkeyPatch, call: int) -> Callable[[], None]:
    advance, calls = RunningSweep.advance, []

    def stopping(*arguments: object, **options: object) -> object:
        calls.append(1)
        if len(calls) == call:
            raise KeyboardInterrupt
        return advance(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(RunningSweep, "advance", stopping)
    return monkeypatch.undo


def test_interrupted_run_of_a_version_without_manifests_goes_on(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With what its kill has left: a file that is not whole, and no record yet."""
    shutil.copytree(results, tmp_path, dirs_exist_ok=True)
    scene, out = str(tmp_path / "block.toml"), tmp_path / "begun"
    with monkeypatch.context() as patched:
        stop(patched, 3)
        assert main(["run", scene, "-o", str(out)]) == 130
    without_manifest(out)
    for name in (".modes.123.partial.csv", "checkpoint/.state.123.partial.npz"):
        (out / name).write_text("half")
    assert main(["run", scene, "-o", str(out), "--resume"]) == 0
    assert_same_results(out, tmp_path / "out")


def test_folder_that_vanishes(place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Moved away while the run goes on: one message, and nothing is made in its place."""
    out = place / "out"
    advance = RunningSweep.advance

    def moving(*arguments: object, **options: object) -> object:
        if out.exists():
            out.rename(place / "moved")
        return advance(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(RunningSweep, "advance", moving)
    said = refused(["run", str(place / "block.toml"), "-o", str(out)], capsys)
    assert "expected the folder of results to stay until the end" in said
    assert not [p for p in out.rglob("*") if p.is_file()] and (place / "moved" / "manifest.sha256").exists()


def test_interrupted_as_the_first_file_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No folder is left, in which the next command would see somebody else's."""
    scene, out = str(write_sweep(tmp_path, 3)), tmp_path / "out"

    def stopping(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(fe_squeal.run.manifest.Manifest, "_append", stopping)
        assert main(["run", scene, "-o", str(out)]) == 130
    assert not out.exists()
    assert main(["run", scene, "-o", str(out), "--resume"]) == 0


@pytest.mark.slow
def test_empty_file_after_a_power_failure(place: Path) -> None:
    """What the system had not yet written holds nothing of anybody's."""
    for name in ("modes.csv", "run.json", "manifest.sha256"):
        (place / "out" / name).write_bytes(b"")
        if name != "manifest.sha256":
            assert main(["run", str(place / "block.toml"), "-o", str(place / "out")]) == 0


@pytest.mark.parametrize("mask", some([0o077, 0o027, 0o000], lambda mask: mask == 0o027))
def test_rights_of_files(mask: int, tmp_path: Path) -> None:
    """They are what the user's mask says, for the tables, the manifest and the shapes alike."""
    before = os.umask(mask)
    try:
        assert main(["run", str(write_sweep(tmp_path, 3)), "-o", str(tmp_path / "out")]) == 0
    finally:
        os.umask(before)
    for path in (tmp_path / "out").rglob("*"):
        assert path.stat().st_mode & 0o777 == (0o777 if path.is_dir() else 0o666) & ~mask, path
