"""Mass matrices that are singular though no row of them is empty: lumps that move with the mean of several unknowns."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from selection import some

from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import prove_completeness, solve_modes

KINDS = ["symmetric", "friction", "damped", "loss"]


def test_two_unknowns_with_one_mass_between_them():
    """m (u + v)'' = −k u = −c v: u and v are springs in a row, with θ = 1 / (m (1/k + 1/c))."""
    pencil = Pencil(sp.csr_array([[3.0, 3.0], [3.0, 3.0]]), sp.csr_array(np.diag([6.0, 3.0])), symmetric=True)
    modes = solve_modes(pencil, Request(count=1))
    np.testing.assert_allclose(modes.lam, [1j * np.sqrt(2 / 3)], rtol=1e-14)
    assert modes.re_uncertainty[0] < 1e-13 and modes.exhaustive
    assert prove_completeness(pencil, modes).proven


@pytest.mark.parametrize("unit", some([1.0, 1e-9, 1e6], lambda unit: unit == 1e6))
@pytest.mark.parametrize("kind", KINDS)
def test_lumps_in_a_chain(kind, unit):
    """Rounding parts the two halves of each lump, in some of the matrices so that they seem to be positive definite."""
    for seed in range(12):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(6, 24))
        M, share = np.diag(rng.uniform(1, 3, n)), rng.uniform(0.3, 1, 3)
        lump = rng.choice(n, 3, replace=False)
        M[np.ix_(lump, lump)] = np.outer(share, share)
        K = np.diag(rng.uniform(4, 9, n)) - np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1)
        K += np.diag(np.full(n - 1, 0.3), 1) * (kind == "friction")
        K = K * (1 + 0.05j) if kind == "loss" else K
        C = 0.02 * np.diag(rng.uniform(1, 9, n)) if kind == "damped" else None
        pencil = Pencil(
            *(sp.csr_array(A) for A in (unit * M, unit * K)), None if C is None else sp.csr_array(unit * C),
            symmetric=kind != "friction",
        )  # fmt: skip
        modes = solve_modes(pencil, Request(count=3))
        exact = eigenvalues(M, np.zeros_like(M) if C is None else C, K)
        swings = modes.lam.imag > 0  # a damped unknown without mass decays
        np.testing.assert_allclose(modes.lam[swings], exact[:3], rtol=1e-9)
        assert (modes.lam.real[~swings] < 0).all() and modes.re_uncertainty[swings].max() < 1e-9


def eigenvalues(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Those with Im λ > 0 by increasing size, by QZ on the companion form."""
    zero, identity = np.zeros_like(M), np.eye(len(M))
    alpha, beta = la.eigvals(
        np.block([[zero, identity], [-K, -C]]), la.block_diag(identity, M), homogeneous_eigvals=True
    )
    lam = alpha[np.abs(beta) > 1e-7 * np.abs(alpha)] / beta[np.abs(beta) > 1e-7 * np.abs(alpha)]
    lam = lam[lam.imag > 1e-6 * np.abs(lam)]
    return lam[np.argsort(np.abs(lam))]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["friction", "damped"])
def test_lumps_in_a_long_chain(kind):
    """Beyond the size of LAPACK the operator K⁻¹M is asked alone, whose infinite eigenvalues are zeros."""
    n, rng = DENSE_LIMIT + 20, np.random.default_rng(3)
    M = np.eye(n)
    for lump in rng.permutation(n)[:60].reshape(20, 3):
        M[np.ix_(lump, lump)] = np.outer(*[rng.uniform(0.3, 1, 3)] * 2)
    K = np.diag(rng.uniform(4, 9, n)) - np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1)
    K += np.diag(np.full(n - 1, 0.3), 1)
    C = None if kind == "friction" else sp.csr_array(0.02 * np.eye(n))
    modes = solve_modes(Pencil(sp.csr_array(M), sp.csr_array(K), C), Request(count=6))
    exact = eigenvalues(M, np.zeros_like(M) if C is None else C.toarray(), K)
    np.testing.assert_allclose(modes.lam, exact[:6], rtol=1e-8)
