"""A bush that turns in a ring: contact faces of straight edges, which the motion does not see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from selection import some

from meshes import annulus, frequencies, join, make_problem, mapped

BORE, FACE, RIM, THICK = 0.02, 0.03, 0.042, 0.004  # m
STIFFNESS = 1e6  # N/m of the springs at each free face, along x and along y
MATERIALS = {"soft": {"youngs_modulus": 5e9, "poisson_ratio": 0.3, "density": 2600.0},
             "hard": {"youngs_modulus": 2e10, "poisson_ratio": 0.3, "density": 2600.0}}  # fmt: skip


def rings(kind="hex1", around=(20, 26)):
    bush = annulus(kind, (2, around[0], 1), BORE, FACE, THICK, name="bush")
    return join(bush, annulus(kind, (2, around[1], 1), FACE, RIM, THICK, name="ring"))


def drum(mesh, normal_stiffness=1e11, pad="bush", kind="sliding", **more):
    faces = {"bush": ("rim_bush", "hub_ring"), "ring": ("hub_ring", "rim_bush")}[pad]
    held = [{"surface": f"{side}_{name}", "fixed": "z"} for name in ("bush", "ring") for side in ("bottom", "top")]
    springs = [{"name": f"{s}_{i}", "surface": s, "direction": np.eye(3)[i].tolist(), "stiffness": STIFFNESS}
               for s in ("hub_bush", "rim_ring") for i in (0, 1)]  # fmt: skip
    contact = {"name": "c", "surface": faces[0], "counterface": faces[1], "normal_stiffness": normal_stiffness,
               "kind": kind, "gap_tolerance": 1e-3, "sliding": {"axis": [0.0, 0.0, 1.0], "speed": 10.0}}  # fmt: skip
    bodies = {"bush": {"material": "soft"}, "ring": {"material": "hard"}}
    effects = ({"friction": {"mu": 0.3}} if kind == "sliding" else {}) | more.pop("effects", {})
    return make_problem(mesh, materials=MATERIALS, bodies=bodies, supports=held, springs=springs, contacts=[contact],
                        effects=effects, **more)  # fmt: skip


def torsion(inner, outer, at):
    """Return √(k r²/J)/2π of a rigid ring on springs at a radius, J = π ρ h (r₂⁴ − r₁⁴)/2."""
    J = 2600.0 * np.pi * THICK * (outer**4 - inner**4) / 2
    return np.sqrt(STIFFNESS * at**2 / J) / (2 * np.pi)


@pytest.mark.parametrize(("kind", "pad", "contact"), some([
    ("hex1", "bush", "sliding"), ("hex1", "ring", "frictionless"), ("tet1", "bush", "frictionless"),
    ("tet1", "ring", "sliding"),
], lambda kind, pad, contact: (kind, pad) != ("tet1", "bush")))  # fmt: skip
def test_rings_turn_freely_in_each_other(kind, pad, contact):
    """Without friction nothing but springs holds their rotation, however stiff the contact and straight its edges."""
    mesh = rings(kind)
    without = {"mu": 0.0} if contact == "sliding" else {}
    soft, stiff = (frequencies(drum(mesh, k, pad, contact), 8, **without) for k in (1e10, 1e14))
    for exact in (torsion(BORE, FACE, BORE), torsion(FACE, RIM, RIM)):
        found = [f[np.argmin(np.abs(f - exact))] for f in (soft, stiff)]
        assert found[0] == pytest.approx(exact, rel=0.01)  # a polygon for a circle; the rings bend a little
        assert found[1] == pytest.approx(found[0], rel=1e-6)


@pytest.mark.parametrize("kind", ["hex1", "tet1"])
@pytest.mark.parametrize("pad", ["bush", "ring"])
def test_a_sector_that_ends_within_a_facet_turns_freely(kind, pad):
    """The facets that are half covered, all in one column, are part of a drum and not a flat face."""
    mesh = rings(kind)
    counter = {"bush": "hub_ring", "ring": "rim_bush"}[pad]
    x, y, _ = mesh.p[:, mesh.facets[:, mesh.boundaries[counter]]].mean(axis=1)
    cut = mesh.boundaries[counter][(np.arctan2(y, x) > 0) & (np.arctan2(y, x) < 0.7)]
    problem = drum(replace(mesh, _boundaries={**mesh.boundaries, counter: cut}), pad=pad)
    space, operators = problem.discretisation.space, problem.discretisation.contacts["c"]
    assert 0.05 < operators.coverage < 0.15
    for body in ("bush", "ring"):
        turn = np.zeros_like(space.coordinates)
        nodes = np.unique(space.dofs.element_dofs[:, problem.discretisation.bodies[body]])
        turn[nodes] = np.cross([0.0, 0.0, 1.0], space.coordinates[nodes])
        assert np.abs(operators.gap @ space.gather(turn)).max() < 1e-12 * FACE


@pytest.mark.parametrize("kind", some(["hex1", "tet1"], lambda kind: kind == "hex1"))
def test_a_cone_turns_freely_too(kind):
    """A surface of revolution whose normals have a part along the axis."""
    mesh = mapped(rings(kind), lambda x: np.stack([x[0] * (1 + 15 * x[2]), x[1] * (1 + 15 * x[2]), x[2]]))
    soft, stiff = (frequencies(drum(mesh, k), 8, mu=0.0) for k in (1e10, 1e14))
    for i in (0, 3):  # the torsions of the ring and the bush; the others bend and feel the contact
        assert stiff[i] == pytest.approx(soft[i], rel=1e-6)


@pytest.mark.parametrize("kind", ["hex1", "hex2", "tet1"])
def test_a_bush_turns_freely_on_a_rigid_shaft(kind):
    found = []
    for stiffness in (1e10, 1e14):
        contact = {"name": "c", "surface": "hub_bush", "counterface": "rigid", "normal_stiffness": stiffness,
                   "sliding": {"axis": [0.0, 0.0, 1.0], "speed": 10.0}}  # fmt: skip
        springs = [{"name": f"s{i}", "surface": "rim_bush", "direction": np.eye(3)[i].tolist(),
                    "stiffness": STIFFNESS} for i in (0, 1)]  # fmt: skip
        problem = make_problem(
            annulus(kind, (2, 20, 1), BORE, FACE, THICK, name="bush"), materials={"soft": MATERIALS["soft"]},
            supports=[{"surface": f"{side}_bush", "fixed": "z"} for side in ("bottom", "top")], springs=springs,
            contacts=[contact], effects={"friction": {"mu": 0.3}},
        )  # fmt: skip
        found.append(frequencies(problem, 1, mu=0.0)[0])
    assert found[0] == pytest.approx(torsion(BORE, FACE, FACE), rel=0.01)
    assert found[1] == pytest.approx(found[0], rel=1e-6)


@pytest.mark.parametrize("kind", ["hex1", "hex2"])
def test_pressure_on_a_drum_is_even(kind):
    """By symmetry; the torque is μ r times the normal force, whichever side is the pad."""
    for pad in ("bush", "ring"):
        problem = drum(rings(kind), 5e12, pad, effects={"preload": {"pressures": {"hub_bush": 1e7}}})
        state = problem.discretisation.static_state.contacts["c"]
        assert state.closed.all()
        assert np.ptp(state.pressure) < 0.35 * state.pressure.mean()
        assert abs(state.torque) == pytest.approx(0.3 * FACE * state.normal_force, rel=0.01)


def test_a_flat_face_keeps_its_normal():
    """Where the direction of sliding is slightly off, it is the direction that is put right."""
    mesh = annulus("hex1", (1, 8, 1), 0.05, 0.1, 0.01)
    sliding = {"axis": [0.0, 0.02, 1.0], "speed": 5.0}
    contact = {"name": "c", "surface": "top", "counterface": "rigid", "normal_stiffness": 1e9, "sliding": sliding}
    problem = make_problem(mesh, contacts=[contact], effects={"friction": {"mu": 0.1}})
    operators = problem.discretisation.contacts["c"]
    np.testing.assert_allclose(operators.normals, [[0.0, 0.0, -1.0]] * len(operators.normals), atol=1e-12)
    assert 0.001 < operators.lifting < 0.03
