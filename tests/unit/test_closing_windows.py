"""Bars of the ends of windows of instability that a finer mesh makes narrower, against the law of two coupled modes."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal import sweep
from fe_squeal.accuracy.bars import Parts, bar_of_parts
from fe_squeal.accuracy.closing import with_closing_windows
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term

W, SPEED, MIDDLE = 5000.0, 1e7, 0.4


def onsets_of(h2):
    """θ = ω² ± √(s²(p − m)² − h²): flutter where |p − m| < h/s; a third mode is far away."""
    x, coupling, h = np.diag([SPEED, -SPEED, 0.0]), np.zeros((3, 3)), np.sqrt(max(h2, 0.0))
    coupling[0, 1], coupling[1, 0] = h, -h
    K = np.diag([1.0, 1.0, 4.0]) * W**2 + coupling - MIDDLE * x
    terms = (Term("mass", "M", sp.eye_array(3, format="csr"), True), Term("stiffness", "K", sp.csr_array(K), False),
             Term("friction", "K", sp.csr_array(x), True, {"p": 1}))  # fmt: skip
    return sweep(Problem(terms, {"p": 0.0}), np.linspace(0.0, 1.0, 11), "p", modes=3).onsets


@pytest.mark.parametrize("half", [0.006, 0.02])
@pytest.mark.parametrize(("rate", "is_singular"), [(2, False), (4, False), (1, True)])
@pytest.mark.parametrize("left", [0.98, 0.5, 0.02, -0.02])
def test_bars_hold_until_the_window_is_closed(half, rate, is_singular, left):
    """Errors of the mesh change h² at usual rates; `left` of it is what an infinitely fine mesh has.

    A window that such a mesh has not has no bar but an infinite one; one that is nearly closed may have it, too.
    """
    h2 = (half * SPEED) ** 2
    error = (1 - left) * h2
    here, finer = onsets_of(h2), onsets_of(h2 - (1 - 2.0**-rate) * error)
    change = np.array([b.value - a.value for a, b in zip(here, finer, strict=True)])
    first = (1 - 2.0**-rate) * error / (2 * half * SPEED**2)  # dp/dh² to first order, at the first end
    parts = Parts.of(np.array([[first, -first]]), np.array([is_singular]))
    bars = with_closing_windows(here, change, bar_of_parts(change, parts, 2))
    assert [o.direction for o in here] == ["into", "out of"]
    if left < 0:
        assert np.isinf(bars).all()
    else:
        true = np.abs([a.value - b.value for a, b in zip(here, onsets_of(left * h2), strict=True)])
        assert (bars >= 0.88 * true).all()  # 0.9 where half is left of a singular one, by the rule of singular parts
    if left > 0.9:
        np.testing.assert_allclose(bars, bar_of_parts(change, parts, 2), rtol=0.05)


def test_ends_of_different_windows_are_left_alone():
    here = onsets_of((0.02 * SPEED) ** 2)
    change, bars = np.array([0.01, np.nan]), np.array([0.02, np.nan])
    np.testing.assert_array_equal(with_closing_windows(here, change, bars), bars)
    np.testing.assert_array_equal(with_closing_windows(here[:1], change[:1], bars[:1]), bars[:1])
