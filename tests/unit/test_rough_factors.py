"""Factors in single precision, which corrections are made with, and when others are computed instead."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from chains import CLASSES, MODES, chain
from selection import some

import fe_squeal.eigen.linear.choice as choice
from fe_squeal import sweep
from fe_squeal.eigen.linear.choice import (
    factorize_definite_roughly,
    factorize_roughly,
    factorize_with_care,
    negative_eigenvalues,
)
from fe_squeal.eigen.linear.pardiso import PARDISO, PardisoFactor
from fe_squeal.eigen.linear.refinement import contraction, refined
from fe_squeal.eigen.request import Request
from fe_squeal.errors import NotConvergedError
from fe_squeal.reduced import ReducedModel

N = 300
pytestmark = pytest.mark.usefixtures("needs_pardiso")


def bar(n=N, moved=0.0):
    """A bar of springs, one end held, moved by a multiple of the unit matrix; all eigenvalues are below 4."""
    beside = -np.ones(n - 1)
    return sp.csr_array(sp.diags_array([beside, np.full(n, 2.0 - moved), beside], offsets=[-1, 0, 1]))


def kinds():
    rng = np.random.default_rng(5)
    slip = sp.random_array((N, N), density=0.005, random_state=rng)
    A = bar(moved=0.01)
    return {
        "symmetric": (A, True), "general": (sp.csr_array(A + slip), False),
        "complex": (sp.csr_array(A + 1j * slip), False), "complex symmetric": (sp.csr_array(A + 0.1j * bar()), True),
    }  # fmt: skip


@pytest.mark.parametrize("kind", kinds())
@pytest.mark.parametrize("unit", [1.0, 1e-200, 1e200, 3e40])
def test_solves_are_those_of_the_matrix_to_single_precision(kind, unit):
    """In any unit, though numbers of single precision end at 1e38; refined, they are exact."""
    A, symmetric = kinds()[kind]
    factor = PARDISO.rough.factorize(A * unit, symmetric)
    b = np.random.default_rng(6).standard_normal((N, 3)) * [1.0, 1e-100, 1e60]
    b[:, 1] = 0.0
    for B in (b, b[:, 0], b * (1 + 2j)):
        for solve, dense in (
            (factor.solve, A.toarray()), (factor.solve_transposed, A.T.toarray()),
            (factor.solve_adjoint, A.conj().T.toarray()),
        ):  # fmt: skip
            exact = np.linalg.solve(dense, B) / unit
            got = solve(B)
            assert got.shape == B.shape and got.dtype.itemsize >= 8 and np.iscomplexobj(got) == np.iscomplexobj(exact)
            size = np.abs(exact).max(axis=0)
            off = np.abs(got - exact).max(axis=0)
            assert np.all(off <= 1e-2 * size)
            assert off.max() > 0  # else they would not be single
    rho = contraction(A, lambda x: factor.solve(x) * unit)
    assert 1e-9 < rho < 1e-2
    x = refined(A, lambda x: factor.solve(x) * unit, b[:, 0], rho)
    np.testing.assert_allclose(A @ x, b[:, 0], atol=1e-12)


def test_the_inertia_is_that_of_the_matrix():
    A = bar(moved=0.5)
    factor = factorize_roughly(lambda: A, True)
    assert contraction(A, factor.solve) > 1e-9  # it is single
    assert factor.negative_pivots == np.count_nonzero(np.linalg.eigvalsh(A.toarray()) < 0)


@pytest.mark.parametrize("unit", [1.0, 1e60])
def test_halves_make_the_whole_to_single_precision(unit):
    A = bar() * unit
    Z = factorize_definite_roughly(lambda: A).half_solve(np.eye(N))
    assert Z.dtype == float
    exact = np.linalg.inv(bar().toarray())
    np.testing.assert_allclose((Z @ Z.T) * unit, exact, atol=1e-2 * exact.max())


@pytest.mark.parametrize("near", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("symmetric", [True, False])
def test_what_single_precision_cannot_solve_is_factorised_in_double(near, symmetric):
    """The nearer the lowest eigenvalue is to zero, the more of a residual remains."""
    lowest = 4 * np.sin(np.pi / (N + 1) / 2) ** 2
    A = bar(moved=lowest * (1 - near))
    assert contraction(A, PARDISO.rough.factorize(A, symmetric).solve) > (0.1 if near < 1e-4 else 1e-6)
    assert contraction(A, factorize_roughly(lambda: A, symmetric).solve) < choice._ROUGH
    assert contraction(A, factorize_definite_roughly(lambda: A).solve) < choice._ROUGH


def test_a_definite_matrix_that_single_precision_takes_for_another_is_factorised():
    A = bar(moved=4 * np.sin(np.pi / (N + 1) / 2) ** 2 * (1 - 1e-6))
    assert np.linalg.eigvalsh(A.toarray())[0] > 0
    x = factorize_definite_roughly(lambda: A).solve(np.ones(N))
    np.testing.assert_allclose(A @ x, 1.0, atol=1e-3)
    with pytest.raises(NotConvergedError):
        factorize_definite_roughly(lambda: bar(moved=0.5))


@pytest.mark.parametrize("effects", [(), *some([(("damper",),), (("loss",),)], lambda _: False)])
def test_a_sweep_is_as_exact_by_them(effects, monkeypatch):
    values = np.linspace(0.0, 0.8, 5)

    def lam():
        found = sweep(chain(*effects, n=400), values, modes=6, method="reduced")
        return [p.modes.lam for p in found.points]

    made = []
    single = PARDISO.rough
    monkeypatch.setattr(choice, "_MANY", 0)
    monkeypatch.setattr(choice, "_rough", lambda _: made.append(1) or single)
    rough = lam()
    monkeypatch.setattr(choice, "_rough", lambda _: None)
    assert made
    for one, other in zip(rough, lam(), strict=True):
        np.testing.assert_allclose(np.sort_complex(one), np.sort_complex(other), rtol=1e-7)


@pytest.mark.parametrize("unit", [1.0, 1e30])
def test_large_definite_matrices_are_factorised_roughly(unit, monkeypatch):
    A = bar(1000) * unit
    off = [contraction(A, factorize_with_care(lambda: A).solve)]
    monkeypatch.setattr(choice, "_MANY", 0)
    off.append(contraction(A, factorize_with_care(lambda: A).solve))
    assert off[0] < 1e-9 < off[1] < choice._ROUGH
    with pytest.raises(NotConvergedError):
        factorize_with_care(lambda: bar(moved=0.5))


@pytest.mark.parametrize("kind", some(["nonsymmetric", "complex with C"], lambda kind: kind == "nonsymmetric"))
def test_a_reduced_model_begins_with_rough_factors(kind, monkeypatch):
    """As that of a large problem does; its eigenvalues are those of double precision within the tolerance."""
    problem, values = chain(*CLASSES[kind]), np.linspace(0.0, 0.9, 7)
    usual = ReducedModel(problem, "mu", values, Request(count=MODES))
    monkeypatch.setattr(choice, "_MANY", 0)
    large = ReducedModel(problem, "mu", values, Request(count=MODES))
    assert large.worst <= 1e-8
    for p in values.tolist():
        np.testing.assert_allclose(large.modes(p).lam, usual.modes(p).lam, rtol=3e-8)


@pytest.mark.parametrize("near", [0.5, 1e-9])
def test_eigenvalues_are_counted_by_rough_factors_that_show_the_same_number(near, monkeypatch):
    """Near an eigenvalue the rough ones do not show it, and others count."""
    lowest = 4 * np.sin(np.pi / (N + 1) / 2) ** 2
    made = []
    make = PardisoFactor.__init__

    def noted(self, *args, single=False, **more):
        made.append(single)
        make(self, *args, single=single, **more)

    monkeypatch.setattr(PardisoFactor, "__init__", noted)
    monkeypatch.setattr(choice, "_MANY", 0)
    for side, expected in ((-1, 0), (1, 1)):
        made.clear()
        assert negative_eigenvalues(bar(moved=lowest * (1 + side * near))) == expected
        assert made == ([True] if near == 0.5 else [True, False])
