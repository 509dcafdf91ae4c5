"""Onsets where rounding is large, or where eigenvalues crowd far from any onset: right, and at few values.

Bodies that are nearly rigid are 1e12 times as stiff as the modes that matter: rounding moves these by 1e-4, by other
amounts at every value of the sweep. Strong stiffness-proportional damping puts as many real eigenvalues as there
are unknowns next to −1/β.
"""

from __future__ import annotations

import importlib
import re

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from selection import some

from fe_squeal import find_onsets, sweep
from fe_squeal.compare import SETUPS
from fe_squeal.errors import NotConvergedError, SceneWarning, TooLargeError
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.reduced import ReducedModel
from fe_squeal.sweep.roots import Roots


@pytest.fixture
def asked(monkeypatch):
    """Numbers of values that each step asked modes of."""
    counts = []
    onsets = importlib.import_module("fe_squeal.sweep.onsets")  # the name is that of the function in fe_squeal
    whole = onsets.scan

    def counted(*args):
        seen = whole(*args)
        counts.append(seen.nodes)
        return seen

    monkeypatch.setattr(onsets, "scan", counted)
    return counts


def test_nearly_rigid_bodies(asked):
    """Three blocks 1e12 times as stiff as their springs, two of them alike: the onset of nine masses, no more. The two
    that are alike turn at one frequency, which friction leaves as it is: rounding may hide whether these modes grow."""
    setup = SETUPS["nine-dof"]
    case = setup.make()
    result = sweep(case.problem(setup.modulus), np.linspace(0, 1, 6), modes=12)
    [onset] = result.onsets
    [exact] = [mu for mu in case.model.critical_mu() if mu < 1]
    assert onset.value == pytest.approx(exact, rel=1e-4)  # what is left falls with 1/E: tests/analytic/test_compare.py
    alike = result.points[0].modes.select(np.arange(4, 6))
    turning = alike.frequency_hz
    assert 2 * np.pi * np.ptp(turning) <= alike.re_uncertainty.sum() < 1e-2 * alike.lam[0].imag
    for sentence in result.unsettled:
        assert "are one within rounding" in sentence
        assert float(re.search(r"[\d.]+(?= Hz)", sentence)[0]) == pytest.approx(turning[0], rel=1e-3)
    assert sum(asked) < 20 * len(asked)


@pytest.mark.slow
@pytest.mark.parametrize("values", [np.linspace(0, 2.5, 6), np.linspace(1.69, 1.73, 5)])
def test_two_modes_that_are_one_within_rounding(values):
    """Near μ = 1.71 two modes of the nearly rigid bodies cross and stay stable, nearer to each other than rounding. The
    order of sums decides for which values it hides whether they grow: for many around 1.71, for a few, or none.
    Whatever the steps, no onset is told to better than 1e-3 there, and no sentence tells of values where the modes, one
    of which is known exactly and the other does not move, are farther apart than rounding."""
    setup = SETUPS["nine-dof"]
    case = setup.make()
    exact = [mu for mu in case.model.critical_mu() if values[0] < mu < values[-1]]
    problem = case.problem(setup.modulus)
    result = sweep(problem, values, modes=12)
    assert [o.value for o in result.onsets if o.uncertainty < 1e-3] == pytest.approx(exact, rel=1e-4)
    for sentence in result.unsettled:
        assert "are one within rounding" in sentence
        low, high, told_hz = (float(word) for word in re.findall(r"[\d.]+(?= and| two| Hz)", sentence))
        assert low <= high
        for end in (low, high):
            modes = sweep(problem, [end], modes=12).points[0].modes
            pair = modes.select(np.argsort(np.abs(modes.lam.imag - 2 * np.pi * told_hz))[:2])
            still = pair.lam[np.argmin(pair.re_uncertainty)].imag
            moving = case.model.eigenvalues([end])[0].imag
            apart = np.abs(moving - still).min()
            assert apart < 4 * pair.re_uncertainty.max() < 0.05 * still


@pytest.mark.parametrize("beta", [0.3, 3.0])
def test_eigenvalues_crowd_at_the_inverse_of_beta(beta, asked):
    """C = βK: every mode is overdamped, with one eigenvalue next to −1/β; friction moves them by little."""
    rng = np.random.default_rng(7)
    n = 24
    theta = np.sort(rng.uniform(1e8, 1e10, n))
    Q = la.qr(rng.standard_normal((n, n)))[0]
    K, F = Q @ np.diag(theta) @ Q.T, rng.standard_normal((n, n)) * 1e6
    terms = (
        Term("inertia", "M", sp.eye_array(n, format="csr"), True, {}),
        Term("elastic", "K", sp.csr_array((K + K.T) / 2), True, {}),
        Term("rayleigh", "C", sp.csr_array(beta * (K + K.T) / 2), True, {}),
        Term("friction", "K", sp.csr_array(F), False, {"mu": 1}),
    )
    result = sweep(Problem(terms, {"mu": 0.0}), np.linspace(0, 0.8, 3), modes=4)
    assert not result.onsets and not result.unsettled
    assert sum(asked) < 10 * max(len(asked), 1)


@pytest.mark.parametrize("method", ["direct", "reduced"])
@pytest.mark.parametrize("power", some([1, 3, 5], lambda power: power < 5))
def test_growth_that_passes_zero_without_a_slope(power, method):
    """Gyroscopic forces, and friction in proportion to p^m: λ depends on p^m alone, and Re λ passes zero at p = 0.

    For m = 3 and 5 it is lost in rounding over a part of the sweep that grows with m. Bars have to tell of it. They are
    as wide as the errors of λ make them: some hundred roundings, or, in a reduced model, what `tolerance` allows."""
    rng, n = np.random.default_rng(power), 6
    G, F = rng.standard_normal((2, n, n))
    K = sp.diags_array(np.linspace(1, 40, n) * rng.uniform(0.9, 1.1, n)).tocsr()
    terms = (
        Term("mass", "M", sp.eye_array(n, format="csr"), True),
        Term("elastic", "K", K, True),
        Term("gyroscope", "C", sp.csr_array(0.3 * (G - G.T)), False, skew=True),
        Term("friction", "K", sp.csr_array(0.05 * F), False, {"p": power}),
    )
    result = sweep(Problem(terms, {"p": -1.0}), np.linspace(-1.0, 1.3, 4), "p", modes=n, method=method)
    found = len(result.onsets)
    assert found == n or (power > 1 and found + sum("not refined" in w for w in result.warnings) >= n)
    step = 1e-4  # of p^m, in which Re λ is a line there
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K.toarray() - 0.05 * step * F, -0.3 * (G - G.T)]])
    exact = la.eigvals(A)
    for onset in result.onsets:
        omega = 2 * np.pi * onset.frequency_hz
        slope = abs(exact[np.argmin(np.abs(exact - 1j * omega))].real) / step
        limit = 50 * 1e-11 ** (1 / power) if method == "direct" else (1e-8 * omega / slope) ** (1 / power)
        assert abs(onset.value) <= onset.uncertainty <= limit


@pytest.fixture
def bisected(monkeypatch):
    """Return a problem with an onset at p = 0.1, which Newton's method is kept from."""

    def fail(*_):
        raise NotConvergedError("left to bisection")

    monkeypatch.setattr(Roots, "of", fail)
    parts = [("m", "M", np.eye(3), {}), ("k", "K", np.diag([1.0, 1.2, 9.0]), {}),
             ("f", "K", np.array([[0, 1.0, 0], [-1.0, 0, 0], [0, 0, 0]]), {"p": 1})]  # fmt: skip
    return Problem(tuple(Term(n, slot, sp.csr_array(A), n != "f", power) for n, slot, A, power in parts), {"p": 0.0})


@pytest.mark.parametrize("error", [1e-3, 10.0])
def test_the_error_of_a_reduced_model_is_in_the_bar_of_a_bisected_onset_however_large(bisected, monkeypatch, error):
    monkeypatch.setattr(ReducedModel, "root_error", lambda *_, **__: (error, 0.0))
    (onset,) = sweep(bisected, [0.0, 0.07, 0.2], "p", modes=2, method="reduced").onsets
    assert onset.value == pytest.approx(0.1, abs=1e-7) and onset.uncertainty >= error


def test_an_onset_that_does_not_fit_into_memory_is_told_and_ends_nothing(bisected, monkeypatch):
    def refuse(*_, **__):
        raise TooLargeError("too large")

    monkeypatch.setattr(importlib.import_module("fe_squeal.sweep.bisection"), "solve_modes", refuse)
    with pytest.warns(SceneWarning, match="not refined: too large"):
        assert not find_onsets(bisected, [0.0, 0.07, 0.2], "p", modes=2, method="direct")


def test_a_damped_window_of_which_neither_end_is_refined_is_told(monkeypatch):
    """ü + 0.1((p − ½)² − 1e-4)u̇ + u = 0 grows for |p − ½| < 0.01, between samples that touch each other."""
    def refuse(*_, **__):
        raise TooLargeError("too large")

    for module in ("bisection", "roots"):
        for name in ("solve_modes", "find_crossing"):
            monkeypatch.setattr(importlib.import_module(f"fe_squeal.sweep.{module}"), name, refuse, raising=False)
    one = sp.csr_array(np.eye(1))
    terms = [Term("m", "M", one, True), Term("k", "K", one, True)]
    parts = enumerate((0.1 * (0.25 - 1e-4), -0.1, 0.1))
    terms += [Term(f"c{i}", "C", c * one, True, {"p": i} if i else {}) for i, c in parts]
    result = sweep(Problem(tuple(terms), {"p": 0.0}), [0.0, 1.0], "p", modes=1, method="direct")
    told = [w for w in result.warnings if "not refined: too large" in w]
    assert not result.onsets and len(told) == 2


@pytest.mark.parametrize("values", [(0, 3), (0, 0.5, 1, 1.5), (0.5, 2)])
def test_growth_that_is_clear_only_far_beyond_a_bisected_onset(values):
    """Two masses with ten times the stiffness that doubles tell from zero, C = 0.3 (1 − p): Re λ = 0.15 (p − 1)."""
    stiff = 1e13 * np.array([[1.0, -1.0], [-1.0, 1.0]]) + np.eye(2)
    parts = [("m", "M", np.eye(2), {}), ("k", "K", stiff, {}), ("c", "C", 0.3 * np.eye(2), {})]
    parts.append(("d", "C", -0.3 * np.eye(2), {"p": 1}))
    terms = tuple(Term(name, slot, sp.csr_array(A), True, powers) for name, slot, A, powers in parts)
    [onset] = sweep(Problem(terms, {"p": 0.0}), values, "p", modes=1).onsets
    assert abs(onset.value - 1) <= onset.uncertainty < 0.3
    assert onset.crossing_speed == pytest.approx(0.15, rel=0.1)  # rounding of Re λ is 0.018, growth at most 0.3


@pytest.mark.parametrize("stiffness", [1e6, 1e9, 1e12])
def test_roots_that_rounding_hides_from_bisection(bisected, stiffness):
    """K = diag(1, 2) + p [[1, 1], [−1, 0]], turned together with two stiff modes: ((1 − p)/2)² = p² at p = 1/3, where
    θ = 5/3 ± √(1/3 − p): Re λ = √dp/(2√(5/3))."""
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((4, 4)))[0]
    friction = la.block_diag([[1.0, 1.0], [-1.0, 0.0]], np.zeros((2, 2)))
    K = turn @ np.diag([1.0, 2.0, stiffness, 2 * stiffness]) @ turn.T
    parts = [("m", "M", np.eye(4), True, {}), ("k", "K", (K + K.T) / 2, True, {})]
    parts.append(("f", "K", turn @ friction @ turn.T, False, {"p": 1}))
    terms = tuple(Term(name, slot, sp.csr_array(A), symmetric, powers) for name, slot, A, symmetric, powers in parts)
    [onset] = sweep(Problem(terms, {"p": 0.0}), [0, 1], "p", modes=2).onsets
    assert abs(onset.value - 1 / 3) <= onset.uncertainty < 1e-7 + 1e-14 * stiffness
    assert onset.crossing_speed == pytest.approx(np.sqrt(3 / 20), rel=0.02)
