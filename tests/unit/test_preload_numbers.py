"""Numbers of a scene under preload: derivatives by them, at the end of what is allowed, and other points in contact."""

from __future__ import annotations

import numpy as np
import pytest

import fe_squeal
from fe_squeal.problem.problem import Problem
from meshes import BELT, box, make_problem

LINING = {"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.25, "density": 2500.0}}


def pad(mu=0.4, slope=None, tilt=0.0, counts=(3, 2, 2), **contact) -> Problem:
    """A pad pressed on a belt and guided by springs; `tilt` is how far its foot rises along the belt, m."""
    mesh = box("hex1", counts, (0.04, 0.03, 0.02))
    points = mesh.p.copy()
    points[2] += tilt * points[0] / 0.04
    mesh = type(mesh)(points, mesh.t, _subdomains=mesh.subdomains, _boundaries=mesh.boundaries)
    effects = {"friction": {"mu": mu}, "preload": {"pressures": {"top": 1e6}, "mu": mu}}
    if slope is not None:
        effects["falling_friction"] = {"slope": slope}
    return make_problem(
        mesh, 1, LINING,
        springs=[{"name": "abut", "surface": "right", "direction": [1, 0, 0], "stiffness": 1e7},
                 {"name": "side", "surface": "front", "direction": [0, 1, 0], "stiffness": 1e6}],
        contacts=[{"name": "c", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e12, "sliding": BELT,
                   **contact}], effects=effects,
    )  # fmt: skip


def test_both_ways_list_derivatives_by_the_same_numbers():
    """Not by those that move the static state: a model with its pressures as they were gave even wrong signs."""
    problem = pad(mu=0.8, slope=-0.05, counts=(2, 1, 1))
    listed = []
    for method in ("direct", "reduced"):
        found = fe_squeal.sweep(problem, [0.6, 0.8], "mu", modes=8, method=method).sensitivities_dataframe()
        listed.append(sorted(set(found["number"])))
    assert listed[0] == listed[1] and listed[0]
    assert not {"contacts.c.normal_stiffness", "contacts.c.friction_ratio"} & set(listed[0])


@pytest.mark.parametrize(("path", "at", "step"), [("contacts.c.friction_ratio", 0.0, 1e-6),
                                                  ("materials.m.poisson_ratio", 0.49999, -4.9999e-5)])  # fmt: skip
def test_a_derivative_at_the_end_of_what_is_allowed(path, at, step):
    """It is a difference to the inside: to the other side there is no such scene."""
    problem = pad()
    here, beside = (problem.at({path: at + s}).pencil().K for s in (0.0, step))
    found = problem.derivative(path, "K", {path: at})
    assert abs(found - (beside - here) / step).max() <= 1e-6 * abs(found).max()


def test_a_sweep_from_zero_friction_in_a_contact():
    """It had ended with a message about a negative ratio. Without friction in the contact nothing grows."""
    result = fe_squeal.sweep(pad(), [0.0, 0.5, 1.0], "contacts.c.friction_ratio", modes=6)
    assert result.values == (0.0, 0.5, 1.0)
    first = result.points[0].modes
    assert not (first.stability == "unstable").any() and (first.lam.real == 0).all()


def test_another_gap_tolerance_brings_other_points_into_contact():
    """The search for the closed ones begins anew; it does not begin with as many as were in contact before."""
    problem = pad(tilt=1e-4, gap_tolerance=5e-5)
    wide = problem.at({"contacts.c.gap_tolerance": 2e-4})
    fresh = pad(tilt=1e-4, gap_tolerance=2e-4)
    ours, theirs = (p.state["c"]["normal_force_n"] for p in (wide, fresh))
    assert ours == pytest.approx(theirs, rel=1e-9) and np.isfinite(ours)
