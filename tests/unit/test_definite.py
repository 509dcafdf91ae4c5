"""Cholesky factors by PARDISO and by SuperLU: solves, halves, and what is not positive definite."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen.definite import PardisoCholesky, SuperLUCholesky
from fe_squeal.eigen.linear_solvers import has_pardiso
from fe_squeal.errors import NotConvergedError

N = 300
SOLVERS = [
    pytest.param(PardisoCholesky, marks=pytest.mark.skipif(not has_pardiso(), reason="no PARDISO")), SuperLUCholesky
]  # fmt: skip


def definite(shift=0.0):
    A = sp.random_array((N, N), density=0.02, random_state=np.random.default_rng(2))
    return sp.csr_array(A @ A.T + (0.1 - shift) * sp.eye_array(N))


@pytest.mark.parametrize("solver", SOLVERS)
def test_halves_make_the_whole(solver):
    """With Z = L⁻ᵀS: ZᵀAZ = SᵀS, and ZZᵀ = A⁻¹ where S is the unit matrix."""
    A = definite()
    factor = solver(A)
    S = np.random.default_rng(3).standard_normal((N, 7))
    np.testing.assert_allclose(A @ factor.solve(S), S, atol=1e-11)
    Z = factor.half_solve(S)
    np.testing.assert_allclose(Z.T @ (A @ Z), S.T @ S, rtol=1e-10, atol=1e-10)
    Z = factor.half_solve(np.eye(N))
    np.testing.assert_allclose(Z @ Z.T, np.linalg.inv(A.toarray()), atol=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
def test_what_is_not_definite_is_refused(solver):
    with pytest.raises(NotConvergedError):
        solver(definite(shift=5.0))
