"""Reduced models of a problem that has fewer modes than are asked for, since few unknowns have mass."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from fe_squeal import sweep
from fe_squeal.eigen.request import Request
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.reduced import BoxModel
from fe_squeal.study.models import CertifiedModel

N, MASSES = 60, 6


def problem() -> Problem:
    """A chain of springs with six masses, and friction between its ends, two unknowns of which have none."""
    mass = np.zeros(N)
    mass[4::10] = np.linspace(1.0, 2.0, MASSES)
    K = sp.diags_array([np.full(N, 3.0), np.full(N - 1, -1.0), np.full(N - 1, -1.0)], offsets=[0, 1, -1])
    friction = sp.csr_array(([0.3, -0.3, 0.2], ([4, 5, 20], [5, 14, 24])), (N, N))
    terms = (
        Term("mass", "M", sp.csr_array(sp.diags_array(mass)), True), Term("elastic", "K", sp.csr_array(K), True),
        Term("friction", "K", friction, False, {"mu": 1}),
    )  # fmt: skip
    return Problem(terms, {"mu": 0.3})


def frequencies(mu: float) -> np.ndarray:
    """Return the ω of all six, rad/s: 1/ω² are the eigenvalues of K⁻¹M that are not zero."""
    pencil = problem().pencil({"mu": mu})
    inverse = np.sort(la.eigvals(la.solve(pencil.K.toarray(), pencil.M.toarray())).real)[-MASSES:]
    return np.sort(inverse**-0.5)


@pytest.mark.parametrize("count", [4, 10])
def test_a_study_has_its_reduced_model_everywhere(count):
    made = BoxModel(problem(), ("mu",), [0.0], [0.8], lambda i: [(p,) for p in np.linspace(0.05, 0.75, 8)],
                    Request(count, None, 1e-6))  # fmt: skip
    for mu in (0.0, 0.37, 0.8):
        outcome = CertifiedModel(made.online()).outcome((mu,))
        assert outcome is not None and not outcome.row[6]
        np.testing.assert_allclose(made.online().modes((mu,))[0].lam.imag, frequencies(mu)[:count], rtol=1e-6)


def test_a_sweep_has_all_modes_that_there_are():
    result = sweep(problem(), np.linspace(0.0, 0.8, 5), modes=10, method="reduced")
    for point in result.points:
        assert point.modes.method.startswith("reduced")
        np.testing.assert_allclose(point.modes.lam.imag, frequencies(point.value), rtol=1e-8)
