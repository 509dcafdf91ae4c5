"""The reduced model over a box of parameters against dense solves of the whole problem."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from chains import CLASSES, MODES, N, chain

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.request import Request
from fe_squeal.problem.forms import collect_powers
from fe_squeal.problem.terms import Term
from fe_squeal.reduced import BoxModel
from fe_squeal.study.points import sobol_points

NAMES, LOW, HIGH = ("mu", "k"), np.array([0.0, 0.5]), np.array([0.9, 2.0])
TOLERANCE = 1e-7


def problem_of(kind):
    """A chain whose first springs have a stiffness k of their own, beside the friction coefficient."""
    problem = chain(*CLASSES[kind])
    rows = np.arange(N // 8)
    size = float(np.abs(problem.pencil({"mu": 0.0}).K.diagonal()).mean())
    own = sp.csr_array((np.full(len(rows), 0.1 * size), (rows, rows)), shape=(N, N))
    terms = (*problem.terms, Term("own", "K", own, True, {"k": 1}))
    return replace(problem, terms=terms, parameters={**problem.parameters, "k": 1.0}, _sums={}, _unheld={})


def draw(i):
    return [tuple(map(float, LOW + (HIGH - LOW) * u)) for u in sobol_points(20, 2, i)]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nonsymmetric", "quadratic"])
def test_every_mode_all_over_the_box(kind):
    problem = problem_of(kind)
    model = BoxModel(problem, NAMES, LOW, HIGH, draw, Request(MODES, None, TOLERANCE))
    assert model.missed == 0 and model.error < TOLERANCE
    assert 0 < len(model.places) < 12 and len(model.basis) < N // 2
    online = pickle.loads(pickle.dumps(model.online()))
    assert online.whole.basis.V.size == 0 and all(t.matrix.nnz == 0 for t in online.whole.basis.problem.terms)
    for place in draw(0):  # with a margin, as errors elsewhere are larger
        assert online.whole.found(place, model.enough)[0][1].max() <= model.enough
    for place in draw(99)[:4]:
        modes, off, relative = online.modes(place)
        exact = solve_dense(problem.pencil(dict(zip(NAMES, place, strict=True)))).lam
        distance = np.abs(modes.lam[:, None] - exact[None, :]).min(axis=1)
        assert off.max() <= 1 and relative.max() <= TOLERANCE
        rounding = N * np.finfo(float).eps * np.abs(exact).max()
        assert (distance <= np.maximum(relative * np.abs(modes.lam), modes.re_uncertainty) + rounding).all()
        below = np.abs(exact) < 0.999 * np.abs(modes.lam).max()
        assert np.count_nonzero(below) == np.count_nonzero(np.abs(modes.lam) < 0.999 * np.abs(modes.lam).max())


def test_powers_of_several_parameters_are_collected():
    problem = problem_of("nonsymmetric")
    place = {"mu": 0.7, "k": 1.7}
    collected = collect_powers(problem, NAMES)
    assert len(collected.terms) < len(problem.terms) + 1
    for slot in "MK":
        a, b = (getattr(p.pencil(place), slot) for p in (problem, collected))
        assert abs(a - b).max() <= 1e-12 * abs(a).max()
