"""The static state under preload against closed forms: pressures, forces, torque, lift-off, stress stiffening."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fe_squeal import sweep
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.errors import SceneError
from meshes import BELT, annulus, box, make_problem, modes_of, rigid_motions

P = 2.0
KN = 1e3
RIGID = {"stiff": {"youngs_modulus": 1e8, "poisson_ratio": 0.0, "density": 1.0}}
FRICTIONLESS = {"name": "belt", "surface": "bottom", "counterface": "rigid", "kind": "frictionless"}


def test_uniform_pressure_goes_through_a_block():
    """A pressure on the top of a block is the contact pressure, and presses the block by p/k_n + pH/E."""
    problem = make_problem(
        box("hex2", (2, 2, 2), (1.0, 1.0, 0.5)),
        materials={"m": {"youngs_modulus": 50.0, "poisson_ratio": 0.3, "density": 1.0}},
        contacts=[{**FRICTIONLESS, "normal_stiffness": 10.0}],
        supports=[{"surface": "left", "fixed": "x"}, {"surface": "front", "fixed": "y"}],
        effects={"preload": {"pressures": {"top": P}}},
    )  # fmt: skip
    state = problem.discretisation.static_state
    np.testing.assert_allclose(state.contacts["belt"].pressure, P, rtol=1e-10)
    top = problem.discretisation.space.coordinates[:, 2] > 0.5 - 1e-9
    u = problem.discretisation.space.expand(state.u)
    np.testing.assert_allclose(u[top, 2], -(P / 10.0 + P * 0.5 / 50.0), rtol=1e-10)
    assert state.contacts["belt"].normal_force == pytest.approx(P)
    np.testing.assert_allclose(state.contacts["belt"].force, [0, 0, P], atol=1e-12)


@pytest.mark.parametrize("speed", [3.0, -3.0])
def test_braking_torque_of_a_ring_pad(speed):
    """T = μ p ∫ r dA = 2π μ p (r2³ − r1³)/3, in the sense that the disc turns the pad."""
    r1, r2, mu = 0.10, 0.15, 0.35
    problem = make_problem(
        annulus("hex2", (3, 24, 1), r1, r2, 0.02),
        materials={"m": {"youngs_modulus": 1e9, "poisson_ratio": 0.0, "density": 1.0}},
        contacts=[{
            "name": "disc", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e4,
            "sliding": {"axis": [0, 0, 1.0], "centre": [0, 0, 0.3], "speed": speed},
        }],
        supports=[{"surface": "top", "fixed": "xy"}],
        effects={"friction": {"mu": mu}, "preload": {"pressures": {"top": P}}},
    )  # fmt: skip
    state = problem.discretisation.static_state.contacts["disc"]
    area = np.pi * (r2**2 - r1**2)
    assert state.normal_force == pytest.approx(P * area, rel=2e-5)  # the mesh follows the circle to 1e-5
    # The torque that the contact puts on the pad about the axis along its rotation.
    assert state.torque == pytest.approx(2 * np.pi * mu * P * (r2**3 - r1**3) / 3, rel=2e-5)
    np.testing.assert_allclose(state.force[:2], 0.0, atol=1e-9 * P * area)


def tipping(mu=0.0, load=(0.0, 0.2), height=0.0, cells=40):
    """A stiff block of 1 m on a Winkler belt, pressed on a part of its top; `height` is where an abutment holds it."""
    mesh = box("hex1", (cells, 1, 4), (1.0, 0.2, 0.4))
    x, z = mesh.p[0][mesh.facets], mesh.p[2][mesh.facets]
    top = mesh.boundaries["top"]
    right = mesh.boundaries["right"]
    patch = top[(x[:, top].min(axis=0) > load[0] - 1e-9) & (x[:, top].max(axis=0) < load[1] + 1e-9)]
    stop = right[np.abs(z[:, right].mean(axis=0) - height) < 0.051]
    mesh = mesh.with_boundaries({"patch": patch, "stop": stop if height else mesh.boundaries["bottom"]})
    return make_problem(
        mesh, order=1, materials=RIGID,
        contacts=[
            {"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": KN, "sliding": BELT}
        ],
        supports=[{"surface": "front", "fixed": "y"}, {"surface": "back", "fixed": "y"}],
        # Soft beside the contact: its force then stays where the middle of the surface is.
        springs=[{"name": "stop", "surface": "stop", "direction": [1.0, 0, 0], "stiffness": 2.0}],
        effects={"friction": {"mu": mu}, "preload": {"pressures": {"patch": P}}},
    )  # fmt: skip


def contact_length(problem):
    """Return the length of the closed part along x and the largest pressure."""
    state, points = problem.discretisation.static_state.contacts["belt"], problem.discretisation.contacts["belt"]
    return points.weights[state.closed].sum() / 0.2, state.pressure.max(), points.points[state.closed, 0]


def test_a_block_under_an_eccentric_load_lifts_off():
    """Load at e > L/6 from the middle: pressure is a triangle on a length 3(L/2 − e), its peak 2N/(a b)."""
    problem = tipping()
    length, peak, x = contact_length(problem)
    force, e = P * 0.2 * 0.2, 0.4
    assert length == pytest.approx(3 * (0.5 - e), abs=1 / 40)  # to one cell
    assert peak == pytest.approx(2 * force / (3 * (0.5 - e) * 0.2), rel=0.05)
    assert x.max() < 0.3 + 1 / 40
    assert problem.discretisation.static_state.contacts["belt"].normal_force == pytest.approx(force, rel=1e-6)


def test_friction_tips_a_block_on_its_stop():
    """The belt drags the block along x against a stop at height h: the couple μNh shifts the pressure by e = μh to −x.

    With e > L/6 the pressure is a triangle on 3(L/2 − e) at the end that the belt comes from.
    """
    mu, height = 1.0, 0.35
    problem = tipping(mu, load=(0.0, 1.0), height=height)
    length, _, x = contact_length(problem)
    # The force of the stop acts at the centroid of its facets, at height 0.35.
    assert length == pytest.approx(3 * (0.5 - mu * height), abs=1.5 / 40)
    assert x.min() < 0.02 and x.max() < 0.5
    state = problem.discretisation.static_state.contacts["belt"]
    np.testing.assert_allclose(state.force, [mu * P * 0.2, 0, P * 0.2], rtol=1e-6, atol=1e-9)


def test_friction_and_contact_stiffness_live_on_the_closed_part():
    """Open points are out of K_c, K_f: per k_n, each sums to the closed area."""
    problem = tipping(mu=0.3)
    closed = contact_length(problem)[0] * 0.2
    z = rigid_motions(problem)[:, 2]
    (normal,) = [t for t in problem.terms if t.name == "contact.belt"]
    assert float(z @ (normal.matrix @ z)) == pytest.approx(closed, rel=1e-9)
    x = rigid_motions(problem)[:, 0]
    (friction,) = [t for t in problem.terms if t.name == "friction.belt"]
    assert float(x @ (friction.matrix @ z)) == pytest.approx(closed, rel=1e-9)


def test_the_static_state_follows_mu_unless_it_is_fixed():
    """More friction tips the block more; with a stated mu the state, and so the stiffness, stays."""
    swept = tipping(0.2, load=(0.0, 1.0), height=0.35)
    lengths = [contact_length(swept.at(mu=mu))[0] for mu in (0.2, 0.8, 1.0)]
    assert lengths[0] == pytest.approx(1.0) and lengths[1] > lengths[2]
    assert not swept.is_affine("mu")
    again = swept.at(mu=1.0).at(mu=0.2)
    found, first = (p.discretisation.static_state.u for p in (again, swept))
    np.testing.assert_allclose(found, first, rtol=1e-9, atol=1e-12)


def test_a_long_beam_on_a_foundation_that_does_not_pull():
    """A weightless beam under a force in its middle touches on π/(2β) to either side, β⁴ = k b/(4EI).

    From the ends of the contact w ~ cosh ξ sin ξ + sinh ξ cos ξ, without moment and shear there, and the slope
    cosh ξ cos ξ vanishes under the force at ξ = π/2. Half of the beam is modelled.
    """
    height, width, modulus, stiffness, length = 0.02, 0.05, 1e6, 2e3, 1.2
    beta = (stiffness / (4 * modulus * height**3 / 12)) ** 0.25
    cells = 60
    mesh = box("hex2", (cells, 1, 1), (length, width, height))
    top = mesh.boundaries["top"]
    ends = mesh.p[0][mesh.facets][:, top]
    mesh = mesh.with_boundaries({"patch": top[ends.max(axis=0) < 1.01 * length / cells]})
    problem = make_problem(
        mesh, materials={"m": {"youngs_modulus": modulus, "poisson_ratio": 0.0, "density": 1.0}},
        contacts=[{**FRICTIONLESS, "normal_stiffness": stiffness}],
        supports=[{"surface": "left", "fixed": "x"}, {"surface": "front", "fixed": "y"}],
        effects={"preload": {"pressures": {"patch": 1.0}}},
    )  # fmt: skip
    state, c = problem.discretisation.static_state.contacts["belt"], problem.discretisation.contacts["belt"]
    assert length > 2 * np.pi / (2 * beta)  # the beam goes on, and stands off
    touching = c.weights[state.closed].sum() / width
    assert touching == pytest.approx(np.pi / (2 * beta), rel=0.02)
    force = 1.0 * width * length / cells
    assert state.normal_force == pytest.approx(force, rel=1e-9)
    # The pressure's integral, ∫ (cosh sin + sinh cos) = sinh ξ sin ξ, is the force.
    end = np.pi / 2
    peak = force / width * beta * np.cosh(end) / np.sinh(end)
    assert state.pressure.max() == pytest.approx(peak, rel=0.02)


def test_contact_that_may_pull_stays_closed():
    """lift_off = false: the linear state, p = N/A (1 + 12 e x/L²), negative on the far side."""
    problem = tipping()
    scene = problem.source.scene
    linear = make_linear(scene, problem)
    state, points = linear.discretisation.static_state.contacts["belt"], linear.discretisation.contacts["belt"].points
    x = points[:, 0] - 0.5
    np.testing.assert_allclose(state.pressure, 0.2 * P * (1 - 12 * 0.4 * x), atol=1e-3 * P)
    assert state.closed.all() and any("pulls" in w for w in linear.discretisation.warnings)


def make_linear(scene, problem):
    preload = scene.effects.preload.model_copy(update={"lift_off": False})
    effects = scene.effects.model_copy(update={"preload": preload})
    from fe_squeal.assembly.assembly import Assembly

    return Assembly(scene.model_copy(update={"effects": effects}), problem.source.loaded).problem({})


@pytest.mark.parametrize(
    ("pressure", "held", "word"),
    [({"top": -1.0}, True, "open every contact"), ({"right": 1.0}, False, "nothing holds")],
)
def test_loads_that_make_no_sense(pressure, held, word):
    """A pull opens every contact; a push along the belt meets nothing but friction, which does not hold."""
    with pytest.raises(SceneError, match=word) as caught:
        make_problem(
            box("hex1", (2, 2, 2)), order=1, materials=RIGID,
            contacts=[{"surface": "bottom", "counterface": "rigid", "normal_stiffness": 10.0, "sliding": BELT}],
            springs=[{"name": "s", "surface": "left", "direction": [1.0, 1.0, 0], "stiffness": 1.0}] * held,
            supports=[{"surface": "left", "fixed": "y"}] * held,
            effects={"friction": {"mu": 0.1}, "preload": {"pressures": pressure}},
        )  # fmt: skip
    assert "resultant" in str(caught.value)


def tensioned_bar(stress, stiffening=True, modulus=1e9):
    """A free bar along x under tension at both ends, on springs so soft that they only fix its place."""
    soft = [
        {"name": c, "surface": "bottom", "direction": [float(c == d) for d in "xyz"], "stiffness": 1e-6} for c in "xyz"
    ]
    effects = {"preload": {"pressures": {"left": -stress, "right": -stress}}}
    return make_problem(
        box("hex2", (4, 1, 1), (1.0, 0.1, 0.1), (-0.5, -0.05, -0.05)),
        materials={"m": {"youngs_modulus": modulus, "poisson_ratio": 0.0, "density": 1000.0}},
        springs=soft, effects={**effects, **({"stress_stiffening": {}} if stiffening else {})},
    )  # fmt: skip


def test_tension_stiffens_the_rotation_of_a_free_bar():
    """Dead forces ±F at the ends of a rigid bar resist its rotation with F L: ω² = F L/I, I = m(L² + b²)/12."""
    stress = 1e4
    omega = modes_of(tensioned_bar(stress), 8).lam.imag
    mass = 1000.0 * 0.01
    exact = np.sqrt(stress * 0.01 / (mass * (1.0 + 0.01) / 12))
    np.testing.assert_allclose(omega[4:6], exact, rtol=2e-3)  # two rotations across; the bar bends a little, σ/E = 1e-5
    assert omega[3] < 0.05 * exact  # the rotation about the bar's own axis is free


def test_pressure_buckles_a_bar_at_eulers_load():
    """A clamped bar's lowest frequency passes zero at σ A = π²EI/(4L²), less a little shear."""
    length, height, modulus = 1.0, 0.05, 1e9
    euler = np.pi**2 * modulus * height**2 / 12 / (4 * length**2)

    def lowest(factor):
        problem = make_problem(
            box("hex2", (8, 1, 1), (length, height, 1.3 * height)),
            materials={"m": {"youngs_modulus": modulus, "poisson_ratio": 0.0, "density": 1000.0}},
            supports=[{"surface": "left", "fixed": "xyz"}],
            effects={"preload": {"pressures": {"right": factor * euler}}, "stress_stiffening": {}},
        )  # fmt: skip
        lam = solve_modes(problem.pencil(), Request(count=2)).lam
        return lam[np.argmax(lam.real)]

    assert lowest(0.98).real == 0 and lowest(0.98).imag > 0
    assert lowest(1.02).real > 0 and lowest(1.02).imag == 0


def test_wobble_of_a_free_spinning_disc():
    """A free disc that spins at Ω wobbles at Ω Ip/Id in the frame at rest, whatever its elasticity: nutation.

    This needs the gyroscopic matrix, the convected inertia and the centrifugal stress together; any one of them alone
    gives another number.
    """
    r1, r2, h, speed = 0.05, 0.1, 0.02, 50.0
    problem = make_problem(
        annulus("hex2", (2, 16, 1), r1, r2, h, bottom=-h / 2),
        materials={"m": {"youngs_modulus": 2e11, "poisson_ratio": 0.3, "density": 7800.0}},
        springs=[
            {"name": c, "surface": "hub", "direction": [float(c == d) for d in "xyz"], "stiffness": 1e-3} for c in "xyz"
        ],
        effects={
            "rotation": {"bodies": ["disc"], "axis": [0, 0, 1], "speed": speed}, "preload": {}, "stress_stiffening": {}
        },
    )  # fmt: skip
    lam = solve_modes(problem.pencil(), Request(count=7)).lam
    polar = (r1**2 + r2**2) / 2
    diametral = (r1**2 + r2**2) / 4 + h**2 / 12
    exact = speed * polar / diametral
    assert np.abs(lam - 1j * exact).min() < 2e-3 * exact
    # All rigid motions: nothing grows, but for rounding of modes that are at rest.
    slow = np.abs(lam) < 3 * speed
    assert slow.sum() >= 4 and lam.real[slow].max() < 1e-2 * speed


@pytest.mark.slow
def test_a_sweep_along_which_the_contact_opens():
    """A block that friction tips on its stop: at each value modes are those of the problem assembled there alone."""
    values = [0.0, 0.45, 0.6, 1.0]  # from e = μh = L/6, at 0.48, on it opens point after point
    result = sweep(tipping(0.3, load=(0.0, 1.0), height=0.35, cells=12), values, modes=6, method="reduced")
    closed = [point.pressed["belt"]["closed"] for point in result.points]
    assert closed[0] == closed[1] == 1.0 > closed[2] > closed[3]
    for point in result.points:
        exact = modes_of(tipping(point.value, load=(0.0, 1.0), height=0.35, cells=12), count=6)
        away = np.abs(point.modes.lam[:, None] - exact.lam[None, :])
        nearest = away.argmin(axis=1)
        assert (np.sort(nearest) == np.arange(6)).all()
        # A direct solve has rounding of its own, which counts for modes that are slow beside stiff bodies.
        assert (away.min(axis=1) <= 1e-8 * np.abs(point.modes.lam) + exact.re_uncertainty[nearest]).all()
        assert (away.min(axis=1) <= point.modes.re_uncertainty + exact.re_uncertainty[nearest]).all()


@pytest.mark.slow
def test_newton_asks_for_values_without_a_static_state():
    """A block that tips from some friction on: no trial of Newton's method beyond the sweep may end it."""
    found = []
    for method in ("direct", "reduced"):
        problem = tipping(0.3, load=(0.0, 1.0), height=0.35, cells=6)
        result = sweep(problem, np.linspace(0, 0.8, 5), modes=6, method=method)
        found.append([(o.direction, o.value) for o in result.onsets])
    assert len(found[0]) >= 2
    for (one, a), (other, b) in itertools.zip_longest(*found):
        assert one == other and a == pytest.approx(b, abs=1e-5)
