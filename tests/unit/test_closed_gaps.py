"""How far apart surfaces may lie and touch: by default, on curved faces of straight facets, and on meshes cut finer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fe_squeal
from fe_squeal import sweep
from fe_squeal.accuracy.candidates import finer_candidate, first_candidate
from fe_squeal.accuracy.discretisation import with_discretisation
from fe_squeal.accuracy.refined import FinerMesh
from fe_squeal.accuracy.settings import own_setting, scene_at
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.assembly.contacts import closed_by_default
from fe_squeal.errors import SceneError
from fe_squeal.fem.closing import default_gap_tolerance, sagitta
from fe_squeal.fem.spaces import make_space
from fe_squeal.mesh.writing import write_loaded
from meshes import BELT, STEEL, annulus, box, join, make_problem, mapped, raised, rotation

RADIUS = 0.03
CONTACT = {"name": "c", "surface": "rim_bush", "counterface": "hub_ring", "normal_stiffness": 1e11, "kind": "tied"}
HELD = [{"surface": "rim_ring", "fixed": "xyz"}]


def rings(kind, around, thickness=0.004):
    bush, ring = ((0.02, RADIUS), (RADIUS, 0.042))
    return join(*(annulus(kind, (1, n, 1), *radii, thickness, name=name)
                  for n, radii, name in zip(around, (bush, ring), ("bush", "ring"), strict=True)))  # fmt: skip


def tied(kind, around, order=1):
    return make_problem(rings(kind, around), order, contacts=[CONTACT], supports=HELD)


@pytest.mark.parametrize("kind", ["hex1", "tet1", "hex2", "tet2"])
@pytest.mark.parametrize("n", [12, 40])
def test_the_sagitta_of_a_polygon_is_that_of_its_circle(kind, n):
    """Also where facets have middle nodes, on straight edges."""
    mesh = raised(annulus(f"{kind[:3]}1", (1, n, 2), 0.02, RADIUS, 0.004), kind)
    assert sagitta(mesh, mesh.boundaries["rim"]) == pytest.approx(RADIUS * (1 - np.cos(np.pi / n)), rel=0.01)
    assert sagitta(mesh, mesh.boundaries["top"]) < 1e-12


def test_facets_that_follow_a_face_and_rims_of_flat_ones_leave_nothing():
    curved = annulus("hex2", (1, 12, 1), 0.02, RADIUS, 0.004)
    assert sagitta(curved, curved.boundaries["rim"]) < 0.02 * RADIUS * (1 - np.cos(np.pi / 12))
    flat = box("hex1", (8, 8, 1), (0.08, 0.08, 0.01))
    chamfered = mapped(flat, lambda x: np.stack([x[0], x[1], x[2] - 0.3 * np.maximum(x[0] - 0.07, 0.0)]))
    top = chamfered.boundaries["top"]
    assert sagitta(chamfered, top) < 1e-15
    pad = make_space(chamfered, 1, []).surface(top)
    assert default_gap_tolerance(chamfered, pad, top) == pytest.approx(0.02 * np.sqrt(pad.area / 64), rel=1e-12)


@pytest.mark.parametrize("kind", ["hex1", "tet1"])
@pytest.mark.parametrize("around", [(12, 16), (20, 26), (40, 52)])
def test_a_curved_face_of_straight_facets_touches_as_a_whole_on_every_mesh(kind, around):
    """Cut into smaller facets, the two polygons are as far apart as before."""
    problem = tied(kind, around)
    operators = problem.discretisation.contacts["c"]
    finer = FinerMesh.of(problem.source).assembly.problem({}).discretisation.contacts["c"]
    assert np.abs(operators.separation).max() > 1e-5
    assert [operators.coverage, finer.coverage] == pytest.approx([1.0, 1.0], abs=1e-9)


def test_a_flat_gap_stays_closed_on_a_finer_mesh():
    pad = box("hex1", (2, 2, 1), (0.04, 0.04, 0.01), (0, 0, 0.0003), name="pad")  # the default is 0.4 mm
    plate = box("hex1", (2, 2, 1), (0.04, 0.04, 0.01), (0, 0, -0.01), name="plate")
    contact = {"surface": "bottom_pad", "counterface": "top_plate", "normal_stiffness": 1e12, "sliding": BELT}
    held = [{"surface": "bottom_plate", "fixed": "xyz"}]
    problem = make_problem(join(pad, plate), 1, contacts=[contact], supports=held)
    finer = FinerMesh.of(problem.source).assembly.problem({}).discretisation.contacts["contact_1"]
    assert finer.area == pytest.approx(0.04**2, rel=1e-9)


@pytest.mark.parametrize("kind", ["hex1", "tet1", "hex2"])
@pytest.mark.parametrize("away", [0.0, 100.0])
def test_without_a_tolerance_surfaces_touch_that_lie_on_each_other_but_for_rounding(kind, away):
    """Also far from the origin, where the coordinates of both sides are rounded; 1e-6 of a facet is a gap."""
    Q = rotation()
    contact = {"surface": "bottom_pad", "counterface": "top_belt", "normal_stiffness": 1e12, "kind": "tied"}

    def made(gap, **more):
        pad = box(kind, (2, 3, 1), (0.05, 0.03, 0.02), (0, 0, 0.1 + gap), name="pad")
        belt = box(kind, (3, 2, 1), (0.05, 0.03, 0.01), (0, 0, 0.09), name="belt")
        mesh = mapped(join(pad, belt), lambda x: Q @ x + away)
        problem = make_problem(mesh, int(kind[-1]), contacts=[{**contact, "gap_tolerance": 0.0, **more}])
        return problem.discretisation.contacts["contact_1"]

    assert made(0.0).coverage == pytest.approx(1.0, rel=1e-9)
    assert made(1e-8, gap_tolerance=2e-8).coverage == pytest.approx(1.0, rel=1e-9)
    with pytest.raises(SceneError, match=r"the gap along the normal is 1e-08 m; expected at most gap_tolerance = 0 m"):
        made(1e-8)


def test_without_a_tolerance_curved_faces_of_equal_meshes_touch():
    contact = {**CONTACT, "gap_tolerance": 0.0}
    problem = make_problem(rings("hex2", (12, 12)), 2, contacts=[contact], supports=HELD)
    assert problem.discretisation.contacts["c"].coverage == pytest.approx(1.0, rel=1e-9)


@pytest.mark.slow
def test_the_change_by_refinement_is_not_that_of_a_lost_contact():
    """A bush whose mass hangs on a soft tie: its frequencies are those of the tie's area, which both meshes have."""
    soft = {**CONTACT, "normal_stiffness": 1e9}
    problem = make_problem(rings("hex1", (40, 52)), 1, contacts=[soft], supports=HELD)
    result = with_discretisation(sweep(problem, [0.0], "mu", modes=3))
    (point,) = result.points
    away = point.extrapolated.imag / point.modes.lam.imag - 1
    assert np.abs(away).max() < 0.01  # nearly rigid; with 30 % of the contact lost, it was a fifth


def written(folder: Path, kind="hex1", around=(20, 26)):
    loaded = fe_squeal.from_skfem(rings(kind, around))
    write_loaded(loaded, folder / "rings.msh")
    tables = {
        "mesh": {"file": str(folder / "rings.msh"), "order": 1}, "materials": {"steel": STEEL},
        "bodies": {name: {"material": "steel"} for name in ("bush", "ring")}, "contacts": [CONTACT], "supports": HELD,
    }  # fmt: skip
    return fe_squeal.parse_scene(tables)


@pytest.mark.slow
def test_meshes_of_a_search_and_of_a_study_keep_the_contacts_of_the_first_one(tmp_path):
    scene = written(tmp_path)
    candidate = first_candidate(scene)
    whole = Assembly(candidate.scene, candidate.loaded).problem({}).discretisation.contacts["c"].coverage
    finer = finer_candidate(candidate)
    problem = Assembly(finer.scene, finer.loaded).problem({})
    found = [problem.discretisation.contacts["c"].coverage]
    found.append(Assembly(*scene_at(scene, replace(own_setting(scene), refinement=1))).problem({}).discretisation
                 .contacts["c"].coverage)  # fmt: skip
    assert [whole, *found] == pytest.approx([1.0] * 3, abs=1e-9)
    (told,) = closed_by_default(problem, scene, finer.scene)
    assert told == f"contacts.c.gap_tolerance = {finer.scene.contacts[0].gap_tolerance:.3g}"
