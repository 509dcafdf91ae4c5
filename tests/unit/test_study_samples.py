"""Samples of a study that are no valid scenes, and scenes that are written of samples."""

from __future__ import annotations

import json
import os
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from fe_squeal.cli import main
from fe_squeal.commands.shared import make_console
from fe_squeal.run.scattered import _write_dangerous
from fe_squeal.scene.file import load_scene
from fe_squeal.study import engine

SCENE = """
[mesh]
order = 1
FILE[mesh.block]
size = 0.02
length = 0.04
width = 0.03
height = 0.02
elements_x = 2
elements_y = 1
layers = 1
[materials.m]
youngs_modulus = MODULUS
poisson_ratio = NU
density = 2000.0
[bodies.block]
material = "m"
[[contacts]]
surface = "bottom"
counterface = "rigid"
normal_stiffness = 1e11
sliding = { direction = [1, 0, 0], speed = 1.0 }
[[springs]]
name = "abut"
surface = "right"
direction = [1, 0, 0]
stiffness = 1e7
[effects.friction]
mu = 0.5
[solve]
modes = 4
[output]
report = false
[study]
samples = 64
indices = false
[study.parameters]
PARAMETERS
"""
ORTHOTROPIC = {"MODULUS": "[2e9, 2e9, 2e9]", "NU": "[0.3, 0.3, 0.3]\nshear_modulus = [8e8, 8e8, 8e8]"}
PLAIN = {"MODULUS": "2e9", "NU": "0.3"}


def write(folder, parameters, file="", **values):
    text = SCENE
    for name, value in {**(values or PLAIN), "PARAMETERS": parameters, "FILE": file}.items():
        text = text.replace(name, value)
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def test_numbers_that_do_not_fit_together_are_refused_before_anything_is_solved(tmp_path, capsys, monkeypatch):
    """Each of two Poisson ratios is possible alone; the elasticity of both at once is not positive definite."""
    monkeypatch.setattr(engine, "solve_chunk", lambda *_: pytest.fail("solved"))
    nu = "\n".join(f'"materials.m.poisson_ratio.{i}" = {{ uniform = {{ low = 0.3, high = 0.72 }} }}' for i in (0, 1))
    assert main(["study", str(write(tmp_path, nu, **ORTHOTROPIC)), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "study.parameters: a sample has numbers that do not fit together" in said and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_sample_that_fails_says_which_and_what_is_finished_stays(tmp_path, capsys, monkeypatch):
    """Here the mesh of a geometry; a static state where a contact opens fails likewise."""
    from fe_squeal.errors import MeshError
    from fe_squeal.study import models

    made, assemble = [], models.assemble

    def failing(scene, **options):
        made.append(scene)
        if len(made) > engine.CHUNK + 3:
            raise MeshError("elements are flat")
        return assemble(scene, **options)

    monkeypatch.setattr(models, "assemble", failing)
    height = '"mesh.block.height" = { uniform = { low = 0.015, high = 0.03 } }'
    out = tmp_path / "out"
    assert main(["study", str(write(tmp_path, height)), "-o", str(out)]) == 2
    said = capsys.readouterr().err
    assert "study, at mesh.block.height = 0.0" in said and "elements are flat" in said and said.count("\n") == 1
    assert f"what was finished before is in {out / 'parts'}" in said
    assert [p.name for p in sorted((out / "parts").glob("*.npz"))] == ["samples_00000.npz"]
    assert json.loads((out / "study.json").read_text())["status"] == "not converged"


@pytest.mark.slow
def test_scenes_of_samples_have_the_geometry_of_the_sample(tmp_path):
    """The file of the mesh, which is the scene's own, does not stand beside it: it would be what runs."""
    path = write(tmp_path, '"mesh.block.height" = { uniform = { low = 0.015, high = 0.03 } }')
    assert main(["mesh", str(path), "-o", str(tmp_path / "block.msh")]) == 0
    path = write(tmp_path, '"mesh.block.height" = { uniform = { low = 0.015, high = 0.03 } }',
                 'file = "block.msh"\n')  # fmt: skip
    path.write_text(path.read_text().replace("samples = 64", "samples = 8").replace("mu = 0.5", "mu = 2.0"))
    assert main(["study", str(path), "-o", str(tmp_path / "out")]) == 0
    written = [load_scene(p) for p in (tmp_path / "out" / "dangerous").glob("*.toml")]
    assert written and all(s.mesh.file is None and s.mesh.block.height != 0.02 for s in written)
    assert len({s.mesh.block.height for s in written}) == len(written)
    assert np.all([0.015 <= s.mesh.block.height <= 0.03 for s in written])


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are any bytes there alone")
def test_samples_that_no_scene_can_name_the_mesh_of_are_left_out(tmp_path, capsys):
    """TOML is UTF-8; the study itself is there."""
    points, rows = np.full((4, 1), 0.7), np.ones((4, 6))
    result = SimpleNamespace(dangerous=lambda count: [3], names=("mu",), points=points, rows=rows)
    for name, written in ((b"caf\xe9", []), (b"cafe", ["dangerous/sample_00004.toml"])):
        folder = tmp_path / os.fsdecode(name)
        folder.mkdir()
        scene = load_scene(write(folder, "mu = { values = [0.1, 0.7] }", 'file = "block.msh"\n'))
        assert _write_dangerous(scene, result, tmp_path / "out", make_console()) == written
    assert [load_scene(p).effects.friction.mu for p in (tmp_path / "out" / "dangerous").iterdir()] == [0.7]
    assert capsys.readouterr().out.count("no sample is written as a scene") == 1


def test_corners_of_a_map_that_do_not_fit_are_refused_before_anything_is_solved(tmp_path, capsys, monkeypatch):
    """The ends of each axis are possible with the scene's own other number; both Poisson ratios of a corner are not."""
    monkeypatch.setattr(engine, "solve_chunk", lambda *_: pytest.fail("solved"))
    path = write(tmp_path, "", **ORTHOTROPIC)
    axes = (f'[study.{k}]\nparameter = "materials.m.poisson_ratio.{i}"\nfrom = 0.3\nto = 0.72\npoints = 3\n'
            for i, k in enumerate("xy"))  # fmt: skip
    path.write_text(path.read_text().partition("[study]")[0] + "".join(axes))
    assert main(["study", str(path), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {path}: stability_map: a corner has numbers that do not fit together: materials.m.")
    assert said.count("\n") == 1 and not (tmp_path / "out").exists()
