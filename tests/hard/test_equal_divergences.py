"""Identical parts that diverge: equal θ < 0 of a full nonsymmetric matrix, which rounding splits into complex pairs."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

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
