"""Threads, seeds and numbering are nobody's business: the answer stays within what it says of itself.

See tests/unit/test_reduced.py for the seeds of the reduced model.
"""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hard_problems import SMALL, brake, digits
from renumbering import renumbered
from selection import some

import fe_squeal
from fe_squeal.eigen import shift_invert
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes

ROOT = Path(__file__).parents[2]
MU = 0.3


def spectrum(problem, count=12):
    modes = solve_modes(problem.pencil(mu=MU), Request(count=count))
    return modes, fe_squeal.find_onsets(problem, [0.2, 0.23], modes=8)


@functools.cache
def plain():
    """Return problem and spectrum as they are, to compare with."""
    problem = brake()
    return problem, spectrum(problem)


def assert_same(a, b) -> float:
    """Compare modes and onsets within their uncertainties; return the digits that agree."""
    (modes, onsets), (others, theirs) = a, b
    assert modes.stability.tolist() == others.stability.tolist()
    blur = modes.re_uncertainty + others.re_uncertainty + 1e-9 * np.abs(modes.lam)
    assert (np.abs(modes.lam - others.lam) <= blur).all()
    assert len(onsets) == len(theirs) == 1
    assert abs(onsets[0].value - theirs[0].value) <= onsets[0].uncertainty + theirs[0].uncertainty + 1e-9
    return digits(modes.lam, others.lam)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_start_vectors(record, monkeypatch, seed):
    """Krylov methods start at random: another start is another rounding, and near clusters another set of modes."""
    problem, first = plain()
    monkeypatch.setattr(shift_invert, "_SEED", seed)
    record(assert_same(first, spectrum(problem)), "the same within the uncertainties")


SCRIPT = """
import json, sys
sys.path.insert(0, {tests!r})
from hard_problems import brake
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
modes = solve_modes(brake().pencil(mu={mu}), Request(count=12))
print(json.dumps([modes.lam.real.tolist(), modes.lam.imag.tolist(), modes.re_uncertainty.tolist(),
                  modes.stability.tolist()]))
"""


@pytest.mark.slow
def test_one_thread_and_two(record):
    """Sums of threads come in another order. In processes of their own, since libraries read the number once."""
    found = []
    for threads in ("1", "2"):
        names = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
        environment = {**os.environ, **dict.fromkeys(names, threads), "PYTHONPATH": str(ROOT)}
        code = SCRIPT.format(tests=str(ROOT / "tests"), mu=MU)
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        re, im, blur, verdicts = json.loads(done.stdout.splitlines()[-1])
        found.append((np.array(re) + 1j * np.array(im), np.array(blur), verdicts))
    (a, u, verdicts), (b, v, others) = found
    assert verdicts == others
    assert (np.abs(a - b) <= u + v + 1e-9 * np.abs(a)).all()
    record(digits(a, b), "the same within the uncertainties")


@pytest.mark.parametrize("seed", some([0, 1], lambda seed: seed == 0))
@pytest.mark.parametrize("size", ["dense", "sparse"])
def test_node_and_element_numbers(record, size, seed):
    """Nodes and elements numbered anew at random: other pivots, other sums, and in careless code other normals and
    partners. λ, verdicts and onsets stay."""
    counts = {"counts": SMALL} if size == "dense" else {}
    same = plain()[0] if size == "sparse" else brake(**counts)
    other = brake(**counts, change=lambda mesh: renumbered(mesh, seed)[0])
    a, b = same.pencil(mu=MU).K, other.pencil(mu=MU).K
    assert a.shape == b.shape and (a != b).nnz > 0
    if size == "dense":
        modes, others = (solve_modes(p.pencil(mu=MU), Request(count=12)) for p in (same, other))
        assert modes.stability.tolist() == others.stability.tolist()
        np.testing.assert_allclose(modes.lam, others.lam, rtol=1e-8)
        record(digits(modes.lam, others.lam), "the same λ, verdicts and onsets")
    else:
        record(assert_same(plain()[1], spectrum(other)), "the same λ, verdicts and onsets")
