"""Flutter millions of times faster than all other modes: what looks infinite may be finite, and unstable.

Units of the unknowns differ by many orders of magnitude, too. A count is proven only if no eigenvalue was dropped.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.pencil import Pencil


@pytest.mark.parametrize("damped", [False, True])
def test_a_fast_unstable_pair_is_not_taken_for_infinite(damped):
    rng = np.random.default_rng(11)
    for _ in range(40):
        n, fast = int(rng.integers(4, 9)), 10 ** rng.uniform(3, 7)
        w = np.r_[10 ** rng.uniform(-3, -1, n - 2), fast, fast * rng.uniform(1, 1.05)]
        K = np.diag(w**2)
        K[-1, -2], K[-2, -1] = 0.4 * fast**2, -0.4 * fast**2
        K[:-2, -1], K[-1, :-2] = (rng.uniform(-0.1, 0.1, n - 2) * w[:-2] * fast for _ in range(2))
        C = np.diag(w * np.r_[rng.choice([1e-3, 0.1, 3.0, 30.0], n - 2), 0.01, 0.01])
        units = np.diag(10 ** rng.uniform(-4, 4, n))
        M, C, K = (sp.csr_array(units @ A @ units) for A in (np.eye(n), C, K))
        modes = solve_dense(Pencil(M, K, C if damped else None))
        theta = la.eigvals((la.inv(units) @ K.toarray() @ la.inv(units))[-2:, -2:])  # the others hardly move these
        damping = 0.01 * fast if damped else 0.0
        exact = -damping / 2 + np.sqrt(damping**2 / 4 - theta + 0j)
        unstable = modes.lam[modes.stability == "unstable"]
        assert len(unstable) == 1
        np.testing.assert_allclose(unstable[0].real, np.abs(exact.real + damping / 2).max() - damping / 2, rtol=1e-2)
        assert modes.exhaustive


@pytest.mark.parametrize("damped", [False, True])
def test_a_count_without_infinite_eigenvalues_is_proven(damped):
    """Springs without mass and a constraint: the eigenvalues that are infinite are known, and none else is missing."""
    K = np.diag([1.0, 2.0, 3.0, 5.0, 0.0])
    K[0, 3] = K[3, 0] = 0.5
    K[4, :2] = K[:2, 4] = 1.0, -1.0
    K[1, 2], K[2, 1] = 0.3, -0.3
    C = np.diag([0.1, 0.1, 0.1, 0.2, 0.0])
    M = np.diag([1.0, 1.0, 1.0, 0.0, 0.0])
    modes = solve_dense(Pencil(*(sp.csr_array(A) for A in (M, K)), C=sp.csr_array(C) if damped else None))
    assert modes.exhaustive
    assert np.count_nonzero(modes.lam.imag > 0) == 2
    assert len(modes) == (3 if damped else 2)
