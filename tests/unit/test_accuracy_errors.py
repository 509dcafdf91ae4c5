"""Errors of measurements against a reference, on modes and onsets that are made up."""

from __future__ import annotations

import numpy as np
import pytest
from accuracy_scene import fake

from fe_squeal.accuracy.reference import errors_of, reference_of, same_modes


def test_modes_are_paired_by_shape():
    """Two modes that changed places: by number they would be 5 % off, by shape 1 and 5 %; that of 400 rad/s is beyond
    what is compared."""
    shapes = np.linalg.qr(np.random.default_rng(0).standard_normal((12, 4)))[0]
    reference = reference_of(fake([100j, 110j, 200j, 400j], shapes))
    found = fake([101j, 104.5j, 202j, 500j], shapes[:, [0, 1, 2, 3]])
    assert errors_of(found, reference).frequency == pytest.approx(0.05)
    swapped = fake([101j, 104.5j, 202j, 500j], shapes[:, [1, 0, 2, 3]])
    assert errors_of(swapped, reference).frequency == pytest.approx(9 / 110)
    three, lam = shapes[:, :3], np.array([100j, 110j, 200j])
    assert same_modes(three, lam, three[:, [1, 0, 2]], np.array([101j, 109j, 202j])) == {0: 1, 1: 0, 2: 2}


def test_errors_of_growth_and_onsets():
    shapes = np.eye(6)[:, :3] + 0j
    onset = (0.4, 100 / (2 * np.pi), 1, 1, 1, 2)
    reference = reference_of(fake([5 + 100j, 150j, 300j], shapes, [onset]))
    off = errors_of(fake([4 + 100j, 150j, 300j], shapes, [(0.42, *onset[1:])]), reference)
    assert (off.growth, off.onset) == pytest.approx((0.2, 0.05))
    none = errors_of(fake([100j, 150j, 300j], shapes), reference)
    assert (none.growth, none.onset) == (1.0, 1.0)  # an instability that is not found counts whole
    extra = errors_of(fake([5 + 100j, 2 + 150j, 300j], shapes, [onset]), reference)  # one that should not be there
    assert extra.growth == pytest.approx(0.4)
    quiet = reference_of(fake([100j, 150j, 300j], shapes))
    assert np.isnan(errors_of(fake([100j, 150j, 300j], shapes), quiet).growth)


def test_reference_is_extrapolated_and_says_how_sure_it_is():
    shapes = np.eye(6)[:, :3] + 0j
    changes = [[-1j, -1j, -1j]] * 2
    reference = reference_of(fake([100j, 200j, 400j], shapes, changes=changes))
    np.testing.assert_allclose(reference.lam.imag, [98.6, 198.6, 398.6])
    assert reference.uncertainty.frequency == pytest.approx(0.6 / 98.6)  # an error of 2 times the change, see `bars`
