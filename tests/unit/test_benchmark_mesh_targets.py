"""Scenes with targets, the smallest of them as the page has it."""

from __future__ import annotations

import chamfered
import mesh_targets as page
import numpy as np
import pytest
from chamfered import chamfered_scene, write_chamfered
from scipy.integrate import quad

import fe_squeal
from fe_squeal.accuracy.settings import own_setting, scene_at
from fe_squeal.assembly.bodies import read_mesh
from fe_squeal.mesh.measures import area_of


def test_scenes_differ_and_can_be_made_finer():
    cases = page.cases(3)
    tables = [scene.mesh.geometry.model_dump_json() for scene, _, _ in cases.values()]
    assert len({t for t in tables if "thickness" in t}) >= 5  # the example, with one pad, and three random ones
    assert all(0 < target < 1 for _, target, _ in cases.values())
    assert page.random_brake(1) == page.random_brake(1) != page.random_brake(2)
    assert page.random_brake(2).effects.rayleigh is not None and page.random_brake(1).effects.rayleigh is None
    assert page.random_pad(1) == page.random_pad(1) != page.random_pad(2)
    assert page.random_pad(2).effects.rayleigh is not None and page.random_pad(1).effects.rayleigh is None
    scene, _, _ = cases["random brake 0, onsets"]
    own = own_setting(scene)
    counts = scene.model_copy(
        update={"mesh": scene.mesh.model_copy(update={"disc_pad": scene.mesh.disc_pad.with_counts({})})}
    )
    finer, loaded = scene_at(counts, type(own)(2, own.size / 2, 6, "reduced", 1e-8))
    assert loaded.mesh.nelements == finer.mesh.geometry.cells == 8 * scene.mesh.geometry.cells


@pytest.mark.slow
def test_a_row():
    scene, _, _ = page.cases(0)["soft pad on a belt"]
    mesh = scene.mesh.model_copy(update={"block": scene.mesh.block.resized(0.02)})
    scene = scene.model_copy(update={"mesh": mesh, "sweep": scene.sweep.model_copy(update={"points": 5})})
    found = page.reach("soft pad", scene, 0.05)
    assert found["true"] <= found["bar"] <= 0.05 and found["unknowns"] >= found["first"]
    assert page.row(found).count("|") == page.PAGE.partition("|---|")[0].splitlines()[-1].count("|")


@pytest.mark.slow
def test_the_mesh_from_a_file_has_chamfers_and_slots(tmp_path):
    """The faces of its pads are sectors without the strips of slot and chamfers, to what parabolas make of arcs; bodies
    touch there and have no node in common."""
    scene = chamfered_scene(write_chamfered(tmp_path / "chamfered.msh", 0.03))
    loaded = read_mesh(scene)

    inner, outer = chamfered.PAD_INNER, chamfered.PAD_OUTER

    def strip(low, high):
        return quad(lambda y: np.sqrt(outer**2 - y**2) - np.sqrt(inner**2 - y**2), low, high)[0]

    whole = chamfered.ANGLE / 2 * (outer**2 - inner**2)
    half = chamfered.SLOT / 2
    area = whole - strip(-half, half) - 2 * strip(0, chamfered.CHAMFER)
    for name in ("pad_face_1", "pad_face_2"):
        assert area_of(loaded.mesh, loaded.mesh.boundaries[name])[0] == pytest.approx(area, rel=2e-3)
    assert fe_squeal.assemble(scene, loaded).unknowns > 3000
