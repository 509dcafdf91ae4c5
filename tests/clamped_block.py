"""A clamped block on a rigid belt, the scene of searches for a mesh."""

from __future__ import annotations

BLOCK = """
title = "A clamped block on a rigid belt"
[mesh]
order = {order}
[mesh.block]
length = 0.08
width = 0.04
height = 0.02
size = 0.02
element = "{element}"
[materials.steel]
youngs_modulus = 2e11
poisson_ratio = 0.3
density = 7800.0
[bodies.block]
material = "steel"
[[supports]]
surface = "left"
fixed = "xyz"
[[contacts]]
name = "belt"
surface = "bottom"
counterface = "rigid"
normal_stiffness = 1e12
sliding = {{ direction = [1.0, 0.0, 0.0], speed = 1.0 }}
[effects.friction]
mu = 0.3
[sweep]
parameter = "mu"
from = 0.0
to = 0.3
points = 2
[solve]
modes = 5
"""


def write(folder, element="hex", order=2, report=False):
    path = folder / "block.toml"
    output = "" if report else "[output]\nreport = false\n"
    path.write_text(BLOCK.format(element=element, order=order) + output, encoding="utf-8")
    return path
