"""Every critical point is listed and no other, against eigenvalues counted on their own; rounding is told."""

import dataclasses
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from selection import some

from fe_squeal.cli import main
from lumped import Minimal, NineDof, TwoMass, evaluate
from lumped.axis import axis_of
from lumped.critical_points import search_critical_points
from lumped.intervals import find_unstable_intervals

HIGH = 5.0
DAMPERS = {TwoMass: ("c1x", "c2x", "cy"), NineDof: tuple(f"c{i}" for i in range(1, 10))}


def growing(model, mu):
    """Numbers of eigenvalues that grow for sure, and that may grow, from their condition numbers (Bauer and Fike)."""
    w = 1 / np.sqrt(np.diag(model.M))
    K0, F, C = (w[:, None] * X * w for X in (model.K0, model.friction_matrix, model.C))
    K = K0 + np.asarray(mu)[:, None, None] * F
    n, size = len(w), np.abs(K).max((1, 2))[:, None]
    if C.any():
        A = np.zeros((len(K), 2 * n, 2 * n))
        A[:, :n, n:] = np.eye(n) * np.sqrt(size)[..., None]
        A[:, n:, :n] = -K / np.sqrt(size)[..., None]
        A[:, n:, n:] = -C
        value, error = eigenvalues(A)
        return (value.real > error).sum(1), (value.real > -error).sum(1)
    value, error = eigenvalues(K)  # θ = −λ²: a complex pair has two growing roots, a negative number has one
    apart = np.abs(value[:, :, None] - value[:, None, :]) + np.where(np.eye(n), np.inf, 0)
    double = apart.min(2) <= 2 * error
    return ((np.abs(value.imag) > error) | (value.real < -error)).sum(1), (
        double | (value.imag != 0) | (value.real < error)
    ).sum(1)


def eigenvalues(A):
    value, right = np.linalg.eig(A)
    with np.errstate(all="ignore"):
        left = np.linalg.pinv(right, rcond=1e-300)
        condition = np.linalg.norm(right, axis=1) * np.linalg.norm(left, axis=2)
    return value, 20 * np.finfo(float).eps * np.abs(A).max((1, 2))[:, None] * condition


def assert_counts(model, found, steps=1000):
    """Between its critical points the number of growing eigenvalues is constant, and each point is a change of it."""
    gains = np.array([(1 if o.kind == "divergence" else 2) * (1 if o.into else -1) for o in found.points])
    at = np.array([o.mu for o in found.points])
    beside = [o.mu + side * max(1e-9 * o.mu, 4 * o.uncertainty) for o in found.points for side in (-1, 1)]
    mu = np.sort(np.concatenate([np.linspace(found.low, found.high, steps + 1)[1:], beside]))
    unknown = np.array([2 * sum(d.low <= x <= d.high for d in found.doubts) for x in mu])
    least, most = growing(model, mu) + np.array([-unknown, unknown])
    expected = np.array([gains[at < x].sum() for x in mu], dtype=int)
    # The number at the lowest μ is not known beforehand: with stiffness there is none, without it may be any.
    starts = range(least[0] - expected[0], most[0] - expected[0] + 1)
    assert any((least <= expected + x).all() and (expected + x <= most).all() for x in starts)
    for o, gain in zip(found.points, gains, strict=True):
        below, above = (growing(model, [o.mu + side * max(1e-3 * o.mu, 8 * o.uncertainty)]) for side in (-1, 1))
        near = [p for p in found.points if p is not o and abs(p.mu - o.mu) <= 1e-3 * o.mu]
        if not near:
            assert below[0][0] + gain <= above[1][0] and below[1][0] + gain >= above[0][0]


def drawn(cls, seed, damped):
    """A model of random stiffness, masses and angles: some springs are missing, and some are very stiff."""
    rng = np.random.default_rng(seed)
    values = {}
    for f in dataclasses.fields(cls):
        if f.name in DAMPERS[cls]:
            if damped and rng.random() < 0.4:
                values[f.name] = 10 ** rng.uniform(-3, 0)
        elif f.name.startswith("k"):
            stiff = 10 ** rng.uniform(0, 5) if rng.random() < 0.1 else 1
            values[f.name] = f.default * 10 ** rng.uniform(-1, 1) * stiff * (rng.random() >= 0.05)
        elif f.name.startswith("theta"):
            values[f.name] = 15.0 * rng.integers(0, 12)
        elif f.name != "friction":
            values[f.name] = 10 ** rng.uniform(-0.5, 0.5)
    return cls(**{name: float(value) for name, value in values.items()})


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e5, 1e6])
@pytest.mark.parametrize(("spring", "count"), [("k7", 2), ("k11", 3), ("kc1", 2), ("k3", 2)])
def test_stiff_springs(spring, count, stiffness):
    model = NineDof(**{spring: stiffness})
    found = model.search_critical_points(0, 4)
    assert [(o.kind, o.into) for o in found.points] == [("flutter", True)] * count and not found.doubts
    assert_counts(model, found)


def test_stiff_spring_is_a_support():
    """As k7 rises, the critical points differ like 1/k7 from those of a mass that cannot move along y3."""
    limit = [o.mu for o in NineDof(k7=1e8).critical_points(0, 4)]
    for stiffness in (1e4, 1e5, 1e6):
        found = [o.mu for o in NineDof(k7=stiffness).critical_points(0, 4)]
        assert_allclose(found, limit, atol=0.1 / stiffness + 1e-5)


@pytest.mark.parametrize("model", [TwoMass, NineDof])
@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_random_parameters(model, damped, seed):
    drawn_model = drawn(model, seed, damped)
    assert_counts(drawn_model, drawn_model.search_critical_points(0, HIGH))


# Each of these went wrong at some time: a pair and a third eigenvalue, a nearly undamped divergence, a divergence that
# ends a growing pair, a free mass, motions that rounding hides.
@pytest.mark.parametrize(
    ("model", "damped", "seed"),
    [(NineDof, False, 10), (NineDof, False, 22), (TwoMass, True, 35), (TwoMass, True, 80), (TwoMass, True, 166),
     (NineDof, True, 147), (TwoMass, False, 25), (TwoMass, False, 154), (NineDof, True, 20), (TwoMass, True, 183)],
)  # fmt: skip
def test_chosen_parameters(model, damped, seed):
    test_random_parameters(model, damped, seed)


def test_one_damper_leaves_a_motion_undamped():
    """The belt along x is driven by the pads and drives nothing: undamped at every μ, so that λ and −λ are roots."""
    model = NineDof(c1=0.1)
    found = model.search_critical_points(0, 4)
    assert all(o.kind == "hopf" and o.into for o in found.points) and not found.doubts
    # Re λ of the third one is below 5e-7 rad/s on both sides.
    assert_allclose([o.mu for o in found.points], [0.03318149, 0.14921894, 1.15912620, 3.35078106], atol=1e-7)
    assert_counts(model, found)


@pytest.mark.parametrize("damper", some(["c8", "c9"], lambda damper: damper == "c8"))
def test_touches_are_not_listed(damper):
    """Without the damper on x1, three of these motions decay on both sides of where they are undamped."""
    model = NineDof(**{damper: 0.1})
    found = model.search_critical_points(0, 4)
    assert_allclose(model.critical_mu()[:3], [0.16870587, 0.54145801, 1.66483713], atol=1e-7)
    assert len(found.points) == 3 and not found.doubts
    assert_counts(model, found)
    for touch in (0.1492190, 3.35078):
        lam = model.eigenvalues(np.array([touch - 0.02, touch, touch + 0.02]))
        pair = lam[np.arange(3), np.abs(lam.real).argsort(1)[:, 2]]  # the belt's own pair is nearer to the axis
        assert (pair.real < 1e-12).all()


def test_equal_pads_flutter_against_each_other_beside_a_damper():
    """A damper on the belt's lift does not see pads that move oppositely: that motion has a flutter, no Hopf point."""
    model = NineDof(k4=0.0, c8=0.1)
    hopf, flutter = model.search_critical_points(0, 8).points
    assert (hopf.kind, hopf.into, flutter.kind, flutter.into) == ("hopf", True, "flutter", True)
    # x1 − x2, y1 − y2 and φ alone
    turn = np.zeros((9, 3))
    turn[[0, 2], 0] = turn[[1, 3], 1] = np.sqrt(0.5) * np.array([1, -1])
    turn[8, 2] = 1
    A, B = (turn.T @ X @ turn for X in (model.K0, model.friction_matrix))
    for mu, flutters in ((flutter.mu - 1e-6, False), (flutter.mu + 1e-6, True)):
        assert (np.abs(np.linalg.eigvals(A + mu * B).imag).max() > 1e-9) == flutters
    assert_counts(model, model.search_critical_points(0, 8))


@pytest.mark.parametrize("coupling", [1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 1e-11])
def test_narrow_windows(coupling):
    """(θ1 − θ2)² = (2 μ − 1)² − 4 c² μ² for A + μ B = [[1 + 2 μ, c μ], [−c μ, 2]]: zero at μ = 1 / (2 (1 ± c))."""
    A, B = np.diag([1.0, 2.0]), np.array([[2.0, coupling], [-coupling, 0.0]])
    found = search_critical_points(np.eye(2), 0 * A, A, B, 0, 1)
    assert [o.into for o in found.points] == [True, False] and not found.doubts
    assert_allclose([o.mu for o in found.points], [0.5 / (1 + coupling), 0.5 / (1 - coupling)], rtol=1e-14)


@pytest.mark.parametrize("damping", [0.0, 0.1])
@pytest.mark.parametrize(("stiffness", "mass"), [(1e6, 1e-3), (1e-6, 1e3), (1e12, 1.0)])
@pytest.mark.parametrize("model", [TwoMass(), NineDof()])
def test_units_do_not_matter(model, damping, stiffness, mass):
    scales = {"k": stiffness, "m": mass, "j": mass}
    one = dataclasses.replace(model, **dict.fromkeys(DAMPERS[type(model)], damping))
    other = dataclasses.replace(one, **{
        f.name: getattr(one, f.name) * scales[f.name[0]] for f in dataclasses.fields(one) if f.name[0] in scales
    }, **dict.fromkeys(DAMPERS[type(model)], damping * np.sqrt(stiffness * mass)))  # fmt: skip
    expected, found = (m.search_critical_points(0, 10) for m in (one, other))
    assert len(expected.points) == len(found.points) > 0
    rate = np.sqrt(stiffness / mass)
    for a, b in zip(expected.points, found.points, strict=True):
        assert (a.kind, a.into) == (b.kind, b.into)
        assert_allclose([b.mu, b.omega / rate], [a.mu, a.omega], rtol=1e-9)
        assert_allclose(b.slope / rate, a.slope, rtol=1e-5)
    mu = np.linspace(0, 4, 9)
    a, b = one.spectrum(mu), other.spectrum(mu)
    assert (a.unstable == b.unstable).all()
    assert np.median(b.uncertainty) / rate < 10 * np.median(a.uncertainty)


def test_range_that_was_searched():
    assert [o.mu for o in NineDof().critical_points(1, 3)] == pytest.approx([2.7383310465820566])
    found = Minimal(k2=20.0, friction="contact").search_critical_points(-np.inf, 0.5)
    assert (found.low, found.high) == (-1e6, 0.5)
    assert found.completeness["what"] == "critical mu from -1e+06 to 0.5"
    far = dataclasses.replace(TwoMass(friction="contact"), k=1e-9)  # as weak as the coupling is, as large is μ
    assert not far.critical_mu() and far.search_critical_points().completeness["sure"]


def test_what_rounding_hides_is_told():
    """With a contact a thousand times as stiff two modes meet in the limit of large μ, nearer than rounding tells."""
    result = evaluate("nine-dof", {"kc1": "1000"})
    [sentence] = result["critical_mu_complete"]["open"]
    assert not result["critical_mu_complete"]["sure"]
    assert sentence.startswith("between mu = ") and "and 1e+06 a motion at 1.4142 rad/s" in sentence
    assert result["critical_mu"] == pytest.approx([1.539943, 3.489907, 8.615116, 18059.17], rel=1e-6)


def test_stiffness_that_hides_all_is_told():
    """Next to 1e16 N/m rounding is larger than the stiffness of all other springs."""
    found = NineDof(k7=1e16).search_critical_points(0, 4)
    assert not found.points
    assert found.completeness["open"][0].startswith("between mu = 0 and 4 a motion at ")


def test_weak_damping():
    """Dampers of 1e-9 N s/m move the onsets by less than rounding, and of 1e-300 N s/m are none."""
    plain = NineDof().critical_points(0, 4)
    for damping, kind in ((1e-9, "hopf"), (1e-300, "flutter")):
        found = NineDof(**dict.fromkeys(DAMPERS[NineDof], damping)).search_critical_points(0, 4)
        assert [(o.kind, o.into) for o in found.points] == [(kind, True)] * 3 and not found.doubts
        assert_allclose([o.mu for o in found.points], [o.mu for o in plain], rtol=1e-7)


def test_command(capsys):
    assert main(["lumped", "nine-dof", "--set", "k7=1e4", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["critical_mu"] == pytest.approx([0.8804558, 2.6644447], abs=1e-7)
    assert result["critical_mu_complete"] == {"sure": True, "what": "critical mu from 0 to 1e+06", "open": []}
    assert main(["lumped", "nine-dof", "--set", "kc1=1000"]) == 0
    text = capsys.readouterr().out
    assert "searched: critical mu from 0 to 1e+06" in text and "warning: between mu = " in text


@pytest.mark.parametrize(("damper", "start"), [("c1", 0.03318149), ("c9", 0.16870587)])
def test_ends_of_intervals_beside_an_undamped_motion(damper, start):
    model = NineDof(**{damper: 0.1})
    [(low, high)] = find_unstable_intervals(model, axis_of(model, "mu", np.linspace(0, 1, 401)), 0.0)
    assert high == 1.0
    assert low == pytest.approx(start, abs=1e-8)


def test_intervals_over_a_mass():
    model = TwoMass()
    [(low, high)] = find_unstable_intervals(model, axis_of(model, "m2", np.linspace(0.5, 8, 151)), 0.4)
    assert 0.5 < low < model.m2 < high < 8
    for mass, unstable in ((low - 1e-6, False), (low + 1e-6, True), (high - 1e-6, True), (high + 1e-6, False)):
        assert dataclasses.replace(model, m2=mass).spectrum(0.4).unstable == unstable
