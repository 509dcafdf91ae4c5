"""Windows of instability that one mesh alone has: they keep a search from its end only if something grows in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal import sweep
from fe_squeal.accuracy.largest_error import estimated_error, slow_windows
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term

OMEGA, HALF, CENTRE = 5000.0, 3000.0, 0.4  # rad/s; rad²/s², half the split of θ where growth is largest; its place
SLOPE = 1e7  # rad²/s² over the unit of p


def window(damping=0.0):
    """θ = ω² ± √(s²(p − p₀)² − h²): a window |p − p₀| < h/s, in whose middle Re λ = h/2ω to first order in h/ω²."""
    x, coupling = np.diag([SLOPE, -SLOPE, 0.0]), np.zeros((3, 3))
    coupling[0, 1], coupling[1, 0] = HALF, -HALF
    K = np.diag([1.0, 1.0, 4.0]) * OMEGA**2 + coupling - CENTRE * x  # the third mode is far above
    terms = [
        Term("mass", "M", sp.eye_array(3, format="csr"), True),
        Term("stiffness", "K", sp.csr_array(K), False),
        Term("friction", "K", sp.csr_array(x), True, {"p": 1}),
    ]
    if damping:
        terms.append(Term("damping", "C", damping * sp.eye_array(3, format="csr"), True))
    result = sweep(Problem(tuple(terms), {"p": 0.0}), np.linspace(0.0, 1.0, 11), "p", modes=3)
    assert [o.direction for o in result.onsets] == ["into", "out of"]
    return with_bars(result, np.inf)


def with_bars(result, of_onsets):
    """The same with bars: 1e-6 of each frequency, and those of onsets as they are given."""
    points = tuple(replace(p, discretisation=1e-6j * p.modes.lam.imag) for p in result.points)
    return replace(result, points=points, onsets=tuple(replace(o, discretisation=of_onsets) for o in result.onsets))


@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_growth_in_a_window_by_its_closed_form(damping):
    result = window(damping)
    growth = HALF / (2 * OMEGA) - damping / 2
    if damping:  # tangents at both ends lie above the growth between
        assert not slow_windows(result, growth)
        assert slow_windows(result, 10 * growth) == list(result.onsets)
        return
    assert slow_windows(result, 1.001 * growth) == list(result.onsets)
    assert not slow_windows(result, 0.999 * growth)


def test_a_window_counts_unless_other_modes_grow_much_faster():
    result = window()
    assert estimated_error(result) == np.inf  # nothing grows faster than what is in it
    assert np.isnan(estimated_error(with_bars(result, np.nan)))  # interpolated matrices lack it
    point = next(p for p in result.points if p.modes.lam.real.max() > 0)
    fast = replace(point.modes, lam=point.modes.lam.imag * 1j + np.array([100.0, -100.0, 0.0]))
    grown = replace(result, points=(*result.points, replace(point, modes=fast, branches=np.array([7, 8, 9]))))
    assert estimated_error(grown) == pytest.approx(1e-6)
    known = with_bars(grown, 0.01)
    assert estimated_error(known) == pytest.approx(0.01 / CENTRE, rel=1e-2)


def test_an_end_without_the_other_counts():
    result = window()
    for kept in result.onsets:
        assert not slow_windows(replace(result, onsets=(kept,)), 1e9)
    into, out = result.onsets
    other = replace(out, frequency_hz=2 * out.frequency_hz)
    assert not slow_windows(replace(result, onsets=(into, other)), 1e9)


def test_a_window_whose_speed_is_not_known_counts():
    result = window()
    for i in (0, 1):
        onsets = list(result.onsets)
        onsets[i] = replace(onsets[i], crossing_speed=np.nan)
        assert not slow_windows(replace(result, onsets=tuple(onsets)), 1e9)


def test_a_bar_near_critical_damping_counts_beside_the_eigenvalue():
    """ü + 2ζu̇ + u = 0 with ζ = 0.96 and a bar of 1 % of |λ| = 1, which is 3.6 % of its frequency of 0.28 rad/s."""
    one = sp.csr_array([[1.0]])
    terms = Term("m", "M", one, True), Term("k", "K", one, True), Term("c", "C", 1.92 * one, True)
    result = sweep(Problem(terms, {"p": 0.0}), [0.0], "p", modes=1)
    assert result.points[0].modes.lam[0] == pytest.approx(-0.96 + 0.28j)
    barred = replace(result, points=(replace(result.points[0], discretisation=np.array([0.5 + 0.01j])),))
    assert estimated_error(barred) == pytest.approx(0.01)
