"""What SuperLU's factors of symmetric matrices are good for: solves, signs of the eigenvalues, and modes."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from selection import some

from fe_squeal.eigen.inertia import count_below
from fe_squeal.eigen.linear.factor import SingularError
from fe_squeal.eigen.linear.superlu import SuperLUFactor
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import prove_completeness, solve_modes
from meshes import box, make_problem

N, TIES = 300, 30


def shifted_chain(shift: float, ties: int, seed: int) -> sp.csr_array:
    """K − sM of a chain of springs to the ground, of which Lagrange multipliers tie some masses together."""
    rng = np.random.default_rng(seed)
    k = rng.uniform(1.0, 3.0, N + 1)
    K = sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], offsets=[0, 1, -1])
    K = K - shift * sp.diags_array(rng.uniform(0.5, 2.0, N))
    if not ties:
        return sp.csr_array(K)
    B = sp.csr_array((rng.uniform(0.5, 2.0, 3 * ties), rng.choice(N, (ties, 3), replace=False).ravel(),
                      3 * np.arange(ties + 1)), shape=(ties, N))  # fmt: skip
    return sp.csr_array(sp.block_array([[K, B.T], [B, None]]))


@pytest.mark.parametrize("ties", [0, 1, TIES])
def test_signs_are_counted(ties):
    """Against LAPACK. Eigenvalues nearer to zero than 1e-6 would let rounding decide; none is."""
    for seed in range(4):
        for shift in (0.0, 0.01, 0.09, 0.3, 1.0, 2.0, 4.0):
            A = shifted_chain(shift, ties, seed)
            w = la.eigvalsh(A.toarray())
            assert np.abs(w).min() > 1e-6
            factor = SuperLUFactor(A, True)
            assert factor.negative_pivots == (w < 0).sum()
            x = np.random.default_rng(seed).standard_normal(A.shape[0])
            np.testing.assert_allclose(factor.solve(A @ x), x, atol=1e-13 / np.abs(w).min())


def test_no_count_where_rounding_decides():
    """A ring of springs that nothing holds has the eigenvalue zero: the sign of its last pivot is chance."""
    k = np.random.default_rng(1).uniform(1.0, 3.0, N)
    i = np.arange(N)
    K = sp.csr_array(sp.coo_array((np.r_[k, k, -k, -k], (np.r_[i, (i + 1) % N, i, (i + 1) % N],
                                                        np.r_[i, (i + 1) % N, (i + 1) % N, i]))))  # fmt: skip
    with contextlib.suppress(SingularError):  # where rounding left exactly zero
        assert SuperLUFactor(K, True).negative_pivots is None
    assert SuperLUFactor(sp.csr_array(K - 1e-9 * sp.eye_array(N)), True).negative_pivots == 1
    assert SuperLUFactor(sp.csr_array(K + 1e-9 * sp.eye_array(N)), True).negative_pivots == 0


@pytest.mark.parametrize("least", [1e-20, 1e-9])
def test_small_pivots_are_left_aside(least):
    """Pairs [[δ, 1], [1, δ]] have the eigenvalues δ ± 1; eliminated by δ they are gone to the digits of δ."""
    pairs = sp.kron(sp.eye_array(50), np.array([[least, 1.0], [1.0, least]]))
    link = sp.diags_array([1e-3 * np.ones(99)] * 2, offsets=[1, -1])
    A = sp.csr_array(pairs + link)
    factor, x = SuperLUFactor(A, True), np.random.default_rng(2).standard_normal(100)
    np.testing.assert_allclose(factor.solve(A @ x), x, atol=1e-14)
    np.testing.assert_allclose(factor.solve_transposed(A @ x), x, atol=1e-14)
    assert factor.negative_pivots == (50 if least > 1e-16 else None)


def test_complex_symmetric_matrices_with_ties():
    A = shifted_chain(0.3, TIES, 0).astype(complex)
    A = sp.csr_array(A + 0.01j * sp.diags_array(A.diagonal()))
    factor, x = SuperLUFactor(A, True), np.random.default_rng(3).standard_normal((len(A.indptr) - 1, 2)) * (1 + 2j)
    assert factor.negative_pivots is None
    np.testing.assert_allclose(factor.solve(A @ x), x, atol=1e-11)
    np.testing.assert_allclose(factor.solve_transposed(A.T @ x), x, atol=1e-11)
    np.testing.assert_allclose(factor.solve_adjoint(A.conj().T @ x), x, atol=1e-11)


@pytest.mark.parametrize("stiffness", [1e3, 1e6])
def test_modes_above_much_softer_ones(stiffness):
    """A steel block on springs: its own modes lie up to 17,000 times as high as those on the springs, and a Lanczos
    method whose operator is symmetric but for rounding finds them to six or nine digits only."""
    springs = [{"name": n, "surface": "left", "direction": list(e), "stiffness": stiffness}
               for n, e in zip("xyz", np.eye(3), strict=True)]  # fmt: skip
    pencil = make_problem(box("hex2", (3, 2, 2), (0.1, 0.05, 0.05)), springs=springs).pencil()
    modes = solve_modes(pencil, Request(count=8), linear_solver="superlu")
    assert modes.backward_error.max() < 1e-11
    proof = prove_completeness(pencil, modes, "superlu")
    assert proof.proven and proof.found == 8
    assert count_below(pencil, float(modes.lam.imag[5:7].mean()), "superlu") == 6


@pytest.mark.parametrize("kind", some(["tet1", "hex1"], lambda kind: kind == "hex1"))
def test_equal_bodies_have_equal_frequencies(kind):
    """Two bodies in one mesh: both of a pair of modes, which an operator that is not quite symmetric tears apart."""
    block = box(kind, (3, 3, 3), (0.1, 0.1, 0.1))
    pencil = make_problem(block).pencil()
    alone = solve_modes(pencil, Request(count=10), linear_solver="superlu").lam.imag[6:10]
    both = Pencil(*(sp.csr_array(sp.block_diag([A, A])) for A in (pencil.M, pencil.K)), symmetric=True)
    found = solve_modes(both, Request(count=20), linear_solver="superlu").lam.imag[12:20]
    np.testing.assert_allclose(found, np.repeat(alone, 2), rtol=1e-9)
