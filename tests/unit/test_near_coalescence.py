"""The uncertainty of eigenvalues near a double one, by the square-root law."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from fe_squeal.eigen.dense import solve_dense
from fe_squeal.eigen.multiple import ROUNDING, near_coalescence
from fe_squeal.eigen.pencil import Pencil


def moved(h, u):
    """Return how far ±ih may move at most, if h² may change by 2hu either way."""
    ends = np.sqrt(np.array([h**2 - 2 * h * u, h**2 + 2 * h * u], complex))
    return np.abs(ends - h).max()


@pytest.mark.parametrize("share", [1e-3, 0.1, 0.4, 0.5, 0.51, 0.7, 1.0, 1.9, 5.0])
def test_a_pair_that_may_be_two_real_eigenvalues(share):
    """The bound covers what the first order does not: where u is half of Im θ or more, the pair may have met."""
    h = 0.01
    values, likeness = np.array([1 + 1j * h, 1 - 1j * h]), np.ones((2, 2))
    bound = near_coalescence(np.full(2, share * h), np.full(2, 1e-9), values, likeness)
    assert (bound >= moved(h, share * h) * (1 - 1e-6)).all() and (bound <= 1.01 * moved(h, share * h)).all()
    assert (bound >= h * (1 - 1e-6)).all() == (share >= 0.5)


def test_the_partner_is_the_one_of_like_shape():
    """A third eigenvalue in the middle, of another shape, does not take the place of the conjugate."""
    h = 0.01
    values = np.array([1 + 1j * h, 1 - 1j * h, 1.0])
    likeness = np.array([[1.0, 0.999, 0.4], [0.999, 1.0, 0.4], [0.4, 0.4, 1.0]])
    first = np.array([0.7 * h, 0.7 * h, 1e-6])
    assert (near_coalescence(first, np.full(3, 1e-9), values, likeness)[:2] >= h).all()
    other = np.array([[1.0, 0.2, 0.9], [0.2, 1.0, 0.9], [0.9, 0.9, 1.0]])
    assert near_coalescence(first, np.full(3, 1e-9), values, other)[0] < h


def test_multiple_eigenvalues_keep_the_error_of_single_ones():
    """Three modes in one plane but for a sine of 1e-5 are any basis of it, which may be as bad as that."""
    values, planar = np.array([2.0, 2.0, 2.0, 5.0]), np.array([[1, 0, 0], [0, 1, 0], [0.6, 0.8, 1e-5]])
    planar /= np.linalg.norm(planar, axis=1)[:, None]
    bound = near_coalescence(np.full(4, 1e-3), np.full(4, 1e-7), values, la.block_diag(planar @ planar.T, 1.0))
    np.testing.assert_allclose(bound[2:], [1e-7, 1e-3], rtol=0.1)


@pytest.mark.parametrize("copies", [1, 2, 3])
def test_an_equal_eigenvalue_elsewhere_is_no_reason_to_trust_one_more(copies):
    """Compared with what small changes of the entries make of a block with a condition number of 17000."""
    rng = np.random.default_rng(1)
    V = np.eye(6) + 10 * np.triu(rng.standard_normal((6, 6)), 1)
    one = V @ la.block_diag([[2, 0.5], [-0.5, 2]], np.diag([4.0, 5, 6, 7])) @ np.linalg.inv(V)
    modes = solve_dense(Pencil(sp.eye_array(6 * copies, format="csr"), sp.csr_array(la.block_diag(*[one] * copies))))
    root = np.sqrt(np.abs(one.diagonal()))
    changes = 1e-10 * np.maximum(np.abs(one), np.outer(root, root)) * rng.choice([-1.0, 1.0], (500, *one.shape))
    growth = np.sqrt(-np.linalg.eigvals(np.vstack([one[None], one + changes])).astype(complex)).real.max(axis=1)
    largest = np.abs(growth - growth[0]).max() * ROUNDING / 1e-10
    uncertain = modes.re_uncertainty[modes.lam.real > 0.1]
    assert len(uncertain) == copies and (uncertain > 0.9 * largest).all() and (uncertain < 2 * largest).all()
