"""Defective eigenvalues where two discs overlap: rounding parts them by a root of itself, but they are not twice there.

A k×k Jordan block has k eigenvalues that rounding ε spreads by about ε^(1/k), differently in every disc.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from selection import some

from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.errors import NotConvergedError

OTHERS, DAMPING, LIMIT = 420, 0.01, 1.3


@pytest.mark.parametrize(("size", "coupling", "omega"), some(
    [(2, 0.1, 0.6), (3, 0.1, 0.6), (4, 0.1, 0.6)], lambda size, *_: size == 3
))  # fmt: skip
def test_a_defective_eigenvalue_counts_once_in_two_discs(size, coupling, omega):
    rng = np.random.default_rng(0)
    chain = 3 * np.eye(OTHERS) - 1.4 * (np.eye(OTHERS, k=1) + np.eye(OTHERS, k=-1))
    T = np.eye(size) + 0.3 * rng.standard_normal((size, size))
    K = la.block_diag(chain, T @ (omega**2 * np.eye(size) + coupling * np.eye(size, k=1)) @ la.inv(T))
    pencil = Pencil(*(sp.csr_array(A) for A in (np.eye(len(K)), K, DAMPING * np.eye(len(K)))))
    try:
        modes = solve_modes(pencil, Request(max_frequency_hz=LIMIT / (2 * np.pi)))
    except NotConvergedError as error:  # of four copies rounding may leave too little to meet the tolerance
        assert size == 4 and "backward error" in str(error)
        return
    simple = np.sqrt(la.eigvalsh(chain) - DAMPING**2 / 4)
    assert len(modes) == np.count_nonzero(simple <= LIMIT) + size
    around = np.abs(modes.lam - (-DAMPING / 2 + 1j * np.sqrt(omega**2 - DAMPING**2 / 4)))
    assert np.count_nonzero(modes.re_uncertainty > 1e-9) == size == np.count_nonzero(around < 1e-3)
    assert not (modes.stability == "unstable").any()
