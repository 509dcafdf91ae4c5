"""The nine-degree-of-freedom model, the disc without diagonal springs, and the pad that is the counter-example."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from lumped import NineDof, RigidPad, UncoupledDisc
from lumped.axis import axis_of
from lumped.intervals import find_unstable_intervals

BASE = NineDof()
X1, Y1, X2, Y2, X3, Y3, XB, YB, PHI = range(9)


def virtual_work(k, kc, mu):
    """K(μ) from where springs and contacts act: positions, directions, and forces with their reactions."""
    K = np.zeros((9, 9))
    pads = [(X1, Y1), (X2, Y2), (X3, Y3)]

    def spring(stiffness, *parts):  # (coordinate, component of the elongation)
        d = np.zeros(9)
        for i, value in parts:
            d[i] = value
        K[:] += stiffness * np.outer(d, d)

    spring(k[1], (X1, 1))
    spring(k[2], (X2, 1))
    spring(k[3], (X1, 1), (X2, -1))
    spring(k[4], (X1, 1), (X3, -1))
    for i, (x, y) in enumerate(pads):
        spring(k[5 + i], (y, 1))
        spring(k[8 + i], (x, np.sqrt(0.5)), (y, -np.sqrt(0.5)))
    spring(k[11], (XB, 1))
    spring(k[12], (YB, 1), (PHI, -2))
    spring(k[13], (YB, 1), (PHI, 2))
    for stiffness, (x, y), lever in zip(kc, pads[:2], (-2, 2), strict=True):
        opening = np.zeros(9)
        opening[[y, YB, PHI]] = 1, -1, -lever  # the belt's surface under the pad rises by yb + lever φ
        K += stiffness * np.outer(opening, opening)
        pull = np.zeros(9)  # on the pad along the belt's velocity, and back on the belt in the contact plane
        pull[[x, XB]] = 1, -1
        K += mu * stiffness * np.outer(pull, opening)  # N = N0 − kc · opening
    return K


def test_matrices_are_those_of_virtual_work():
    rng = np.random.default_rng(1)
    k = dict(enumerate(rng.uniform(0.5, 3, 13), 1))
    model = NineDof(**{f"k{i}": v for i, v in k.items()}, kc1=1.3, kc2=0.7)
    assert_allclose(model.K(0.6), virtual_work(k, (1.3, 0.7), 0.6), atol=1e-14)


def test_matrix_with_all_ones():
    K0 = BASE.K0
    assert_allclose(np.diag(K0), [3.5, 2.5, 2.5, 2.5, 1.5, 1.5, 1, 4, 16], rtol=1e-14)
    for i, j, value in (
        (X1, Y1, -0.5), (X2, Y2, -0.5), (X3, Y3, -0.5), (X1, X2, -1), (X1, X3, -1), (Y1, YB, -1), (Y2, YB, -1),
        (Y1, PHI, 2), (Y2, PHI, -2),
    ):  # fmt: skip
        assert_allclose([K0[i, j], K0[j, i]], value, rtol=1e-14)
        K0[i, j] = K0[j, i] = 0
    assert_allclose(K0 - np.diag(np.diag(K0)), 0, atol=1e-15)
    F = np.zeros((9, 9))
    F[X1, [Y1, YB, PHI]] = 1, -1, 2
    F[X2, [Y2, YB, PHI]] = 1, -1, -2
    F[XB, [Y1, Y2, YB]] = -1, -1, 2
    assert_allclose(BASE.friction_matrix, F)


def test_all_onsets():
    onsets = BASE.critical_points(0, 4)
    # s² of the first pair has the slope 0.06 against entries of 16: three digits of sixteen are lost.
    expected = [0.85815420475276589, 2.7383310465820566, 3.6588856526499511]
    assert_allclose([o.mu for o in onsets], expected, rtol=1e-13)
    assert all(o.kind == "flutter" and o.into for o in onsets)
    # A scan sees the same number of growing pairs, on both sides of each.
    for o, before in zip(onsets, (0, 1, 2), strict=True):
        for mu, growing in ((o.mu - 1e-3, before), (o.mu + 1e-3, before + 1)):
            lam = BASE.eigenvalues(mu)
            assert np.sum((lam.real > 1e-6) & (lam.imag > 0)) == growing


@pytest.mark.parametrize(
    ("names", "high", "expected"),
    [
        (("k1", "k2", "k3", "k4"), 10, [(1.04, 1.15), (2.205, 2.98), (3.965, 4.315), (8.285, 10)]),
        (("kc1", "kc2"), 15, [(0.82, 0.955)]),
    ],
)
def test_unstable_intervals_at_mu_05(names, high, expected):
    axis = axis_of(BASE, names, np.linspace(0, high, 100 * high + 1))
    # the expected ends come from a scan in steps of 0.005
    assert_allclose(find_unstable_intervals(BASE, axis, 0.5), expected, atol=5.1e-3)


def test_damped_onset():
    model = NineDof(**{f"c{i}": 0.1 for i in range(1, 10)})
    first = model.critical_points(0, 4)[0]
    assert first.kind == "hopf"
    assert_allclose(first.mu, 1.63936399181397, rtol=1e-13)
    assert_allclose(first.omega, 2.123418565, rtol=1e-9)
    # C = 0.1 M: λ² + 0.1 λ = −θ with θ of the undamped model
    undamped = BASE.eigenvalues(1.0) ** 2
    expected = np.concatenate([-0.05 + s * np.sqrt(0.05**2 + undamped) for s in (1, -1)])
    assert max(np.abs(expected - x).min() for x in model.eigenvalues(1.0)) < 1e-12


def test_uncoupled_disc_does_not_know_friction():
    rng = np.random.default_rng(2)
    for dampers in ({}, dict(cpn=0.1, cpt=0.2, cdn=0.1, cdt=0.3, cc=0.5)):
        model = UncoupledDisc(mp=1.2, md=3.0, kpn=8.0, kpt=15.0, kdn=25.0, kdt=12.0, **dampers)
        assert np.abs(model.friction_matrix).max() == 50
        lam = model.eigenvalues(np.concatenate([[0.0], rng.uniform(-5, 5, 20)]))
        # the two pads are alike, so that one tangential pair is double: its error is the root of the rounding error
        assert max(np.abs(row - x).min() for row in lam[1:] for x in lam[0]) < 1e-6
        assert model.critical_mu() == []
        assert_allclose([np.poly(m) for m in -model.K([0.3, 3.0])], np.array([np.poly(-model.K0)] * 2), rtol=1e-10)


def test_uncoupled_disc_friction_does_the_work_of_two_opposite_faces():
    model = UncoupledDisc(kc=50.0)
    F = model.friction_matrix
    closing = np.array([-1.0, 1.0, 0, 0, 0, 0])  # both pads move towards the disc
    assert_allclose(-F @ closing, [0, 0, 0, 50, 50, -100])  # both are pulled along, the disc is braked
    shift = np.array([1.0, 1.0, 1.0, 0, 0, 0])
    assert_allclose(F @ shift, 0)


def test_rigid_pad_flutters_without_a_diagonal_spring():
    model = RigidPad()
    assert_allclose(model.K(0.2), [[3, 1], [1 - 0.6, 4 - 0.2]], rtol=1e-14)
    assert_allclose(model.critical_mu(), [7 - 2 * np.sqrt(11)], rtol=1e-13)
