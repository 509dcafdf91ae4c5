"""Files of strangers: what they include, inflate to, link to and promise."""

from __future__ import annotations

import gzip
import io
import os
import struct
import time
import zipfile
import zlib
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from test_safety import matrix_scene

import fe_squeal.assembly.matrix_files.checks as checks
from fe_squeal.assembly.matrix_files import read_matrix
from fe_squeal.cli import main
from fe_squeal.eigen.memory import peak_memory_mib
from fe_squeal.errors import MeshError, OutputError, SceneError
from fe_squeal.mesh import load_mesh
from fe_squeal.run.measurements import MeasurementFolder
from fe_squeal.scene.file import load_scene

NODES = "1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 0., 0., 1.\n5, 1., 1., 1.\n"
CELLS = "1, 1, 2, 3, 4\n", "2, 2, 3, 4, 5\n"


def deck(folder: Path, text: str, **files: str) -> Path:
    for name, content in files.items():
        (folder / f"{name}.inc").write_text(content)
    (folder / "a.inp").write_text(text)
    return folder / "a.inp"


@pytest.mark.parametrize(
    "middle", ["*INCLUDE, INPUT=b.inc\n", "*Include,\n input = b.inc\n", "*INCLUDE, INPUT=c.inc\n"]
)
def test_included_lines_stand_where_the_include_stands(middle: str, tmp_path: Path) -> None:
    """Inside a block of data lines, at its beginning, between, and through another include."""
    text = f"*NODE\n{NODES}*ELEMENT, TYPE=C3D4, ELSET=PAD\n{CELLS[0]}{middle}"
    mesh = load_mesh(deck(tmp_path, text, b=CELLS[1], c="*INCLUDE, INPUT=b.inc\n")).mesh
    assert mesh.nelements == 2 and len(mesh.subdomains["PAD"]) == 2
    text = f"*NODE\n*INCLUDE, INPUT=n.inc\n*ELEMENT, TYPE=C3D4, ELSET=PAD\n{middle}{CELLS[0]}"
    mesh = load_mesh(deck(tmp_path, text, n=NODES)).mesh
    assert mesh.nelements == 2 and len(mesh.subdomains["PAD"]) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("*ELEMENT, TYPE=C3D4, ELSET=BACK\n", r"\*ELEMENT has no data lines"),
        ("*NODE, NSET=N\n*ELSET, ELSET=E\n1\n", r"\*NODE has no data lines"),
        ("*ELSET, ELSET=E\n", r"\*ELSET has no data lines"),
        ("*SOLID SECTION, ELSET=PADD\n", 'of element set "PADD", which has no elements .* did you mean "PAD"'),
        ("*INCLUDE, INPUT=none.inc\n", "does not exist"),
    ],
)
def test_what_a_keyword_promises_is_there(text: str, message: str, tmp_path: Path) -> None:
    base = f"*NODE\n{NODES}*ELEMENT, TYPE=C3D4, ELSET=PAD\n{CELLS[0]}{CELLS[1]}"
    assert load_mesh(deck(tmp_path, f"{base}*SOLID SECTION, ELSET=PAD\n")).mesh.nelements == 2
    with pytest.raises(MeshError, match=message):
        load_mesh(deck(tmp_path, base + text))


def test_includes_are_limited_in_number(tmp_path: Path) -> None:
    """18 files, each of which includes the next eight times: 8^17 in all."""
    files = {f"f{i}": f"*INCLUDE, INPUT=f{i + 1}.inc\n" * 8 for i in range(17)} | {"f17": "** end\n"}
    begun = time.process_time()
    with pytest.raises(MeshError, match="more than 1000 files"):
        load_mesh(deck(tmp_path, "*INCLUDE, INPUT=f0.inc\n", **files))
    assert time.process_time() - begun < 5


@pytest.mark.parametrize("line", ["*NODE, INPUT={}", "*INCLUDE, INPUT={}", "*ELEMENT, TYPE=C3D4, INPUT={}"])
@pytest.mark.parametrize("kind", ["absolute", "relative", "link"])
def test_includes_lie_inside(line: str, kind: str, tmp_path: Path) -> None:
    """A file of the system is neither read nor shown; with allow_outside no more of it than the keyword is long."""
    (tmp_path / "in").mkdir()
    secret = tmp_path / "secret"
    secret.write_text("password:0:root, hunter2, something, else\n")
    names = {"absolute": str(secret), "relative": "../secret", "link": "b.inc"}
    if kind == "link":
        (tmp_path / "in" / "b.inc").symlink_to(secret)
    text = f"*NODE\n{NODES}{line.format(names[kind])}\n"
    path = deck(tmp_path / "in", text)
    with pytest.raises(MeshError, match="lies outside") as refusal:
        load_mesh(path)
    assert "password" not in str(refusal.value) and "hunter" not in str(refusal.value)
    with pytest.raises(MeshError) as refusal:
        load_mesh(path, allow_outside=True)
    assert "hunter" not in str(refusal.value) and "outside" not in str(refusal.value)
    secret.write_text("5, 1., 1., 1.\n" if "NODE" in line else "")
    (tmp_path / "in" / "near").mkdir()
    inside = deck(tmp_path / "in" / "near", text.replace(names[kind], "../../secret"))
    with pytest.raises(MeshError, match=r"no data lines|no volume elements") as refusal:  # it was read
        load_mesh(inside, folders=[tmp_path])
    assert "outside" not in str(refusal.value)


def test_nastran_includes_lie_inside(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.bdf").write_text("INCLUDE '/etc/hostname'\n")
    with pytest.raises(MeshError, match="lies outside"):
        load_mesh(tmp_path / "in" / "a.bdf")


def test_the_scene_may_allow_what_lies_outside(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "nodes.inc").write_text(NODES)
    deck(tmp_path / "in", f"*NODE, INPUT=../nodes.inc\n*ELEMENT, TYPE=C3D4, ELSET=PAD\n{CELLS[0]}{CELLS[1]}")
    text = '[mesh]\nfile = "a.inp"\n[materials.m]\nyoungs_modulus = 1e9\npoisson_ratio = 0.3\ndensity = 1e3\n'
    scene = tmp_path / "in" / "s.toml"
    scene.write_text(text + '[bodies.PAD]\nmaterial = "m"\n')
    assert main(["check", str(scene)]) == 2
    assert "allow_outside = true" in capsys.readouterr().err
    scene.write_text(scene.read_text().replace('"a.inp"', '"a.inp"\nallow_outside = true'))
    assert main(["check", str(scene)]) == 0


@pytest.fixture
def xdmf(tmp_path: Path) -> Path:
    """An XDMF file of two tetrahedra with its arrays in `two.h5`, which can be read."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
    meshio.write(tmp_path / "two.xdmf", meshio.Mesh(points, [("tetra", np.array([[0, 1, 2, 3], [1, 2, 3, 4]]))]))
    assert load_mesh(tmp_path / "two.xdmf").mesh.nelements == 2
    return tmp_path / "two.xdmf"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no fifos")
@pytest.mark.parametrize("name", ["two.h5", "two.xdmf", "a.inc", "K.mtx"])
def test_pipes_are_not_read(name: str, xdmf: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nobody writes into it, and reading would wait for ever."""
    folder = xdmf.parent
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    if name == "K.mtx":
        assert main(["check", str(matrix_scene(folder, name))]) == 2
        return
    with pytest.raises(MeshError, match=r"regular file|no such mesh file"):
        load_mesh(xdmf if name != "a.inc" else deck(folder, "*NODE, INPUT=a.inc\n"))


@pytest.mark.parametrize("kind", ["link", "storage", "virtual", "outside"])
def test_arrays_in_other_files_are_refused(kind: str, xdmf: Path) -> None:
    """External links, external storage, virtual data sets, and an .h5 file in another place."""
    folder = xdmf.parent
    other, h5 = folder / "other", folder / "two.h5"
    other.mkdir()
    if kind == "outside":
        (folder / "deep").mkdir()
        xdmf = xdmf.rename(folder / "deep" / "two.xdmf")
        xdmf.write_text(xdmf.read_text().replace("two.h5:", "../two.h5:"))
    else:
        h5.rename(other / "all.h5")
        with h5py.File(other / "all.h5") as there, h5py.File(h5, "w") as file:
            for name, data in there.items():
                if kind == "link":
                    file[name] = h5py.ExternalLink(str(other / "all.h5"), name)
                elif kind == "storage":
                    (other / name).write_bytes(data[()].tobytes())
                    file.create_dataset(name, data.shape, data.dtype, external=[(str(other / name), 0, data.nbytes)])
                else:
                    layout = h5py.VirtualLayout(data.shape, data.dtype)
                    layout[...] = h5py.VirtualSource(str(other / "all.h5"), name, shape=data.shape)
                    file.create_virtual_dataset(name, layout)
    with pytest.raises(MeshError, match=r"not followed|lies outside"):
        load_mesh(xdmf)


def bomb(path: Path, size: int, promised: int) -> None:
    """Write a matrix file of zeros and blanks that inflates to so many bytes."""
    head = f"%%MatrixMarket matrix coordinate real general\n3 3 {promised}\n1 1 1.0\n".encode()
    zeros = bytes(size)
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(head + b" " * size, 9))
    elif path.suffix == ".npz":
        stream = io.BytesIO()
        np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (size // 8,)})
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
            for name, array in (("format", np.array(b"csr")), ("shape", np.array([3, 3]))):
                part = io.BytesIO()
                np.save(part, array)
                file.writestr(f"{name}.npy", part.getvalue())
            for name in ("data", "indices", "indptr"):
                file.writestr(f"{name}.npy", stream.getvalue() + zeros)
    else:
        scipy.io.savemat(path, {"K": np.eye(3)}, do_compression=True)
        data = path.read_bytes()
        inner = zlib.decompress(data[136:])
        packed = zlib.compress(inner + zeros, 9)
        path.write_bytes(data[:128] + struct.pack("<2I", 15, len(packed)) + packed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["K.mtx.gz", "K.npz", "K.mat"])
def test_archives_inflate_to_what_they_promise(name: str, tmp_path: Path) -> None:
    """A file of some hundred kB that inflates to 100 MB: refused by its header, and never in memory."""
    bomb(tmp_path / name, 100_000_000, 1)
    assert (tmp_path / name).stat().st_size < 1_000_000
    before = peak_memory_mib() or 0.0
    with pytest.raises(SceneError, match="promise"):
        read_matrix(tmp_path / name)
    assert (peak_memory_mib() or 0.0) - before < 50


@pytest.mark.parametrize("name", ["K.mtx.gz", "K.npz", "K.mat"])
def test_archives_that_do_not_fit_are_not_inflated(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a header promises is held against the free memory."""
    K, path = sp.random_array((400, 400), density=0.5, random_state=1, format="csr"), tmp_path / name
    if name == "K.npz":
        sp.save_npz(path, K)
    elif name == "K.mat":
        scipy.io.savemat(path, {"K": sp.csc_matrix(K)}, do_compression=True)
    else:
        scipy.io.mmwrite(tmp_path / "K.mtx", K)
        path.write_bytes(gzip.compress((tmp_path / "K.mtx").read_bytes()))
    assert abs(read_matrix(path) - K).max() == 0
    monkeypatch.setattr(checks, "available_memory", lambda: 100_000)
    with pytest.raises(SceneError, match="are free"):
        read_matrix(path)


@pytest.mark.parametrize("name", ["K.mtx", "K.npy", "a.inp", "a.msh", "a.vtu"])
def test_files_larger_than_the_memory_are_not_read(name: str, tmp_path: Path) -> None:
    """A file of 10 TB that takes no room on the disc."""
    (tmp_path / name).touch()
    os.truncate(tmp_path / name, 10**13)
    with pytest.raises((MeshError, SceneError), match="are free"):
        (read_matrix if name.startswith("K") else load_mesh)(tmp_path / name)


def test_damaged_measurements_are_told(tmp_path: Path) -> None:
    store = MeasurementFolder(tmp_path)
    for content in (b"", b"PK", b"\x93NUMPY"):
        (tmp_path / "probes_a.npy").write_bytes(content)
        (tmp_path / "a.npz").write_bytes(content)
        with pytest.raises(OutputError, match="measurement is damaged"):
            store.load("a")
        with pytest.raises(OutputError, match="measurement is damaged"):
            store.load_probes("a")


def test_numbers_that_cannot_be_squared_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Found by a spoilt file: NumPy's warnings of overflows came before "backward error nan"."""
    for largest, code in ((1e90, 0), (2e206, 2)):
        scipy.io.mmwrite(tmp_path / "K.mtx", sp.csr_array(np.diag([1.0, 2.0, largest])))
        assert main(["check", str(matrix_scene(tmp_path, "K.mtx"))]) == code
    assert "expected numbers up to 1e+100" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a." * 100_000 + "b = 1\n", "a key of more than 100 parts"),
        ('"a" . ' * 200 + "b = 1\n", "a key of more than 100 parts"),
        ("".join(f"[a{i}]\n" for i in range(60_000)), r"a0: unknown key.* and [56]\d{4} more"),
        ("# " + "x" * 2_000_000, "more than 2 MB"),
    ],
)
def test_scenes_are_of_the_size_of_scenes(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(text)
    begun, before = time.process_time(), peak_memory_mib() or 0.0
    with pytest.raises(SceneError, match=message):
        load_scene(tmp_path / "s.toml")
    assert time.process_time() - begun < 10 and (peak_memory_mib() or 0.0) - before < 400


def test_dots_in_texts_and_numbers_are_no_keys(tmp_path: Path) -> None:
    """A title of a thousand dots, and a list of ten thousand numbers."""
    title, values = "a." * 1000, ", ".join(f"{i / 1e4:.4f}" for i in range(10_000))
    (tmp_path / "s.toml").write_text(f'title = "{title}" # {title}\n[sweep]\nparameter = "mu"\nvalues = [{values}]\n')
    with pytest.raises(SceneError, match="mesh: is missing"):
        load_scene(tmp_path / "s.toml")
