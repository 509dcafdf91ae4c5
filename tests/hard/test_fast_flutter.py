"""Flutter millions of times faster than all other modes: what looks infinite may be finite, and unstable.

Units of the unknowns differ by many orders of magnitude, too. A count is proven only if no eigenvalue was dropped.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.lapack import finite_number
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


def degree(K, C, M):
    """Return the degree of det(λ²M + λC + K), by how fast it grows."""
    lam = np.array([1e6, 1e7])
    first, second = (np.linalg.slogdet(x**2 * M + x * C + K)[1] for x in lam)
    return round((second - first) / np.log(10))


@pytest.mark.parametrize(("K", "C", "number"), [
    ([[1, 0, 1], [0, 0, -1], [1, -1, 0]], [0, 0.1, 0], 2),  # a constraint ties a damper to a mass
    ([[2, -1, 0], [-1, 1, 0], [0, 0, 1]], [[0, 0, 0], [0, 0.1, -0.1], [0, -0.1, 0.1]], 3),  # one between two nodes
    ([[2, -1, 0], [-1, 1, 0], [0, 0, 1]], [0.1, 0, 0.2], 3),  # a spring and a damper without mass
    ([[1, 0.3, 0], [0.3, 1, 1], [0, 1, 0]], [0.1, 0.2, 0], 2),  # a constraint of the damper alone
    ([[1, 0, 1], [0, 1, 0], [1, 0, 0]], [0.1, 0.2, 0], 1),  # one of the mass alone
])  # fmt: skip
def test_how_many_eigenvalues_are_finite(K, C, number):
    K, C, M = np.array(K, float), np.array(C), np.diag([1.0, 0.0, 0.0])
    C = np.diag(C) if C.ndim == 1 else C
    assert degree(K, C, M) == number and finite_number([K, C, M]) == number
    modes = solve_dense(Pencil(*(sp.csr_array(A) for A in (M, K)), sp.csr_array(C)))
    assert modes.exhaustive and np.count_nonzero(modes.lam.imag == 0) + 2 * np.count_nonzero(modes.lam.imag) == number


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_how_many_eigenvalues_of_random_constraints_are_finite(friction):
    """Masses, dampers, springs and constraints of them all; with friction, which lets these push otherwise, at most."""
    rng = np.random.default_rng(5)
    for _ in range(200):
        heavy, light, ties = rng.integers(1, 4), rng.integers(0, 4), rng.integers(0, 3)
        n = heavy + light
        B = rng.integers(-1, 2, (min(ties, n - 1), n)) * (rng.random(n) < 0.7)
        if np.linalg.matrix_rank(B) < len(B):
            continue
        stiffness, dampers = rng.standard_normal((n, n)), rng.integers(-1, 2, (rng.integers(0, n + 1), n))
        push = B.T * (1 + friction * rng.uniform(-1, 1, B.T.shape))
        zero = np.zeros((len(B), len(B)))
        K = np.block([[stiffness @ stiffness.T + np.eye(n), push], [B, zero]])
        mass = np.diag(np.r_[np.ones(heavy), np.zeros(light)])
        C, M = (la.block_diag(part, zero) for part in (dampers.T @ dampers, mass))
        number, exact = finite_number([K, C, M]), degree(K, C, M)
        assert number == exact or (friction and number > exact)
