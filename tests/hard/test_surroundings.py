"""What the program does not choose: clocks that jump, rights of other users, names that other systems do not take."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from interrupted import assert_same_results, interrupt, write_sweep
from scene_texts import replaced, write_scene
from selection import some
from test_folders import content, refused
from test_safety import matrix_scene

import fe_squeal.report.export
import fe_squeal.run.accuracy  # what commands import later could not be read by another user
import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.sweep.running import RunningSweep

_NOBODY = 65534
# https://learn.microsoft.com/windows/win32/fileio/naming-a-file: characters, devices with or without suffix, last ones
_DEVICES = r"(?:con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])(?:\..*)?"
_NOT_ON_WINDOWS = re.compile(rf'.*[<>:"|?*\\\x00-\x1f].*|{_DEVICES}|.*[. ]', re.I | re.S)


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
    monkeypatch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())


# Clocks


@pytest.fixture
def jumping(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock of the day that is years before or behind what it told last."""
    years = itertools.cycle([0.0, 3e9, -1e9, 1e9])
    real = time.time()
    monkeypatch.setattr(time, "time", lambda: real + next(years))
    monkeypatch.setattr(time, "time_ns", lambda: int(1e9 * (real + next(years))))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["direct", "reduced"])
def test_clock_that_jumps(method: str, tmp_path: Path, jumping: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seconds are those that went by; a run goes on behind its last value, whatever the times of its files are."""
    path, out = write_sweep(tmp_path, 5, method), tmp_path / "out"
    begun = time.monotonic()
    interrupt(path, out, 4, monkeypatch)
    for i, file in enumerate(p for p in (*tmp_path.glob("*"), *out.rglob("*")) if p.is_file()):
        os.utime(file, [(0, 0), (4e9, 4e9)][i % 2])  # 1970 and 2096
    solved = []
    advance = RunningSweep.advance

    def counted(self: object, value: float, **options: object) -> object:
        solved.append(value)
        return advance(self, value, **options)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        patched.setattr(RunningSweep, "advance", counted)
        assert main(["run", str(path), "-o", str(out), "--resume"]) == 0
    took = time.monotonic() - begun
    assert 1 <= len(solved) <= 3  # what was kept is not computed again
    seconds = json.loads((out / "run.json").read_text("utf-8"))["seconds"]
    assert all(0 <= s <= took for s in seconds.values()), seconds
    assert main(["run", str(path), "-o", str(tmp_path / "whole")]) == 0
    assert_same_results(out, tmp_path / "whole")


def test_forecast_does_not_ask_the_clock_of_the_day(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sweep that takes a second is not said to take years."""
    days = itertools.count(time.time(), 86_400.0)
    monkeypatch.setattr(time, "time", lambda: next(days))
    assert main(["run", str(write_sweep(tmp_path, 12)), "-o", str(tmp_path / "out")]) == 0
    assert "forecast:" not in capsys.readouterr().out


@pytest.mark.slow
def test_a_lock_is_as_old_as_its_process(tmp_path: Path) -> None:
    """The file that a killed command left is no lock, however new it is; it is not the time in it that counts."""
    out = tmp_path / "out"
    out.mkdir()
    (out / ".lock").write_text(f"process 1 since {time.strftime('%Y-%m-%d %H:%M:%S')}\n")
    assert main(["run", str(write_sweep(tmp_path, 2)), "-o", str(out)]) in (0, 2)
    shutil.rmtree(out)
    assert main(["run", str(tmp_path / "direct.toml"), "-o", str(out)]) == 0
    (out / ".lock").write_text("process 1 since 2999-12-31 23:59:59\n")
    assert main(["run", str(tmp_path / "direct.toml"), "-o", str(out)]) == 0
    assert not (out / ".lock").exists()


# Rights


@contextmanager
def another_user() -> Iterator[None]:
    """Be somebody whom the rights of files bind; root is bound by none."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(_NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene with results, and all that the program imports for them."""
    place = tmp_path_factory.mktemp("done")
    text = replaced("points = 5", "points = 2").replace('shapes = "none"', 'shapes = "unstable"')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
        patch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
        assert main(["run", str(write_scene(place, text)), "-o", str(place / "out")]) == 0
    assert main(["lumped", "oscillator", "--study", "noise-map", "-o", str(place / "lumped")]) == 0
    shutil.rmtree(place / "lumped")
    return place


@pytest.fixture
def common(done: Path) -> Iterator[Path]:
    """A copy in a folder of `another_user`."""
    place = Path(tempfile.mkdtemp(prefix="fe_squeal_rights_"))
    shutil.copytree(done, place, dirs_exist_ok=True)
    if os.geteuid() == 0:
        for entry in (place, *place.rglob("*")):
            os.chown(entry, _NOBODY, _NOBODY)
    yield place
    for entry in (place, *place.rglob("*")):
        if entry.is_dir():
            entry.chmod(0o700)
    shutil.rmtree(place)


FORBIDDEN = {  # what is forbidden, to which rights; and what the message names
    "scene": ("block.toml", 0o000, "block.toml"), "mesh": ("block.msh", 0o000, "block.msh"),
    "results read": ("out", 0o000, "out"), "results write": ("out", 0o555, "out"),
    "shapes": ("out/shapes", 0o555, "shapes"), "table": ("out/modes.csv", 0o000, "modes.csv"),
    "manifest": ("out/manifest.sha256", 0o000, "manifest.sha256"), "parent": (".", 0o555, "out"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="rights of POSIX")
@pytest.mark.parametrize("what", FORBIDDEN)
def test_what_is_forbidden_is_told(what: str, common: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, one line with the file, and nothing is changed."""
    name, rights, told = FORBIDDEN[what]
    if what == "parent":
        shutil.rmtree(common / "out")
    before = content(common)
    (common / name).chmod(rights)
    with another_user():
        said = refused(["run", str(common / "block.toml"), "-o", str(common / "out")], capsys)
    (common / name).chmod(0o700)
    assert told in said and ("ermission" in said or "fe-squeal wrote" in said), said
    assert content(common) == before


@pytest.mark.skipif(os.name == "nt", reason="rights of POSIX")
@pytest.mark.parametrize(
    "command",
    [
        ("check", "{}/block.toml"), ("onset", "{}/block.toml"), ("mesh", "{}/block.toml", "-o", "{}/x.msh"),
        ("lumped", "oscillator", "--study", "noise-map", "-o", "{}/new"),
        ("accuracy", "{}/block.toml", "-o", "{}/new"),
    ],
    ids=lambda command: command[0],
)  # fmt: skip
def test_every_command_tells_what_is_forbidden(
    command: tuple[str, ...], common: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = content(common)
    reads = command[0] in ("check", "onset")
    (common / "block.toml" if reads else common).chmod(0o000 if reads else 0o555)
    with another_user():
        said = refused([part.format(common) for part in command], capsys)
    common.chmod(0o700)
    (common / "block.toml").chmod(0o600)
    assert str(common) in said and "ermission" in said
    assert content(common) == before


# Names


NAMES = ["CON", "nul.txt", "a:b", "C:\\x", "end.", "end ", "<a|b>", "?*", '"', "com1", "LPT9.x", "aux", "conin$"]


def test_the_rule_knows_names_of_windows() -> None:
    assert all(_NOT_ON_WINDOWS.fullmatch(name) for name in NAMES)
    assert not any(map(_NOT_ON_WINDOWS.fullmatch, ("modes.csv", "console", "branch_07_mu_0.60_2413Hz.png", "é")))


@pytest.mark.parametrize("name", some(NAMES, lambda name: name == "a:b"))
def test_no_name_of_the_scene_makes_a_name_that_windows_refuses(name: str, tmp_path: Path) -> None:
    """Bodies, contacts, springs, materials and the parameter that is swept are in names of files at most as letters."""
    quoted = json.dumps(name)
    text = replaced('title = "block on a belt"', f"title = {quoted}")
    for old, new in (
        ("[materials.steel]", f"[materials.{quoted}]"), ('material = "steel"', f"material = {quoted}"),
        ('name = "belt"', f"name = {quoted}"), ('name = "across"', f"name = {quoted}"),
        ("[bodies.block]", f'[bodies.{quoted}]\ngroups = ["block"]'), ("points = 5", "points = 2"),
        ('shapes = "none"', 'shapes = "unstable"'),
    ):  # fmt: skip
        text = replaced(old, new, text)
    text += "[effects.preload]\npressures = { top = 1e5 }\n"
    scenes = [write_scene(tmp_path, text)]
    matrices = tmp_path / "matrices"
    matrices.mkdir()
    scipy.io.mmwrite(matrices / "K.mtx", sp.diags_array([2.0, 3.0, 4.0]))
    scipy.io.mmwrite(matrices / "F.mtx", sp.csr_array(np.array([[0, 9.0, 0], [-9.0, 0, 0], [0, 0, 0]])))
    scenes.append(matrix_scene(matrices, "K.mtx"))
    quoted = json.dumps(name.strip())  # a parameter of the sweep is known without blanks around it
    body = f"[parameters]\n{quoted} = 1.0\n" + scenes[1].read_text("utf-8").replace('shapes = "none"', "")
    body += f'[[terms]]\nrole = "stiffness"\nfile = "F.mtx"\npowers = {{ {quoted} = 1 }}\n'
    scenes[1].write_text(body + f"[sweep]\nparameter = {quoted}\nvalues = [0.0, 1.0]\n", encoding="utf-8")
    for i, scene in enumerate(scenes):
        out = tmp_path / f"out_{i}"
        assert main(["run", str(scene), "-o", str(out)]) == 0
        made = [p.relative_to(out) for p in out.rglob("*")]
        assert any(p.parts[0] == "shapes" for p in made) or i
        assert not [p for p in made if any(_NOT_ON_WINDOWS.fullmatch(part) for part in p.parts)]
        assert len({p.as_posix().casefold() for p in made}) == len(made)  # Windows does not tell A from a
        assert all(stat.S_ISREG(p.lstat().st_mode) or p.is_dir() for p in out.rglob("*"))


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are any bytes there alone")
def test_a_folder_whose_name_is_not_in_utf_8(tmp_path: Path) -> None:
    """The scene is read and run there; run.json spells the byte out."""
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    folder.mkdir()
    path = write_sweep(folder, 2)
    assert main(["run", str(path), "-o", str(folder / "out")]) == 0
    record = json.loads((folder / "out" / "run.json").read_text("utf-8"))
    assert record["status"] == "complete" and record["scene"] == str(tmp_path / r"caf\udce9" / path.name)
    assert main(["run", str(path), "-o", str(folder / "out"), "--resume"]) == 0
