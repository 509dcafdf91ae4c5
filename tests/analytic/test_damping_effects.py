"""Damping effects against closed forms: Rayleigh, structural, slip damping and falling friction.

Signs come from virtual work on a stiff block on a belt that runs along x: the pad feels μ(v − ṡ) p0 along the belt and
−μ p0 ṡ⊥/|v| across it.
"""

from __future__ import annotations

import numpy as np
import pytest

from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from meshes import BELT, STEEL, annulus, box, join, make_problem, modes_of, rigid_motions, term

P0, SPEED, MU = 3.0, 2.0, 0.4
STIFF = {"stiff": {"youngs_modulus": 1e6, "poisson_ratio": 0.0, "density": 1.0}}
K = 25.0


def free_block(effects, counterface="rigid", **tables):
    """A block of 1 m³ and 1 kg on a belt, of which the rigid motions are the unknowns that matter."""
    sliding = {**BELT, "speed": SPEED}
    contact = {"name": "belt", "surface": "bottom", "counterface": counterface, "normal_stiffness": 10.0}
    return make_problem(
        box("hex1", (2, 2, 2)), order=1, materials=STIFF, contacts=[{**contact, "sliding": sliding}],
        effects={"friction": {"mu": MU}, **effects}, **tables,
    )  # fmt: skip


def held_block(free, effects):
    """The block that a spring of 25 N/m holds along x or y, the only direction in which it can move."""
    others = "".join(c for c in "xyz" if c != free)
    return free_block(
        effects, supports=[{"surface": s, "fixed": others} for s in ("left", "right", "front", "back")],
        springs=[
            {"name": s, "surface": s, "direction": [float(c == free) for c in "xyz"], "stiffness": K / 2}
            for s in ("left", "right")
        ],
    )  # fmt: skip


def test_slip_damping_on_rigid_motions():
    """Of the translations only that across the belt feels it: ∫ μ p0/|v| dA = μ p0 A/v."""
    problem = free_block({"friction_damping": {"contact_pressure": P0}})
    motions = rigid_motions(problem)[:, :3]
    C = motions.T @ (problem.pencil().C @ motions)
    np.testing.assert_allclose(C, np.diag([0.0, MU * P0 / SPEED, 0.0]), atol=1e-12)
    # It counts with mu, and with one over the speed.
    C = motions.T @ (problem.pencil(mu=0.8).C @ motions)
    assert C[1, 1] == pytest.approx(0.8 * P0 / SPEED)
    faster = problem.at({"contacts.belt.sliding.speed": 5.0})
    assert (motions.T @ (faster.pencil().C @ motions))[1, 1] == pytest.approx(MU * P0 / 5.0)
    back = problem.at({"contacts.belt.sliding.speed": -5.0})
    assert (motions.T @ (back.pencil().C @ motions))[1, 1] == pytest.approx(MU * P0 / 5.0), "stabilises either way"


@pytest.mark.parametrize("slope", [-0.02, 0.03])
def test_falling_friction_on_rigid_motions(slope):
    """Only the motion along the belt feels it: ∫ p0 dμ/dv dA, negative where friction falls."""
    problem = free_block({"falling_friction": {"contact_pressure": P0, "slope": slope}})
    motions = rigid_motions(problem)[:, :3]
    C = motions.T @ (problem.pencil().C @ motions)
    np.testing.assert_allclose(C, np.diag([P0 * slope, 0.0, 0.0]), atol=1e-12)


@pytest.mark.parametrize("slope", [-0.02, 0.03])
def test_falling_friction_of_a_sprung_block(slope):
    """m ẍ + p0 A μ' ẋ + k x = 0: a falling coefficient makes it grow at −p0 A μ'/2m, a rising one damps it."""
    problem = held_block("x", {"falling_friction": {"contact_pressure": P0, "slope": slope}})
    lam = solve_modes(problem.pencil(), Request(count=1)).lam[0]
    exact = -P0 * slope / 2 + 1j * np.sqrt(K - (P0 * slope / 2) ** 2)
    assert abs(lam - exact) < 1e-4 * abs(exact)  # the block is soft by K/E = 2.5e-5
    assert lam.real == pytest.approx(exact.real, rel=1e-4)


def test_slip_damping_of_a_sprung_block():
    """Across the belt: m ÿ + (μ p0 A/v) ẏ + k y = 0."""
    problem = held_block("y", {"friction_damping": {"contact_pressure": P0}})
    lam = solve_modes(problem.pencil(), Request(count=1)).lam[0]
    c = MU * P0 / SPEED
    exact = -c / 2 + 1j * np.sqrt(K - c**2 / 4)
    assert abs(lam - exact) < 1e-4 * abs(exact)


def test_slip_damping_and_falling_friction_under_a_turning_disc():
    """A ring pad on a disc that turns at Ω: |v| = Ωr, so a radial motion feels ∫ μ p0/(Ωr) e_r·e_r dA.

    For the translation along x that is ∫∫ (μ p0/Ω) cos²φ dr dφ = π μ p0 (r2 − r1)/Ω; sliding is along e_φ, so that
    falling friction feels ∫ p0 μ' sin²φ r dr dφ = π p0 μ' (r2² − r1²)/2.
    """
    r1, r2, omega, slope = 0.1, 0.15, 7.0, -0.05
    ring = annulus("hex2", (3, 24, 1), r1, r2, 0.01)
    problem = make_problem(
        ring, contacts=[{
            "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e9,
            "sliding": {"axis": [0, 0, 2.0], "speed": omega},
        }],
        effects={
            "friction": {"mu": MU}, "friction_damping": {"contact_pressure": P0}, "falling_friction": {"slope": slope}
        },
    )  # fmt: skip
    x = rigid_motions(problem)[:, 0]
    across = float(x @ (term(problem, "friction_damping", "C") @ x))
    # term() puts mu at 1
    assert across == pytest.approx(np.pi * P0 * (r2 - r1) / omega, rel=1e-5)
    along = float(x @ (term(problem, "falling_friction", "C") @ x))
    assert along == pytest.approx(np.pi * P0 * slope * (r2**2 - r1**2) / 2, rel=1e-5)


def bar(effects, loss=(0.0, 0.0), bodies=None):
    """Two clamped bars beside each other, of one mesh each."""
    left, right = box("hex2", (4, 1, 1), (0.4, 0.02, 0.03), name="a"), box(
        "hex2", (4, 1, 1), (0.5, 0.02, 0.03), (0.0, 1.0, 0.0), name="b"
    )
    return make_problem(
        join(left, right), materials={"s": {**STEEL, "loss_factor": loss[0]}, "t": {**STEEL, "loss_factor": loss[1]}},
        bodies=bodies or {"a": {"material": "s"}, "b": {"material": "t"}},
        supports=[{"surface": "left_a", "fixed": "xyz"}, {"surface": "left_b", "fixed": "xyz"}], effects=effects,
    )  # fmt: skip


def test_rayleigh_damping_ratio():
    """λ² + (α + βω²)λ + ω² = 0 for every mode, so ζ = (α/ω + βω)/2."""
    alpha, beta = 30.0, 4e-6
    omega = modes_of(bar({}), 8).lam.imag
    modes = modes_of(bar({"rayleigh": {"alpha": alpha, "beta": beta}}), 8)
    zeta = (alpha / omega + beta * omega) / 2
    exact = -zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)
    np.testing.assert_allclose(modes.lam, exact, rtol=1e-9)
    assert (modes.stability == "stable").all()


def test_a_bodys_own_rayleigh_damping_replaces_that_of_the_model():
    """Bar b alone has another beta; its modes, and no others, have it."""
    bodies = {"a": {"material": "s"}, "b": {"material": "t", "rayleigh": {"beta": 9e-6}}}
    modes = modes_of(bar({"rayleigh": {"alpha": 30.0, "beta": 4e-6}}, bodies=bodies), 6)
    split = modes_of(bar({}), 6)
    problem = bar({})
    of_b = problem.discretisation.space.coordinates[:, 1] > 0.5
    shapes = [np.abs(problem.discretisation.space.expand(split.right[:, i]))[of_b].max() > 1e-6 for i in range(6)]
    assert 0 < sum(shapes) < 6
    for lam, omega, b in zip(modes.lam, split.lam.imag, shapes, strict=True):
        c = 9e-6 * omega**2 if b else 30.0 + 4e-6 * omega**2
        assert lam.real == pytest.approx(-c / 2, rel=1e-8)


def test_structural_damping_acts_at_each_modes_own_frequency():
    """λ² = −ω²(1 + iη), so Re λ ≈ −ηω/2 for every mode; bar b has another η."""
    eta = (0.02, 0.3)
    plain = modes_of(bar({}), 6)
    problem = bar({"structural_damping": {}}, eta)
    modes = modes_of(problem, 6)
    assert problem.problem_class == "complex"
    space = problem.discretisation.space
    of_b = space.coordinates[:, 1] > 0.5
    for i, omega in enumerate(plain.lam.imag):
        loss = eta[int(np.abs(space.expand(plain.right[:, i]))[of_b].max() > 1e-6)]
        exact = 1j * omega * np.sqrt(1 + 1j * loss)
        assert np.abs(modes.lam - exact).min() < 1e-9 * omega
        assert exact.real == pytest.approx(-loss * omega / 2, rel=2 * loss**2)


def test_frozen_structural_damping_is_right_at_its_frequency_alone():
    """C = ηK/ω_ref: 2ζ = ηω/ω_ref, right for the mode at the reference frequency and for no other."""
    eta = 0.02
    omega = modes_of(bar({}), 6).lam.imag
    frozen = {"structural_damping": {"reference_frequency_hz": float(omega[2] / (2 * np.pi))}}
    problem = bar(frozen, (eta, eta))
    assert problem.problem_class == "quadratic"
    modes = modes_of(problem, 6)
    zeta = eta * omega / omega[2] / 2
    np.testing.assert_allclose(modes.lam, -zeta * omega + 1j * omega * np.sqrt(1 - zeta**2), rtol=1e-9)
    own = modes_of(bar({"structural_damping": {}}, (eta, eta)), 6)
    assert modes.lam[2].real == pytest.approx(own.lam[2].real, rel=1e-3)
    assert abs(modes.lam[5].real) > 1.5 * abs(own.lam[5].real)


def test_springs_and_contacts_have_no_part_in_the_bodies_damping():
    """Rayleigh's β and η scale the elastic stiffness alone: a stiff block on springs and a contact stays undamped."""
    beta = 1e-7
    problem = held_block("x", {"rayleigh": {"beta": beta}})
    lam = solve_modes(problem.pencil(), Request(count=1)).lam[0]
    assert lam.imag == pytest.approx(np.sqrt(K), rel=1e-4)
    assert abs(lam.real) < 1e-4 * beta * K / 2  # βK/2 if the spring were damped; the block takes K/E of the energy
