"""Two modes with closed forms: where they flutter, with which probability, and the Sobol indices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse as sp

from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term

STIFFNESS = 1.0e8  # rad²/s²: frequencies of about 1.6 kHz
TERMS = """
title = "two modes"
[parameters]
mu = 0.1
delta = 0.1
[[terms]]
role = "mass"
file = "M.mtx"
[[terms]]
role = "stiffness"
file = "K.mtx"
[[terms]]
role = "stiffness"
file = "gap.mtx"
powers = { delta = 1 }
[[terms]]
role = "stiffness"
file = "friction.mtx"
powers = { mu = 1 }
[output]
report = false
"""
SCATTER = """
[study]
samples = SAMPLES
bands = [0, 1610, 3000]
[study.parameters]
mu = { uniform = { low = 0.0, high = 0.1 } }
delta = { uniform = { low = 0.0, high = 0.3 } }
"""
FILES = {"m": "M", "k": "K", "gap": "gap", "friction": "friction"}  # of the terms, as the scene names them


def two_modes(coupling: float = 1.0, damping: float = 0.0) -> Problem:
    """Return K = k [[1, mu c], [−mu c, 1 + delta]], M = 1: θ = k (1 + δ/2 ± √(δ²/4 − μ²c²)), flutter where δ < 2μc."""
    matrices = {
        "m": ("M", np.eye(2), True, {}),
        "k": ("K", STIFFNESS * np.eye(2), True, {}),
        "gap": ("K", STIFFNESS * np.diag([0.0, 1.0]), True, {"delta": 1}),
        "friction": ("K", STIFFNESS * coupling * np.array([[0.0, 1.0], [-1.0, 0.0]]), False, {"mu": 1}),
        "dampers": ("C", np.sqrt(STIFFNESS) * np.eye(2), True, {"c": 1}),
    }  # fmt: skip
    terms = [Term(n, slot, sp.csr_array(A), symmetric, p) for n, (slot, A, symmetric, p) in matrices.items()]
    kept = terms if damping else terms[:-1]
    return Problem(tuple(kept), {"delta": 0.1, "mu": 0.1, **({"c": damping} if damping else {})})


def write_study(folder: Path, study: str, samples: int = 64) -> Path:
    """Write a scene of two modes without damping and its matrices, with a study, and return its path."""
    for term in two_modes().terms:
        scipy.io.mmwrite(folder / f"{FILES[term.name]}.mtx", sp.coo_array(term.matrix))
    path = folder / "scene.toml"
    path.write_text(TERMS + study.replace("SAMPLES", str(samples)))
    return path
