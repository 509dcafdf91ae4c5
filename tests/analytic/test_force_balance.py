"""The balance of forces of a preload against closed forms, and where a load goes that misses the contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hard_problems import brake

import fe_squeal
from fe_squeal.assembly.forces import balance_warnings, force_balance
from fe_squeal.run.forces import balance_table
from fe_squeal.run.preload import preload_warnings
from meshes import BELT, annulus, box, join, make_problem

STIFF = {"m": {"youngs_modulus": 2e11, "poisson_ratio": 0.0, "density": 7800.0}}
AREA, HEIGHT, P = 0.04 * 0.06, 0.02, 1e6
CONTACT = {"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e12, "sliding": BELT}


def block(springs=(), supports=(), mu=0.3, preload=None, **contact):
    """A stiff block pressed by P on its top; guided along x and y at its sides by what is given."""
    return make_problem(
        box("hex1", (2, 3, 2), (0.04, 0.06, HEIGHT)), order=1, materials=STIFF, bodies={"block": {"material": "m"}},
        contacts=[{**CONTACT, **contact}], springs=list(springs), supports=list(supports),
        effects={"friction": {"mu": mu}, "preload": {"pressures": {"top": P}, **(preload or {})}},
    )  # fmt: skip


GUIDES = [{"name": "along", "surface": "right", "direction": [1, 0, 0], "stiffness": 1e9},
          {"name": "across", "surface": "front", "direction": [0, 1, 0], "stiffness": 1e9}]


def test_all_of_the_load_goes_through_the_contact_and_its_friction_into_the_guide():
    """Applied −PA along z, contact +PA and μPA along the sliding, the guide −μPA: nothing is left."""
    problem = block(GUIDES)
    [part] = force_balance(problem)
    load, mu = P * AREA, 0.3
    np.testing.assert_allclose(part.applied, [0, 0, -load], atol=1e-9 * load)
    np.testing.assert_allclose(part.contacts["belt"], [mu * load, 0, load], atol=1e-7 * load)
    np.testing.assert_allclose(part.springs["along"], [-mu * load, 0, 0], atol=1e-7 * load)
    assert part.residual < 1e-8 and not part.supports.any()
    assert balance_warnings([part]) == []
    table = balance_table([part], problem)
    assert table is not None and table.title == "Balance of forces under preload at μ = 0.3, N"


@pytest.mark.parametrize("ratio", [0.02, 0.1, 1.0, 3.0])
def test_a_spring_on_the_pressed_surface_takes_its_share(ratio):
    """A spring k_s beside the contact k_n A: two springs in parallel but for the block's own give k_e = EA/h between
    the pressed face and the contact: the spring takes 1/(1 + k_c/k_s) with 1/k_c = 1/k_e + 1/(k_n A)."""
    k_contact = 1 / (1 / (1e12 * AREA) + HEIGHT / (2e11 * AREA))
    piston = {"name": "piston", "surface": "top", "direction": [0, 0, 1], "stiffness": ratio * k_contact}
    [part] = force_balance(block([*GUIDES, piston], mu=0.0))
    share = ratio / (1 + ratio)
    assert part.springs["piston"][2] == pytest.approx(share * P * AREA, rel=1e-6)
    assert part.contacts["belt"][2] == pytest.approx((1 - share) * P * AREA, rel=1e-6)
    found = balance_warnings([part])
    if share < 0.05:
        assert found == []
    else:
        [text] = found
        assert f"{100 * share:.3g} % into spring piston on the pressed surface top" in text and "body block" in text


@pytest.mark.parametrize("size", [1e-13, 1e-3])
def test_loads_that_cancel_on_a_part_are_no_load(size):
    """Equal pressures on opposite faces, which rounding or the mesh leaves a little of: shares of that say nothing."""
    parts = force_balance(block(GUIDES, preload={"pressures": {"left": P, "right": P * (1 + size), "top": 1.0}}))
    assert parts[0].loads > 1e3 * np.linalg.norm(parts[0].applied) and balance_warnings(parts) == []


@pytest.mark.parametrize("stiffness", [1e11, 1e12, 1e15])
def test_a_static_state_that_exceeds_its_equations_in_a_sweep_is_told(stiffness):
    """p0/(k_n l) + p0/E of a uniform pressure, l = √A; and a contact that may pull, of a block that friction tilts."""
    pressed = block(GUIDES, mu=0.0, normal_stiffness=stiffness)
    assert not pressed.warnings
    limit = 1e-3 / (1 / (stiffness * np.sqrt(AREA)) + 1 / 2e11)
    values, name = np.array([0.5, 2.0, 3.0]) * limit, "effects.preload.pressures.top"
    [text] = preload_warnings(fe_squeal.sweep(pressed, values, name, modes=2), pressed)
    assert text.startswith(f"at {name} = {values[-1]:g}, contact belt: p0/(k_n l) + p0/E = 0.003:")
    tilted = block([{**GUIDES[0], "surface": "top"}, GUIDES[1]], mu=0.1, preload={"lift_off": False})
    assert not tilted.warnings
    [text] = preload_warnings(fe_squeal.sweep(tilted, [0.1, 3.0], "mu", modes=2), tilted)
    assert text.startswith("at mu = 3, contact belt: ") and "of its area pulls" in text


@pytest.mark.parametrize(("pad", "belt", "softest"), [(1e9, 4e9, 1e9), (4e9, 1e9, 1e9), ([9e9, 6e9, 3e9], 4e9, 3e9)])
def test_follower_terms_go_by_the_softer_side(pad, belt, softest):
    """p0/(k_n l) + p0/E of two bodies, one of them orthotropic, with the modulus that it has and one that is swept."""
    plain = {"poisson_ratio": 0.0, "density": 2500.0}
    wood = {"poisson_ratio": [0.0] * 3, "shear_modulus": [1e9] * 3, "density": 2500.0}
    problem = brake(
        ((2, 2, 1), (2, 2, 1)), "hex1", k_n=1e13, mu=0.0, effects={"preload": {"pressures": {"top_pad": 1e5}}},
        materials={"steel": {"youngs_modulus": belt, **plain},
                   "lining": {"youngs_modulus": pad, **(wood if isinstance(pad, list) else plain)}},
    )  # fmt: skip
    contact = problem.discretisation.contacts["belt"]
    for E, here in (softest, problem), (5e8, problem.at({"materials.steel.youngs_modulus": 5e8})):
        p = here.discretisation.static_state.contacts["belt"].pressure
        mean = contact.weights @ p**2 / (contact.weights @ p)
        assert here.state["belt"]["follower_ratio"] == pytest.approx(
            mean / (1e13 * np.sqrt(contact.area)) + mean / E, rel=1e-9
        )


def test_supports_take_what_is_left_also_through_held_nodes():
    """The top's edge is held along z: pressure on held nodes counts as applied, and the reaction is independent of
    how the sum is made: it is the internal force K u − f of the held rows of the unconstrained stiffness."""
    held = [{"surface": "left", "fixed": "z"}]
    problem = block(GUIDES, held, mu=0.0)
    [part] = force_balance(problem)
    assert part.applied[2] == pytest.approx(-P * AREA, rel=1e-12)
    loose = block(GUIDES, (), mu=0.0)
    u = problem.discretisation.space.expand(problem.discretisation.static_state.u).ravel()
    fixed = problem.discretisation.space.fixed
    internal = sum(t.matrix * t.coefficient(loose.parameters) for t in loose.terms if t.slot == "K") @ u
    pressure = np.zeros((len(u) // 3, 3))
    surface = loose.discretisation.space.surface(loose.discretisation.space.mesh.boundaries["top"])
    pressure[:, 2] = -P * (surface.values.T @ surface.weights)
    reaction = (internal - pressure.ravel())[fixed].sum()
    assert part.supports[2] == pytest.approx(reaction, rel=1e-6) and reaction > 0.01 * P * AREA
    [text] = balance_warnings([part])
    assert "into supports" in text


def test_two_pads_and_a_disc_balance_each_for_itself():
    """Two blocks on a plate from both sides: contact forces are opposite on its sides; a tie carries the back plate."""
    plate = box("hex1", (4, 4, 1), (0.1, 0.1, 0.01), (0.0, 0.0, 0.0), "disc")
    pad = box("hex1", (2, 2, 1), (0.04, 0.04, 0.01), (0.03, 0.03, 0.01), "pad")
    back = box("hex1", (3, 3, 1), (0.04, 0.04, 0.005), (0.03, 0.03, 0.02), "back")
    problem = make_problem(
        join(plate, pad, back), order=1, materials=STIFF, supports=[{"surface": "bottom_disc", "fixed": "xyz"}],
        springs=[{"name": f"g{i}", "surface": "left_pad", "direction": d, "stiffness": 1e8}
                 for i, d in enumerate(([1, 0, 0], [0, 1, 0]))],
        contacts=[
            {"name": "face", "surface": "bottom_pad", "counterface": "top_disc", "normal_stiffness": 1e12,
             "sliding": BELT},
            {"name": "glue", "kind": "tied", "surface": "bottom_back", "counterface": "top_pad",
             "normal_stiffness": 1e14},
        ],
        effects={"friction": {"mu": 0.4}, "preload": {"pressures": {"top_back": P}}},
    )  # fmt: skip
    parts = {p.bodies: p for p in force_balance(problem)}
    load = P * 0.04**2
    for p in parts.values():
        assert p.residual < 1e-7
    np.testing.assert_allclose(parts["back",].contacts["glue"], [0, 0, load], atol=1e-6 * load)
    np.testing.assert_allclose(parts["pad",].contacts["glue"], [0, 0, -load], atol=1e-6 * load)
    np.testing.assert_allclose(parts["pad",].contacts["face"], [0.4 * load, 0, load], atol=1e-6 * load)
    np.testing.assert_allclose(parts["disc",].contacts["face"], [-0.4 * load, 0, -load], atol=1e-6 * load)
    np.testing.assert_allclose(parts["disc",].supports, [0.4 * load, 0, load], atol=1e-6 * load)
    assert balance_warnings(list(parts.values())) == []


def test_a_spring_between_two_parts_pulls_both():
    blocks = join(box("hex1", (1, 1, 1), (0.04, 0.06, HEIGHT), name="a"),
                  box("hex1", (1, 1, 1), (0.04, 0.06, HEIGHT), (0.0, 0.0, 0.05), "b"))  # fmt: skip
    problem = make_problem(
        blocks, order=1, materials=STIFF, supports=[{"surface": "bottom_a", "fixed": "xyz"}],
        springs=[{"name": "between", "surface": "bottom_b", "to": "top_a", "direction": [0, 0, 1], "stiffness": 1e8},
                 {"name": "guide", "surface": "left_b", "direction": [1, 0, 0], "stiffness": 1e8},
                 {"name": "guide_2", "surface": "front_b", "direction": [0, 1, 0], "stiffness": 1e8},
                 {"name": "soft", "surface": "top_b", "direction": [0, 0, 1], "stiffness": 1e3}],
        effects={"preload": {"pressures": {"top_b": P}}},
    )  # fmt: skip
    parts = {p.bodies: p for p in force_balance(problem)}
    a, b = parts["a",], parts["b",]
    load = P * AREA
    assert b.springs["between"][2] == pytest.approx(load, rel=1e-4)
    assert a.springs["between"][2] == pytest.approx(-b.springs["between"][2], rel=1e-12)
    assert a.supports[2] == pytest.approx(load, rel=1e-4) and b.residual < 1e-8


def pair(apart, **tables):
    """Two blocks whose tops share an averaged reference; pressures on their fronts differ, and springs guide each."""
    size = (0.04, 0.06, HEIGHT)
    mesh = join(*(box("hex1", (2, 2, 2), size, (x, 0.0, 0.0), name) for x, name in ((0.0, "a"), (apart, "b"))))
    tops = np.concatenate([mesh.boundaries["top_a"], mesh.boundaries["top_b"]])
    guides = [{"name": f"{name}{i}", "surface": f"left_{name}", "direction": d, "stiffness": 1e6}
              for name in "ab" for i, d in enumerate(np.eye(3).tolist())]  # fmt: skip
    problem = make_problem(
        replace(mesh, _boundaries={**mesh.boundaries, "tops": tops}), order=1, materials=STIFF, springs=guides,
        averaged=[{"name": "ref", "surface": "tops", **tables}],
        effects={"preload": {"pressures": {"front_a": P, "front_b": 3 * P}}},
    )  # fmt: skip
    return {p.bodies[0]: p for p in force_balance(problem)}, problem


def test_springs_at_a_reference_of_two_parts_act_on_both():
    """Virtual work: the force F goes to equal tops in halves. Of a moment M about z, the part at a distance ∓D/2 from
    the reference takes ∓M (D/2) A/J along y, J = 2A (D²/4 + (l_x² + l_y²)/12) that of both tops about z."""
    k, turning, D = 1e7, 1e4, 0.1
    springs = [{"direction": [0, 2, 0], "stiffness": k}, {"axis": [0, 0, 3], "stiffness": turning}]
    parts, problem = pair(D, springs=springs)
    space = problem.discretisation.space
    motion = space.reference(space.ties[0]) @ problem.discretisation.static_state.u
    share = D / 2 / (2 * (D**2 / 4 + (0.04**2 + 0.06**2) / 12))
    for name, side in (("a", -1), ("b", 1)):
        assert parts[name].residual < 1e-9 and not parts[name].held.any()
        np.testing.assert_allclose(parts[name].springs["ref.0"][1], -k * motion[1] / 2, rtol=1e-9)
        np.testing.assert_allclose(parts[name].springs["ref.1"][1], -turning * motion[5] * side * share, rtol=1e-9)
    assert abs(parts["b"].springs["ref.1"][1]) > 0.01 * P * 0.04 * HEIGHT


def test_a_held_rotation_of_two_parts_presses_them_in_opposite_ways():
    """About z, along which the parts lie side by side: along y alone, by forces whose sum is zero."""
    parts, _ = pair(0.1, fixed="rz")
    one, other = parts["a"], parts["b"]
    assert one.held.tolist() == other.held.tolist() == [False, True, False]
    assert one.supports[1] == pytest.approx(-other.supports[1], rel=1e-9) and abs(one.supports[1]) > 1.0
    assert max(one.residual, other.residual) < 1e-9


def test_the_centrifugal_force_of_a_ring_is_balanced():
    """Its resultant is zero by symmetry, whatever holds the hub."""
    ring = annulus("hex1", (1, 12, 1), 0.1, 0.15, 0.02)
    problem = make_problem(
        ring, order=1, supports=[{"surface": "bottom", "fixed": "xyz"}],
        effects={"preload": {}, "rotation": {"bodies": ["disc"], "axis": [0, 0, 1], "speed": 100.0}},
    )  # fmt: skip
    [part] = force_balance(problem)
    assert np.abs(part.applied).max() < 1e-9 * 7800 * 100.0**2 * 0.15 * np.pi * (0.15**2 - 0.1**2) * 0.02
