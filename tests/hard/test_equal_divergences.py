"""Identical parts that diverge: equal θ < 0, which rounding splits into complex pairs, and θ < 0 far beyond all others.

What breaks: a Krylov space of one start vector has one copy of a multiple eigenvalue, and from a shift near the lowest
modes 1/(θ − σ) of a far one is no larger than rounding of theirs.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import prove_completeness, solve_modes

PARTS = 5


@pytest.mark.parametrize("scale", [1.0, 1e9])
def test_every_divergence_is_a_mode_that_grows_and_one_that_decays(scale):
    for seed in range(30):
        rng = np.random.default_rng(seed)
        V = rng.standard_normal((3, 3))
        K = np.kron(np.eye(PARTS), V @ np.diag([-0.5, 2.0, 5.0]) @ la.inv(V))
        Q = la.qr(rng.standard_normal(K.shape))[0]
        pencil = Pencil(sp.csr_array(np.eye(3 * PARTS)), sp.csr_array(scale * Q.T @ K @ Q))
        modes = solve_modes(pencil, Request(count=3 * PARTS))
        for kind, sign in (("unstable", 1), ("stable", -1)):
            lam = modes.lam[modes.stability == kind]
            np.testing.assert_allclose(lam, np.full(PARTS, sign * np.sqrt(0.5 * scale)), rtol=1e-7)
        assert len(modes) == 4 * PARTS == prove_completeness(pencil, modes).found
        assert np.linalg.matrix_rank(modes.right) == 3 * PARTS
        adjoint = pencil.transposed().apply(modes.lam.conj(), modes.left)
        assert np.abs(adjoint).max() < 1e-9 * scale * np.abs(modes.left).max() * np.abs(K).max()


def test_divergences_of_a_symmetric_pencil_over_many_decades():
    """Each thrice, on a free chain whose lowest θ is a millionth of a millionth of the largest −θ."""
    n, far = DENSE_LIMIT + 50, -np.repeat([3e7, 2e7 * (1 + 1e-5), 2e7, 597.0, 1e-3], 3)
    rest = n - len(far)
    k = np.ones(rest - 1)
    chain = sp.diags_array([np.r_[1.0, 2 * k[1:], 1.0], -k, -k], offsets=[0, 1, -1])
    L = sp.csr_array(sp.eye_array(n) + 0.2 * sp.eye_array(n, k=1))
    K = L.T @ sp.block_diag([sp.diags_array(far), chain]) @ L
    modes = solve_modes(Pencil(sp.csr_array(L.T @ L), sp.csr_array(K), symmetric=True), Request(count=4))
    elastic = 2 * np.sin(np.arange(1, 4) * np.pi / (2 * rest))
    grows, swings = modes.lam.real > 0, modes.lam.imag > 0
    assert len(modes) == 2 * len(far) + 4 and (modes.lam == 0).sum() == 1
    np.testing.assert_allclose(np.sort(modes.lam[grows].real), np.sort(np.sqrt(-far)), rtol=1e-10)
    np.testing.assert_allclose(np.sort(-modes.lam.real)[-len(far) :], np.sort(np.sqrt(-far)), rtol=1e-10)
    np.testing.assert_allclose(modes.lam.imag[swings], elastic, rtol=1e-6)


def test_a_divergence_far_below_the_lowest_elastic_mode():
    """Two springs of a free chain that push each other apart: θ = −597, and ten million times as much as the next."""
    n = DENSE_LIMIT + 50
    k = np.ones(n - 1)
    K = sp.lil_array(sp.diags_array([np.r_[1.0, 2 * k[1:], 1.0], -k, -k], offsets=[0, 1, -1]))
    for i, j, sign in ((100, 200, 1), (100, 201, -1), (101, 200, -1), (101, 201, 1)):
        K[i, j], K[j, i] = K[i, j] + 300 * sign, K[j, i] + 300 * sign
    exact = la.eigvalsh(K.toarray())
    modes = solve_modes(Pencil(sp.eye_array(n, format="csr"), sp.csr_array(K), symmetric=True), Request(count=2))
    np.testing.assert_allclose(modes.lam[modes.lam.real > 0], [np.sqrt(-exact[0])], rtol=1e-12)
    np.testing.assert_allclose(modes.lam.imag[modes.lam.imag > 0], [np.sqrt(exact[2])], rtol=1e-7)
