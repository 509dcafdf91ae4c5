"""Where modes coalesce: λ moves by a root of every rounding, so that its sign proves nothing there.

See tests/analytic/test_onsets.py for the onsets themselves.
"""

from __future__ import annotations

import functools
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hard_problems import brake, digits, judged, matrices, plain_eigs, through_files
from matrix_scenes import PULL, SITE, B

import fe_squeal
from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.pencil import Modes, Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from lumped import Minimal

EPS = np.finfo(float).eps
CRITICAL = 1 / np.sqrt(3)
CROWDS = (0, DENSE_LIMIT + 50)  # oscillators of θ = 100, 101, ... beside: the sparse solvers
ALPHA = 0.02
NEAR = [s * 10.0**-k for k in (2, 4, 6, 8, 10, 12, 14) for s in (1, -1)] + [0.0]


def beside(K: np.ndarray, crowd: int) -> sp.csr_array:
    return sp.csr_array(sp.block_diag([K, sp.diags_array(100.0 + np.arange(crowd))]) if crowd else K)


def roots_of(theta: np.ndarray, alpha: float = 0.0) -> np.ndarray:
    """Return λ of Im λ > 0 of λ² + αλ + θ = 0."""
    root = np.sqrt(np.asarray(theta, complex) - alpha**2 / 4)
    lam = -alpha / 2 + 1j * root
    return np.concatenate([lam, -alpha / 2 - 1j * root])[np.concatenate([lam, -lam]).imag > 0]


def exact_theta(K: sp.csr_array) -> np.ndarray:
    """Return both θ of the leading 2 × 2 block as it was rounded: the discriminant is computed without any rounding."""
    a, b, c, d = (Fraction(float(x)) for x in K[:2, :2].toarray().ravel())
    return float((a + d) / 2) + np.array([1, -1]) * np.sqrt(complex(float(((a - d) / 2) ** 2 + b * c)))


def check(modes: Modes, exact: np.ndarray, least: float) -> float:
    """Check errors against the uncertainty, and the verdicts against the exact Re λ; return the digits.

    A verdict must be right; and it must be there where |Re λ| is ten times the error that cannot be avoided, `least`.
    """
    for lam, u, verdict in zip(modes.lam, modes.re_uncertainty, modes.stability, strict=True):
        near = exact[np.argmin(np.abs(exact - lam))]
        assert abs(lam.real - near.real) <= u
        assert u <= 100 * least
        assert verdict in ("marginal", "unstable" if near.real > 0 else "stable" if near.real < 0 else "marginal")
        assert verdict != "marginal" or abs(near.real) <= u + 1000 * least
    return digits(modes.lam, exact)


@pytest.mark.parametrize("distance", NEAR)
@pytest.mark.parametrize("kind", ["undamped", "dashpots"])
def test_minimal_model_around_its_coalescence(tmp_path, record, kind, distance):
    """Two modes meet at μ_c = 1/√3. At a relative distance δ from it λ is known to ε/√δ, at μ_c to √ε = 1e-8 |λ|: a
    test Re λ > 0 calls the stable side unstable."""
    alpha = ALPHA if kind == "dashpots" else 0.0
    mu = CRITICAL * (1 + distance)
    for crowd in CROWDS:
        one = sp.eye_array(2 + crowd)
        F = sp.csr_array(sp.block_diag([PULL, sp.csr_array((crowd, crowd))])) if crowd else sp.csr_array(PULL)
        terms = [("mass", one), ("stiffness", beside(SITE, crowd)), ("stiffness", F, "powers = { mu = 1 }")]
        terms += [("damping", one, f"scale = {ALPHA}")] if alpha else []
        (tmp_path / str(crowd)).mkdir()
        pencil = matrices(tmp_path / str(crowd), terms, mu=0.0).pencil(mu=mu)
        exact = roots_of(exact_theta(pencil.K), alpha)
        modes = solve_modes(pencil, Request(count=2))
        kept = check(modes, exact, 5 * EPS / np.sqrt(max(abs(distance), EPS)) + 5 * EPS)
    model = Minimal(k2=20.0, friction="contact")
    if not alpha and abs(distance) > 1e-13:
        assert model.spectrum(mu).stability == ("unstable" if distance > 0 else "marginal")
    record(kept, "the verdict is right, or `marginal` within the uncertainty", *judged(plain_eigs(pencil, 2), exact))


@pytest.mark.parametrize("mu", [0.0, 0.1, 1.0, 10.0])
@pytest.mark.parametrize("kind", ["undamped", "dashpots"])
def test_degenerate_base_of_the_minimal_model(tmp_path, record, kind, mu):
    """k1 = k2 = k3: a = d = 15, b = 0, one Jordan block [[15, 10μ], [0, 15]] at every μ > 0. It grows linearly in time,
    never exponentially; after rounding any code sees a pair Re λ = ±1e-8."""
    alpha = ALPHA if kind == "dashpots" else 0.0
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])  # the same springs, in axes that do not lie along the belt
    K, F = 15.0 * np.eye(2), turn @ PULL @ turn.T
    for crowd in CROWDS:
        one = sp.eye_array(2 + crowd)
        push = sp.csr_array(sp.block_diag([F, sp.csr_array((crowd, crowd))])) if crowd else sp.csr_array(F)
        terms = [("mass", one), ("stiffness", beside(K, crowd)), ("stiffness", push, "powers = { mu = 1 }")]
        terms += [("damping", one, f"scale = {ALPHA}")] if alpha else []
        (tmp_path / str(crowd)).mkdir()
        pencil = matrices(tmp_path / str(crowd), terms, mu=0.0).pencil(mu=mu)
        modes = solve_modes(pencil, Request(count=2))
        exact = roots_of([15.0, 15.0], alpha)
        assert set(modes.stability) == ({"stable"} if alpha else {"marginal"})
        assert len(modes) == 2 and (np.abs(modes.lam - exact[0]) <= modes.re_uncertainty).all()
    assert Minimal().spectrum(mu).stability == "marginal"
    kept = digits(modes.lam, exact)
    record(kept, "marginal at every μ, stable with dashpots", *judged(plain_eigs(pencil, 2), exact))


# An integer matrix with an integer inverse: P J P⁻¹ of short J has no rounding, and so the eigenvalues of J.
P = np.array([[1, 0, 0], [2, 1, 0], [-1, 3, 1]]) @ np.array([[1, 1, -2], [0, 1, 2], [0, 0, 1]])
P_INVERSE = np.rint(np.linalg.inv(P)).astype(int)


@pytest.mark.parametrize("power", [6, 12, 20, 28, 36, 44, None])
@pytest.mark.parametrize("sign", [1, -1])
def test_three_modes_meet(record, power, sign):
    """θ = 20 + ∛±2⁻ᵏ: near a triple defective eigenvalue λ moves with the cube root, 1e-5 |λ| of nothing but rounding;
    the square-root law of two modes underestimates that."""
    np.testing.assert_array_equal(P @ P_INVERSE, np.eye(3))
    d = 0.0 if power is None else sign * 2.0**-power
    J = np.diag([20.0, 20.0, 20.0]) + np.diag([1.0, 1.0], 1)
    J[2, 0] = d
    theta = 20 + np.cbrt(d) * np.exp(2j * np.pi * np.arange(3) / 3)
    for crowd in CROWDS:
        pencil = Pencil(sp.eye_array(3 + crowd, format="csr"), beside(P @ J @ P_INVERSE, crowd))
        modes, exact = solve_modes(pencil, Request(count=3)), roots_of(theta)
        apart = max(abs(d) ** (1 / 3), (1e3 * EPS) ** (1 / 3))
        kept = check(modes, exact, 1e3 * EPS / apart**2)
    record(kept, "the uncertainty follows the cube root", *judged(plain_eigs(pencil, 3), exact))


@functools.cache
def finite_elements():
    """Return a pad on a belt, 1071 unknowns, and its first onset."""
    problem = brake()
    (onset,) = fe_squeal.find_onsets(problem, [0.2, 0.23], modes=8)
    assert onset.kind == "flutter" and onset.uncertainty < 1e-10
    return problem, onset


@pytest.mark.parametrize("distance", [0.0, *(s * 10.0**-k for k in (4, 8, 12) for s in (1, -1))])
@pytest.mark.parametrize("through", ["mesh", "files"])
def test_finite_elements_around_their_onset(tmp_path, record, through, distance):
    """A pad on a belt within 1e-4 ... 1e-12 of its onset: Re λ = c √(μ − μ_c) behind it, nothing before. Growth
    falls below rounding at 1e-12, and no mode of the stable side may be called unstable."""
    problem, onset = finite_elements()
    mu, omega = onset.value * (1 + distance), 2 * np.pi * onset.frequency_hz
    pencil = (problem if through == "mesh" else through_files(problem, tmp_path)).pencil(mu=mu)
    modes = solve_modes(pencil, Request(count=8))
    near = modes.select(np.flatnonzero(np.abs(modes.lam - 1j * omega) < 0.02 * omega))
    growth = onset.crossing_speed * np.sqrt(complex(mu - onset.value))
    exact = 1j * omega + np.array([growth, -growth])
    assert len(near) == 2 and (distance > 0 or set(modes.stability) == {"marginal"})
    assert distance < 1e-9 or set(near.stability) == {"unstable", "stable"}
    # The law itself holds to the next order, the distance; below it is the uncertainty, also that of the onset.
    blur = onset.crossing_speed * np.sqrt(onset.uncertainty)
    away = np.abs(near.lam[:, None] - exact).min(axis=0)
    assert (away <= abs(distance) * omega + near.re_uncertainty.max() + blur).all()
    record(digits(near.lam, exact), "growth right down to its uncertainty", *judged(plain_eigs(pencil, 8), exact))


@pytest.mark.parametrize("crowd", CROWDS)
def test_onset_within_one_step_of_the_sweep(tmp_path, record, crowd):
    """A value of the sweep lies at the coalescence itself, its neighbours 1e-9 beside: the onset is one, where it is,
    with two branches, not several that rounding makes."""
    one, zero = sp.eye_array(2 + crowd), sp.csr_array((crowd, crowd))
    F = sp.csr_array(sp.block_diag([PULL, zero])) if crowd else sp.csr_array(PULL)
    terms = [("mass", one), ("stiffness", beside(SITE, crowd)), ("stiffness", F, "powers = { mu = 1 }")]
    values = [0.0, 0.5, CRITICAL - 1e-9, CRITICAL, CRITICAL + 1e-9, 0.6, 0.9]
    result = fe_squeal.sweep(matrices(tmp_path, terms, mu=0.0), values, modes=2)
    [onset] = result.onsets
    assert onset.kind == "flutter" and not result.warnings
    assert abs(onset.value - CRITICAL) <= max(onset.uncertainty, 1e-14) < 1e-9
    assert onset.crossing_speed == pytest.approx(np.sqrt(10 * B) / (2 * np.sqrt(20.0)), rel=1e-6)
    record(digits(onset.value, CRITICAL), "one onset, by Newton's method on the double eigenvalue")


@pytest.mark.parametrize("method", ["direct", "reduced"])
@pytest.mark.parametrize(("coupling", "stiffer"), [(0.45, 2.0), (0.0245, 1.05)])
def test_two_modes_that_cross_in_opposite_directions_at_once(coupling, stiffer, method):
    """M = 1, K = [[1, μ], [−μ, k]], and C = p diag(1, 0.02): without damping both swing at ω² = (1 + k ± √D)/2 with
    D = (k − 1)² − 4μ². Their shapes are so alike that each damper damps the one and drives the other, so that at
    p = 0 one turns stable and the other unstable."""
    K, F = np.diag([1.0, stiffer]), coupling * np.array([[0.0, 1.0], [-1.0, 0.0]])
    terms = [Term("m", "M", sp.eye_array(2, format="csr"), True), Term("k", "K", sp.csr_array(K), True),
             Term("f", "K", sp.csr_array(F), False),
             Term("c", "C", sp.csr_array(np.diag([1, 0.02])), True, {"p": 1})]  # fmt: skip
    problem = Problem(tuple(terms), {"p": 0.0})
    root = np.sqrt((stiffer - 1) ** 2 - 4 * coupling**2)
    exact = np.sqrt((1 + stiffer + np.array([-root, root])) / 2)
    for count in (2, 3, 4, 6):
        result = fe_squeal.sweep(problem, np.linspace(-0.05, 0.05, count), "p", 2, method=method)
        onsets = sorted(result.onsets, key=lambda o: o.frequency_hz)
        assert [o.direction for o in onsets] == ["out of", "into"] and not result.warnings
        np.testing.assert_allclose([2 * np.pi * o.frequency_hz for o in onsets], exact, rtol=1e-9)
        assert all(abs(o.value) <= o.uncertainty < 1e-12 for o in onsets)
