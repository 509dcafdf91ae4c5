"""Defective eigenvalues where two discs overlap: rounding parts them by a root of itself, but they are not twice there.

A k×k Jordan block has k eigenvalues that rounding ε spreads by about ε^(1/k), differently in every disc.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from selection import some

from fe_squeal.eigen.band import with_far_growth
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


@pytest.mark.parametrize("alpha", [0.0, 0.01])
def test_a_defective_pair_whose_vectors_are_equal_is_found_once(alpha):
    """Rounding usually parts them by 1e-8; where it does not, they cannot be taken out of a search for others, and left
    ones with ψᴴφ = 1, of which nothing but rounding is left, would spoil it."""
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    block = turn @ [[15.0, 10.0], [0.0, 15.0]] @ turn.T
    K = sp.csr_array(sp.block_diag([block, sp.diags_array(np.linspace(40, 4e3, 450))]))
    one, rng = sp.eye_array(452, format="csr"), np.random.default_rng(0)
    pencil = Pencil(one, K, one * alpha if alpha else None)
    modes = solve_modes(pencil, Request(count=2))
    both = np.pad(turn, ((0, 450), (0, 0)))
    right, left = (both[:, [i, i]] + 1e-16 * rng.standard_normal((452, 2)) for i in (0, 1))
    exact = np.full(2, 1j * np.sqrt(15 - alpha**2 / 4) - alpha / 2)
    equal = replace(modes, lam=exact, right=right + 0j, left=left / (left * right).sum(axis=0) + 0j)
    found = with_far_growth(pencil, equal, abs(exact[0]), None, "auto")
    np.testing.assert_allclose(found.lam, exact, atol=1e-6)
