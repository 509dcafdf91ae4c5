"""Onsets of small systems with closed forms, through the same sweep as finite-element models."""

import numpy as np
import pytest
import scipy.sparse as sp

from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.sweep.sweep import sweep

SQRT3 = np.sqrt(3.0)


def problem(K, F=None, C=None, M=None, power=1):
    K = np.asarray(K, float)
    M = np.eye(len(K)) if M is None else np.asarray(M, float)
    terms = [Term("mass", "M", sp.csr_array(M), True), Term("elastic", "K", sp.csr_array(K), True)]
    if F is not None:
        terms.append(Term("friction", "K", sp.csr_array(np.asarray(F, float)), False, {"mu": power}))
    if C is not None:
        terms.append(Term("damping", "C", sp.csr_array(np.asarray(C, float)), True))
    return Problem(tuple(terms), {"mu": 0.0})


def block_on_belt(k1=10.0, k2=20.0, k3=10.0, reading="contact", c=(0.0, 0.0, 0.0)):
    """Mass 1 on springs at 120° and 60° and a contact spring; x along the belt, y out of it (Hoffmann et al. 2002)."""
    direction = [np.array([np.sin(t), -np.cos(t)]) for t in np.radians([120.0, 60.0])] + [np.array([0.0, 1.0])]
    K = sum(k * np.outer(d, d) for k, d in zip((k1, k2, k3), direction, strict=True))
    C = sum(ci * np.outer(d, d) for ci, d in zip(c, direction, strict=True))
    normal = {"contact": k3, "all": K[1, 1]}[reading]
    return problem(K, [[0.0, normal], [0.0, 0.0]], C if any(c) else None)


@pytest.mark.parametrize(("reading", "onset"), [("contact", 1 / SQRT3), ("all", 4 / (7 * SQRT3))])
def test_two_modes_merge_at_the_closed_form(reading, onset):
    """a = 22.5, d = 17.5, b = −5√3/2: (a − d)² + 4b² = 4 μ |b| k_normal."""
    result = sweep(block_on_belt(reading=reading), np.linspace(0, 1, 8), modes=2)
    [found] = result.onsets
    assert found.kind == "flutter" and found.direction == "into"
    assert found.value == pytest.approx(onset, rel=1e-13)
    assert abs(found.value - onset) <= found.uncertainty < 1e-12
    # θ = (a + d)/2 there, whatever the friction.
    assert found.frequency_hz == pytest.approx(np.sqrt(20.0) / (2 * np.pi), rel=1e-13)
    # θ = 20 ± √(d/dμ(discriminant) (μ − μ_c)), Re λ = |Im θ|/(2√20): the coefficient from the closed form.
    normal = 10.0 if reading == "contact" else 17.5
    coefficient = np.sqrt(5 * SQRT3 / 2 * normal) / (2 * np.sqrt(20.0))
    assert found.crossing_speed == pytest.approx(coefficient, rel=1e-10)
    assert found.two_mode_value == pytest.approx(onset, rel=1e-12)


@pytest.mark.parametrize(("power", "onset"), [(1, 0.5), (2, np.sqrt(0.5))])
def test_what_two_modes_predict_is_told_where_stiffness_is_linear(power, onset):
    """K = diag(1, 2) + μ^m F with F skew: the two meet at μ^m = ½. For m = 2 the slope at the first value, 0.1, says
    that they meet at 2.55, although they are all there is."""
    terms = (Term("m", "M", sp.eye_array(2, format="csr"), True),
             Term("k", "K", sp.csr_array(np.diag([1.0, 2.0])), True),
             Term("f", "K", sp.csr_array(np.array([[0.0, 1.0], [-1.0, 0.0]])), False, {"mu": power}))  # fmt: skip
    [found] = sweep(Problem(terms, {"mu": 0.1}), [0.1, 0.5, 1.0], modes=2).onsets
    assert found.value == pytest.approx(onset, rel=1e-9)
    assert found.two_mode_value == pytest.approx(onset if power == 1 else np.nan, rel=1e-9, nan_ok=True)


def test_what_two_modes_predict_where_one_diverges_at_the_first_value():
    """K(1) = [[2, 1], [−1, 4]] has the double θ = 3. At p = 0 θ is −1 and 4."""
    stiffness = np.diag([-1.0, 4.0])
    result = sweep(problem(stiffness, [[3.0, 1.0], [-1.0, 0.0]]), np.linspace(0, 1.5, 6), modes=2)
    [flutter] = [o for o in result.onsets if o.kind == "flutter"]
    assert [flutter.value, flutter.two_mode_value] == pytest.approx([1.0, 1.0], rel=1e-9)


def test_growth_rates_behind_the_onset():
    """λ at μ = 0.5 and 1 for friction on the whole normal diagonal, to the digits of 40-digit arithmetic."""
    result = sweep(block_on_belt(reading="all"), [0.3, 0.5, 1.0], modes=2)
    expected = [
        [4.30051152833405j, 4.63741313607769j],
        [0.399787888218975 + 4.48996997267984j, -0.399787888218975 + 4.48996997267984j],
        [0.784702125053326 + 4.54045784311045j, -0.784702125053326 + 4.54045784311045j],
    ]
    for point, lam in zip(result.points, expected, strict=True):
        np.testing.assert_allclose(point.modes.lam, lam, atol=3e-14)
    assert [list(p.modes.stability) for p in result.points] == [["marginal"] * 2, *[["unstable", "stable"]] * 2]
    # The growing mode continues the lower branch all along.
    assert [list(p.branches) for p in result.points] == [[1, 2]] * 3


@pytest.mark.parametrize(
    ("c", "onset", "speed"),
    [((0.3, 0.3, 0.3), 116.2 / (175 * SQRT3), 2.0996082231), ((0.3, 0.3, 0.0), 0.325996705567428, None)],
)
def test_damped_onset_is_a_crossing(c, onset, speed):
    """Even damping raises the onset 4/(7√3) = 0.3299, damping of the inclined springs alone lowers it."""
    result = sweep(block_on_belt(reading="all", c=c), np.linspace(0, 1, 6), modes=2)
    [found] = result.onsets
    assert (found.kind, found.direction, found.branch_b) == ("flutter", "into", None)
    assert found.value == pytest.approx(onset, rel=1e-13)
    if speed:
        assert found.crossing_speed == pytest.approx(speed, rel=1e-9)


def test_degenerate_springs_are_marginal_at_every_friction():
    """k2 = 10: a = d = 15 and b = 0 up to rounding, a Jordan block for every μ, never unstable beyond doubt."""
    result = sweep(block_on_belt(k2=10.0, reading="all"), np.linspace(0, 1, 11), modes=2)
    assert result.onsets == ()
    for point in result.points:
        assert (point.modes.stability == "marginal").all()
        np.testing.assert_allclose(point.modes.lam.imag, np.sqrt(15.0), rtol=1e-7)


@pytest.mark.parametrize("values", [[0.5, 0.8, 1.3, 1.7, 2.4], [0.5, 2.6], [0.4, 0.9, 2.3]], ids=str)
def test_pair_that_couples_and_parts_again(values):
    """θ = 1 ± √((μ−1)(μ−2)): flutter between 1 and 2; ∂D/∂μ = ∓1, so the coefficient is 1/(2√1) at both ends.

    Both may happen within one step, at whose ends nothing of it is to be seen.
    """
    # D = μ² − 3μ + 2 = K12(μ) · 1 needs μ and μ²: two friction terms.
    base = problem([[1.0, 0.0], [0.0, 1.0]])
    lower = Term("lower", "K", sp.csr_array(np.array([[0.0, 0.0], [1.0, 0.0]])), False)
    upper = sp.csr_array(np.array([[0.0, 1.0], [0.0, 0.0]]))
    terms = [Term(f"mu{e}", "K", upper * c, False, {"mu": e}) for e, c in ((0, 2.0), (1, -3.0), (2, 1.0))]
    result = sweep(Problem((*base.terms, lower, *terms), {"mu": 0.5}), values, modes=2)
    into, out = result.onsets
    assert (into.direction, out.direction) == ("into", "out of")
    assert into.value == pytest.approx(1.0, abs=1e-13) and out.value == pytest.approx(2.0, abs=1e-13)
    for found in (into, out):
        assert found.crossing_speed == pytest.approx(0.5, rel=1e-10)
        assert (found.branch_a, found.branch_b) == (1, 2)


@pytest.mark.parametrize("c", [0.0, 0.02])
def test_instability_beyond_the_range_raises_no_doubt(c):
    """θ = 100 ± 50 √(1 − 2μ²), far above the two modes asked for, but among those that are followed for them."""
    K = np.diag([1.0, 2.0, 50.0, 150.0])
    F = np.zeros((4, 4))
    F[2, 3], F[3, 2] = 100.0, -50.0
    base = problem(K, F)
    damper = (Term("damper", "C", sp.csr_array(c * np.eye(4)), True),) if c else ()
    result = sweep(Problem((*base.terms, *damper), {"mu": 0.0}), np.linspace(0, 1.6, 5), modes=2)
    assert result.onsets == () and result.warnings == ()
    assert all(len(point.modes) == 2 == point.branches.max() for point in result.points)
    assert len(sweep(Problem((*base.terms, *damper), {"mu": 0.0}), np.linspace(0, 1.6, 5), modes=4).onsets) == 1


def test_divergence_is_found_where_the_stiffness_becomes_singular():
    """K = [[2, −μ], [−μ, 2]] + mode 9: θ = 2 ± μ, zero at μ = 2; behind it λ = √(μ − 2)."""
    K = np.diag([2.0, 2.0, 9.0])
    F = -np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    result = sweep(problem(K, F), [1.0, 1.5, 2.5, 3.0], modes=3)
    [found] = [o for o in result.onsets if o.kind == "divergence"]
    assert found.value == pytest.approx(2.0, abs=1e-12) and found.frequency_hz == 0
    assert found.crossing_speed == pytest.approx(1.0, rel=1e-10)
    assert result.points[-1].modes.lam[0] == pytest.approx(1.0)


def test_doublet_flutters_from_the_start_without_threshold():
    """K = I + μ [[0, −1], [1, 0]]: θ = 1 ± iμ, semisimple at μ = 0; Re λ = sin(φ/2)|θ|^½ from the first value on."""
    K = np.diag([1.0, 1.0, 5.0])
    F = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    result = sweep(problem(K, F), [0.0, 0.1, 0.2], modes=3)
    [found] = result.onsets
    assert found.value == 0.0 and found.kind == "flutter"
    assert result.points[1].modes.lam[0] == pytest.approx(1j * np.sqrt(1 - 0.1j), rel=1e-13)


def test_tracking_follows_shapes_through_crossing_and_veering():
    """Three oscillators: θ1 = 1 + μ crosses θ2 = 2 (no coupling) and veers off θ3 = 3 (coupling 0.05)."""
    base = problem(np.diag([1.0, 2.0, 3.0]) + 0.05 * np.array([[0, 0, 1.0], [0, 0, 0], [1.0, 0, 0]]))
    slope = Term("slope", "K", sp.csr_array(np.diag([1.0, 0.0, 0.0])), True, {"mu": 1})
    result = sweep(Problem((*base.terms, slope), {"mu": 0.0}), np.linspace(0, 4, 9), modes=3)
    for point in result.points:
        mu, branch = point.value, dict(zip(point.branches, point.modes.lam.imag**2, strict=True))
        low, high = 2 + mu / 2 + np.array([-1, 1]) * np.hypot(1 - mu / 2, 0.05)
        # Crossing keeps the shape: branch 2 stays at 2 throughout. Veering keeps the order of the curves.
        np.testing.assert_allclose([branch[1], branch[2], branch[3]], [low, 2.0, high], rtol=1e-12)
    assert result.onsets == ()


def test_shares_of_the_growth_rate_add_up_next_to_an_onset():
    """10⁻⁶ beyond the onset the left-right shares would be ±10³ of the sum; the energy balance keeps every digit."""
    mu = 1 / SQRT3 * (1 + 1e-6)
    result = sweep(block_on_belt(), [0.0, mu], modes=2)
    shares = result.contributions_dataframe()
    assert set(shares.term[shares.re_share != 0]) == {"friction", "sum"}  # conservative terms: exactly nothing
    total = shares[shares.term == "sum"].re_share.iloc[0]
    growth = result.points[1].modes.lam[0].real
    assert total == pytest.approx(growth, rel=1e-6) and growth > 0
