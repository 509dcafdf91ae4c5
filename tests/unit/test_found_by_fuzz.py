"""What spoilt scenes and meshes have found once: each ended in a traceback, a warning of Python or a broken message."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from pictures import ink
from scene_texts import SCENE, replaced, write_scene

import fe_squeal.run.run
from fe_squeal.cli import main
from fe_squeal.errors import MeshError, SceneError
from fe_squeal.fem.spaces import make_space
from fe_squeal.geometry import Block, write_mesh
from fe_squeal.mesh import load_mesh
from fe_squeal.report.shapes import ShapeGrid
from fe_squeal.report.vtk_files import names_in, write_shape
from fe_squeal.scene.file import load_scene
from meshes import box

INP = """\
*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 0., 0., 1.
*ELEMENT, TYPE=C3D4, ELSET=PAD
1, 1, 2, 3, 4
"""


@pytest.mark.parametrize(
    ("tail", "refusal"),
    [
        (f"*ELEMENT, TYPE=MASS, ELSET=M\n1{'0' * 30}, 1\n", None),
        ("*ELEMENT, TYPE=MASS, ELSET=M\n\u00b2, 1\n", None),
        ("*NSET, NSET=N\n\u00b2\n*SURFACE, NAME=S, TYPE=NODE\nN\n", "\u00b2"),
        ("*NSET, NSET=N\n--1\n*SURFACE, NAME=S, TYPE=NODE\nN\n", "--1"),
        (f"*NSET, NSET=N, GENERATE\n{2**70}, {2**70 + 3}, 1\n*SURFACE, NAME=S, TYPE=NODE\nN\n", "GENERATE takes"),
        ("*ELEMENT, TYPE=S3, ELSET=SKIN\n\u00b2, 1, 2, 3\n", None),
    ],
)
def test_abaqus_labels(tmp_path: Path, tail: str, refusal: str | None) -> None:
    """Numbers beyond 64 bits, digits that are no ASCII, two signs."""
    (tmp_path / "a.inp").write_text(INP + tail, encoding="utf-8")
    if refusal is None:
        assert load_mesh(tmp_path / "a.inp").mesh.nelements == 1
    else:
        with pytest.raises(MeshError, match=refusal):
            load_mesh(tmp_path / "a.inp")


@pytest.mark.parametrize("number", ["1e200", "-1e300", "1e20"])
def test_coordinates_whose_products_overflow(tmp_path: Path, number: str) -> None:
    (tmp_path / "a.inp").write_text(INP.replace("4, 0., 0., 1.", f"4, 0., 0., {number}"))
    with warnings.catch_warnings(), pytest.raises(MeshError, match="coordinates of node 4 are beyond"):
        warnings.simplefilter("error")
        load_mesh(tmp_path / "a.inp")


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('material = "steel"', 'material = "steel"\naxes = [[1, 0, 0], [1e300, 1, 0]]', "bodies.block.axes"),
        ("[effects.fr", "[effects.preload]\npressures = { top = 1e300 }\n[effects.fr", "effects.preload.pressures"),
        ("size = 0.02", f"size = 0.02\nrefinement = 1{'0' * 400}", "mesh.block.refinement"),
    ],
)
def test_numbers_inside_lists_and_tables_have_limits_too(tmp_path: Path, old: str, new: str, key: str) -> None:
    with warnings.catch_warnings(), pytest.raises(SceneError, match=f"{key}: "):
        warnings.simplefilter("error")
        load_scene(write_scene(tmp_path, replaced(old, new)))


@pytest.mark.slow
def test_sweep_without_any_mode(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A loss factor of 1e38 leaves no eigenvalue that the law is meant for; `modes` was asked for, no frequency."""
    scipy.io.mmwrite(tmp_path / "M.mtx", 2 * sp.eye_array(4))
    scipy.io.mmwrite(tmp_path / "K.mtx", sp.diags_array([[3.0, 4, 5, 6], [-1.0] * 3, [-1.0] * 3], offsets=[0, 1, -1]))
    terms = [("mass", "M"), ("stiffness", "K"), ("stiffness", "K")]
    text = "".join(f'[[terms]]\nrole = "{role}"\nfile = "{name}.mtx"\n' for role, name in terms)
    (tmp_path / "a.toml").write_text(text + "scale = 1e38\nimaginary = true\n")
    assert main(["run", str(tmp_path / "a.toml"), "-o", str(tmp_path / "out")]) == 0
    assert "warning: no mode is determined, so nothing is shown" in capsys.readouterr().out


def test_messages_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Names with line breaks and the commands of terminals in them."""
    text = SCENE.replace('surface = "bottom"', f"surface = {json.dumps(chr(10) + chr(27) + '[2J')}")
    assert main(["check", str(write_scene(tmp_path, text))]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and r'"\n\x1b[2J"' in said and "\x1b" not in said


def test_names_beyond_ascii_in_shapes(tmp_path: Path) -> None:
    """pyvista refuses them as text arrays; VTK and ParaView do not."""
    import pyvista

    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    grid = ShapeGrid(points, np.array([[0, 1, 2, 3]]), 10, np.array([0]), ("Bremsbelag äußen",))
    about = {"parameter": "springs.Führung.damping", "value": 1.0}
    write_shape(grid, np.ones((4, 3), complex), tmp_path / "a.vtu", about)
    read = pyvista.read(tmp_path / "a.vtu")
    assert names_in(read, "body") == ["Bremsbelag äußen"]
    assert names_in(read, "parameter") == ["springs.Führung.damping"]
    assert read.field_data["value"][0] == 1.0


@pytest.mark.slow
def test_dollars_in_titles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two of them are mathematics to Matplotlib, and most text between them is none."""
    text = SCENE.replace("block on a belt", r"from 5 $ \\frac to 6 $").replace('name = "belt"', r'name = "$\\frac$"')
    assert main(["run", str(write_scene(tmp_path, text)), "-o", str(tmp_path / "out")]) == 0
    written = ink(tmp_path / "out" / "contributions.png")[:60]  # the title stands there as it was given
    assert 0.01 < written.mean() < 0.3


@pytest.mark.slow
def test_memory_that_runs_out_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """While results are written, too: what was solved is kept for --resume."""
    def fail(*_: object) -> None:
        raise MemoryError

    path = write_scene(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(fe_squeal.run.run, "write_figures", fail)
        assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 2
    assert "more memory is needed than the" in capsys.readouterr().err
    assert main(["run", str(path), "-o", str(tmp_path / "out"), "--resume"]) == 0
    assert "resuming: 5 of 5 values are finished" in capsys.readouterr().out


def test_huge_geometry_is_refused_before_it_is_assembled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("fe_squeal.eigen.memory.available_memory", lambda: 2**27)
    text = replaced("order = 1", "order = 2", replaced("size = 0.02", "size = 0.002"))
    text = replaced('file = "block.msh"\n', "", text)
    assert main(["run", str(write_scene(tmp_path, text)), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "the matrices of" in said and "of memory, 128 MiB are free; about" in said and "order = 1" in said


@pytest.mark.parametrize("kind", ["hex1", "hex2", "tet2"])
def test_meshes_far_from_the_origin(kind: str) -> None:
    """Elements of 1 cm at 1 km: facets are integrated as they are at the origin, and beyond all digits are refused."""
    near = box(kind, (3, 2, 2), (0.03, 0.02, 0.02))
    for offset, digits in ((1e3, 1e-9), (1e5, 1e-7)):
        far = near.translated((offset, -offset, offset))
        areas = [
            make_space(mesh, 2, []).surface(np.sort(mesh.boundaries["top"])).area for mesh in (near, far)
        ]
        assert areas[1] == pytest.approx(areas[0], rel=digits) == pytest.approx(0.03 * 0.02, rel=digits)
    lost = near.translated((1e9, 0.0, 0.0))
    with pytest.raises(MeshError, match="from the origin, where rounding hides their shape"):
        make_space(lost, 2, []).surface(np.sort(lost.boundaries["top"]))


def test_mesh_of_one_block_is_still_fine(tmp_path: Path) -> None:
    """The control of the tests above."""
    write_mesh(Block(length=0.08, width=0.04, height=0.02, size=0.02), tmp_path / "block.msh")
    assert load_mesh(tmp_path / "block.msh").mesh.nelements == 8
