"""The two-mass model against numbers from 40-digit arithmetic and matrices by virtual work."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from lumped import TwoMass
from lumped.axis import axis_of
from lumped.intervals import find_unstable_intervals

BASE = TwoMass()


def test_matrices_are_those_of_virtual_work():
    model = TwoMass(m1=1.5, m2=2.5, k1x=3, k2x=5, ky=7, k=11, theta1=30, c1x=0.1, c2x=0.2, cy=0.3, friction="contact")
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    elongations = {3: [1, 0, 0], 5: [-1, 1, 0], 7: [0, 0, 1], 11: [-c, c, -s]}
    K0 = sum(k * np.outer(d, d) for k, d in elongations.items())
    assert_allclose(model.K0, K0, rtol=1e-14, atol=1e-14)
    assert_allclose(model.C, [[0.3, -0.2, 0], [-0.2, 0.2, 0], [0, 0, 0.3]], rtol=1e-14)
    assert_allclose(model.M, np.diag([1.5, 2.5, 2.5]))
    # Friction pulls m2 with μ N along +x, and N falls by ky y.
    assert_allclose(model.K(0.4) - model.K0, 0.4 * 7 * np.outer([0, 1, 0], [0, 0, 1]), rtol=1e-14)


def test_printed_matrix():
    k1x, k2x, ky, k, c, s, mu = 10, 10, 50, 5, np.sqrt(0.5), np.sqrt(0.5), 0.4
    expected = [
        [k1x + k2x + k * c * c, -k2x - k * c * c, k * c * s],
        [-k2x - k * c * c, k2x + k * c * c, -k * c * s + mu * (ky + k * s * s)],
        [k * c * s, -k * c * s, ky + k * s * s],
    ]
    assert_allclose(BASE.K(mu), expected, rtol=1e-14)


@pytest.mark.parametrize(
    ("friction", "mu_c"), [("printed", 0.2014936461296), ("contact", 0.21156832843608), ("full", 0.201629797017653)]
)
def test_threshold(friction, mu_c):
    # The numbers carry 13 to 15 digits; the double root of a cubic of scale 55² and slope 5 costs about one.
    assert_allclose(TwoMass(friction=friction).critical_mu(), [mu_c], rtol=3e-13)


def test_eigenvalues():
    still = [1.5366198280494, 4.9191169008708, 5.3330186967245]
    assert_allclose(BASE.eigenvalues(0.0)[3:], 1j * np.array(still), rtol=1e-13, atol=1e-13)
    lam = BASE.eigenvalues(0.4)[3:]
    assert_allclose(lam[0], 1.592413832468j, rtol=1e-12)
    assert_allclose(np.sort(lam[1:].real), [-0.2060851969335, 0.2060851969335], rtol=1e-12)
    assert_allclose(lam[1:].imag, 5.125873603736, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "low", "high", "expected"),
    [
        ("k1x", 5, 50, [(5, 13.88620677389)]),
        ("k2x", 5, 50, [(7.099712843403, 12.9314481623)]),
        ("ky", 5, 100, [(5, 5.088363910334), (43.29426294938, 60.64146908786)]),
        ("k", 1, 80, [(1, 9.951692518442)]),
        ("theta1", 0, 360, [(19.7818561146, 72.72386436916), (199.7818561146, 252.72386436916)]),
    ],
)
def test_unstable_intervals_at_mu_04(name, low, high, expected):
    found = find_unstable_intervals(BASE, axis_of(BASE, name, np.linspace(low, high, 721)), 0.4)
    assert_allclose(found, expected, rtol=2e-12)  # as many digits as the numbers have


@pytest.mark.parametrize(
    ("dampers", "mu_c"),
    [((0.1, 0.1, 0), 0.200846969392334), ((0.3, 0.3, 0), 0.200665119304709), ((0.3, 0.3, 0.3), 0.320707221248113)],
)
def test_hopf_onset(dampers, mu_c):
    model = TwoMass(**dict(zip(("c1x", "c2x", "cy"), dampers, strict=True)))
    assert_allclose(model.critical_mu(), [mu_c], rtol=1e-13)
    if dampers[2] == 0:
        assert model.critical_mu() < BASE.critical_mu()


@pytest.mark.parametrize(
    ("name", "rates"),
    [
        ("c2x", (0.206085197, 0.173005490, 0.124298266, 0.093246777, 0.073197919)),
        ("cy", (0.206085197, 0.193881868, 0.171756317, 0.152550852, 0.136031594)),
    ],
)
def test_growth_falls_with_one_damper_and_stays_positive(name, rates):
    found = [TwoMass(**{name: c}).eigenvalues(0.4).real.max() for c in (0, 0.1, 0.3, 0.5, 0.7)]
    assert_allclose(found, rates, atol=6e-10)  # nine decimals are given


@pytest.mark.parametrize(("c", "growth"), [(0.1, 0.241), (0.3, 0.169)])
def test_no_overdamped_regime(c, growth):
    lam = TwoMass(c1x=c, c2x=c).eigenvalues(np.linspace(0, 0.6, 601))
    assert np.abs(lam.imag).min() > 1.536
    assert (-lam.real / np.abs(lam)).max() < 0.10
    assert_allclose(lam[-1].real.max(), growth, atol=6e-4)
