"""The committed scenes, end to end, and the disc again on a finer mesh."""

import json
import subprocess
import sys
import tomllib
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import fe_squeal
import fe_squeal.report.export
from fe_squeal.cli import main

EXAMPLES = Path(__file__).parents[2] / "examples"


def waves_around(result, point, mode):
    """Return the number of waves of a shape's motion along z around the rim of the disc (its upper edge)."""
    discretisation = result.problem.discretisation
    u = discretisation.space.expand(point.shapes[mode])
    disc = np.unique(discretisation.space.dofs.element_dofs[:, discretisation.bodies["disc"]])
    x = discretisation.space.coordinates[disc]
    radius = np.hypot(x[:, 0], x[:, 1])
    rim = disc[(radius > 0.130 - 1e-6) & (x[:, 2] > 0.006 - 1e-9)]
    order = np.argsort(np.arctan2(*discretisation.space.coordinates[rim, :2].T[::-1]))
    spectrum = np.abs(np.fft.fft(u[rim[order], 2]))
    return int(np.argmax(spectrum[: len(rim) // 2] + spectrum[-np.arange(len(rim) // 2)]))


def squealing_pair(size, values):
    """Return the unknowns of a mesh and, of the pair that couples near 4.6 kHz, the onset and the number of waves."""
    scene = tomllib.loads((EXAMPLES / "disc_pad.toml").read_text())
    del scene["mesh"]["file"]
    scene["mesh"]["disc_pad"]["size"] = size
    problem = fe_squeal.assemble(fe_squeal.parse_scene(scene))
    result = fe_squeal.sweep(problem, values, modes=18)
    [onset] = [o for o in result.onsets if 4400 < o.frequency_hz < 4800]
    point = result.points[-1]
    [mode] = [i for i in point.shapes if 4400 < point.modes.frequency_hz[i] < 4800]
    return problem.unknowns, onset, waves_around(result, point, mode)


@pytest.mark.slow
@pytest.mark.long
def test_disc_pad_couples_in_the_range_of_squeal(tmp_path):
    """Golden onset: `fe-squeal run examples/disc_pad.toml`; the scene's own demands are the other assertions."""
    command = [sys.executable, "-m", "fe_squeal", "run", str(EXAMPLES / "disc_pad.toml"), "-o", str(tmp_path)]
    subprocess.run(command, check=True)  # its own process, for its own peak of memory
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["unknowns"] >= 8000 and record["problem_class"] == "nonsymmetric"
    assert (tmp_path / "report.html").stat().st_size < 12e6
    assert record["completeness"]["proven"] and record["completeness"]["found"] == 20
    assert record["peak_memory_mib"] < 2048
    onsets = pd.read_csv(tmp_path / "onsets.csv")
    squeal = onsets[onsets.frequency_hz.between(1e3, 1e4) & onsets.value.between(0.05, 0.6)]
    assert len(squeal) == 3 and (onsets.uncertainty < 1e-6).all()
    np.testing.assert_allclose(onsets.value, [0.11012863, 0.24075268, 0.36667072], rtol=1e-5)
    modes = pd.read_csv(tmp_path / "modes.csv")
    # Past the last onset each of the three pairs has one growing and one decaying mode, exact mirror images.
    last = modes[modes.value == 0.7]
    growing, decaying = (last[last.stability == s].sort_values("im") for s in ("unstable", "stable"))
    assert len(growing) == len(decaying) == 3
    np.testing.assert_allclose(growing.re.to_numpy(), -decaying.re.to_numpy(), rtol=1e-9)
    assert len(list((tmp_path / "shapes").glob("*.png"))) == 3
    # The nodal lines in the pictures, counted by eye.
    assert growing.nodal_diameters.to_list() == [3, 5, 6] and (growing.body == "disc").all()


@pytest.mark.slow
@pytest.mark.long
def test_the_pair_is_the_same_on_a_finer_mesh():
    """21 618 unknowns against 9 486: the critical friction of the 4.6 kHz pair agrees within 10 %."""
    values = [0.33, 0.41]  # 10 % on either side of what is expected: the reduced model of a short interval is cheap
    coarse, onset, waves = squealing_pair(0.014, values)
    fine, refined, fine_waves = squealing_pair(0.0095, values)
    assert fine > 2 * coarse
    assert waves == fine_waves > 0
    assert refined.value == pytest.approx(onset.value, rel=0.1)
    assert refined.frequency_hz == pytest.approx(onset.frequency_hz, rel=0.02)


def test_pad_on_belt_flutters_once(tmp_path, monkeypatch):
    """Golden onset: `fe-squeal run examples/pad_on_belt.toml`, without the pictures of its shapes."""
    monkeypatch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
    assert main(["run", str(EXAMPLES / "pad_on_belt.toml"), "-o", str(tmp_path)]) == 0
    onsets = pd.read_csv(tmp_path / "onsets.csv")
    assert len(onsets) == 1 and onsets.kind[0] == "flutter" and onsets.direction[0] == "into"
    assert onsets.value[0] == pytest.approx(0.27107574, rel=1e-6)


@pytest.mark.parametrize("name", ["disc_pad", "pad_on_belt"])
def test_committed_meshes_come_from_the_scenes_geometry(name, tmp_path):
    """`fe-squeal mesh` remakes the committed file to the byte, and it is small."""
    made = tmp_path / f"{name}.msh"
    assert main(["mesh", str(EXAMPLES / f"{name}.toml"), "-o", str(made)]) == 0
    committed = EXAMPLES.parent / "meshes" / f"{name}.msh"
    assert made.read_bytes() == committed.read_bytes()
    assert committed.stat().st_size < 1e6
