"""A free body with its own dashpots beside a body with loss factors: what decays far away must not pass for near.

The free motion decays with ν = −α, far from every shift. It is known beforehand, and says nothing about how far around
the shift a search has come.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes

FREE, HELD, ALPHA, LIMIT = 20, DENSE_LIMIT, 50.0, 0.3


def chain(n):
    k = np.ones(n - 1)
    return np.diag(np.r_[1.0, 2 * np.ones(n - 2), 1.0]) - np.diag(k, 1) - np.diag(k, -1)


def test_the_decay_of_a_free_body_does_not_hide_the_band():
    held = chain(HELD)
    held[0, 0] += 1.0
    flutter = (0.9 * LIMIT) ** 2 * np.array([[1.0, 0.06], [-0.06, 1.0]])
    losses = la.block_diag(np.zeros((FREE, FREE)), 0.02 * held, 0.01 * LIMIT**2 * np.eye(2))
    K = la.block_diag(chain(FREE), held, flutter) + 1j * losses
    C = np.diag(np.r_[np.full(FREE, ALPHA), np.zeros(HELD + 2)])
    pencil = Pencil(*(sp.csr_array(A) for A in (np.eye(len(K)), K, C)))
    modes = solve_modes(pencil, Request(max_frequency_hz=LIMIT / (2 * np.pi)))
    theta = np.append(la.eigvalsh(held) * (1 + 0.02j), la.eigvals(flutter) + 0.01j * LIMIT**2)
    expected = 1j * np.sqrt(theta)
    expected = np.where(expected.imag < 0, -expected, expected)
    expected = expected[expected.imag <= LIMIT]  # the free body creeps, or is slowed at once
    found = modes.lam[modes.lam.imag > 1e-6]
    assert len(found) == len(expected)
    np.testing.assert_allclose(np.sort(found.imag), np.sort(expected.imag), rtol=1e-9)
    assert np.count_nonzero(modes.stability == "unstable") == np.count_nonzero(expected.real > 0) == 1
    assert np.count_nonzero(modes.lam == 0) == 1
