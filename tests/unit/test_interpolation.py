"""Matrices interpolated over a parameter that changes them, against what they are and where they have entries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen.pencil import FreeMotions
from fe_squeal.problem.interpolation import interpolate, interpolate_beside
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term

N = 12


class Opening:
    """A chain whose last spring, and the friction there, depend on p as a + b p + c p² + d p³."""

    def __init__(self, a, b, c, d):
        self.powers = np.array([a, b, c, d])
        chain = sp.diags_array([np.full(N - 1, -1.0), np.full(N, 2.0), np.full(N - 1, -1.0)], offsets=[-1, 0, 1])
        self.chain, self.one = sp.csr_array(chain), sp.csr_array(sp.eye_array(N))

    def stiffness(self, p):
        return float(self.powers @ p ** np.arange(4))

    def check(self, values):
        pass

    def number(self, path):
        return 0.0

    def problem(self, values):
        k = self.stiffness(values["p"])
        spring = sp.csr_array(([k], ([N - 1], [N - 1])), shape=(N, N))
        friction = sp.csr_array(([k * values["p"]], ([0], [N - 1])), shape=(N, N))
        terms = (
            Term("mass", "M", self.one, True), Term("chain", "K", self.chain, True),
            Term("spring", "K", spring, True), Term("friction", "K", friction, False),
            Term("loss", "K", self.chain * 0.1, True, imaginary=True),
        )  # fmt: skip
        used = tuple(t for t in terms if t.matrix.count_nonzero())
        return Problem(used, {}, changed=values, source=self, free=lambda _: FreeMotions.none(N))

    def at(self, p):
        return self.problem({"p": p}).pencil()


@pytest.mark.parametrize("origin", [0.0, 0.5])
def test_polynomials_are_what_they_are(origin):
    """Friction k p is quadratic where k is linear: then matrices agree everywhere, not at three values alone."""
    system = Opening(3.0, 2.0, 0.0, 0.0)
    found = interpolate_beside(system.problem({"p": 0.2}), "p", 0.1, 0.9, origin)
    for p in (0.1, 0.3, 0.5, 0.77, 0.9):
        K = found.pencil({"p": p - origin}).K
        np.testing.assert_allclose(K.toarray(), system.at(p).K.toarray(), rtol=0, atol=1e-13)


def test_others_agree_at_three_values():
    system = Opening(3.0, -2.0, 1.0, 4.0)
    found = interpolate(system.problem({"p": 0.2}), "p", 0.0, 0.8)
    for p in (0.0, 0.4, 0.8):
        pencil, exact = found.pencil({"p": p}), system.at(p)
        np.testing.assert_allclose(pencil.K.toarray(), exact.K.toarray(), rtol=0, atol=1e-13)
        assert pencil.problem_class == exact.problem_class
    assert abs(found.pencil({"p": 0.2}).K - system.at(0.2).K).max() > 1e-3


def test_what_does_not_change_has_one_term():
    """Of mass, loss and the rest of the chain there are no further terms, and the spring's have its entry alone."""
    system = Opening(3.0, 2.0, 1.0, 0.0)
    found = interpolate(system.problem({"p": 0.2}), "p", 0.0, 0.8)
    moving = [t for t in found.terms if t.powers]
    assert moving and all(t.slot == "K" and not t.imaginary and t.matrix.nnz == 1 for t in moving)
    assert [t.slot for t in found.terms if not t.powers].count("M") == 1


def test_a_difference_of_skew_and_other_terms_is_not_skew():
    """If a term is skew at one end alone, so is the difference not, and its transposed matrix is another."""
    skew = sp.csr_array(([1.0, -1.0], ([0, 1], [1, 0])), shape=(2, 2))
    upper = sp.csr_array(([1.0], ([0], [1])), shape=(2, 2))
    one = Term("m", "M", sp.csr_array(sp.eye_array(2)), True)

    class Turning:
        def check(self, values):
            pass

        def number(self, path):
            return 0.0

        def problem(self, values):
            turning = Term("g", "C", skew if values["p"] > 0 else upper, False, skew=values["p"] > 0)
            terms = (one, replace(one, name="k", slot="K"), turning)
            return Problem(terms, {}, changed=values, source=self, free=lambda _: FreeMotions.none(2))

    problem = Turning().problem({"p": 1.0})
    found = interpolate(problem, "p", 0.0, 1.0)
    of_c = [t for t in found.terms if t.slot == "C"]
    assert len(of_c) > 1
    for t in of_c:
        A = t.matrix.toarray()
        assert not t.skew or (A == -A.T).all()
