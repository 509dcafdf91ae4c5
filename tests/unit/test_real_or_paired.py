"""Eigenvalues that are nearly real or nearly in conjugate pairs, and the ones that are exactly so."""

from __future__ import annotations

import numpy as np

from fe_squeal.sweep.samples import _real_or_paired


def test_two_real_ones_that_are_far_apart_do_not_part_a_good_pair():
    """Rounding has them at ±iD beside a pair of height s: with s² < εD two crossed pairs are nearer in sum."""
    height, apart, error = 1e-3, 1.0, 1e-4
    pair = [5.0 + 1j * height, 5.0 + error - 1j * height]
    real = [5.0 + apart + 1e-7j, 5.0 - apart - 1e-7j]
    [found] = _real_or_paired(np.array([[*pair, *real]]))
    np.testing.assert_allclose(found[:2], 5.0 + error / 2 + 1j * height * np.array([1, -1]), rtol=1e-14)
    np.testing.assert_allclose(found[2:], [5.0 + apart, 5.0 - apart], rtol=1e-14)
    assert found[0] == found[1].conj() and (found[2:].imag == 0).all()


def test_each_of_two_copies_nearest_to_the_other_ones_conjugate():
    """The nearest of all conjugates would be taken twice."""
    v = np.array([1.0 + 1j, 1.1 + 1j, 1.09 - 1j, 1.2 - 1j])
    [found] = _real_or_paired(v[None])
    assert sorted(found[found.imag > 0]) == sorted(found[found.imag < 0].conj()) and (found.imag != 0).all()


def test_those_that_have_no_partner_are_real():
    [found] = _real_or_paired(np.array([[2.0 + 1e-9j, 3.0 - 1e-9j, 4.0, 7.0 + 0.5j]]))
    assert found.tolist() == [2.0, 3.0, 4.0, 7.0]
