"""Folders that somebody exchanges for links while a command runs: nothing behind the links is touched.

The exchange comes at the worst moment, between a check and what it was made for: in the system's call itself.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest
from interrupted import interrupt, write_sweep
from scene_texts import replaced, write_scene
from test_folders import content, refused

import fe_squeal.report.export
import fe_squeal.report.vtk_files
import fe_squeal.run.checkpoint
import fe_squeal.run.open_folder
import fe_squeal.run.run
from fe_squeal.cli import main

pytestmark = pytest.mark.skipif(os.unlink not in os.supports_dir_fd, reason="no calls that take descriptors")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene with shapes."""
    monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
    monkeypatch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
    write_scene(tmp_path, replaced("points = 5", "points = 2").replace('shapes = "none"', 'shapes = "unstable"'))
    return tmp_path


def exchange(folder: Path, elsewhere: Path) -> None:
    """Move a folder away, and put a link to another one in its place."""
    folder.rename(folder.with_name(f"{folder.name}_moved"))
    folder.symlink_to(elsewhere)


def put(path: Path, text: str) -> None:
    path.write_text(text)


def before(
    monkeypatch: pytest.MonkeyPatch, call: str, when: Callable[[str], bool], act: Callable[[], None]
) -> list[str]:
    """Act once, just before the system is called with such a name of a file; return the names that were acted on."""
    original, acted = getattr(os, call), []

    def watched(path: Any, *arguments: Any, **options: Any) -> Any:
        name = os.path.basename(path) if isinstance(path, str | os.PathLike) else ""
        if not acted and when(name):
            acted.append(name)
            act()
        return original(path, *arguments, **options)

    monkeypatch.setattr(os, call, watched)
    return acted


def test_nothing_is_removed_behind_a_link(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`shapes` is exchanged as the next run begins to remove what is in there; elsewhere has files of these names."""
    scene, out, elsewhere = str(place / "block.toml"), place / "out", place / "elsewhere"
    assert main(["run", scene, "-o", str(out)]) == 0
    shutil.copytree(out / "shapes", elsewhere)
    untouched = content(elsewhere)
    acted = before(
        monkeypatch, "unlink", lambda name: name.endswith(".vtu"), lambda: exchange(out / "shapes", elsewhere)
    )
    assert main(["run", scene, "-o", str(out)]) == 2
    assert acted and content(elsewhere) == untouched


@pytest.mark.slow
def test_no_checkpoint_is_removed_behind_a_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, out, elsewhere = write_sweep(tmp_path, 4), tmp_path / "out", tmp_path / "elsewhere"
    interrupt(scene, out, 3, monkeypatch)
    shutil.copytree(out / "checkpoint", elsewhere)
    untouched = content(elsewhere)
    acted = before(
        monkeypatch, "unlink", lambda name: name == "inputs.json", lambda: exchange(out / "checkpoint", elsewhere)
    )
    assert main(["run", str(scene), "-o", str(out)]) == 2
    assert acted and content(elsewhere) == untouched


@pytest.mark.parametrize("name", ["shapes", "scratch"])
def test_nothing_is_written_behind_a_link(
    name: str, place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exchanged while a shape is being written: the folder that it is for, or the one that has it until it is whole."""
    out, elsewhere, acted = place / "out", place / "elsewhere", []
    original = fe_squeal.report.vtk_files.replace_atomically

    @contextmanager
    def exchanging(path: Path) -> Iterator[Path]:
        with original(path) as temporary:
            if not acted:
                assert temporary.parent.stat().st_mode & 0o077 == 0  # nobody else sees the names in there
                (out / "shapes").mkdir(exist_ok=True)
                exchange(out / "shapes" if name == "shapes" else temporary.parent, elsewhere)
                acted.append(path)
            yield temporary

    elsewhere.mkdir()
    (elsewhere / "precious.vtu").write_text("mine")
    untouched = content(elsewhere)
    monkeypatch.setattr(fe_squeal.report.vtk_files, "replace_atomically", exchanging)
    said = refused(["run", str(place / "block.toml"), "-o", str(out)], capsys)
    assert str(out / "shapes") in said and acted
    assert content(elsewhere) == untouched


def test_lock_that_is_exchanged(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file of the user takes the place of the lock just before it is opened."""
    scene, out = str(place / "block.toml"), place / "out"
    assert main(["run", scene, "-o", str(out)]) == 0
    acted = before(monkeypatch, "open", lambda name: name == ".lock", lambda: put(out / ".lock", "mine"))
    assert ".lock" in refused(["run", scene, "-o", str(out)], capsys)
    assert acted and (out / ".lock").read_text() == "mine"


@pytest.mark.slow
def test_another_folder_of_results_in_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It has a manifest, too; what is being computed is not written among its files."""
    scene, out, other = write_sweep(tmp_path, 3), tmp_path / "out", tmp_path / "other"
    assert main(["lumped", "oscillator", "--study", "noise-map", "-o", str(other)]) == 0
    untouched = content(other).values()
    save = fe_squeal.run.checkpoint.Checkpoint.save

    def moving(*arguments: Any) -> None:
        if other.exists():
            out.rename(tmp_path / "moved")
            other.rename(out)
        save(*arguments)

    monkeypatch.setattr(fe_squeal.run.checkpoint.Checkpoint, "save", moving)
    said = refused(["run", str(scene), "-o", str(out)], capsys)
    assert "expected the folder of results to stay until the end" in said
    assert list(content(out).values()) == list(untouched) and not list((tmp_path / "moved").glob(".*"))


@pytest.mark.slow
def test_a_system_without_such_calls(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As on Windows: the same files and refusals, by paths."""
    scene, outs = str(place / "block.toml"), (place / "out", place / "by_paths")
    assert main(["run", scene, "-o", str(outs[0])]) == 0
    monkeypatch.setattr(fe_squeal.run.open_folder, "_BY_DESCRIPTOR", False)
    for _ in range(2):
        assert main(["run", scene, "-o", str(outs[1])]) == 0
    names = [sorted(p.relative_to(out).as_posix() for p in out.rglob("*")) for out in outs]
    assert names[0] == names[1] and len(names[0]) > 20
    (place / "elsewhere").mkdir()
    exchange(outs[1] / "shapes", place / "elsewhere")
    assert "nothing is written through links" in refused(["run", scene, "-o", str(outs[1])], capsys)
