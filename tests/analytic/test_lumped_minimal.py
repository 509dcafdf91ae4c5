"""The minimal model and the oscillator: closed forms, numbers from 40-digit arithmetic, virtual work."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose

from lumped import Minimal, Oscillator, critical_friction
from lumped.axis import axis_of
from lumped.intervals import find_unstable_intervals
from lumped.spectrum import solve_spectrum

REGULAR = Minimal(k2=20.0)
DEGREES = np.pi / 180
# Condition numbers are below 10 away from the double root, so that 1e-13 leaves two digits.
TIGHT = dict(rtol=1e-13, atol=1e-13)


def springs_to_ground(*springs):
    """Σ k d dᵀ over (k, angle from the belt's normal in degrees): virtual work, written out for the test."""
    return sum(k * np.outer(d, d) for k, a in springs for d in [np.array([np.sin(a * DEGREES), -np.cos(a * DEGREES)])])


def test_matrices_are_those_of_virtual_work():
    model = Minimal(m=1.7, k1=11, k2=23, k3=31, theta1=100, theta2=35, c1=0.1, c2=0.2, c3=0.5, friction="contact")
    assert_allclose(model.K0, springs_to_ground((11, 100), (23, 35), (31, 0)), rtol=1e-14)
    assert_allclose(model.C, springs_to_ground((0.1, 100), (0.2, 35), (0.5, 0)), rtol=1e-14)
    assert_allclose(model.M, 1.7 * np.eye(2))
    # A lift y out of the belt takes k3 y off the normal force and μ k3 y off the pull along the belt's velocity, +x.
    # The virtual work of what is missing, −μ k3 y δx, stands in K u with the opposite sign.
    lift, along = np.array([0.0, 1.0]), np.array([1.0, 0.0])
    pull = -0.3 * 31 * lift[1] * along
    assert_allclose(-(model.K(0.3) - model.K0) @ lift, pull, rtol=1e-14)
    assert_allclose((model.K(0.3) - model.K0) @ along, 0)


@pytest.mark.parametrize(
    ("friction", "mu_c"),
    [("printed", 4 / (7 * np.sqrt(3))), ("contact", 1 / np.sqrt(3)), ("full", 0.29333239703485345)],
)
def test_threshold_of_each_reading(friction, mu_c):
    model = Minimal(k2=20.0, friction=friction)
    assert_allclose(model.critical_mu(), [mu_c], rtol=1e-14)
    # The general method knows nothing of the closed form.
    (onset,) = model.critical_points()
    assert_allclose(onset.mu, mu_c, rtol=1e-13)
    assert onset.kind == "flutter" and onset.into


def test_printed_threshold_to_all_digits():
    assert_allclose(REGULAR.critical_mu(), [0.32991443953692901], rtol=1e-15)
    assert_allclose(Minimal(k2=20.0, friction="contact").critical_mu(), [0.57735026918962576], rtol=1e-15)


@pytest.mark.parametrize(
    ("mu", "expected"),
    [
        (0.0, [3.87298334620742j, 5j]),
        (0.3, [4.30051152833405j, 4.63741313607769j]),
        (0.4, [-0.257229876136457 + 4.47952756539986j, 0.257229876136457 + 4.47952756539986j]),
        (0.5, [-0.399787888218975 + 4.48996997267984j, 0.399787888218975 + 4.48996997267984j]),
        (1.0, [-0.784702125053326 + 4.54045784311045j, 0.784702125053326 + 4.54045784311045j]),
    ],
)
def test_eigenvalues(mu, expected):
    lam = REGULAR.eigenvalues(mu)[2:]
    assert_allclose(lam[np.lexsort((lam.real, lam.imag.round(9)))], expected, **TIGHT)


def test_growth_rises_like_a_square_root():
    mu_c = REGULAR.critical_mu()[0]
    # A difference quotient of step 1e-6.
    assert_allclose(REGULAR.critical_points()[0].slope, 0.973249857636, rtol=1e-10)
    for h, tolerance in ((1e-4, 1e-4), (1e-6, 1e-6)):  # the next term of the expansion is of order h
        assert_allclose(REGULAR.eigenvalues(mu_c + h).real.max() / np.sqrt(h), 0.973249857636, rtol=tolerance)


def intervals(model, name, low, high, steps):
    return find_unstable_intervals(model, axis_of(model, name, np.linspace(low, high, steps + 1)), 0.5)


def test_unstable_stiffness():
    # The lower end is a double root at which coupling and gap vanish together; it is a simple zero of the discriminant.
    assert_allclose(intervals(Minimal(), "k2", 0, 50, 500), [(10, 26.58007192841084)], rtol=1e-13)
    contact = Minimal(friction="contact")
    assert_allclose(intervals(contact, "k2", 0, 50, 500), [(10, 18.66025403784439)], rtol=1e-13)


def test_unstable_angle():
    expected = np.array([(46.1082349041256, 60), (226.1082349041256, 240)])
    assert_allclose(intervals(Minimal(), "theta2", 0, 360, 720), expected, rtol=1e-13)
    contact = intervals(Minimal(friction="contact"), "theta2", 0, 360, 720)
    assert_allclose(contact, [(50.1039093610171, 60), (230.1039093610171, 240)], rtol=1e-13)


@pytest.mark.parametrize(
    ("dampers", "mu_c"),
    [
        (dict(c1=0.3, c2=0.3, c3=0.3), 116.2 / (175 * np.sqrt(3))),
        (dict(c1=0.3, c2=0.3), 0.325996705567428),
        (dict(c3=0.3), 0.24743582965269676),
        (dict(c3=0.01), 0.24743582965269676),
    ],
)
def test_hopf_onset(dampers, mu_c):
    model = Minimal(k2=20.0, **dampers)
    assert_allclose(model.critical_mu(), [mu_c], rtol=1e-13)
    assert_allclose(hopf_by_routh_hurwitz(model), mu_c, rtol=1e-12)
    assert_allclose(model.eigenvalues(mu_c).real.max(), 0, atol=1e-14)


def test_hopf_slope():
    (onset,) = Minimal(k2=20.0, c1=0.3, c2=0.3, c3=0.3).critical_points()
    assert_allclose(onset.mu, 0.38336057874191151, rtol=1e-14)
    assert_allclose(onset.slope, 2.0996082231, rtol=1e-10)
    assert_allclose(Minimal(k2=20.0, c3=0.3).critical_mu(), [2.5 * np.sqrt(3) / 17.5], rtol=1e-13)  # |b|/d


def hopf_by_routh_hurwitz(model):
    """Smallest μ > 0 with p1 p2 p3 − p1² − p0 p3² = 0 for λ⁴ + p3 λ³ + p2 λ² + p1 λ + p0, m = 1."""
    (a, b), (_, d) = model.K0
    (r, s), (_, t) = model.C
    mu = Polynomial([0, 1])
    coupling = b + mu * d  # `printed`
    p3, p2, p1, p0 = r + t, a + d + r * t - s * s, r * d + t * a - s * (coupling + b), a * d - b * coupling
    roots = (p1 * p2 * p3 - p1**2 - p0 * p3**2).roots()
    return min(x.real for x in roots if abs(x.imag) < 1e-12 and x.real > 0)


def test_damped_base_values_have_no_onset():
    model = Minimal(c1=0.3, c2=0.3, c3=0.3)
    assert model.critical_mu() == []
    for mu in (0.0, 0.5, 1.0, 3.0):
        # λ is double and, for μ ≠ 0, defective: an error of 1e-15 in the matrix is one of 3e-8 in λ
        assert_allclose(model.eigenvalues(mu)[2:], -0.225 + 3.8664421630227446j, atol=1e-7)
        assert model.spectrum(mu).stability == "stable"


@pytest.mark.parametrize("mu", [0.0, 0.1, 0.5, 1.0, 5.0])
def test_degenerate_base_values_are_marginal(mu):
    """b is zero but for rounding and a = d: λ is double for every μ, and noise of 1e-9 in Re λ is no instability."""
    model = Minimal()
    spectrum = model.spectrum(mu)
    assert spectrum.stability == "marginal"
    assert_allclose(spectrum.lam[2:], np.sqrt(15) * 1j, atol=1e-7)
    assert model.critical_mu() == [] and model.critical_points() == []


@pytest.mark.parametrize("mu", [0.1, 0.5, 1.0])
def test_degenerate_matrix_with_naive_trigonometry_is_marginal(mu):
    """The same with sines and cosines as NumPy gives them: b = −1.8e-15, and the eigenvalues do get a real part."""
    K = springs_to_ground((10, 120), (10, 60), (10, 0))
    assert -1e-14 < K[0, 1] < 0
    K[0, 1] += mu * K[1, 1]
    spectrum = solve_spectrum(np.eye(2), np.zeros((2, 2)), K)
    assert spectrum.growth > 1e-9
    assert spectrum.stability == "marginal"
    assert spectrum.uncertainty.max() < 1e-6


def test_uncertainty_does_not_hide_flutter():
    mu_c = REGULAR.critical_mu()[0]
    for h in (1e-12, 1e-9, 1e-6, 1e-3):
        assert REGULAR.spectrum(mu_c * (1 + h)).stability == "unstable"
        assert REGULAR.spectrum(mu_c * (1 - h)).stability == "marginal"
    assert REGULAR.spectrum(0.5).uncertainty.max() < 1e-12


def test_no_threshold_where_the_springs_cancel():
    assert np.isinf(critical_friction(10, 10, 10, 120, 60))
    assert np.isinf(critical_friction(10, 10, 25, [30, 75], [150, 105])).all()  # a ≠ d: safe for every μ
    assert critical_friction(10, 5, 10, 120, 60) < 0  # b > 0: only the reversed belt
    last = Minimal(k2=5.0).critical_points(-np.inf, 0)[-1].mu
    assert_allclose(last, critical_friction(10, 5, 10, 120, 60), rtol=1e-13)


def test_closed_form_agrees_with_the_double_root_everywhere():
    rng = np.random.default_rng(3)
    for friction in ("printed", "contact", "full"):
        for _ in range(20):
            p = dict(zip(("k1", "k2", "k3", "theta1", "theta2"), rng.uniform(1, [50, 50, 50, 180, 180]), strict=True))
            model = Minimal(friction=friction, **p)
            flutter = [o.mu for o in model.critical_points(0, 1e3) if o.kind == "flutter" and o.into]
            mu = [mu for mu in model.critical_mu() if mu < 1e3]
            assert_allclose(flutter, mu, rtol=1e-9)  # the nearest b to zero makes the root a thousand times worse


def test_oscillator():
    model = Oscillator()
    assert_allclose(model.K(0.2), [[16, -5 + 0.2 * 25], [-5, 25]], rtol=1e-14, atol=1e-14)
    assert_allclose(model.critical_mu(), [((16 - 25) ** 2 + 100) / (4 * 5 * 25)], rtol=1e-14)
    assert_allclose(model.critical_mu(), [0.362], rtol=1e-14)
    assert_allclose(Oscillator(friction="contact").critical_mu(), [181 / 400], rtol=1e-14)
    assert_allclose(Oscillator(friction="full").critical_mu(), [(41 - 2 * np.sqrt(375)) / 5], rtol=1e-13)
