"""Sweeps over a parameter that changes matrices, on a reduced model: against dense solves and direct sweeps."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
from chains import CLASSES, MODES, PATCH, N, Opening, dense
from selection import some

from fe_squeal import sweep
from fe_squeal.eigen.request import Request
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.tabulated import Tabulated
from fe_squeal.problem.terms import Term
from fe_squeal.reduced import ReducedModel
from fe_squeal.reduced.corners import softest_value

VALUES = np.linspace(0.0, 0.9, 4)
REQUEST = Request(count=MODES)


def made(kind, mu=0.3):
    return Opening(*CLASSES[kind]).problem({"mu": mu})


@cache
def swept(kind, method, precise=False):
    """Return a sweep, which several tests look at."""
    return sweep(made(kind), VALUES, modes=MODES, method=method, precise=precise)


@pytest.mark.parametrize("kind", CLASSES)
def test_a_table_has_the_matrices_of_its_values(kind):
    """At each value the sum of the terms is that of the problem; at others there is none."""
    problem = made(kind)
    table = Tabulated.of(problem, "mu", 0.0)
    for mu in (0.9, 0.45):
        table = table.with_value(mu)
    for mu in (0.0, 0.45, 0.9):
        ours, exact = table.pencil({"mu": mu}), problem.pencil({"mu": mu})
        for name in ("M", "C", "K"):
            A, B = getattr(ours, name), getattr(exact, name)
            if B is None or not abs(B).max():
                assert A is None or not abs(A).max()
            else:
                assert abs(A - B).max() <= 4 * np.finfo(float).eps * abs(B).max()
        assert ours.symmetric == exact.symmetric
    with pytest.raises(KeyError, match=r"0\.3 is not in the table"):
        table.pencil({"mu": 0.3})


def test_terms_of_a_value_have_the_entries_that_change():
    """Where contacts open and nothing else moves, few entries; where nothing changes, no term."""

    class Still(Opening):
        def problem(self, values):
            made = super().problem(values)
            terms = tuple(t for t in made.terms if t.name != "stress")
            return Problem(terms, made.parameters, None, self, made.coupled, made.changed)

    table = Tabulated.of(Still().problem({}), "mu", 0.2)
    (friction,) = (t for t in Tabulated.with_value(table, 0.4).terms if t.only and not t.symmetric)
    assert 0 < friction.matrix.nnz <= 4 * PATCH
    assert all(not t.depends_on(["mu"]) for t in table.terms) and friction.depends_on(["mu"])
    assert friction.coefficient({"mu": 0.4}) == 1.0 and friction.coefficient({"mu": 0.2}) == 0.0


def test_a_matrix_that_is_only_there_at_some_values():
    """A damper that begins at one value, and a spring that ends there, are terms of the table."""

    class Switched:
        def problem(self, values):
            p = values["p"]
            terms = [
                Term("mass", "M", sp.csr_array(np.eye(2)), True), Term("ground", "K", sp.csr_array(np.eye(2)), True),
            ]  # fmt: skip
            if p > 0:
                terms.append(Term("damper", "C", sp.csr_array(p * np.eye(2)), True))
            else:
                terms.append(Term("loss", "K", sp.csr_array(0.1 * np.eye(2)), True, imaginary=True))
            return Problem(tuple(terms), {"p": p}, None, self, frozenset({"p"}), dict(values))

    source = Switched()
    table = Tabulated.of(source.problem({"p": -1.0}), "p", -1.0).with_value(2.0)
    for p in (-1.0, 2.0):
        ours, exact = table.pencil({"p": p}), source.problem({"p": p}).pencil()
        np.testing.assert_array_equal(ours.K.toarray(), exact.K.toarray())
        assert (ours.C is None) == (exact.C is None)
        assert ours.C is None or (ours.C.toarray() == exact.C.toarray()).all()


@pytest.mark.parametrize("kind", some(CLASSES, lambda kind: kind == "nonsymmetric"))
def test_every_mode_at_every_value(kind):
    """Within the tolerance and the uncertainty of LAPACK's on the whole problem; none missing."""
    problem, result = made(kind), swept(kind, "reduced")
    assert result.method.startswith("reduced model of")
    for point in result.points:
        exact, lam = dense(problem, point.value), point.modes.lam
        distance = np.abs(lam[:, None] - exact[None, :]).min(axis=1)
        rounding = N * np.finfo(float).eps * np.abs(exact).max()
        assert (distance <= 1e-8 * np.abs(lam)).all()
        assert (distance <= point.modes.re_uncertainty + rounding).all()
        below = exact.imag < 0.999 * lam.imag.max()
        assert np.count_nonzero(below) == np.count_nonzero(lam.imag < 0.999 * lam.imag.max())


def test_errors_are_told_where_points_of_a_stiff_contact_have_opened():
    """Measured by the stiffness of the contact that is closed, at mu = 0, they would be seven times as large as told.

    A stress that stiffens everything a little leaves the start where friction is least.
    """
    problem = Opening(n=200, stiffer=1e4).problem({})
    assert softest_value(problem, "mu", VALUES) == VALUES[-1]
    assert softest_value(Opening(n=200, stiffer=0.0).problem({}), "mu", VALUES) == VALUES[0]
    model = ReducedModel(problem, "mu", VALUES, REQUEST)
    for mu in (0.3, 0.6, 0.8):
        modes, exact = model.modes(mu), dense(problem, mu)
        swings = modes.lam.imag > 1e-6 * model.highest  # of others `dense` gives none
        distance = np.abs(modes.lam[swings, None] - exact[None, :]).min(axis=1)
        rounding = 200 * np.finfo(float).eps * np.abs(exact).max()
        assert (distance <= modes.re_uncertainty[swings] + rounding).all()


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "precise"), [
    *((kind, False) for kind in CLASSES), ("nonsymmetric", True), ("complex", True),
])  # fmt: skip
def test_onsets_are_those_of_direct_solves(kind, precise):
    direct, reduced = swept(kind, "direct"), swept(kind, "reduced", precise)
    assert len(reduced.onsets) == len(direct.onsets)
    assert direct.onsets or "damp" in kind
    for a, b in zip(reduced.onsets, direct.onsets, strict=True):
        assert a.value == pytest.approx(b.value, rel=1e-7, abs=1e-8)  # some are at the start itself, by rounding
        assert abs(a.value - b.value) <= a.uncertainty + b.uncertainty
        assert (a.kind, a.direction) == (b.kind, b.direction)
    assert len(reduced.warnings) == len(direct.warnings)


@pytest.mark.parametrize("kind", some(["nonsymmetric", "quadratic"], lambda kind: kind == "nonsymmetric"))
def test_a_stored_model_gives_the_same_modes(kind):
    """Its values come back in the order in which its terms were made."""
    problem = made(kind)
    model = ReducedModel(problem, "mu", VALUES, REQUEST)
    between = 0.31
    expected = [model.modes(float(v)).lam for v in (*VALUES, between)]
    again = ReducedModel.restored(problem, "mu", VALUES, REQUEST, *model.stored())
    for value, lam in zip((*VALUES, between), expected, strict=True):
        np.testing.assert_allclose(again.modes(float(value)).lam, lam, rtol=1e-9)
    np.testing.assert_array_equal(again.basis.V, model.basis.V)


def test_projected_terms_and_their_derivative():
    """The small problem is made anew at each value, as the whole one; so is its derivative by the parameter."""
    problem = made("quadratic")
    model = ReducedModel(problem, "mu", VALUES, REQUEST)
    V = model.basis.V
    for small in (model.projected, model.collected):
        assert not small.is_affine("mu")
        for mu in (0.3, 0.37, 0.9):
            ours, exact = small.pencil({"mu": mu}), problem.pencil({"mu": mu})
            for name in ("M", "C", "K"):
                A = V.T @ getattr(exact, name) @ V
                np.testing.assert_allclose(getattr(ours, name).toarray(), A, atol=1e-10 * np.abs(A).max())
        for mu in (0.37, 1e-15):  # also where a step relative to the value would be rounding
            high, low = (problem.pencil({"mu": mu + s * 1e-4}).K for s in (1, -1))
            A = V.T @ ((high - low) @ V) / 2e-4
            slope = small.derivative("mu", "K", {"mu": mu})
            np.testing.assert_allclose(slope.toarray(), A, atol=1e-6 * np.abs(A).max())
    names = [t.name for t in model.projected.at({"mu": 0.5}).terms]
    assert names == [t.name for t in problem.at({"mu": 0.5}).terms]  # for shares in a mode's energy


@pytest.mark.slow
def test_a_number_that_no_coefficient_has():
    """As Poisson's ratio: it is in no term's powers and in no static state, and changes matrices all the same."""

    class Unlisted(Opening):
        def problem(self, values):
            made = super().problem({"mu": values.get("ratio", 0.3)})
            mu = made.parameters["mu"]
            terms = tuple(Term(t.name, t.slot, t.matrix * t.coefficient({"mu": mu}), t.symmetric) for t in made.terms)
            return Problem(terms, {}, None, self, frozenset(), dict(values), free=made.free)

        def check(self, values):
            pass

        def number(self, path):
            return {"ratio": 0.3}[path]

    problem = Unlisted().problem({})
    direct, reduced = (sweep(problem, VALUES, "ratio", modes=MODES, method=m) for m in ("direct", "reduced"))
    assert not reduced.reduced_model.collected.is_affine("ratio")
    assert len(reduced.onsets) == len(direct.onsets) > 0
    for a, b in zip(reduced.onsets, direct.onsets, strict=True):
        assert abs(a.value - b.value) <= a.uncertainty + b.uncertainty
        assert a.value == pytest.approx(b.value, rel=1e-7, abs=1e-8)


def test_terms_of_one_name_are_compared_one_by_one():
    """Two dampers of one name, of which one changes, and a stiffness that only its coefficient changes."""
    one, skew = sp.csr_array(np.eye(3)), sp.csr_array(np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 0]]))

    class Paired:
        def problem(self, values):
            p = values["p"]
            first = sp.csr_array(np.diag([1.0, 2.0, 3.0 + p]))
            terms = (
                Term("mass", "M", one, True), Term("spring", "K", one, True, {"q": 1}),
                Term("damper", "C", first, True), Term("damper", "C", 2 * one, True),
                Term("gyroscopic", "C", skew, False, skew=True),
            )  # fmt: skip
            return Problem(terms, {"p": p, "q": 5.0 - p}, None, self, frozenset({"p"}), dict(values))

    source = Paired()
    table = Tabulated.of(source.problem({"p": 1.0}), "p", 1.0).with_value(2.0)
    for p in (1.0, 2.0):
        ours, exact = table.pencil({"p": p}), source.problem({"p": p}).pencil()
        for name in ("M", "C", "K"):
            np.testing.assert_array_equal(getattr(ours, name).toarray(), getattr(exact, name).toarray())
    more = {t.slot: t for t in table.terms if t.only}
    assert set(more) == {"C", "K"} and more["C"].matrix.nnz == 1 and more["C"].symmetric
