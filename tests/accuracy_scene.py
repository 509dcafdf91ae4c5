"""The smallest scene for a study of accuracy, and made-up measurements."""

from __future__ import annotations

import numpy as np

from fe_squeal.accuracy.measure import Measurement

TINY = """
title = "pad on a belt"
[mesh]
order = 2
[mesh.block]
length = 0.08
width = 0.04
height = 0.02
size = 0.02
[materials.lining]
youngs_modulus = 2.0e9
poisson_ratio = 0.25
density = 2600.0
[bodies.block]
material = "lining"
[[springs]]
name = "back"
surface = "top"
direction = [0, 0, 1]
stiffness = 2.0e7
[[springs]]
name = "side"
surface = "right"
direction = [1, 0, 0]
stiffness = 5.0e7
[[springs]]
name = "guide"
surface = "right"
direction = [0, 1, 0]
stiffness = 1.0e7
[[contacts]]
surface = "bottom"
counterface = "rigid"
normal_stiffness = 1.0e10
sliding = { direction = [1, 0, 0], speed = 1.0 }
[effects.friction]
mu = 0.4
[sweep]
parameter = "mu"
from = 0.0
to = 0.6
points = 3
[solve]
modes = 8
"""


def fake(lam, shapes, onsets=(), changes=(), appeared=()):
    """With the likely values 1.4 of the changes away, uncertain by 0.6 of these, where changes are given."""
    lam = np.array([lam, lam], complex)
    rows, new = (np.array(own, float).reshape(-1, 6) for own in (onsets, appeared))
    changes = np.array(changes, complex).reshape(-1, lam.shape[1])
    bars = 0.6 * (np.abs(changes.real) + 1j * np.abs(changes.imag))
    likely = np.column_stack([rows[:, 0], np.zeros(len(rows))])
    return Measurement(
        1, {"assembly": 1.0}, 1.0, np.array([0.0, 1.0]), lam, shapes, shapes, rows, lam[: len(changes)] + 1.4 * changes,
        bars, likely, new,
    )  # fmt: skip
