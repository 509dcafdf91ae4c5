"""Doubts: pairs of modes that are one within rounding, what they explain, and which onsets are part of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fe_squeal.sweep.balance import Census, unbalanced
from fe_squeal.sweep.changes import Change
from fe_squeal.sweep.doubts import Doubt, one_in_rounding, pairs_in_rounding, without_narrow_windows
from fe_squeal.sweep.onset import Onset
from fe_squeal.sweep.onsets import _told_apart

_HZ = 100.0


def _onset(value: float, uncertainty: float, direction: str = "into", frequency: float = _HZ) -> Onset:
    return Onset("mu", value, frequency, "flutter", direction, 1.0, 1, 2, uncertainty)


def _census(value: float, *unstable: float, unsure: float | None = None, counted: bool = False) -> Census:
    """Unstable modes of these frequencies, Hz, and one pair in rounding of another one."""
    lam = 1.0 + 2j * np.pi * np.array(unstable)
    pairs = np.array([] if unsure is None else [2 * np.pi * unsure])
    return Census(value, lam, pairs, np.full(len(pairs), counted))


def test_pairs_are_neighbours_nearer_than_their_rounding():
    v = np.array([9.0, 1.0, 4.0, 1.1, 4.0 + 0.1j, 4.0 - 0.1j, 20.0])
    found = pairs_in_rounding(v, np.full(7, 0.05))
    assert sorted(map(sorted, found.tolist())) == [[1, 3], [2, 4]]  # each mode is in one pair at most


def test_a_pair_at_the_frequency_explains_one_mode_more_or_fewer():
    silent = _census(0.1)
    assert unbalanced("mu", silent, _census(0.2, _HZ), [_onset(0.15, 1e-9)], np.inf) == ""
    told = unbalanced("mu", silent, _census(0.2, _HZ), [], np.inf)
    assert told == "between mu = 0.1 and 0.2 0 modes become 1 unstable ones, of which the onsets found explain +0"
    for before, now, onsets in (
        (silent, _census(0.2, _HZ, unsure=_HZ, counted=True), []),
        (_census(0.1, _HZ), _census(0.2, _HZ, unsure=_HZ, counted=True), [_onset(0.15, 1e-2, "out of")]),
        (_census(0.1, _HZ), _census(0.2, _HZ, unsure=1.001 * _HZ), [_onset(0.15, 1e-2)]),
    ):
        doubt = unbalanced("mu", before, now, onsets, np.inf)
        assert isinstance(doubt, Doubt)
        assert (doubt.low, doubt.high, doubt.frequency_hz) == (0.1, 0.2, pytest.approx(_HZ, rel=2e-3))


@pytest.mark.parametrize(
    ("before", "now"),
    [
        (_census(0.1), _census(0.2, _HZ, unsure=1.1 * _HZ)),  # a pair of another frequency
        (_census(0.1), _census(0.2, _HZ, _HZ, unsure=_HZ)),  # two modes more
        (_census(0.1, _HZ, unsure=_HZ), _census(0.2)),  # the pair is not the unstable mode, which is lost
    ],
)
def test_a_pair_explains_nothing_else(before, now):
    assert isinstance(unbalanced("mu", before, now, [], np.inf), str)


@pytest.mark.parametrize(("apart", "damped", "told"), [(0.3, False, True), (0.5, False, False), (0.3, True, False)])
def test_modes_that_rounding_moves_cannot_be_followed(apart, damped, told):
    """Not where they are farther apart than their rounding, nor with dampers, whose eigenvalues are not θ."""
    omega = 2 * np.pi * _HZ
    v = omega**2 + np.array([0.0, apart, 50.0])
    unstable = np.array([True, False, False])
    node = SimpleNamespace(v=v, blur=np.full(3, 0.1), unstable=unstable, C=1.0 if damped else None)
    step = SimpleNamespace(between=lambda p: node, end=lambda i: node)
    found = one_in_rounding(step, 0.1, 0.2, omega)
    assert found == (Doubt(0.1, 0.2, pytest.approx(_HZ)) if told else None)


def test_windows_narrower_than_their_ends_are_doubts():
    into, out = _onset(0.3, 1e-3), _onset(0.3015, 1e-3, "out of")
    kept, doubts = without_narrow_windows([into, out, _onset(0.5, 1e-9)], 1e-6, 1.0)
    assert [o.value for o in kept] == [0.5]
    assert doubts == [Doubt(0.3, 0.3015, _HZ)]
    sure = [_onset(0.3, 1e-6), _onset(0.3015, 1e-6, "out of")]
    assert without_narrow_windows(sure, 1e-6, 1.0) == (sure, [])
    assert without_narrow_windows([into, out], 1e-2, 1.0) == ([], [])  # so narrow a window is not looked for
    other = _onset(0.3, 1e-9), _onset(0.3, 1e-9, "out of", 1.001 * _HZ)  # two modes, of two frequencies
    assert without_narrow_windows(other, 1e-6, 1.0) == (list(other), [])


def test_onsets_of_steps_before_are_not_judged_by_the_length_of_this_one():
    """Frequencies 3e-3 apart are of one mode in a step of 500 times the uncertainty, and not in a longer one."""
    old = _onset(0.3, 1e-3), _onset(0.3015, 1e-3, "out of", 1.003 * _HZ)
    assert without_narrow_windows(old, 0.0, 10.0) == (list(old), [])
    new = _onset(0.5, 1e-9)
    assert without_narrow_windows([*old, new], 0.0, 0.5, 2) == ([*old, new], [])
    assert without_narrow_windows([*old, new], 0.0, 0.5, 1) == ([new], [Doubt(0.3, 0.3015, _HZ)])


def test_onsets_that_a_doubt_covers():
    doubt = Doubt(0.3, 0.4, _HZ)
    assert doubt.covers(_onset(0.35, 0.02)) and doubt.covers(_onset(0.41, 0.02))
    assert not doubt.covers(_onset(0.35, 1e-9))  # far more certain: perhaps of other modes, and never dropped
    assert not doubt.covers(_onset(0.43, 0.02))
    assert not doubt.covers(_onset(0.35, 0.02, frequency=1.1 * _HZ))


def test_doubts_are_joined_in_either_order():
    first, second = Doubt(0.3, 0.32, _HZ), Doubt(0.33, 0.35, 1.001 * _HZ)
    for a, b in ((first, second), (second, first)):
        both = a.joined(b)
        assert both is not None and (both.low, both.high) == (0.3, 0.35)
    assert first.joined(Doubt(0.4, 0.41, _HZ)) is None
    assert first.joined(Doubt(0.33, 0.35, 1.1 * _HZ)) is None


def test_a_crowd_of_unstable_modes_is_counted():
    """Eight of them 5.5 % apart, with no gap wide enough for a limit below each but between them, become five."""
    omega, none = 100 * 1.055 ** np.arange(8), np.zeros(0)
    before, now = (Census(p, 1j * w + 1, none, np.zeros(0, bool)) for p, w in ((0.0, omega), (1.0, omega[3:])))
    told = unbalanced("mu", before, now, [], 1.01 * omega[-1])
    assert isinstance(told, str) and "7 modes become 4" in told
    assert unbalanced("mu", before, before, [], 1.01 * omega[-1]) == ""


@pytest.mark.parametrize(("omega", "runs"), [((100.0, 101.0), 2), ((100.0, 100.05), 1), ((1e-4, 2e-4), 1)])
def test_changes_at_one_value_are_one_only_if_their_frequencies_are(omega, runs):
    """However high other modes are; but near zero a frequency is the root of rounding."""
    none = np.zeros(2, complex)
    changes = [Change("zero", 1, 0.3, 0.3, (0.2, 0.4), w**2, none, none, none[:, None]) for w in omega]
    high = SimpleNamespace(lam=np.array([1e4j]))
    step = SimpleNamespace(width=1.0, modes_at_ends=(high, high), model=SimpleNamespace(terms=()))
    assert len(_told_apart(step, changes)) == runs
