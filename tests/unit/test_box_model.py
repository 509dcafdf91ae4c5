"""The reduced model over a box of parameters against dense solves of the whole problem."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from chains import CLASSES, MODES, N, chain
from selection import some

from fe_squeal.eigen import block_lanczos
from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.request import Request
from fe_squeal.problem.forms import collect_powers
from fe_squeal.problem.problem import Problem
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


def test_numbers_with_few_values_are_drawn_again():
    """Many places are equal, and all draws have the same ones."""
    problem = chain(*CLASSES["nonsymmetric"])

    def few(i):
        return [(0.45 * k,) for k in np.random.default_rng(i).integers(3, size=20).tolist()]

    model = BoxModel(problem, ("mu",), LOW[:1], HIGH[:1], few, Request(MODES, None, TOLERANCE))
    assert (model.checked, model.missed) == (3, 0)
    for place in set(few(0)):
        modes, off, _ = model.online().modes(place)
        exact = solve_dense(problem.pencil({"mu": place[0]})).lam
        assert off.max() <= 1
        assert (np.abs(modes.lam[:, None] - exact[None, :]).min(axis=1) <= TOLERANCE * np.abs(modes.lam)).all()


def test_powers_of_several_parameters_are_collected():
    problem = problem_of("nonsymmetric")
    place = {"mu": 0.7, "k": 1.7}
    collected = collect_powers(problem, NAMES)
    assert len(collected.terms) < len(problem.terms) + 1
    for slot in "MK":
        a, b = (getattr(p.pencil(place), slot) for p in (problem, collected))
        assert abs(a - b).max() <= 1e-12 * abs(a).max()


def lone(soft, n=120):
    """n oscillators of θ = 10, 20, …, the last one softened into the lowest few by x, or by x and y at one place."""

    def at(value):
        return sp.csr_array(([float(value)], ([n - 1], [n - 1])), shape=(n, n))

    theta = np.arange(1.0, n + 1) * 10
    theta[-1] = 605.0 if soft == "corner" else 5 + 1000 * (0.62**2 + 0.37**2)
    terms = [Term("mass", "M", sp.eye_array(n, format="csr"), True),
             Term("elastic", "K", sp.csr_array(sp.diags_array(theta)), True),
             Term("damper", "C", sp.csr_array(0.02 * sp.eye_array(n)), True),
             Term("springs", "K", sp.eye_array(n, format="csr"), True, {"y": 1})]  # fmt: skip
    if soft == "corner":
        return Problem((*terms, Term("soft", "K", at(-600), True, {"x": 1})), {"x": 0.1, "y": 0.1}), theta
    more = [("xx", 1000, {"x": 2}), ("x", -1240, {"x": 1}), ("yy", 1000, {"y": 2}), ("yl", -740, {"y": 1})]
    terms += [Term(name, "K", at(size), True, powers) for name, size, powers in more]
    return Problem(tuple(terms), {"x": 0.1, "y": 0.1}), theta


@pytest.mark.parametrize("soft", some(["corner", "inside"], lambda soft: soft == "corner"))
def test_a_mode_that_a_negative_stiffness_brings_into_the_range(soft):
    """What softens with a rising number is softest where that is large; inside the box modes have to be counted."""
    problem, theta = lone(soft)

    def places(i):
        return [tuple(map(float, u)) for u in sobol_points(60, 2, i)]

    model = BoxModel(problem, ("x", "y"), np.zeros(2), np.ones(2), places, Request(6, None, 1e-6))
    assert model.proven == (soft == "corner") and model.missed == 0
    came = 0
    for x, y in places(99):
        own = 605 - 600 * x if soft == "corner" else 5 + 1000 * ((x - 0.62) ** 2 + (y - 0.37) ** 2)
        exact = np.sort(np.sqrt(np.append(theta[:-1], own) + y - 1e-4))[:6]
        np.testing.assert_allclose(np.sort(model.modes((x, y)).lam.imag)[:6], exact, rtol=1e-6)
        came += own < 55
    assert came >= 3


def test_a_mode_that_the_first_iteration_misses_is_counted(monkeypatch):
    """Neither other places nor the search tell of it: modes are those of the basis, and here a search is blind."""

    def without_one(*arguments):
        theta, vectors = block_lanczos.lowest_modes(*arguments)
        return np.delete(theta, 2), np.delete(vectors, 2, axis=1)

    monkeypatch.setattr("fe_squeal.reduced.begun.lowest_modes", without_one)
    monkeypatch.setattr("fe_squeal.reduced.growing.search_vectors", lambda basis, factor: np.zeros((len(basis.V), 0)))
    problem, theta = lone("corner")

    def places(i):
        return [tuple(map(float, u)) for u in sobol_points(20, 2, i)]

    model = BoxModel(problem, ("x", "y"), np.zeros(2), np.ones(2), places, Request(6, None, 1e-6))
    exact = np.sort(np.sqrt(np.append(theta[:-1], 605.0 - 600 * 0.2) + 0.3 - 1e-4))[:6]
    np.testing.assert_allclose(np.sort(model.modes((0.2, 0.3)).lam.imag)[:6], exact, rtol=1e-6)
