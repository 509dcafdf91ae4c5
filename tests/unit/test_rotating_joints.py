"""What joins turning bodies by single directions: supports, held references and springs that a turn would change."""

from __future__ import annotations

import numpy as np
import pytest

from fe_squeal.errors import SceneError
from meshes import STEEL, annulus, join, make_problem, modes_of, term

ROTATION = {"bodies": ["disc"], "axis": [0, 0, 1], "speed": 800.0}
DAMPED = {"rotation": ROTATION, "rayleigh": {"beta": 1e-6}}
RINGS = join(annulus("hex1", (1, 16, 1), 0.06, 0.08, 0.01, name="a"), annulus("hex1", (1, 16, 1), 0.08, 0.10, 0.01,
                                                                              name="b"))  # fmt: skip
WHEEL = {"mesh": annulus("hex1", (1, 16, 1), 0.06, 0.10, 0.01), "order": 1}
SPRINGS = [{"name": n, "surface": "rim", "direction": d, "stiffness": 1e7}
           for n, d in (("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1]))]  # fmt: skip


@pytest.mark.parametrize(("fixed", "axis", "allowed"), [
    ("x", [0, 0, 1], '"z", "xy", "xyz"'), ("yz", [0, 0, 1], '"z", "xy", "xyz"'),
])
def test_supports_along_directions_that_a_turn_mixes_are_refused_with_damping(fixed, axis, allowed):
    """The skew matrix of damping, made of displacements that supports allow, would be that of another body."""
    support = {"supports": [{"surface": "hub", "fixed": fixed}], "springs": SPRINGS}
    with pytest.raises(SceneError, match=f"rotates with damping.*{allowed}"):
        make_problem(**WHEEL, **support, effects=DAMPED)
    make_problem(**WHEEL, **support, effects={"rotation": {**ROTATION, "axis": axis}})  # K_Ω and G are right


@pytest.mark.parametrize("fixed", ["z", "xy", "xyz"])
def test_supports_that_a_turn_leaves_alone_are_taken(fixed):
    """A rigid motion that they allow has no strain in axes that turn with the body either: B u = 0."""
    problem = make_problem(**WHEEL, supports=[{"surface": "hub", "fixed": fixed}], springs=SPRINGS, effects=DAMPED)
    B = term(problem, "rotating_damping.disc")
    space = problem.discretisation.space
    for i in range(3):
        if "xyz"[i] not in fixed:
            u = np.zeros((space.nodes, 3))
            u[:, i] = 1.0
            forces = B @ u.ravel()[space.free]
            assert np.abs(forces).max() <= 1e-9 * abs(B).max()


@pytest.mark.parametrize(("fixed", "is_taken"), [("xyz rx", False), ("x z ry", False), ("z rz", True), ("xyz", True)])
def test_held_references_likewise(fixed, is_taken):
    hub = {"rigid": [{"name": "hub", "surface": "hub", "reference": [0.0, 0.0, 0.005], "fixed": fixed}]}
    if is_taken:
        make_problem(**WHEEL, **hub, springs=SPRINGS, effects=DAMPED)
    else:
        with pytest.raises(SceneError, match=rf'rigid\[0\].fixed: given "{fixed}"'):
            make_problem(**WHEEL, **hub, springs=SPRINGS, effects=DAMPED)


def rings(springs, speed=300.0):
    """Two rings that turn alike, the outer one on springs between both."""
    between = [{"name": f"s{i}", "surface": "hub_b", "to": "rim_a", **s} for i, s in enumerate(springs)]
    return make_problem(
        RINGS, 1, materials={"s": {**STEEL, "youngs_modulus": 2e12}}, supports=[{"surface": "hub_a", "fixed": "xyz"}],
        springs=[*between, {"name": "z", "surface": "top_b", "direction": [0, 0, 1], "stiffness": 1e7}],
        effects={"rotation": {"bodies": ["a", "b"], "axis": [0, 0, 1], "speed": speed}, "preload": {},
                 "stress_stiffening": {}},
    )  # fmt: skip


def test_springs_between_bodies_that_turn_alike_have_to_be_alike_across_the_axis():
    x, y, inclined = ({"direction": d, "stiffness": 4e7} for d in ([1, 0, 0], [0, 1, 0], [1, 1, 0]))
    with pytest.raises(SceneError, match=r"springs s0, s1: .* turn alike"):
        rings([x, inclined])
    with pytest.raises(SceneError, match="springs s0: "):
        rings([x])
    problem = rings([x, y])
    # The outer ring translates across the axis in two ways of one frequency, as in axes that turn with both.
    hz = modes_of(problem, 8).frequency_hz
    assert np.abs(np.diff(np.sort(hz))).min() <= 1e-6 * hz.max()


def test_dampers_between_bodies_that_turn_alike_are_taken_along_the_axis_alone():
    stiff = [{"direction": d, "stiffness": 4e7} for d in ([1, 0, 0], [0, 1, 0])]
    with pytest.raises(SceneError, match=r'springs.s2.damping: given 30 .*kind = "tied"'):
        rings([*stiff, {"direction": [1, 0, 0], "damping": 30.0}])
    rings([*stiff, {"direction": [0, 0, 1], "damping": 30.0}])
