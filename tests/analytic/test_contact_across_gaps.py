"""Contacts whose surfaces the meshes leave apart: rigid motions, levers, areas."""

from __future__ import annotations

import numpy as np
import pytest

from meshes import BELT, annulus, box, frequencies, join, make_problem, rigid_motions

KINDS = "hex1", "tet1", "hex2"


def rings(kind, counts=(16, 20)):
    """A ring in a ring, of which facets with straight edges do not lie on each other."""
    inner = annulus(kind, (1, counts[0], 2), 0.05, 0.1, 0.04, name="inner")
    outer = annulus(kind, (1, counts[1], 2), 0.1, 0.15, 0.04, name="outer")
    contact = {"name": "c", "surface": "rim_inner", "counterface": "hub_outer", "normal_stiffness": 1e15,
               "kind": "tied", "gap_tolerance": 0.01}  # fmt: skip
    return make_problem(join(inner, outer), int(kind[-1]), contacts=[contact])


@pytest.mark.parametrize("kind", KINDS)
def test_rigid_motions_neither_open_nor_shear_a_tied_contact(kind):
    problem = rings(kind)
    operators = problem.discretisation.contacts["c"]
    R = rigid_motions(problem)
    apart = np.abs(operators.separation).max()
    assert kind == "hex2" or apart > 1e-4  # quadratic edges follow the circle but for 1e-5
    for rows in (operators.gap, operators.slip, operators.cross):
        # u_pad − u_counter of a rotation by one radian would be the distance of the two points.
        assert np.abs(rows @ R).max() < 1e-12
    assert operators.coverage == pytest.approx(1.0, abs=1e-6)


def test_a_free_structure_with_a_tied_contact_has_six_rigid_motions():
    hz = frequencies(rings("hex1"), 8)
    matching = frequencies(rings("hex1", counts=(20, 20)), 8)
    assert hz[:6].max() < 1e-3 * hz[6]
    assert hz[6] == pytest.approx(matching[6], rel=0.1)


def test_a_layer_that_is_left_out_couples_as_a_rigid_lever():
    """Two plates tied across a gap of a tenth of their thickness bend as one, with the levers of their own places."""
    gap, t = 0.001, 0.01
    lower, upper = (box("hex2", (8, 2, 2), (0.1, 0.02, t), (0, 0, z), n) for z, n in ((0.0, "a"), (t + gap, "b")))
    contact = {"name": "c", "surface": "bottom_b", "counterface": "top_a", "normal_stiffness": 1e15, "kind": "tied",
               "gap_tolerance": 2 * gap}  # fmt: skip
    tied = frequencies(make_problem(join(lower, upper), contacts=[contact]), 8)[6:]
    whole = frequencies(make_problem(box("hex2", (8, 2, 4), (0.1, 0.02, 2 * t))), 8)[6:]
    # Bending stiffness per mass about the common middle: 2 (t³/12 + t (t + gap)²/4) instead of (2 t)³/12.
    stiffer = np.sqrt((2 * (t**3 / 12 + t * (t + gap) ** 2 / 4)) / ((2 * t) ** 3 / 12))
    assert 1.0 < tied[0] / whole[0] < stiffer * 1.01


@pytest.mark.parametrize("facet", [0.01, 0.001, 0.0004])
def test_gaps_within_the_tolerance_are_closed_however_small_the_facets_are(facet):
    n = round(0.008 / facet)
    pad = box("hex1", (2, 2, 1), (0.004, 0.004, 0.002), (0.0015, 0.0015, 0.0009), name="pad")
    plate = box("hex1", (max(n, 1), max(n, 1), 1), (0.008, 0.008, 0.002), (0, 0, -0.002), name="plate")
    contact = {"name": "c", "surface": "bottom_pad", "counterface": "top_plate", "normal_stiffness": 1e12,
               "gap_tolerance": 0.001, "sliding": BELT}  # fmt: skip
    problem = make_problem(join(pad, plate), 1, contacts=[contact])
    assert problem.discretisation.contacts["c"].area == pytest.approx(0.004**2, rel=1e-9)
