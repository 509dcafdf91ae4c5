"""Thousands of spoilt scenes: each ends in results or in one message, and soon, and takes no memory to speak of."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from mutations import dump, growth_of_memory, mutated_bytes, mutated_data, needs_timer, outcome
from scene_texts import SCENE, environment
from selection import amount

import fe_squeal.run.run
from fe_squeal.eigen.memory import peak_memory_mib
from fe_squeal.geometry import Block, write_mesh

pytestmark = needs_timer
COUNT = amount(125, 250)  # scenes of a round; more with other seeds: tests/again.py
MOST_MIB = 500.0  # that a round may add to the peak of the process

SHORT = SCENE.replace("points = 5", "points = 2").replace("modes = 8", "modes = 4")
EFFECTS = """\
[effects.preload]
pressures = { top = 1.0e5 }
mu = "swept"
[effects.friction_damping]
[effects.falling_friction]
slope = -0.02
[effects.rayleigh]
alpha = 10.0
beta = 1.0e-8
[effects.structural_damping]
reference_frequency_hz = 2000.0
[effects.stress_stiffening]
[effects.friction]"""
ORTHOTROPIC = """\
title = "orthotropic block"
[mesh]
length_unit = "mm"
order = 1
[mesh.block]
length = 80.0
width = 40.0
height = 20.0
size = 80.0
[materials.lining]
youngs_modulus = [2.0e9, 3.0e9, 1.0e9]
shear_modulus = [4.0e8, 5.0e8, 6.0e8]
poisson_ratio = [0.2, 0.1, 0.15]
density = 2600.0
loss_factor = 0.01
[bodies.block]
material = "lining"
axes = [[1, 0, 0], [0, 1, 0]]
rayleigh = { alpha = 10.0, beta = 1e-8 }
[[supports]]
surface = "top"
fixed = "xyz"
[[springs]]
name = "a"
surface = "left"
to = "right"
direction = [1, 0, 0]
stiffness = 1e7
damping = 3.0
[[contacts]]
surface = "bottom"
counterface = "rigid"
normal_stiffness = 1e10
normal_damping = 10.0
gap_tolerance = 1e-3
friction_ratio = 0.5
sliding = { axis = [0, 0, 1], centre = [1, 0, 0], speed = 5.0 }
[effects.friction]
mu = 0.3
[sweep]
parameter = ["materials.lining.density", "springs.a.damping"]
values = [1.0, 2.0]
[solve]
max_frequency = 30000.0
[output]
shapes = "none"
"""
MATRICES = """\
title = "matrices"
[parameters]
mu = 1.0
omega = 6.28
[[terms]]
role = "stiffness"
file = "K.mtx"
[[terms]]
role = "stiffness"
file = "KR.mat"
variable = "KR"
powers = { mu = 1, omega = -2 }
[[terms]]
role = "mass"
file = "M.npz"
scale = 2.0
[[terms]]
role = "stiffness"
file = "K.mtx"
scale = 0.01
imaginary = true
[sweep]
parameter = "mu"
from = 0.0
to = 2.0
points = 2
[output]
shapes = "none"
"""
BASES = [SHORT, SHORT.replace("[effects.friction]", EFFECTS), ORTHOTROPIC, MATRICES]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a mesh of one hexahedron and small matrices."""
    folder = tmp_path_factory.mktemp("fuzz")
    write_mesh(Block(length=0.08, width=0.04, height=0.02, size=0.08), folder / "block.msh")
    K = sp.diags_array([[3.0, 4, 5, 6], [-1.0] * 3, [-1.0] * 3], offsets=[0, 1, -1], format="csr")
    scipy.io.mmwrite(folder / "K.mtx", K)
    scipy.io.savemat(folder / "KR.mat", {"KR": np.triu(np.ones((4, 4)), 1)})
    sp.save_npz(folder / "M.npz", sp.eye_array(4, format="csr"))
    return folder


@pytest.fixture(autouse=True)
def _no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fe_squeal.run.run, "write_figures", lambda *_: None)
    monkeypatch.setattr(fe_squeal.run.run, "write_preload", lambda *_: None)
    monkeypatch.setattr(fe_squeal.run.run, "exporting_shapes", lambda *_: nullcontext())


def spoilt(rng: np.random.Generator, number: int) -> bytes:
    text = BASES[number % len(BASES)]
    if number % 3 == 0:
        return mutated_bytes(text.encode(), rng)
    data: dict[str, Any] = mutated_data(tomllib.loads(text), rng)
    return dump(data).encode("utf-8", "surrogatepass")


@pytest.mark.slow
@pytest.mark.parametrize("base", BASES)
def test_scenes_are_good_before_they_are_spoilt(
    place: Path, base: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for text in (base, dump(tomllib.loads(base))):
        (place / "good.toml").write_text(text, encoding="utf-8")
        assert outcome(["run", str(place / "good.toml"), "-o", str(place / "out")], place / "out", capsys)[0] == 0
        shutil.rmtree(place / "out")


@pytest.mark.slow
def test_spoilt_scenes(
    place: Path, other_seed: int, capsys: pytest.CaptureFixture[str], recwarn: pytest.WarningsRecorder
) -> None:  # fmt: skip
    """A good scene behind them all still runs: none leaves anything behind, and not all are refused for nothing."""
    rng = np.random.default_rng([1, other_seed] if other_seed else 1)
    path, out = place / "scene.toml", place / "out"
    before = peak_memory_mib()
    codes = []
    for number in range(COUNT):
        path.write_bytes(spoilt(rng, number))
        command = "run" if number % 5 else "check"
        arguments = [command, str(path), *(["-o", str(out)] if command == "run" else [])]
        try:
            codes.append(outcome(arguments, out, capsys)[0])
        except BaseException:
            (place / f"failed_{number}.toml").write_bytes(path.read_bytes())
            print(f"number {number}: {place}/failed_{number}.toml")
            raise
        finally:
            shutil.rmtree(out, ignore_errors=True)
    path.write_text(BASES[1], encoding="utf-8")
    assert outcome(["run", str(path), "-o", str(out)], out, capsys)[0] == 0
    shutil.rmtree(out)
    # One spoilt scene in seven is still good (measured on 320 of them). By chance 10 or fewer of 250 are in one round
    # out of a million; the fewer scenes that are the same in every run have enough of them.
    assert codes.count(0) > COUNT // 25
    assert codes.count(2) > COUNT // 2
    assert growth_of_memory(peak_memory_mib, before) < MOST_MIB


FORKED = """
import contextlib, os, runpy, sys, traceback
import fe_squeal.cli
with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
    fe_squeal.cli.main(["check", "good.toml"])
for number in range(int(sys.argv[1])):
    child = os.fork()
    if not child:
        os.dup2(os.open(f"{number}.err", os.O_WRONLY | os.O_CREAT), 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.argv = ["fe-squeal", "check", f"{number}.toml"]
        try:
            runpy.run_module("fe_squeal", run_name="__main__")
        except SystemExit as end:
            os._exit(end.code or 0)
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("count", "seed", "whole"), [(30, 50, False), (2, 51, True)])
def test_through_the_command(
    place: Path, tmp_path: Path, count: int, seed: int, other_seed: int, whole: bool
) -> None:
    """Processes of their own, in which stderr is the system's: 30 forked from one that has checked a good scene, since
    what a command imports takes longest, and two from the start."""
    rng = np.random.default_rng([seed, other_seed] if other_seed else seed)
    for path in (*place.glob("*.m*"), place / "M.npz"):
        shutil.copy(path, tmp_path)
    for number in range(count):
        (tmp_path / f"{number}.toml").write_bytes(spoilt(rng, number))
    (tmp_path / "good.toml").write_text(BASES[0], encoding="utf-8")
    options = {"cwd": tmp_path, "env": environment(), "capture_output": True, "encoding": "utf-8", "timeout": 120}
    if whole:
        commands = [[sys.executable, "-m", "fe_squeal", "check", f"{number}.toml"] for number in range(count)]
        done = [subprocess.run(command, **options) for command in commands]  # type: ignore[call-overload]
        codes, said = [d.returncode for d in done], [d.stderr for d in done]
    else:
        parent = subprocess.run([sys.executable, "-c", FORKED, str(count)], **options)  # type: ignore[call-overload]
        codes = [int(line) for line in parent.stdout.split()]
        said = [(tmp_path / f"{number}.err").read_text("utf-8") for number in range(count)]
        assert {0, 2} <= set(codes)
    assert len(codes) == count and set(codes) <= {0, 2, 3}
    for code, text in zip(codes, said, strict=True):
        assert text.count("\n") == (code != 0) and "Traceback" not in text
        assert code == 0 or text.startswith(("error: ", "not converged: "))
