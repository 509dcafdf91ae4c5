"""Errors of measurements against a reference, on modes and onsets that are made up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from accuracy_scene import fake

from fe_squeal.accuracy.reference import along, as_reference, errors_of, reference_of, same_modes, with_exact


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


def test_a_frequency_near_critical_damping_counts_beside_its_eigenvalue():
    """λ = −93 + 36.8i is nearly real: 1 rad/s is 2.7 % of its frequency and 1 % of |λ|, as of an undamped mode."""
    shapes = np.eye(6)[:, :3] + 0j
    slow = -93 + 1j * (100**2 - 93**2) ** 0.5
    reference = reference_of(fake([slow, 100j, 200j], shapes))
    for off in ([1j, 0, 0], [0, 1j, 0], [-1j, 0, 0]):
        found = fake([slow + off[0], 100j + off[1], 200j], shapes)
        assert errors_of(found, reference).frequency == pytest.approx(0.01)


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


def test_a_window_that_one_mesh_alone_has_is_as_wrong_as_it_is_wide():
    """Both ends move by half its width to close it; an end without the other, or of other branches, counts whole."""
    shapes, hz, lam = np.eye(6)[:, :3] + 0j, 150 / (2 * np.pi), [100j, 150j, 300j]
    one = (0.4, 100 / (2 * np.pi), 1, 1, 1, 2)
    into, out, end = (0.200, hz, 1, 1, 2, 3), (0.204, hz, 1, 0, 2, 3), (0.21, hz, 1, 0, 1, np.nan)
    again = (0.30, hz, 1, 1, 2, 3)
    few, many = (fake(lam, shapes, onsets) for onsets in ([one], [one, into, out]))
    for found, reference in ((few, many), (many, few)):
        assert errors_of(found, as_reference(reference)).onset == pytest.approx(0.002 / 0.2)
    for whole in ([one, into], [one, out], [one, into, end], [one, into, out, again], [one, out, again]):
        assert errors_of(fake(lam, shapes, whole), as_reference(few)).onset == 1.0


def test_errors_on_the_same_mesh_are_the_largest_along_the_sweep():
    """At the first of three values growth is half of what it is in truth, at the last it is right; by shape, as errors
    against other meshes are found, the last value alone would count."""
    shapes = np.eye(6)[:, :3] + 0j
    best = fake([10 + 100j, 150j, 300j], shapes)
    best = replace(best, lam=np.array([[8 + 100j, 150j, 300j], [9 + 100j, 150j, 300j], [10 + 100j, 150j, 300j]]))
    found = replace(best, lam=best.lam + np.array([[-4 + 1j, 0, 0], [0, -0.3j, 0], [0, 0, 0]]))
    errors = errors_of(found, as_reference(best))
    assert errors.growth == 0
    swept = along(errors, found, best)
    assert (swept.frequency, swept.growth) == pytest.approx((1 / abs(8 + 100j), 0.4))
    lost = replace(best, lam=np.delete(best.lam, 0, axis=1))  # the growing mode is not found at all
    assert (along(errors, lost, best).growth, along(errors, lost, best).frequency) == (1.0, 1.0)
    extra = replace(best, lam=np.column_stack([best.lam, np.full(3, 5 + 200j)]))  # one that should not be there
    assert along(errors, extra, best).growth == 0.5
    still = replace(best, lam=1j * best.lam.imag)  # nothing grows in either
    assert np.isnan(along(errors_of(still, as_reference(still)), still, still).growth)


def test_reference_is_extrapolated_and_says_how_sure_it_is():
    shapes = np.eye(6)[:, :3] + 0j
    changes = [[-1j, -1j, -1j]] * 2
    reference = reference_of(fake([100j, 200j, 400j], shapes, changes=changes))
    np.testing.assert_allclose(reference.lam.imag, [98.6, 198.6, 398.6])
    assert reference.uncertainty.frequency == pytest.approx(0.6 / 98.6)  # an error of 2 times the change, see `bars`


def test_what_only_the_refined_mesh_has_is_not_known_either():
    """Another mesh may have it or not; an onset that neither has is an error."""
    shapes, one = np.eye(6)[:, :3] + 0j, (0.4, 100 / (2 * np.pi), 1, 1, 1, 2)
    new, far = (0.7, 150 / (2 * np.pi), 1, 1, 0, np.nan), (0.1, 200 / (2 * np.pi), 1, 1, 2, 3)
    lam, changes = [100j, 150j, 300j], [[-1j] * 3] * 2
    reference = reference_of(fake(lam, shapes, [one], changes, [new]))
    assert np.isnan(reference.uncertainty.onset) and reference.lost == (0, 0, 1)
    for found, error in (([one], 0.0), ([one, (0.72, *new[1:4], 2, 3)], 0.0), ([one, far], 1.0)):
        assert errors_of(fake(lam, shapes, found), reference).onset == error
    out = (0.75, new[1], 1, 0, 2, 3)  # the end of the window that begins there
    assert errors_of(fake(lam, shapes, [one, new, out]), reference).onset == 0.0
    high = (0.1, 350 / (2 * np.pi), 1, 1, 3, np.nan)  # beyond 0.8 of the highest frequency
    assert errors_of(fake(lam, shapes, [one, high]), reference).onset == 0.0
    alone = reference_of(fake(lam, shapes, [one], changes))
    assert alone.uncertainty.onset == 0.0 and errors_of(fake(lam, shapes, [one, new]), alone).onset == 1.0
    assert errors_of(fake(lam, shapes, [new]), reference_of(fake(lam, shapes, (), changes))).onset == 1.0


def test_what_the_refined_mesh_does_not_have_is_not_known():
    """A NaN is no change of 0: the mode or onset has no error, and the quantity that it counts for no uncertainty."""
    shapes, two = np.eye(6)[:, :4] + 0j, ((0.4, 100 / (2 * np.pi), 1, 1, 1, 2), (0.6, 150 / (2 * np.pi), 1, 1, 2, 3))
    lam, change = np.array([5 + 100j, 8 + 150j, 200j, 400j]), np.full((2, 4), -1.0 - 1j)
    found = replace(fake(lam, shapes, two, change), likely_onsets=np.array([[0.414, 0.006], [np.nan, np.inf]]))
    half = reference_of(found)
    assert np.isnan(half.uncertainty.onset) and half.lost == (0, 0, 1)
    assert half.uncertainty.frequency == pytest.approx(0.6 / abs(3.6 + 98.6j))
    shifted = fake(lam, shapes, [(0.414, *two[0][1:]), (0.9, *two[1][1:])])
    assert errors_of(shifted, half).onset == pytest.approx(0.0, abs=1e-12)  # the other has none
    none = reference_of(replace(found, likely_onsets=np.full((2, 2), np.nan)))
    assert np.isnan(errors_of(shifted, none).onset) and np.isnan(none.uncertainty.onset) and none.lost[2] == 2
    change[:, 1] = np.nan * (1 + 1j)  # the mode at 150 rad/s, which grows most
    gone = reference_of(fake(lam, shapes, changes=change))
    assert np.isnan([gone.uncertainty.frequency, gone.uncertainty.growth]).all() and gone.lost == (1, 1, 0)
    off = errors_of(fake([3.6 + 98.6j, 2 + 170j, 198.6j, 398.6j], shapes), gone)
    assert (off.frequency, off.growth) == pytest.approx((0.0, 0.0), abs=1e-12)
    empty = reference_of(fake(lam, shapes, changes=np.full((2, 4), np.nan * (1 + 1j))))
    away = errors_of(fake(lam, shapes), empty)
    assert np.isnan([away.frequency, away.growth, empty.uncertainty.frequency, empty.uncertainty.growth]).all()
    exact = with_exact(empty, lam.imag / (2 * np.pi))  # what is known exactly needs no refined mesh
    assert exact.uncertainty.frequency == 0.0 and exact.lost[0] == 0
    assert errors_of(fake(1.01 * lam, shapes), exact).frequency == pytest.approx(0.01)
