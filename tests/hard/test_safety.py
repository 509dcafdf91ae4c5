"""Files are numbers and names, nothing else: no code in them runs, and nothing is written outside the folder."""

from __future__ import annotations

import io
import json
import pickle
import zipfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from scene_texts import SCENE, replaced, write_scene
from selection import some

from fe_squeal.cli import main
from fe_squeal.geometry import Block, write_mesh


class Payload:
    """Unpickled, it makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)



def matrix_scene(folder: Path, name: str) -> Path:
    scipy.io.mmwrite(folder / "M.mtx", sp.eye_array(3))
    text = f'[[terms]]\nrole = "mass"\nfile = "M.mtx"\n[[terms]]\nrole = "stiffness"\nfile = "{name}"\n'
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    return folder / "scene.toml"


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".mat", ".mtx"])
@pytest.mark.parametrize("where", ["data", "format", "whole"])
def test_pickles_are_not_opened(
    suffix: str, where: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In each array of a SciPy file, in a NumPy file, and under every name as a bare pickle."""
    mark, file = tmp_path / "executed", tmp_path / f"K{suffix}"
    objects = np.array([Payload(mark)] * 3, dtype=object)
    if where == "whole":
        file.write_bytes(pickle.dumps(objects))
        opened = lambda: pickle.loads(file.read_bytes())  # noqa: E731
    elif suffix == ".npz":
        good = {"format": np.array(b"csr"), "shape": np.array([3, 3]), "data": np.ones(3), "indices": np.arange(3),
                "indptr": np.arange(4)}  # fmt: skip
        np.savez(file, **{**good, where: objects})
        opened = lambda: np.load(file, allow_pickle=True)[where]  # noqa: E731
    else:
        np.save(tmp_path / "K.npy", objects)
        (tmp_path / "K.npy").rename(file)
        opened = lambda: np.load(file, allow_pickle=True)  # noqa: E731
    assert main(["run", str(matrix_scene(tmp_path, file.name)), "-o", str(tmp_path / "out")]) == 2
    assert file.name in capsys.readouterr().err
    assert not mark.exists() and not (tmp_path / "out").exists()
    opened()
    assert mark.exists()  # else the file held no danger


def test_matlab_objects_and_functions_are_not_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Cells and structures, which may hold function handles, are named as what they are."""
    scipy.io.savemat(tmp_path / "K.mat", {"K": np.array([[1, "system('x')"]], dtype=object), "s": {"f": 1}})
    assert main(["run", str(matrix_scene(tmp_path, "K.mat")), "-o", str(tmp_path / "out")]) == 2
    assert "no numeric matrix" in capsys.readouterr().err


@pytest.mark.slow
def test_archive_with_paths(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Members of an .npz file are read by name and unpacked nowhere."""
    (tmp_path / "in").mkdir()
    stream = io.BytesIO()
    sp.save_npz(stream, sp.eye_array(3, format="csr"))
    with zipfile.ZipFile(stream, "a") as archive:
        for name in ("../../escaped.npy", "/tmp/fe_squeal_escaped.npy", "..\\escaped.npy"):
            archive.writestr(name, b"data")
    (tmp_path / "in" / "K.npz").write_bytes(stream.getvalue())
    main(["run", str(matrix_scene(tmp_path / "in", "K.npz")), "-o", str(tmp_path / "in" / "out")])
    assert [p.name for p in tmp_path.iterdir()] == ["in"] and not Path("/tmp/fe_squeal_escaped.npy").exists()


NAMES = [
    "../../escaped", "/escaped", "a/b", "..\\..\\escaped", "a\nb", "a\0b", "\x1b[2J", "..", ".", "~", "$HOME", "CON",
    "$\\frac$", "é😀" * 40,
]  # fmt: skip


@pytest.mark.parametrize("name", some(NAMES, lambda name: name == "../../escaped"))
def test_names_are_only_names(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As title, material, body, spring, contact and group: nothing is written outside of the folder of results."""
    import fe_squeal.report.export
    import fe_squeal.run.run

    # Figures take most of the time. They have one name of many folders, and all that are no plain text to them.
    if name != "../../escaped" and name.isascii() and name.isprintable() and "$" not in name:
        monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
    if name.isascii():  # else VTK draws them as well, which takes its time
        monkeypatch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
    folder = tmp_path / "deep" / "er"
    folder.mkdir(parents=True)
    (tmp_path / "home").mkdir()
    quoted = json.dumps(name, ensure_ascii=False).replace("\x7f", "\\u007f")
    text = replaced('title = "block on a belt"', f"title = {quoted}", SCENE)
    text = text.replace("[materials.steel]", f"[materials.{quoted}]")
    text = text.replace('material = "steel"', f"material = {quoted}")
    text = text.replace('name = "belt"', f"name = {quoted}").replace('name = "across"', f"name = {quoted}")
    text = text.replace("[bodies.block]", f'[bodies.{quoted}]\ngroups = ["block"]').replace("points = 5", "points = 3")
    text = text.replace('shapes = "none"', 'shapes = "unstable"')
    text += "[effects.rayleigh]\nbeta = 1e-9\n"
    path = write_scene(folder, text)
    before = {p for p in tmp_path.rglob("*")} | {folder / "out"}
    code = main(["run", str(path), "-o", str(folder / "out")])
    said = capsys.readouterr().err
    assert code in (0, 2) and "Traceback" not in said, said
    new = {p for p in tmp_path.rglob("*")} - before
    assert all(p.is_relative_to(folder / "out") for p in new)
    assert not list(Path("/").glob("escaped*"))
    if code == 0:
        assert all(p.resolve().is_relative_to(tmp_path) for p in new) and len(list((folder / "out").glob("*.csv"))) == 4
        assert json.loads((folder / "out" / "run.json").read_text("utf-8"))["title"] == name


@pytest.mark.parametrize("name", NAMES)
def test_group_names_of_a_mesh(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As the mesh file has them, wanted and printed."""
    write_mesh(Block(length=0.08, width=0.04, height=0.02, size=0.02), tmp_path / "block.msh")
    content = (tmp_path / "block.msh").read_text("utf-8").replace('"block"', f'"{name}"')
    (tmp_path / "block.msh").write_text(content, encoding="utf-8")
    assert main(["check", str(write_scene(tmp_path))]) == 2
    said = capsys.readouterr()
    assert said.err.startswith("error: ") and said.err.count("\n") == 1
    assert all(c.isprintable() or c == "\n" for c in said.err) and said.out == ""


def test_parameter_names_of_matrices(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They are in the names of the files of shapes."""
    scipy.io.mmwrite(tmp_path / "K.mtx", sp.diags_array([2.0, 3.0, 4.0]))
    scipy.io.mmwrite(tmp_path / "F.mtx", sp.csr_array(np.array([[0, 9.0, 0], [-9.0, 0, 0], [0, 0, 0]])))
    scene = matrix_scene(tmp_path, "K.mtx")
    name = "../../../x/ä\n"
    quoted = json.dumps(name, ensure_ascii=False)
    text = f"[parameters]\n{quoted} = 1.0\n" + scene.read_text("utf-8")
    text += f'[[terms]]\nrole = "stiffness"\nfile = "F.mtx"\npowers = {{ {quoted} = 1 }}\n'
    text += f"[sweep]\nparameter = {quoted}\nvalues = [0.0, 1.0]\n"
    scene.write_text(text, encoding="utf-8")
    before = {p.name for p in tmp_path.iterdir()}
    assert main(["run", str(scene), "-o", str(tmp_path / "out")]) in (0, 2)
    assert {p.name for p in tmp_path.iterdir()} <= before | {"out"}
    assert "Traceback" not in capsys.readouterr().err
