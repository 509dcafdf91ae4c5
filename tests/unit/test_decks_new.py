"""`fe-squeal new` of decks and meshes, and the deck of the examples."""

from __future__ import annotations

import errno
import os
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from deck_scenes import deck, written

import fe_squeal
from fe_squeal.cli import main
from fe_squeal.decks.scene import scene_of

SMALL_BRAKE = Path(__file__).parents[2] / "examples" / "small_brake.inp"


def test_new_keeps_what_is_there(tmp_path, capsys):
    path = written(tmp_path, deck())
    (tmp_path / "s.toml").write_text("mine")
    assert main(["new", str(path), "-o", str(tmp_path / "s.toml")]) == 2
    assert "exists already" in capsys.readouterr().err
    assert (tmp_path / "s.toml").read_text() == "mine"


@pytest.mark.parametrize("links", [True, False])
def test_new_writes_all_or_nothing(tmp_path, capsys, monkeypatch, links):
    """A full disc, and a file that somebody makes in the meantime, also where the file system knows no links."""
    path, target, write = written(tmp_path, deck()), tmp_path / "s.toml", Path.write_bytes

    def full(self, data):
        write(self, data[:100])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def not_alone(self, data):
        target.write_text("mine")
        return write(self, data)

    if not links:
        monkeypatch.setattr(os, "link", lambda *_: (_ for _ in ()).throw(OSError(errno.EPERM, "no links here")))
    for writing, said in ((full, os.strerror(errno.ENOSPC)), (not_alone, "cannot be written")):
        before = sorted(tmp_path.iterdir())
        with monkeypatch.context() as patched:
            patched.setattr(Path, "write_bytes", writing)
            assert main(["new", str(path), "-o", str(target)]) == 2
        assert f"error: {target}: cannot be written" in (told := capsys.readouterr().err) and said in told
        assert sorted(p for p in tmp_path.iterdir() if p != target) == before
    assert target.read_text() == "mine"
    target.unlink()
    assert main(["new", str(path), "-o", str(target)]) == 0
    assert tomllib.loads(target.read_text("utf-8"))["mesh"]["file"] == path.name


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are any bytes there alone")
def test_a_mesh_whose_name_no_scene_can_hold(tmp_path, capsys):
    path = written(tmp_path, deck())
    mesh = path.rename(tmp_path / os.fsdecode(b"caf\xe9.inp"))
    assert main(["new", str(mesh), "-o", str(tmp_path / "s.toml")]) == 2
    assert "a name is not in UTF-8" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [mesh]


def test_template_of_a_mesh(tmp_path, capsys):
    """Bodies and groups of a mesh without physics; what has to be given is counted."""
    import meshio

    meshio.write(tmp_path / "a.vtu", meshio.Mesh(
        60 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), [("tetra", [[0, 1, 2, 3]])],
        cell_data={"part": [np.array([3])]}))  # fmt: skip
    assert main(["new", str(tmp_path / "a.vtu"), "-o", str(tmp_path / "sub.toml")]) == 0
    scene = tomllib.loads((tmp_path / "sub.toml").read_text())
    assert scene["mesh"] == {"file": "a.vtu", "length_unit": "mm", "order": 2}
    assert list(scene["bodies"]) == ["part_3"] and scene["bodies"]["part_3"]["groups"] == ["part:3"]
    assert "to be given there before it runs: 3" in capsys.readouterr().out


def test_small_brake_is_read(tmp_path):
    """The example: two pads of one part, springs of both, the turned axes of the second, friction of a later step."""
    scene, draft = scene_of(SMALL_BRAKE)
    assert not draft.missing and scene.effects.on["friction"].mu == 0.5
    assert {b.material for b in scene.bodies.values()} == {"CAST_IRON", "LINING", "STEEL"}
    assert scene.bodies["PAD-2_LINING"].axes == ((-1, 0, 0), (0, 1, 0))
    assert {s.name: s.stiffness for s in scene.springs} == {"ABUTMENTS": 6e7, "GUIDES": 1e7}
    assert main(["new", str(SMALL_BRAKE), "-o", str(tmp_path / "s.toml")]) == 0
    again = fe_squeal.load_scene(tmp_path / "s.toml")
    assert again.model_dump(exclude={"mesh"}) == scene.model_dump(exclude={"mesh"})
    assert again.mesh_path.resolve() == SMALL_BRAKE.resolve()


@pytest.mark.slow
def test_small_brake_runs(tmp_path):
    """The example squeals at 4.3 kHz; `fe-squeal run examples/small_brake.inp` has 0.046174774 and 4303.54 Hz."""
    scene, _ = scene_of(SMALL_BRAKE)
    sweep = fe_squeal.sweep(fe_squeal.assemble(scene), [0.02, 0.06], modes=18)
    (onset,) = [o for o in sweep.onsets if abs(o.frequency_hz - 4303.54) < 1]
    assert onset.value == pytest.approx(0.046174774, rel=1e-6)
