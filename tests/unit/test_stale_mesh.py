"""A mesh file beside a geometry that it does not belong to any more: told, in what runs and in what checks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scene_texts import SCENE, replaced, write_scene

from fe_squeal.assembly import stale
from fe_squeal.assembly.bodies import read_mesh
from fe_squeal.cli import main
from fe_squeal.geometry import DiscPad, write_mesh
from fe_squeal.scene.file import load_scene

DISC = {"inner_radius": 0.07, "outer_radius": 0.13, "thickness": 0.012, "pads": 2, "pad_inner_radius": 0.085,
        "pad_outer_radius": 0.128, "pad_angle_deg": 50.0, "pad_thickness": 0.011, "size": 0.02}  # fmt: skip


def told(folder, **changed):
    """Notes and warnings of the mesh of DISC where the scene's geometry has changed numbers."""
    if not (folder / "disc.msh").exists():
        write_mesh(DiscPad(**DISC), folder / "disc.msh")
    lines = "".join(f"{key} = {value}\n" for key, value in {**DISC, **changed}.items())
    steel = '[materials.steel]\nyoungs_modulus = 2e11\npoisson_ratio = 0.3\ndensity = 7800.0\n'
    bodies = "".join(f'[bodies.{name}]\nmaterial = "steel"\n' for name in ("disc", "pad_1", "pad_2"))
    path = folder / "disc.toml"
    path.write_text(f'[mesh]\nfile = "disc.msh"\n[mesh.disc_pad]\n{lines}{steel}{bodies}')
    loaded = read_mesh(load_scene(path))
    return loaded.notes, loaded.warnings


def test_the_mesh_of_the_geometry_is_silent(tmp_path):
    assert told(tmp_path) == ((), ())


@pytest.mark.parametrize(("key", "value", "sentence"), [
    ("outer_radius", 0.1301, "disc has the largest radius 0.1301 m, and 0.13 m in the file"),
    ("thickness", 0.0121, "disc has the least z -0.00605 m, and -0.006 m in the file"),
    ("pad_angle_deg", 51.0, "pad_1 has the least x"),
    ("pad_inner_radius", 0.0851, "pad_1 has the least x"),
    ("back_plate_thickness", 0.005, "group"),
])  # fmt: skip
def test_other_dimensions_are_a_warning(tmp_path, key, value, sentence):
    """Each by as little as nobody would see in a picture."""
    notes, [warning] = told(tmp_path, **{key: value})
    assert notes == () and sentence in warning and "to mesh it anew: fe-squeal mesh" in warning


@pytest.mark.parametrize("changed", [{"size": 0.014}, {"disc_layers": 2}, {"disc_grading": 2.0}], ids=str)
def test_other_elements_are_a_note(tmp_path, changed):
    [note], warnings = told(tmp_path, **changed)
    assert warnings == () and "[mesh.disc_pad] asks for" in note


def test_the_order_of_nodes_and_the_unit_do_not_matter(tmp_path, monkeypatch):
    """A block meshed in mm; and the nodes of the file in another order."""
    text = replaced('order = 1\n', 'order = 1\nlength_unit = "mm"\n')
    for length in ("length = 0.08", "width = 0.04", "height = 0.02", "size = 0.02"):
        name, _, value = length.partition(" = ")
        text = text.replace(length, f"{name} = {1e3 * float(value):g}")
    write_scene(tmp_path)  # writes the mesh in m
    scene = load_scene(write_scene(tmp_path, text))
    loaded = read_mesh(scene)
    assert "block has the least x" in loaded.warnings[-1]
    assert main(["mesh", str(tmp_path / "block.toml")]) == 0
    loaded = read_mesh(scene)
    assert loaded.warnings == () and loaded.notes == ()
    monkeypatch.setattr(stale, "make_mesh", lambda geometry, make=stale.make_mesh: _shuffled(make(geometry)))
    assert read_mesh(scene).notes == ()


def _shuffled(raw):
    order = np.random.default_rng(3).permutation(len(raw.points))
    place = np.argsort(order)
    blocks = tuple(replace(b, nodes=place[b.nodes]) for b in raw.blocks)
    surfaces = {name: [place[faces] for faces in every] for name, every in raw.surfaces.items()}
    return replace(
        raw, points=raw.points[order], node_labels=raw.node_labels[order], blocks=blocks, surfaces=surfaces
    )


@pytest.mark.slow
def test_check_and_run_say_it(tmp_path, capsys):
    path = write_scene(tmp_path, SCENE.replace("height = 0.02", "height = 0.021"))
    assert main(["check", str(path)]) == 0
    assert "warning: mesh.file is the mesh that runs" in capsys.readouterr().out.replace("\n", " ")
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 0
    assert "warning: mesh.file is the mesh that runs" in capsys.readouterr().out.replace("\n", " ")
