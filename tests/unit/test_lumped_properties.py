"""What holds for every parameter: symmetries and sum of the spectrum, periodic angles, reversal of the belt."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from selection import some

from lumped import MODELS, Minimal, NineDof, Oscillator, RigidPad, TwoMass, UncoupledDisc
from lumped.critical_points import search_critical_points

stiffness = st.floats(0.1, 100)
damper = st.floats(0, 2)
angle = st.integers(-360, 720).map(float)
friction = st.floats(-2, 2)
reading = st.sampled_from(["printed", "contact", "full"])


def minimal(**more):
    names = dict.fromkeys(("k1", "k2", "k3"), stiffness) | dict.fromkeys(("theta1", "theta2"), angle)
    return st.builds(Minimal, **names, m=st.floats(0.5, 5), friction=reading, **more)


def two_mass(**more):
    names = dict.fromkeys(("k1x", "k2x", "ky", "k"), stiffness)
    return st.builds(TwoMass, **names, m2=st.floats(0.5, 5), theta1=angle, friction=reading, **more)


def nine_dof(**more):
    return st.builds(NineDof, **dict.fromkeys(("k1", "k4", "k9", "k13", "kc1", "kc2"), stiffness), **more)


undamped = st.one_of(minimal(), two_mass(), nine_dof())
damped = st.one_of(
    minimal(c1=damper, c2=damper, c3=damper),
    two_mass(c1x=damper, c2x=damper, cy=damper),
    nine_dof(c1=damper, c8=damper),
)


@given(undamped, friction)
@settings(max_examples=60)
def test_undamped_spectrum_is_symmetric(model, mu):
    lam = model.eigenvalues(mu)
    assert set((-lam).tolist()) == set(lam.tolist())  # to the last bit
    assert max(np.abs(lam.conj() - x).min() for x in lam) <= 1e-12 * np.abs(lam).max()


@given(damped, friction)
@settings(max_examples=60)
def test_sum_of_the_spectrum_is_the_damping(model, mu):
    lam = model.eigenvalues(mu)
    trace = np.trace(np.linalg.solve(model.M, model.C))
    assert_allclose(lam.sum(), -trace, atol=1e-12 * (1 + np.abs(lam).sum()))


@given(minimal(), friction)
@settings(max_examples=40)
def test_angles_repeat_after_180_degrees(model, mu):
    turned = replace(model, theta1=model.theta1 + 180, theta2=model.theta2 - 180)
    assert (turned.K(mu) == model.K(mu)).all()  # whole degrees: to the last bit


@given(minimal(), friction)
@settings(max_examples=40)
def test_mirrored_mass_on_a_reversed_belt(model, mu):
    mirrored = replace(model, theta1=-model.theta1, theta2=-model.theta2)
    flip = np.diag([-1.0, 1.0])
    assert_allclose(flip @ mirrored.K(-mu) @ flip, model.K(mu), rtol=1e-12, atol=1e-12)


@given(two_mass(), friction)
@settings(max_examples=40)
def test_mirrored_masses_on_a_reversed_belt(model, mu):
    flip = np.diag([-1.0, -1.0, 1.0])
    assert_allclose(flip @ replace(model, theta1=-model.theta1).K(-mu) @ flip, model.K(mu), rtol=1e-12, atol=1e-12)


@given(damped, friction)
@settings(max_examples=30)
def test_eigenvalues_solve_the_equation(model, mu):
    lam, K = model.eigenvalues(mu), model.K(mu)
    for x in lam:
        smallest = np.linalg.svd(x * x * model.M + x * model.C + K)[1][-1]
        assert smallest <= 1e-11 * (abs(x) ** 2 * model.M.max() + abs(x) * model.C.max() + np.abs(K).max())


@pytest.mark.parametrize("model", [Oscillator(), Minimal(k2=20.0), TwoMass(), NineDof(), UncoupledDisc(), RigidPad()])
def test_reversed_sliding_is_negative_friction(model):
    assert_allclose(model.K(-0.3), model.K0 - 0.3 * model.friction_matrix)
    assert_allclose(model.K0, model.K0.T)
    assert (np.linalg.eigvalsh(model.K0) > 0).all()
    assert model.K([0.1, 0.2]).shape == (2, *model.K0.shape)


@pytest.mark.parametrize("seed", some(range(24), lambda seed: seed < 6))
def test_onsets_agree_with_a_scan(seed):
    """Random systems: between two onsets the number of growing pairs is constant, across one it changes by one."""
    rng = np.random.default_rng(seed)
    n = 5
    B = rng.normal(size=(n, n))
    K0 = B @ B.T + n * np.eye(n)
    F = np.zeros((n, n))
    F[rng.integers(0, 2), rng.integers(2, n)] = 8.0
    F[2] += rng.normal(size=n)
    M, C = np.diag(rng.uniform(0.5, 2, n)), np.zeros((n, n)) if seed % 2 else 0.05 * B @ B.T
    onsets = search_critical_points(M, C, K0, F, 0, 5).points
    scan = np.linspace(1e-6, 5, 2001)
    inverse = np.linalg.inv(M)
    zero, one = np.zeros((n, n)), np.eye(n)

    def growing(mu):
        A = np.block([[zero, one], [-inverse @ (K0 + mu * F), -inverse @ C]])
        return int(np.sum(np.linalg.eigvals(A).real > 1e-7))

    counts = np.array([growing(mu) for mu in scan])
    changes = scan[np.flatnonzero(np.diff(counts))]
    # every change of the count lies beside an onset; onsets closer than the scan's step may hide each other
    assert all(min(abs(o.mu - mu) for o in onsets) < 5e-3 for mu in changes)
    for o in onsets:
        step = 1e-6 * (1 + o.mu)
        above, below = growing(o.mu + 50 * step), growing(o.mu - 50 * step)
        assert (above > below) == o.into and above != below


@pytest.mark.parametrize(("stiffness", "mass"), [(1e6, 1e-3), (1e-6, 1e3), (1e12, 1.0)])
def test_uncertainty_does_not_depend_on_units(stiffness, mass):
    """λ of a damped system scales like √(k/m), and so does what rounding does to it."""
    one = TwoMass(c1x=0.1, c2x=0.1, cy=0.1)
    k, c = {n: stiffness * getattr(one, n) for n in ("k1x", "k2x", "ky", "k")}, 0.1 * np.sqrt(stiffness * mass)
    other = replace(one, m1=mass * one.m1, m2=mass * one.m2, c1x=c, c2x=c, cy=c, **k)
    a, b = one.spectrum(0.3), other.spectrum(0.3)
    rate = np.sqrt(stiffness / mass)
    assert_allclose(b.lam / rate, a.lam, rtol=1e-12)
    assert (b.uncertainty / rate < 5 * a.uncertainty).all() and (a.uncertainty < 1e-13 * np.abs(a.lam).max()).all()


def test_every_model_has_a_name_and_coordinates():
    for name, cls in MODELS.items():
        model = cls()
        assert model.name == name and len(model.coordinates) == len(model.M)
        assert (np.diag(np.diag(model.M)) == model.M).all()
