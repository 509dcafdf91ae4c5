"""Files of parametric meshes: units, the same bytes each time, gmsh left as it was, what is refused."""

from __future__ import annotations

import math
import subprocess
import sys
from importlib.abc import MetaPathFinder
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
from brakes import BLOCK, BRAKE, ROW
from pydantic import ValidationError

from fe_squeal.errors import MeshError, OutputError
from fe_squeal.geometry import Block, DiscPad, make_mesh, tetrahedra, write_mesh
from fe_squeal.geometry.structured import structured_disc_pad
from fe_squeal.geometry.tetrahedra import write_tetrahedra
from fe_squeal.mesh.readers.gmsh import read_gmsh


def test_millimetres_give_the_same_mesh_a_thousand_times_larger() -> None:
    lengths = {key: value if key == "pad_angle_deg" else value * 1000.0 for key, value in BRAKE.items()}
    metres, millimetres = structured_disc_pad(DiscPad(**BRAKE)), structured_disc_pad(DiscPad(**lengths))
    np.testing.assert_allclose(millimetres.points, 1000.0 * metres.points, rtol=0, atol=1e-13)
    blocks = Block(**BLOCK), Block(**{key: 1000 * value for key, value in BLOCK.items()})
    assert blocks[0].block_counts == blocks[1].block_counts  # 0.015 / 0.01 falls just below 1.5 in floating point


@pytest.mark.parametrize("geometry", [DiscPad(**BRAKE), DiscPad(**BRAKE, element="tet"), Block(**ROW, element="tet")])
def test_same_geometry_gives_the_same_bytes(geometry: DiscPad | Block, tmp_path: Path) -> None:
    first, second = (write_mesh(geometry, tmp_path / name).read_bytes() for name in ("a.msh", "b.msh"))
    assert first == second
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.msh", "b.msh"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "geometry",
    [Block(**BLOCK), DiscPad(**BRAKE), DiscPad(**{**BRAKE, "pad_angle_deg": 360.0}), Block(**ROW, element="tet"),
     DiscPad(**BRAKE, element="tet")],
)  # fmt: skip
def test_the_mesh_in_memory_is_that_of_the_file(geometry: DiscPad | Block, tmp_path: Path) -> None:
    """Node by node and cell by cell; gmsh writes 16 digits, of which the last may be one off."""
    here, there = make_mesh(geometry), read_gmsh(write_mesh(geometry, tmp_path / "a.msh"))
    np.testing.assert_allclose(here.points, there.points, rtol=0, atol=0 if geometry.element == "hex" else 1e-16)
    np.testing.assert_array_equal(here.node_labels, there.node_labels)
    for mine, read in zip(here.blocks, there.blocks, strict=True):
        assert mine.kind == read.kind
        np.testing.assert_array_equal(mine.nodes, read.nodes)
        np.testing.assert_array_equal(mine.labels, read.labels)
    assert list(here.volume_groups) == list(there.volume_groups) and list(here.surfaces) == list(there.surfaces)
    for name, cells in there.volume_groups.items():
        np.testing.assert_array_equal(here.volume_groups[name], cells)
    for name, parts in there.surfaces.items():
        for mine, read in zip(here.surfaces[name], parts, strict=True):
            np.testing.assert_array_equal(mine, read)


@pytest.mark.parametrize("mine", ["mine", "fe_squeal"])
def test_gmsh_of_the_caller_is_left_as_it_was(tmp_path: Path, mine: str) -> None:
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 123.0)
        gmsh.model.add(mine)
        gmsh.model.occ.addPoint(1.0, 2.0, 3.0)
        gmsh.model.occ.synchronize()
        models = gmsh.model.list()
        write_mesh(Block(**BLOCK, element="tet"), tmp_path / "block.msh")
        assert gmsh.isInitialized()
        assert gmsh.model.getCurrent() == mine and gmsh.model.getEntities() == [(0, 1)]
        assert gmsh.model.list() == models
        assert gmsh.option.getNumber("Mesh.MeshSizeMax") == 123.0
    finally:
        gmsh.finalize()
    write_mesh(Block(**BLOCK, element="tet"), tmp_path / "block.msh")
    assert not gmsh.isInitialized()


def test_what_fails_behind_gmsh_is_no_failure_of_meshing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that cannot be written, memory that ends while the mesh is taken over."""
    block = Block(**BLOCK, element="tet")
    with pytest.raises(OSError, match="Unable to open file"):
        write_tetrahedra(block, tmp_path / "none" / "block.msh")
    monkeypatch.setattr(tetrahedra, "raw_mesh", lambda *_: exec("raise MemoryError"))
    with pytest.raises(MemoryError):
        make_mesh(block)


@pytest.mark.slow
def test_broken_pipes_stay_errors(tmp_path: Path) -> None:
    """Python ignores SIGPIPE, so that writing to a reader that is gone raises; gmsh would have it end the process."""
    code = """
import os, sys
from fe_squeal.geometry import Block, write_mesh
write_mesh(Block(length=0.02, width=0.02, height=0.01, size=0.01, element="tet"), sys.argv[1])
reader, writer = os.pipe()
os.close(reader)
try:
    os.write(writer, b"x")
except BrokenPipeError:
    print("raised")
"""
    done = subprocess.run([sys.executable, "-c", code, tmp_path / "a.msh"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "raised"), done.stderr


def test_gmsh_not_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "gmsh", None)
    with pytest.raises(MeshError, match="pip install gmsh"):
        write_mesh(Block(**BLOCK, element="tet"), tmp_path / "block.msh")
    assert list(tmp_path.iterdir()) == []
    assert write_mesh(DiscPad(**BRAKE), tmp_path / "brake.msh").exists()  # hexahedra need no gmsh


@pytest.mark.parametrize(("library", "package"), [("libGLU.so.1", "libglu1-mesa"), ("libXft.so.2", "libxft2")])
def test_gmsh_without_its_system_libraries(
    library: str, package: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    class Broken(MetaPathFinder):
        def find_spec(self, fullname: str, path: object, target: object = None) -> None:
            if fullname == "gmsh":
                raise OSError(f"{library}: cannot open shared object file: No such file or directory")

    monkeypatch.delitem(sys.modules, "gmsh")
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    with pytest.raises(MeshError, match=f"apt-get install {package}") as caught:
        write_mesh(Block(**BLOCK, element="tet"), tmp_path / "block.msh")
    assert library in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.slow
def test_importing_the_package_does_not_import_gmsh() -> None:
    code = "import sys, fe_squeal.geometry; print('gmsh' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_failure_keeps_the_old_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fail(mesh: object, path: Path) -> None:
        path.write_text("half")
        raise KeyboardInterrupt

    path = write_mesh(Block(**BLOCK), tmp_path / "block.msh")
    before = path.read_bytes()
    monkeypatch.setattr("fe_squeal.geometry.writing.write_msh", fail)
    with pytest.raises(KeyboardInterrupt):
        write_mesh(Block(**BLOCK), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_paths_and_sizes_that_cannot_be(tmp_path: Path) -> None:
    block = Block(**BLOCK)
    with pytest.raises(OutputError, match=r"ends in \.msh"):
        write_mesh(block, tmp_path / "block.vtu")
    with pytest.raises(OutputError, match="there is no folder"):
        write_mesh(block, tmp_path / "nowhere" / "block.msh")
    (tmp_path / "folder.msh").mkdir()
    with pytest.raises(OutputError, match="cannot be written"):
        write_mesh(block, tmp_path / "folder.msh")
    for change in ({"size": 1e-5}, {"size": 1e-5, "element": "tet"}, {"size": 1e-310}, {"layers": 10**6}):
        with pytest.raises(MeshError, match="choose a larger size"):
            write_mesh(Block(**{**BLOCK, **change}), tmp_path / "block.msh")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"outer_radius": 0.05}, "expected inner_radius < outer_radius"),
        ({"pad_outer_radius": 0.085}, "expected pad_inner_radius < pad_outer_radius"),
        ({"pad_inner_radius": 0.13, "pad_outer_radius": 0.15}, "does not lie over the disc"),
        ({"pad_inner_radius": 0.03, "pad_outer_radius": 0.07}, "does not lie over the disc"),
        ({"pad_angle_deg": 0}, "pad_angle_deg"),
        ({"pad_angle_deg": 361}, "pad_angle_deg"),
        ({"size": 0}, "size"),
        ({"size": math.inf}, "size"),
        ({"size": "0.01"}, "size"),
        ({"gap": -1e-4}, "gap"),
        ({"thickness": math.nan}, "thickness"),
        ({"pads": 3}, "pads"),
        ({"pads": True}, "pads"),
        ({"element": "brick"}, "element"),
        ({"geometry_order": 3}, "geometry_order"),
        ({"disc_layers": 0}, "disc_layers"),
        ({"back_plate_layers": 1, "back_plate_thickness": 0}, "there is no back plate"),
        ({"disc_layers": 2, "element": "tet"}, 'layers belong to element = "hex"'),
        ({"pad_radius": 0.1}, "pad_radius"),
    ],
    ids=str,
)
def test_bad_disc_pad_is_rejected(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        DiscPad(**{**BRAKE, **change})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 0}, "count"),
        ({"count": 1.0}, "count"),
        ({"spacing": 0.01}, "there is one block"),
        ({"count": 2, "spacing": -0.01}, "spacing"),
        ({"belt_margin_x": 0.01}, "there is no belt"),
        ({"belt_layers": 2}, "there is no belt"),
        ({"layers": 2, "element": "tet"}, 'layers belong to element = "hex"'),
        ({"height": -0.01}, "height"),
    ],
    ids=str,
)
def test_bad_block_is_rejected(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Block(**{**BLOCK, **change})
