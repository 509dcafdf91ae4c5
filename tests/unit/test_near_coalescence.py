"""The uncertainty of eigenvalues near a double one, by the square-root law."""

from __future__ import annotations

import numpy as np
import pytest

from fe_squeal.eigen.quality import _near_coalescence


def moved(h, u):
    """Return how far ±ih may move at most, if h² may change by 2hu either way."""
    ends = np.sqrt(np.array([h**2 - 2 * h * u, h**2 + 2 * h * u], complex))
    return np.abs(ends - h).max()


@pytest.mark.parametrize("share", [1e-3, 0.1, 0.4, 0.5, 0.51, 0.7, 1.0, 1.9, 5.0])
def test_a_pair_that_may_be_two_real_eigenvalues(share):
    """The bound covers what the first order does not: where u is half of Im θ or more, the pair may have met."""
    h = 0.01
    values, likeness = np.array([1 + 1j * h, 1 - 1j * h]), np.ones((2, 2))
    bound = _near_coalescence(np.full(2, share * h), np.full(2, 1e-9), values, likeness)
    assert (bound >= moved(h, share * h) * (1 - 1e-6)).all() and (bound <= 1.01 * moved(h, share * h)).all()
    assert (bound >= h * (1 - 1e-6)).all() == (share >= 0.5)


def test_the_partner_is_the_one_of_like_shape():
    """A third eigenvalue in the middle, of another shape, does not take the place of the conjugate."""
    h = 0.01
    values = np.array([1 + 1j * h, 1 - 1j * h, 1.0])
    likeness = np.array([[1.0, 0.999, 0.4], [0.999, 1.0, 0.4], [0.4, 0.4, 1.0]])
    first = np.array([0.7 * h, 0.7 * h, 1e-6])
    assert (_near_coalescence(first, np.full(3, 1e-9), values, likeness)[:2] >= h).all()
    other = np.array([[1.0, 0.2, 0.9], [0.2, 1.0, 0.9], [0.9, 0.9, 1.0]])
    assert _near_coalescence(first, np.full(3, 1e-9), values, other)[0] < h


def test_multiple_eigenvalues_keep_the_error_of_single_ones():
    values = np.array([2.0, 2.0, 5.0])
    bound = _near_coalescence(np.full(3, 1e-3), np.full(3, 1e-7), values, np.eye(3))
    np.testing.assert_allclose(bound, [1e-7, 1e-7, 1e-3], rtol=1e-3)
