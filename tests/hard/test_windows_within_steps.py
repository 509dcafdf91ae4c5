"""Windows of instability within one step of a sweep, where a coarse look at the step shows nothing."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize as so
import scipy.sparse as sp
import structures
from families import damped, damped_window, judge, make, window
from selection import some

import fe_squeal
from fe_squeal.eigen.pencil import FreeMotions
from fe_squeal.eigen.request import Request
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep.running import RunningSweep


class Made:
    """The source of a problem whose stiffness, a function of mu, is made anew at each value, as under preload."""

    def __init__(self, stiffness, friction):
        self.stiffness, self.friction = stiffness, friction

    def problem(self, values):
        mu = values.get("mu", 0.0)
        K, F = self.stiffness(mu), self.friction(mu)
        terms = (
            Term("mass", "M", sp.eye_array(len(K), format="csr"), True), Term("elastic", "K", sp.csr_array(K), True),
            Term("friction", "K", sp.csr_array(F), False, {"mu": 1}),
        )  # fmt: skip
        held = FreeMotions.none(len(K))
        return Problem(terms, {"mu": mu}, None, self, frozenset({"mu"}), dict(values), free=lambda _: held)

    def check(self, values):
        pass

    def number(self, path):
        return {"mu": 0.0}[path]

    def solved_with(self, linear_solver):
        return self


class Lossy(Made):
    """The same with friction that mu is no factor of, and loss factors that make an imaginary part of the stiffness."""

    def problem(self, values):
        made, losses = super().problem(values), sp.csr_array(np.diag([0.001, 0.03]))
        *others, friction = made.terms
        lossy = replace(friction, powers={}), Term("loss", "K", losses, True, imaginary=True)
        return replace(made, terms=(*others, *lossy))


def matrix_problem(*stiffness, friction=None, damping=None):
    """A problem of unit masses with stiffness[0] + mu stiffness[1] + mu² stiffness[2] and a skew friction term."""
    n = len(stiffness[0])
    terms = [Term("m", "M", sp.eye_array(n, format="csr"), True)]
    terms += [Term(f"k{i}", "K", sp.csr_array(np.asarray(K, float)), True, {"mu": i} if i else {})
              for i, K in enumerate(stiffness)]  # fmt: skip
    if friction is not None:
        terms.append(Term("f", "K", sp.csr_array(np.asarray(friction, float)), False, {"mu": 1}))
    if damping is not None:
        terms.append(Term("c", "C", damping * sp.eye_array(n, format="csr"), True))
    return Problem(tuple(terms), {"mu": 0.0})


@pytest.mark.parametrize("method", some(["direct", "reduced"], lambda method: method == "reduced"))
def test_contacts_that_open_one_after_the_other(method):
    """Both lower a θ by the same amount, so that ends and middle of the step 0.2 … 0.3 show the same distance of the
    two; between them they cross, and flutter twice."""
    n = 100
    base, F = np.diag(np.r_[1.5, 1.3, np.linspace(6, 60, n - 2)]), np.zeros((n, n))
    F[0, 1], F[1, 0] = 0.3, -0.3

    def closed(mu, first, last):
        return np.clip((last - mu) / (last - first), 0, 1)

    def stiffness(mu):
        K = base.copy()
        K[0, 0] += 0.7 * closed(mu, 0.21, 0.218)
        K[1, 1] += 0.7 * closed(mu, 0.235, 0.243)
        return K

    def distance(mu):  # of (Δθ/2)² from the square of the coupling
        K = stiffness(mu)
        return ((K[0, 0] - K[1, 1]) / 2) ** 2 - (0.3 * mu) ** 2

    fine = np.linspace(0, 0.4, 4001)
    signs = np.sign([distance(mu) for mu in fine])
    true = [so.brentq(distance, fine[k], fine[k + 1], xtol=1e-15) for k in np.flatnonzero(np.diff(signs))]
    problem = Made(stiffness, lambda mu: F).problem({"mu": 0.0})
    result = fe_squeal.sweep(problem, [0.0, 0.1, 0.2, 0.3, 0.4], modes=8, method=method)
    assert len(true) == 5 and not result.warnings
    assert [o.value for o in result.onsets] == pytest.approx(true, abs=1e-8)
    assert [o.direction for o in result.onsets] == ["into", "out of", "into", "out of", "into"]


def test_a_contact_that_opens_in_the_middle_of_a_step():
    """Ends and middle of the step lie on a straight line then, along which two θ stay 0.1 apart. The matrices do not:
    one θ falls at once in the middle, the other evenly, so that they cross twice."""
    F = np.array([[0.0, 0.1], [-0.1, 0.0]])

    def stiffness(mu):
        return np.diag([2.0 - 0.7 * np.clip((mu - 0.24) / 0.02, 0, 1), 1.9 - 0.7 * np.clip((mu - 0.2) / 0.1, 0, 1)])

    def distance(mu):
        K = stiffness(mu)
        return ((K[0, 0] - K[1, 1]) / 2) ** 2 - (0.1 * mu) ** 2

    fine = np.linspace(0.2, 0.3, 2001)
    signs = np.sign([distance(mu) for mu in fine])
    true = [so.brentq(distance, fine[k], fine[k + 1], xtol=1e-15) for k in np.flatnonzero(np.diff(signs))]
    problem = Made(stiffness, lambda mu: F).problem({"mu": 0.0})
    result = fe_squeal.sweep(problem, [0.0, 0.1, 0.2, 0.3], modes=2, method="direct")
    assert len(true) == 4 and [o.value for o in result.onsets] == pytest.approx(true, abs=1e-8)
    assert [o.direction for o in result.onsets] == ["into", "out of", "into", "out of"] and not result.warnings


def test_flutter_of_lossy_modes_between_values_at_which_friction_is_the_same():
    """Friction is a bell about 0.25. Modes grow where Im θ₁ < 0 of the lower θ₁ of K + iη + friction."""
    def friction(mu):
        return (0.05 + 0.1 * np.exp(-(((mu - 0.25) / 0.05) ** 2))) * np.array([[0.0, 1.0], [-1.0, 0.0]])

    def losing(mu):
        return np.linalg.eigvals(np.diag([1 + 0.001j, 1.5 + 0.03j]) + friction(mu)).imag.min()

    true = so.brentq(losing, 0.1, 0.25, xtol=1e-14), so.brentq(losing, 0.25, 0.4, xtol=1e-14)
    problem = Lossy(lambda mu: np.diag([1.0, 1.5]), friction).problem({"mu": 0.0})
    result = fe_squeal.sweep(problem, [0.0, 1.0], modes=2, method="direct")
    assert [o.direction for o in result.onsets] == ["into", "out of"]
    np.testing.assert_allclose([o.value for o in result.onsets], true, atol=1e-7)


@pytest.mark.parametrize("values", [[0.0, 0.8], [0.0, 0.4, 0.8], np.linspace(0, 0.8, 9)])
def test_the_onset_is_that_of_the_matrices_and_not_of_interpolated_ones(values):
    """Also where the modes at the ends of a step span all unknowns."""
    F = np.array([[0.0, 1.0], [-1.0, 0.0]])

    def stiffness(mu):
        return np.diag([1.0 + 0.3 * np.tanh(4 * mu), 2.0])

    true = so.brentq(lambda mu: ((1 - 0.3 * np.tanh(4 * mu)) / 2) ** 2 - mu**2, 0.1, 1.0, xtol=1e-15)
    result = fe_squeal.sweep(Made(stiffness, lambda mu: F).problem({"mu": 0.0}), values, modes=2, method="direct")
    (onset,) = result.onsets
    assert abs(onset.value - true) <= 4 * onset.uncertainty <= 1e-12


@pytest.mark.parametrize("damping", [None, 1e-2])
@pytest.mark.parametrize("friction", [None, 1e-3])
@pytest.mark.parametrize("depth", [0.5, 0.1, 0.02])
def test_a_spring_that_is_negative_between_two_values(depth, friction, damping):
    """θ = 10(mu − 0.37)² − depth, alone in its group, of symmetric matrices and of others."""
    F = None if friction is None else friction * np.array([[0, 1], [-1, 0]])
    stiffness = np.diag([10 * 0.37**2 - depth, 50]), np.diag([-7.4, 0]), np.diag([10, 0])
    result = fe_squeal.sweep(matrix_problem(*stiffness, friction=F, damping=damping), [0.0, 1.0], modes=2)
    half = np.sqrt(depth / 10)
    assert [o.value for o in result.onsets] == pytest.approx([0.37 - half, 0.37 + half], abs=1e-7)
    assert [(o.kind, o.direction) for o in result.onsets] == [("divergence", "into"), ("divergence", "out of")]


@pytest.mark.slow
def test_friction_bends_a_mode_below_zero_and_back():
    """Matrices linear in mu: the lower of two θ has its lowest value inside the step, a little below zero."""
    rng, tried = np.random.default_rng(1), 0
    mu = np.linspace(0, 1, 801)
    while tried < 6:
        K0, K1 = np.diag(rng.uniform([1, 6], [6, 14])), np.diag(rng.uniform([-8, -16], 0))
        F = rng.uniform(0, 5) * np.array([[0, 1], [-1, 0]])
        v = np.array([np.linalg.eigvals(K0 + p * (K1 + F)) for p in mu])
        low = v.real.min(axis=1)
        i = int(np.argmin(low))
        if np.abs(v.imag).max() > 1e-9 or not 40 < i < 760:
            continue
        shift = low[i] + 0.004 * min(low[0] - low[i], low[-1] - low[i])
        if min(low[0], low[-1]) - shift <= 0.05:
            continue
        tried += 1
        result = fe_squeal.sweep(matrix_problem(K0 - shift * np.eye(2), K1, friction=F), [0.0, 1.0], modes=2)
        edges = np.flatnonzero(np.diff(low < shift))
        assert [o.direction for o in result.onsets] == ["into", "out of"]
        for onset, k in zip(result.onsets, edges, strict=True):
            assert mu[k] <= onset.value <= mu[k + 1]


@pytest.mark.parametrize("damping", [None, 1e-2])
@pytest.mark.parametrize("values", [3, 5])
@pytest.mark.parametrize(("others", "top", "drop"), [((1, 2, 5), 12.0, 80.0), ((1, 2, 5, 9), 11.1, 60.0)])
def test_a_pair_comes_into_the_range_within_a_step(others, top, drop, values, damping):
    """Modes up to a frequency are asked for: the onset of a pair that is above it at one value is found, too."""
    theta = [*np.square(others), top**2 - 1.5, top**2 + 1.5]
    falls = np.zeros(len(theta))
    falls[-2:] = -drop
    F = np.zeros((len(theta), len(theta)))
    F[-2, -1], F[-1, -2] = 1.7, -1.7
    problem = matrix_problem(np.diag(theta), np.diag(falls), friction=F, damping=damping)
    result = fe_squeal.sweep(problem, np.linspace(0, 1, values), max_frequency=10 / (2 * np.pi), method="direct")
    (onset,) = result.onsets
    assert onset.direction == "into" and onset.value == pytest.approx(1.5 / 1.7, abs=2e-3 if damping else 1e-9)
    assert 2 * np.pi * onset.frequency_hz == pytest.approx(np.sqrt(top**2 - drop * onset.value), rel=1e-4)


@pytest.mark.parametrize("method", ["direct", "reduced"])
@pytest.mark.parametrize(("others", "top", "drop"), [((1, 2, 5), 12.0, 80.0), ((1, 2, 5, 9), 11.2, 30.0)])
def test_a_mode_that_comes_into_the_range_unstable_is_told(others, top, drop, method):
    """Its onset is above the frequencies that were asked for, so that no step of the sweep shows it."""
    theta = [*np.square(others), top**2 - 1.5, top**2 + 1.5]
    falls, F = np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
    falls[-2:], F[-2, -1], F[-1, -2] = -drop, 20.0, -20.0
    problem = matrix_problem(np.diag(theta), np.diag(falls), friction=F)
    result = fe_squeal.sweep(problem, [0.0, 0.5, 1.0], max_frequency=10 / (2 * np.pi), method=method)
    assert np.count_nonzero(result.points[-1].modes.stability == "unstable") == 1 and not result.onsets
    (said,) = result.warnings
    assert said.startswith("at mu = 1 the unstable mode of") and "came into the range" in said
    assert not result.onsets_complete["sure"]


def test_a_newcomer_is_told_behind_another_doubt():
    """What could not be decided at the first value silences no mode that comes in unstable at a later one."""
    theta, falls, F = np.diag([4.0, 25.0, 142.5, 145.5]), np.zeros((4, 4)), np.zeros((4, 4))
    falls[-2:, -2:], F[-2, -1], F[-1, -2] = -80.0 * np.eye(2), 20.0, -20.0
    problem, values = matrix_problem(theta, falls, friction=F), np.array([0.0, 0.5, 1.0])
    running = RunningSweep(problem, "mu", Request(max_frequency_hz=10 / (2 * np.pi)), values, precise=False)
    for value in values.tolist():
        running.advance(value, False)
        running.told.of_onsets(f"something else is in doubt at {value}")
    assert sum("came into the range" in w for w in running.told.unsettled) == 1


@pytest.mark.parametrize("most", [8, 30])
def test_where_samples_are_too_many_more_values_are_solved(monkeypatch, most):
    """(1 − 2p)/2 = ±p/100: a pair meets and parts again. What samples leave out is not taken as looked at."""
    monkeypatch.setattr(importlib.import_module("fe_squeal.sweep.samples"), "_MOST", most)
    theta, falls = np.diag([100.0, 101.0]), np.diag([2.0, 0.0])
    problem = matrix_problem(theta, falls, friction=1e-2 * np.array([[0.0, 1.0], [-1.0, 0.0]]))
    result = fe_squeal.sweep(problem, [0.0, 1.0], modes=2, method="direct")
    assert [o.direction for o in result.onsets] == ["into", "out of"] and not result.unsettled
    np.testing.assert_allclose([o.value for o in result.onsets], [1 / 2.02, 1 / 1.98], rtol=1e-8)


@pytest.mark.parametrize("method", ["direct", "reduced"])
@pytest.mark.parametrize("asked", [{"max_frequency": 5 / (2 * np.pi)}, {"modes": 2}])
def test_a_mode_that_comes_in_as_another_one_leaves_is_told(asked, method):
    """One is unstable throughout and leaves the range upwards, another one grows from p = 0.1 far above it on."""
    one, two, three = (np.diag(np.eye(3)[k]) for k in range(3))
    stiffness, damping = 100 * one + 4 * two + 9 * three, 0.1 * one - 0.05 * two + 0.01 * three
    parts = [("m", "M", np.eye(3), {}), ("k", "K", stiffness, {}), ("moved", "K", -95 * one + 60 * two, {"p": 1}),
             ("c", "C", damping, {}), ("driven", "C", -one, {"p": 1})]  # fmt: skip
    terms = tuple(Term(n, slot, sp.csr_array(A), True, powers) for n, slot, A, powers in parts)
    result = fe_squeal.sweep(Problem(terms, {"p": 1.0}), np.linspace(0, 1, 9), "p", method=method, **asked)
    assert not result.onsets and not result.onsets_complete["sure"]
    assert any("came into the range" in w for w in result.warnings)
    assert result.points[-1].modes.stability.tolist().count("unstable") == 1


def test_a_mode_that_leaves_the_range_stable_is_not_told():
    """Unstable at first, above the range; it becomes stable at p = 0.4, and comes into the range at 0.75."""
    one, two = np.diag([1.0, 0.0]), np.diag([0.0, 1.0])
    parts = [("m", "M", np.eye(2), {}), ("k", "K", 40 * one + 4 * two, {}), ("moved", "K", -20 * one, {"p": 1}),
             ("c", "C", -0.04 * one + 0.01 * two, {}), ("damped", "C", 0.1 * one, {"p": 1})]  # fmt: skip
    terms = tuple(Term(n, slot, sp.csr_array(A), True, powers) for n, slot, A, powers in parts)
    result = fe_squeal.sweep(Problem(terms, {"p": 1.0}), np.linspace(0, 1, 9), "p", max_frequency=5 / (2 * np.pi))
    assert not result.warnings and all(o.direction == "out of" for o in result.onsets)


@pytest.mark.parametrize(("kind", "seed"), [(structures.loss, 10070), (window, 3), (damped_window, 4), (damped, 8)])
def test_onsets_and_modes_beside_them_have_the_same_branch(kind, seed):
    """Also in the middle of a window, and where two modes of one shape lie close together."""
    family = (structures.make if kind is structures.loss else make)(kind, seed)
    count = len(family.parts[0][1])
    result = fe_squeal.sweep(family.problem(), np.linspace(family.values[0], family.values[-1], 15), "p", modes=count)
    told = 0
    for onset in result.onsets:
        behind = [p for p in result.points if (p.value > onset.value) == (onset.direction == "into")]
        near = min(behind, key=lambda p: abs(p.value - onset.value), default=None)
        if near is None or any((o.value - onset.value) * (near.value - o.value) > 0 for o in result.onsets):
            continue
        told += 1
        assert {onset.branch_a, onset.branch_b} & set(near.branches[near.modes.stability == "unstable"].tolist())
    assert told


def test_two_ill_conditioned_modes_exchange_their_places_within_a_step():
    """With loss factors that grow along the sweep: one of the two grows for a while as they pass each other. Their
    condition of 11 had hidden how fast they move, and with it that they may meet."""
    family = structures.make(structures.loss, 10070)
    result = fe_squeal.sweep(family.problem(), family.values, "p", modes=7)
    assert not judge(family, [(o.value, o.direction, o.uncertainty) for o in result.onsets])
    assert len(result.onsets) == 5


def test_a_window_below_the_highest_frequency_of_modes_that_lie_above_it_at_both_values():
    """Two modes dip below the frequency asked for within a step, flutter there alone, and leave the range again."""
    level, apart = [10.4, -3.0, 3.0], [0.3, -1.2, 1.2]  # of 1, mu and mu²
    stiffness = [np.diag([1.0 if i == 0 else 0.0, 4.0 if i == 0 else 0.0, a, a + d, 30.0 if i == 0 else 0.0])
                 for i, (a, d) in enumerate(zip(level, apart, strict=True))]  # fmt: skip
    F = np.zeros((5, 5))
    F[2, 3], F[3, 2] = 0.05, -0.05
    limit = np.sqrt(10.0)
    roots = np.roots([apart[2], apart[1] - 0.1, apart[0]]).real, np.roots([apart[2], apart[1] + 0.1, apart[0]])
    true = sorted(r for r in np.concatenate(roots) if np.isreal(r) and 0 < r < 1)
    result = fe_squeal.sweep(matrix_problem(*stiffness, friction=F), [0.0, 1.0], max_frequency=limit / (2 * np.pi))
    found = [o.value for o in result.onsets]
    assert len(true) == 2 and all(p.modes.lam.imag.max() < limit for p in result.points)
    np.testing.assert_allclose(found, true, rtol=1e-9)
    assert all(0.95 * limit < 2 * np.pi * o.frequency_hz < limit for o in result.onsets)


@pytest.mark.parametrize("points", [2, 4])
def test_a_divergence_beside_another_one_comes_and_goes_within_a_step(points):
    """K = [[−100, 10p], [10p, −½]]: θ₁ < 0 throughout, and θ₂ < 0 where det K = 50 − 100p² > 0."""
    problem = matrix_problem(np.diag([-100.0, -0.5]), [[0, 10.0], [10.0, 0]])
    result = fe_squeal.sweep(problem, np.linspace(-1, 1, points), "mu", modes=2)
    assert [o.direction for o in result.onsets] == ["into", "out of"]
    np.testing.assert_allclose([o.value for o in result.onsets], [-(0.5**0.5), 0.5**0.5], rtol=1e-10)


@pytest.mark.parametrize("swept", ["K", "C"])
def test_a_window_of_which_the_ends_of_a_step_show_nothing(swept):
    """Its matrix has the same values and slopes at both ends, 1 and 0, and 1 − 32 p²(1 − p)², −1 half way."""
    dip = [np.diag([c, 0.0]) for c in (0.0, 0.0, -32.0, 64.0, -32.0)]
    one, K = sp.eye_array(2, format="csr"), sp.csr_array(np.diag([1.0, 30.0]))
    terms = [Term("m", "M", one, True), Term("k", "K", K, True), Term("c", "C", 0.1 * one, True)]
    size = 1.0 if swept == "K" else 0.1
    terms += [Term(f"{swept}{i}", swept, sp.csr_array(size * A), True, {"mu": i}) for i, A in enumerate(dip) if A.any()]
    result = fe_squeal.sweep(Problem(tuple(terms), {"mu": 0.0}), [0.0, 1.0], "mu", modes=2)
    exact = np.sort(np.roots([1, -1, 1 / 32**0.5]).real)  # p(1 − p) = 1/√32
    assert [o.direction for o in result.onsets] == ["into", "out of"]
    np.testing.assert_allclose([o.value for o in result.onsets], exact, rtol=1e-9)
