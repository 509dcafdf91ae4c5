"""Rigid bodies under static forces: levers that are pressed, rotors that spin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_rotating_references import TILT, about_z, moments
from test_rotating_references import rotor as held_rotor

from meshes import STEEL, annulus, box, make_problem, modes_of

WIDTH, LENGTH, PRESSURE = 0.02, 0.1, 1e7  # m, m, Pa
AREA = WIDTH**2
FORCE = PRESSURE * AREA
MASS = STEEL["density"] * AREA * LENGTH
INERTIA = MASS * (LENGTH**2 / 3 + WIDTH**2 / 12)  # about an axis across the foot
HINGE = 1000.0  # N m/rad
STIFF = {"steel": {**STEEL, "youngs_modulus": 2e14}}


def whole(mesh):
    return replace(mesh, _boundaries={**mesh.boundaries, "all": mesh.boundary_facets()})


def column(fixed, stiffening=True, **tables):
    """A rigid column that tilts about its foot against a hinge, pressed on its top."""
    mesh = whole(box("hex2", (1, 1, 2), (WIDTH, WIDTH, LENGTH), (-WIDTH / 2, -WIDTH / 2, 0.0)))
    hinge = [{"axis": [1.0, 0.0, 0.0], "stiffness": HINGE}]
    tie = {"name": "column", "surface": "all", "reference": [0.0, 0.0, 0.0], "fixed": fixed, "springs": hinge}
    effects = {"preload": {"pressures": {"top": PRESSURE}}, **({"stress_stiffening": {}} if stiffening else {})}
    return make_problem(mesh, materials=STIFF, rigid=[tie], effects=effects, **tables)


def tilting(problem):
    """Return the stiffness, N m/rad, that the frequency of the tilting column tells."""
    lam = modes_of(problem, 2).lam.imag
    stiffness = INERTIA * lam**2
    return stiffness[np.argmin(np.abs(stiffness - HINGE))]


def test_a_column_is_softened_by_the_force_times_its_length():
    assert tilting(column("xyz ry rz", False)) == pytest.approx(HINGE, rel=1e-6)
    assert tilting(column("xyz ry rz")) == pytest.approx(HINGE - FORCE * LENGTH, rel=1e-5)


@pytest.mark.parametrize(("surface", "lever"), [("bottom", LENGTH), ("top", 0.0)])
def test_springs_on_the_nodes_carry_the_force(surface, lever):
    """The force runs from the top, where it acts, to where the springs take it up."""
    total = 1e7
    spring = {"name": "s", "surface": surface, "direction": [0.0, 0.0, 1.0], "stiffness": total}
    exact = HINGE + total * WIDTH**2 / 12 - FORCE * lever
    assert tilting(column("xy ry rz", springs=[spring])) == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("kind", ["frictionless", "tied"])
def test_a_contact_on_the_nodes_carries_the_force(kind):
    contact = {"surface": "bottom", "counterface": "rigid", "normal_stiffness": 2.5e10, "kind": kind}
    exact = HINGE + 2.5e10 * WIDTH**4 / 12 - FORCE * LENGTH
    assert tilting(column("xy ry rz", contacts=[contact])) == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("below", [0.0, 0.05, -0.03])
def test_a_column_on_the_mean_of_its_foot_is_softened_by_the_whole_lever(below):
    """The reference lies so far below the foot, as the hinge of a rod on it would; the column itself is elastic."""
    mesh = box("hex2", (1, 1, 2), (WIDTH, WIDTH, LENGTH), (-WIDTH / 2, -WIDTH / 2, 0.0))
    tie = {"name": "foot", "surface": "bottom", "reference": [0.0, 0.0, -below], "fixed": "xyz ry rz",
           "springs": [{"axis": [1.0, 0.0, 0.0], "stiffness": HINGE}]}  # fmt: skip
    effects = {"preload": {"pressures": {"top": PRESSURE}}, "stress_stiffening": {}}
    problem = make_problem(mesh, materials=STIFF, averaged=[tie], effects=effects)
    inertia = INERTIA + MASS * ((LENGTH / 2 + below) ** 2 - (LENGTH / 2) ** 2)
    stiffness = inertia * modes_of(problem, 1).lam.imag[0] ** 2
    assert stiffness == pytest.approx(HINGE - FORCE * (LENGTH + below), rel=1e-4)


@pytest.mark.parametrize("load", ["top", "right", "front"])
def test_the_mean_of_a_stiff_face_is_softened_as_a_rigid_one(load):
    """Pressed along the lever and across it, where the reference takes up a moment, too."""
    mesh = box("hex2", (1, 1, 2), (WIDTH, 2 * WIDTH, LENGTH), (-WIDTH / 2, -WIDTH / 2, 0.0))
    hinges = [{"axis": e, "stiffness": HINGE} for e in np.eye(3).tolist()]
    tie = {"name": "foot", "surface": "bottom", "reference": [0.01, 0.0, -0.05], "fixed": "xyz", "springs": hinges}
    effects = {"preload": {"pressures": {load: PRESSURE / 10}}, "stress_stiffening": {}}
    lam = {ties: modes_of(make_problem(mesh, materials=STIFF, effects=effects, **{ties: [tie]}), 3).lam.imag
           for ties in ("rigid", "averaged")}  # fmt: skip
    np.testing.assert_allclose(lam["averaged"], lam["rigid"], rtol=1e-5)


@pytest.mark.parametrize("part", ["hub", "all"])
@pytest.mark.parametrize("speed", [300.0, 1000.0])
def test_a_rigid_rotor_precesses_as_its_closed_form(part, speed):
    """I_d ω² ∓ I_p Ω ω − k = 0: the centrifugal forces leave no stiffness of their own."""
    _, polar, across = moments(held_rotor(1.0, 0.0))
    root = np.sqrt((polar * speed) ** 2 + 4 * across * TILT)
    exact = (root + np.array([-1, 1]) * polar * speed) / (2 * across)
    tie = {"name": "wheel", "surface": part, "reference": [0.0, 0.0, 0.01], "fixed": "xyz rz",
           "springs": [{"axis": list(e), "stiffness": TILT} for e in np.eye(3)[:2]]}  # fmt: skip
    effects = {"rotation": about_z("disc", speed=speed), "preload": {}, "stress_stiffening": {}}
    steel = {"steel": {**STEEL, "youngs_modulus": 2e12}}
    mesh = whole(annulus("hex2", (1, 12, 1), 0.06, 0.10, 0.02))
    modes = modes_of(make_problem(mesh, materials=steel, rigid=[tie], effects=effects), 2)
    np.testing.assert_allclose(modes.lam.imag, exact, rtol=1e-4)
    growth = np.abs(modes.lam.real)
    assert (growth <= np.minimum(modes.re_uncertainty, 1e-8 * modes.lam.imag)).all()
    assert modes.re_uncertainty.max() < 1e-3
