"""The text of a scene, a block of eight hexahedra on a rigid belt that flutters at μ = 0.4, and ways to change it."""

from __future__ import annotations

import cmath
import csv
import os
import re
from pathlib import Path
from typing import Any

from varied_imports import SEED, SHUFFLE, SOLVER

from fe_squeal.geometry import Block, write_mesh

_STARTED = str(Path(__file__).parent / "started")  # has what Python imports at its start

# A rigid block of mass m moves along x and z like the minimal model of two degrees of freedom. The springs give
# K_xx = K_zz = K0 (with the contact), and the inclined ones K_xz = -COUPLING. Friction changes K_xz to
# -COUPLING + mu * CONTACT, so that theta = (K0 ± sqrt(COUPLING * (COUPLING - mu * CONTACT))) / m.
MASS = 7800.0 * 0.08 * 0.04 * 0.02
K0, COUPLING, CONTACT = 1.0e7, 4.0e5, 1.0e6
CRITICAL_MU = COUPLING / CONTACT

HEAD = """\
title = "block on a belt"
[mesh]
file = "block.msh"
order = 1
[mesh.block]
length = 0.08
width = 0.04
height = 0.02
size = 0.02
[materials.steel]
youngs_modulus = 2.0e11
poisson_ratio = 0.3
density = 7800.0
[bodies.block]
material = "steel"
"""
SPRINGS = "".join(
    f'[[springs]]\nname = "{name}"\nsurface = "{surface}"\ndirection = {direction}\nstiffness = {stiffness}\n'
    for name, surface, direction, stiffness in (
        ("inclined_1", "front", [-1.0, 0.0, 1.0], COUPLING),
        ("inclined_2", "back", [-1.0, 0.0, 1.0], COUPLING),
        ("normal_1", "left", [0.0, 0.0, 1.0], (K0 - COUPLING - CONTACT) / 2),
        ("normal_2", "right", [0.0, 0.0, 1.0], (K0 - COUPLING - CONTACT) / 2),
        ("along_1", "left", [1.0, 0.0, 0.0], (K0 - COUPLING) / 2),
        ("along_2", "right", [1.0, 0.0, 0.0], (K0 - COUPLING) / 2),
        ("across", "front", [0.0, 1.0, 0.0], 2.0e7),
    )
)
CONTACTS = f"""\
[[contacts]]
name = "belt"
surface = "bottom"
counterface = "rigid"
normal_stiffness = {CONTACT / (0.08 * 0.04)}
sliding = {{ direction = [1, 0, 0], speed = 1.0 }}
"""
TAIL = """\
[effects.friction]
mu = 0.3
[sweep]
parameter = "mu"
from = 0.0
to = 0.8
points = 5
[solve]
modes = 8
[output]
shapes = "none"
report = false
"""
SCENE = HEAD + SPRINGS + CONTACTS + TAIL
TABLES_AND_FIGURES = {
    "manifest.sha256", "modes.csv", "onsets.csv", "contributions.csv", "sensitivities.csv", "run.json",
    "stability.png", "root_locus.png", "contributions.png",
}  # fmt: skip


def growth_of_rigid_block(mu: float) -> float:
    """Return Re λ of the rigid block, 1/s; zero below the critical friction."""
    theta = (K0 + cmath.sqrt(COUPLING * (COUPLING - mu * CONTACT))) / MASS
    return abs((1j * cmath.sqrt(theta)).real)


def write_scene(folder: Path, text: str = SCENE, name: str = "block.toml") -> Path:
    """Write the scene and, if it does not exist yet, its mesh."""
    if not (folder / "block.msh").exists():
        write_mesh(Block(length=0.08, width=0.04, height=0.02, size=0.02), folder / "block.msh")
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def replaced(old: str, new: str, text: str = SCENE) -> str:
    """Return the scene with the first `old` replaced; it is an error of the test if the scene does not have `old`."""
    assert old in text, old
    return text.replace(old, new, 1)


def without(pattern: str, text: str = SCENE) -> str:
    """Return the scene without the text that a regular expression finds."""
    shorter = re.sub(pattern, "", text, flags=re.DOTALL)
    assert shorter != text, pattern
    return shorter


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file as text."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def environment(**more: Any) -> dict[str, str]:
    """Return the environment for a subprocess that uses one thread, and varies as this process does."""
    values = {**os.environ, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", **more}
    if any(values.get(name) for name in (SEED, SHUFFLE, SOLVER)):
        values["PYTHONPATH"] = os.pathsep.join(filter(None, (_STARTED, values.get("PYTHONPATH"))))
    return values
