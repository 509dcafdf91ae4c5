"""Cholesky factors by PARDISO and by SuperLU: solves, halves, and what is not positive definite."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.eigen.definite import signs_of
from fe_squeal.eigen.linear.choice import factorize, factorize_definite
from fe_squeal.eigen.linear.dense import DenseFactor
from fe_squeal.eigen.linear.factor import SingularError
from fe_squeal.eigen.linear.pardiso import PardisoCholesky, has_pardiso
from fe_squeal.eigen.linear.superlu import SuperLUCholesky
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


def test_a_zero_on_the_diagonal_is_refused():
    """Constraints by multipliers: MKL's Cholesky factorisation crashes on such a matrix."""
    A = sp.block_array([[sp.eye_array(3), np.ones((3, 1))], [np.ones((1, 3)), None]], format="csr")
    with pytest.raises(NotConvergedError, match="diagonal"):
        factorize_definite(A)


@pytest.mark.parametrize("imaginary", [0.0, 1.0])
def test_full_matrices_in_any_units(imaginary):
    """A known solution comes back to the last digits where rows and columns are scaled by 10⁻¹² to 10¹²."""
    rng = np.random.default_rng(4)
    n = 60
    A = rng.standard_normal((n, n)) + 1j * imaginary * rng.standard_normal((n, n)) + 8 * np.eye(n)
    A = A if imaginary else A.real
    rows, columns = (10.0 ** rng.uniform(-12, 12, n) for _ in range(2))
    factor = factorize(sp.csr_array(rows[:, None] * A * columns), symmetric=False)
    assert isinstance(factor, DenseFactor)
    x = rng.standard_normal((n, 3))
    np.testing.assert_allclose(columns[:, None] * factor.solve(rows[:, None] * (A @ x)), x, rtol=1e-10, atol=1e-12)
    for solve, B in ((factor.solve_transposed, A.T), (factor.solve_adjoint, A.conj().T)):
        np.testing.assert_allclose(rows[:, None] * solve(columns[:, None] * (B @ x)), x, rtol=1e-10, atol=1e-12)
    assert factor.solve(rows * (A @ x[:, 0])).shape == (n,)


def test_a_singular_full_matrix_is_told():
    for singular in (np.triu(np.ones((5, 5)), 1), np.ones((5, 5))):
        with pytest.raises(SingularError, match="LAPACK"):
            DenseFactor(sp.csr_array(singular))


@pytest.mark.parametrize("sign", [1, -1])
def test_a_sign_of_far_smaller_eigenvalues_is_not_left_out(sign, monkeypatch):
    """From none of many starts, although Lanczos iteration hardly ever shows it."""
    d, rng = np.append(np.geomspace(1e2, 3e5, 126), [-140.0, -140.0]), np.random.default_rng(2)
    Q = np.linalg.qr(rng.standard_normal((128, 128)))[0]
    A = sp.csr_array(sign * (Q * d) @ Q.T)
    for seed in range(20):
        monkeypatch.setattr("fe_squeal.eigen.definite._SEED", seed)
        assert signs_of(sp.csr_array((A + A.T) / 2)) == {1, -1}


@pytest.mark.skipif(not has_pardiso(), reason="SuperLU counts nothing, and both signs are taken then")
def test_a_semidefinite_matrix_has_one_sign():
    rng = np.random.default_rng(3)
    B = sp.csr_array(np.where(rng.random((40, 90)) < 0.1, rng.standard_normal((40, 90)), 0.0))
    G = sp.csr_array(B.T @ B)
    assert signs_of(G) == {1} and signs_of(sp.csr_array(-G)) == {-1}
