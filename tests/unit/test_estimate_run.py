"""`run --estimate`: the columns that it fills, what --resume makes of it, and a refined mesh that is too large."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from scene_texts import CRITICAL_MU, SCENE, write_scene

from fe_squeal import load_scene
from fe_squeal.accuracy import estimate, refined
from fe_squeal.accuracy.measure import measure
from fe_squeal.accuracy.settings import Setting
from fe_squeal.cli import main

pytestmark = pytest.mark.usefixtures("no_figures")


def columns(out):
    modes, onsets = (pd.read_csv(out / f"{name}.csv") for name in ("modes", "onsets"))
    return modes[["re_discretisation", "im_discretisation"]], onsets["discretisation"]


@pytest.mark.slow
def test_bars_in_the_tables_and_after_a_resume(tmp_path, capsys):
    scene, out = write_scene(tmp_path, SCENE), tmp_path / "out"
    run = ["run", str(scene), "-o", str(out)]
    assert main(run) == 0
    bars, onsets = columns(out)
    assert bars.isna().all(axis=None) and onsets.isna().all() and len(onsets)
    capsys.readouterr()
    assert main([*run, "--resume", "--estimate"]) == 0  # finished, but without what is asked for now
    assert "have no errors of the mesh: the run starts anew" in " ".join(capsys.readouterr().out.split())
    bars, onsets = columns(out)
    assert (bars.notna().all(axis=1).mean()) > 0.8 and (bars.fillna(0.0) >= 0).all(axis=None)
    assert "estimate" in json.loads((out / "run.json").read_text("utf-8"))["seconds"]
    # The block is all but rigid: its onset hardly feels the mesh, its elastic modes above 10 kHz do.
    table = pd.read_csv(out / "modes.csv")
    onset = pd.read_csv(out / "onsets.csv").iloc[0]
    assert onset["value"] == pytest.approx(CRITICAL_MU, rel=0.05) and 0 < onset["discretisation"] < 0.05 * CRITICAL_MU
    assert table["im_discretisation"].max() / table["im"].max() > onset["discretisation"] / CRITICAL_MU
    capsys.readouterr()
    before = (out / "modes.csv").stat().st_mtime_ns
    assert main([*run, "--resume", "--estimate"]) == 0  # nothing is left to do
    assert (out / "modes.csv").stat().st_mtime_ns == before


@pytest.mark.slow
def test_refined_mesh_that_does_not_fit(tmp_path, capsys, monkeypatch):
    """The results are there without bars, and why is told; a study keeps the rest of the measurement."""
    scene, out = write_scene(tmp_path, SCENE), tmp_path / "out"
    monkeypatch.setattr(refined, "refined_memory", lambda result: 10**18)
    assert main(["run", str(scene), "-o", str(out), "--estimate"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "the error of the mesh is not known" in said and "GiB are free" in said and "would fit" in said
    assert columns(out)[0].isna().all(axis=None)
    found, _ = measure(load_scene(scene), Setting(1, 0.02, 8, "reduced", 1e-8), None, True)
    assert np.isfinite(found.lam).any() and not len(found.likely) and "estimate" in found.seconds


@pytest.mark.slow
def test_an_interrupted_estimate_keeps_the_sweep_and_is_resumed(tmp_path, capsys, monkeypatch):
    """Ctrl-C while the refined mesh is looked at: tables are there, the record says so, and --resume goes on."""
    scene, out = write_scene(tmp_path, SCENE), tmp_path / "out"
    run = ["run", str(scene), "-o", str(out), "--estimate"]
    with monkeypatch.context() as patched:
        patched.setattr(estimate, "CorrectedModel", lambda *args: (_ for _ in ()).throw(KeyboardInterrupt))
        assert main(run) == 130
    assert json.loads((out / "run.json").read_text("utf-8"))["status"] == "interrupted"
    assert len(pd.read_csv(out / "modes.csv")) and columns(out)[0].isna().all(axis=None)
    assert main([*run, "--resume"]) == 0
    assert json.loads((out / "run.json").read_text("utf-8"))["status"] == "complete"
    assert columns(out)[0].notna().all(axis=1).mean() > 0.8


LOOSE = """
[mesh]
order = 1
[mesh.block]
length = 0.05
width = 0.03
height = 0.012
size = 0.015
[materials.rubber]
youngs_modulus = 5.0e8
poisson_ratio = 0.3
density = 1500.0
[bodies.block]
material = "rubber"
[[springs]]
name = "stop"
surface = "right"
direction = [1, 0, 0]
stiffness = 3e6
[[averaged]]
name = "piston"
surface = "top"
{piston}
[[contacts]]
name = "belt"
surface = "bottom"
counterface = "rigid"
normal_stiffness = 1e10
sliding = {{ direction = [1, 0, 0], speed = 3.0 }}
[effects.friction]
mu = 0.5
[effects.rayleigh]
alpha = 5
[sweep]
values = [0.0, 0.6]
[solve]
max_frequency = 4000
[output]
shapes = "none"
report = false
"""


@pytest.mark.slow
@pytest.mark.parametrize("piston", ["mass = 0.2", "springs = [{ direction = [0, 0, 1], stiffness = 1e6 }]"])
def test_a_free_motion_beside_a_stiff_contact(tmp_path, piston):
    """A block that nothing holds sideways, on a contact 1e6 times as stiff as what its modes bend.

    Projected on few vectors, its stiffness has rounding of the contact's forces in it. The motion's λ, 0 and −α or
    slower, are known whatever that is, and every mode gets its bar.
    """
    scene, out = write_scene(tmp_path, LOOSE.format(piston=piston)), tmp_path / "out"
    assert main(["run", str(scene), "-o", str(out), "--estimate"]) == 0
    assert columns(out)[0].notna().all(axis=None)
    table = pd.read_csv(out / "modes.csv")
    free = table[table["frequency_hz"] == 0].groupby("value")["re"].max()
    assert len(free) == 2 and (free == 0).all()
