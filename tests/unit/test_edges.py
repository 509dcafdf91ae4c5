"""Which elements lie at edges where stresses are singular."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import skfem

import fe_squeal
from fe_squeal.accuracy.edges import has_end_in_a_notch, singular_elements, surface_edges
from fe_squeal.mesh import from_skfem
from fe_squeal.mesh.groups import NodeSet
from meshes import BELT, STEEL, annulus, box, join, make_problem, mapped

SOFT = {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}


def marked(mesh, **tables):
    """Return the centres (3, m) of all elements and which of them are singular, (m,) bool."""
    problem = make_problem(mesh, order=1, **tables)
    loaded = problem.source.loaded.mesh
    return loaded.p[:, loaded.t].mean(axis=1), singular_elements(problem.source)


@pytest.mark.parametrize("kind", ["hex1", "tet1", "hex2", "tet2"])
def test_a_free_block_has_none(kind):
    _, found = marked(box(kind, (3, 2, 2)))
    assert not found.any()


@pytest.mark.parametrize("kind", ["hex1", "tet1"])
def test_elements_around_a_clamped_face_are_and_those_in_its_middle_are_not(kind):
    (x, y, z), found = marked(box(kind, (3, 3, 3), (3.0, 3.0, 3.0)), supports=[{"surface": "left", "fixed": "xyz"}])
    assert found.any() and not found[x > 1].any()
    middle = (x < 1) & (abs(y - 1.5) < 0.5) & (abs(z - 1.5) < 0.5)
    if kind == "hex1":
        np.testing.assert_array_equal(found, (x < 1) & ~middle)
    else:
        assert found[(x < 1) & ((y < 1) | (y > 2)) & ((z < 1) | (z > 2))].any()


@pytest.mark.parametrize(("fixed", "singular"), [("x", False), ("yz", False), ("xy", True), ("xyz", True)])
def test_a_face_held_along_its_normal_or_along_itself_is_a_plane_of_symmetry(fixed, singular):
    """At a right angle to a free face: the mirrored body has a flat face there."""
    _, found = marked(box("hex1", (3, 2, 2)), supports=[{"surface": "left", "fixed": fixed}])
    assert found.any() == singular


@pytest.mark.parametrize("kind", ["hex1", "hex2", "tet1", "tet2"])
@pytest.mark.parametrize("tables", [
    {"supports": [{"KIND": "left", "fixed": "x"}]}, {"supports": [{"KIND": "left", "fixed": "xyz"}]},
    {"rigid": [{"name": "r", "KIND": "left"}]},
])  # fmt: skip
def test_all_nodes_of_a_face_are_held_as_the_face(kind, tables):
    """Corners alone of quadratic elements are points, and all elements at them are singular."""
    mesh = box(kind, (3, 3, 3), (3.0, 3.0, 3.0))
    x = mesh.doflocs[0]
    found = []
    for place, last in (("surface", 0), ("nodes", len(x)), ("nodes", mesh.nvertices)):
        nodes = np.flatnonzero(x[:last] == 0)
        loaded = replace(from_skfem(mesh, "box"), node_groups={"left": NodeSet(nodes, nodes)})
        own = {key: [{place if k == "KIND" else k: v for k, v in t.items()} for t in ts] for key, ts in tables.items()}
        body = {"materials": {"steel": STEEL}, "bodies": {"block": {"material": "steel"}}}
        scene = fe_squeal.parse_scene({"mesh": {"file": "none.msh", "order": 2}, **body, **own})
        found.append(singular_elements(fe_squeal.assemble(scene, loaded).source))
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[2], found[0] if kind[-1] == "1" else (x[mesh.t] == 0).any(axis=0))


def test_a_plane_of_symmetry_that_ends_on_a_flat_face_is_singular_there():
    """Half of the bottom slides on a smooth plane: the mirrored body has a crack."""
    mesh = box("hex1", (4, 2, 2), (4.0, 2.0, 2.0))
    half = mesh.boundaries["bottom"][mesh.p[0, mesh.facets[:, mesh.boundaries["bottom"]]].mean(axis=0) < 2]
    (x, _, z), found = marked(mesh.with_boundaries({"half": half}), supports=[{"surface": "half", "fixed": "z"}])
    np.testing.assert_array_equal(found, (abs(x - 2) < 1) & (z < 1))


@pytest.mark.parametrize("tables", [
    {"supports": [{"nodes": "corner", "fixed": "x"}]},
    {"springs": [{"name": "s", "nodes": "corner", "direction": [1, 0, 0], "stiffness": 1e6}]},
])  # fmt: skip
def test_forces_on_nodes_are_singular(tables):
    mesh = box("hex1", (3, 2, 2), (3.0, 2.0, 2.0))
    corner = np.flatnonzero((mesh.p == 0).all(axis=0))
    loaded = replace(from_skfem(mesh, "box"), node_groups={"corner": NodeSet(corner, corner)})
    body = {"materials": {"steel": STEEL}, "bodies": {"block": {"material": "steel"}}}
    scene = fe_squeal.parse_scene({"mesh": {"file": "none.msh", "order": 2}, **body, **tables})
    x, y, z = mesh.p[:, mesh.t].mean(axis=1)
    found = singular_elements(fe_squeal.assemble(scene, loaded).source)
    np.testing.assert_array_equal(found, (x < 1) & (y < 1) & (z < 1))


@pytest.mark.parametrize("kind", ["hex1", "tet1"])
def test_a_surface_that_turns_inwards(kind):
    """An L of three cells, each cut into eight: the four that share the inner edge over its height, or touch it."""
    whole = box(kind, (4, 4, 2), (2.0, 2.0, 1.0))
    centre = whole.p[:, whole.t].mean(axis=1)
    angular = type(whole)(*_kept(whole, ~((centre[0] > 1) & (centre[1] > 1))))
    edges = surface_edges(from_skfem(angular, "L"))
    inner = edges.angle > 200
    assert edges.angle[inner] == pytest.approx(270.0)
    ends = angular.p[:2, edges.nodes[inner]]
    assert np.allclose(ends, 1.0) and inner.sum() == 2
    x, y, _ = angular.p[:, angular.t].mean(axis=1)
    (_, found) = marked(angular.with_subdomains({"block": np.arange(angular.nelements)}))
    touches = (np.abs(angular.p[:2, angular.t] - 1.0).max(axis=0) < 1e-9).any(axis=0)
    np.testing.assert_array_equal(found, touches)
    assert found.any() and not found[(x < 0.4) & (y < 0.4)].any()


@pytest.mark.parametrize("kind", ["hex1", "tet1"])
@pytest.mark.parametrize("turned", [0.0, 0.3, 0.7])
def test_the_front_of_a_crack_of_zero_width(kind, turned):
    """Its faces lie on each other, and rounding alone tells 360 degrees from none."""
    whole = box(kind, (4, 3, 4), (4.0, 3.0, 4.0))
    x, z = whole.p[0], whole.p[2]
    cut = np.flatnonzero((x > 2 + 1e-9) & (np.abs(z - 2) < 1e-9))
    other = np.arange(len(x))
    other[cut] = len(x) + np.arange(len(cut))
    above = z[whole.t].mean(axis=0) > 2
    rotation = np.array([[np.cos(turned), 0, -np.sin(turned)], [0, 1, 0], [np.sin(turned), 0, np.cos(turned)]])
    points = np.hstack([whole.p, whole.p[:, cut]])
    cracked = type(whole)(rotation @ points, np.where(above, other[whole.t], whole.t))
    _, found = marked(cracked.with_subdomains({"block": np.arange(cracked.nelements)}))
    front = (np.abs(points[::2] - 2.0).max(axis=0) < 1e-9)[cracked.t].any(axis=0)
    np.testing.assert_array_equal(found, front)
    assert front.any() and not front.all()


@pytest.mark.parametrize("tables", [
    {"supports": [{"surface": "held", "fixed": "xyz"}]}, {"supports": [{"nodes": "held", "fixed": "xyz"}]},
    {"rigid": [{"name": "r", "surface": "held"}]}, {"rigid": [{"name": "r", "nodes": "held"}]},
    {"contacts": [{"surface": "held", "counterface": "rigid", "kind": "tied", "normal_stiffness": 1e14}]},
])  # fmt: skip
@pytest.mark.parametrize(("x", "notched"), [(1.0, True), (0.0, False)])
def test_a_clamp_that_ends_in_a_notch(x, notched, tables):
    whole = box("hex1", (4, 4, 2), (2.0, 2.0, 1.0))
    centre = whole.p[:, whole.t].mean(axis=1)
    angular = type(whole)(*_kept(whole, ~((centre[0] > 1) & (centre[1] > 1))))
    named = angular.with_subdomains({"block": np.arange(angular.nelements)})
    held = named.with_boundaries({"held": lambda p: np.abs(p[0] - x) < 1e-9})
    nodes = np.unique(held.facets[:, held.boundaries["held"]])
    loaded = replace(from_skfem(held, "L"), node_groups={"held": NodeSet(nodes, nodes)})
    body = {"materials": {"steel": STEEL}, "bodies": {"block": {"material": "steel"}}}
    scene = fe_squeal.parse_scene({"mesh": {"file": "none.msh", "order": 2}, **body, **tables})
    assert has_end_in_a_notch(fe_squeal.assemble(scene, loaded).source) == notched


def _kept(mesh, keep):
    used, t = np.unique(mesh.t[:, keep], return_inverse=True)
    return mesh.p[:, used], t.reshape(mesh.t.shape[0], -1)


def test_a_hole_with_curved_elements_does_not_turn_inwards():
    """Twelve elements around: straight ones turn by 30 degrees from one to the next, curved ones by next to nothing."""
    curved = surface_edges(from_skfem(annulus("hex2", (1, 12, 1), 0.07, 0.13, 0.012), "ring"))
    assert np.nanmax(curved.angle) < 185 and np.isclose(curved.angle, 90.0, atol=2).any()
    _, found = marked(annulus("hex2", (1, 12, 1), 0.07, 0.13, 0.012))
    assert not found.any()
    ring = annulus("hex1", (1, 12, 1), 0.07, 0.13, 0.012)
    assert np.nanmax(surface_edges(from_skfem(ring, "ring")).angle) == pytest.approx(210.0)


def test_joined_materials_are_singular_where_they_come_to_the_surface():
    mesh = box("hex1", (4, 3, 3), (4.0, 3.0, 3.0))
    x, y, z = mesh.p[:, mesh.t].mean(axis=1)
    mesh = mesh.with_subdomains({"one": np.flatnonzero(x < 2), "two": np.flatnonzero(x > 2)})
    around = np.maximum(abs(y - 1.5), abs(z - 1.5)) > 0.5
    for other, expected in (("soft", (abs(x - 2) < 1) & around), ("steel", np.zeros(len(x), bool))):
        bodies = {"one": {"material": "steel", "groups": ["one"]}, "two": {"material": other, "groups": ["two"]}}
        materials = {"steel": STEEL, "soft": SOFT}
        _, found = marked(mesh, materials=materials, bodies=bodies)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(("pad", "plate", "kind", "hardness", "expected"), [
    ("steel", "steel", "frictionless", 50, ["pad", "plate"]), ("steel", "steel", "tied", 50, ["pad", "plate"]),
    ("steel", "steel", "frictionless", 1, []), ("steel", "steel", "tied", 1, []),
    ("soft", "steel", "frictionless", 50, []), ("soft", "steel", "tied", 50, ["pad"]),
    ("steel", "soft", "frictionless", 50, ["plate"]), ("steel", "soft", "tied", 50, ["plate"]),
])  # fmt: skip
def test_edges_of_a_contact_between_bodies(pad, plate, kind, hardness, expected):
    """The stiffness is a multiple of E/h of the softer body. Beside a stiff one a soft one is held or pressed on."""
    below = box("hex1", (8, 8, 1), (0.08, 0.08, 0.01), name="plate")
    mesh = join(below, box("hex1", (4, 4, 1), (0.04, 0.04, 0.01), (0.02, 0.02, 0.01), name="pad"))
    softer = SOFT if "soft" in (pad, plate) else STEEL
    contact = {"surface": "bottom_pad", "counterface": "top_plate", "kind": kind}
    contact["normal_stiffness"] = hardness * softer["youngs_modulus"] / 0.01
    (x, y, z), found = marked(
        mesh, materials={"steel": STEEL, "soft": SOFT}, bodies={"pad": {"material": pad}, "plate": {"material": plate}},
        supports=[{"surface": "bottom_plate", "fixed": "z"}], contacts=[contact],
    )  # fmt: skip
    around = abs(np.maximum(abs(x - 0.04), abs(y - 0.04)) - 0.02) < 0.01
    body = np.where(z > 0.01, "pad", "plate")
    np.testing.assert_array_equal(found, around & np.isin(body, expected))


@pytest.mark.parametrize(("chamfer", "hardness", "singular"), [(0.0, 50, False), (1.0, 50, True), (1.0, 1, False)])
def test_edges_of_a_contact_with_a_rigid_plane_are_those_of_a_support(chamfer, hardness, singular):
    """A right angle that slides on a plane is half of a flat surface; one of 135 degrees and its image turn inwards."""
    whole = box("hex1", (4, 2, 2), (4.0, 2.0, 2.0))
    block = mapped(whole, lambda x: x - np.outer([chamfer, 0, 0], x[2] * (1 - x[0] / 4)))
    contact = {"surface": "bottom", "counterface": "rigid", "sliding": BELT}
    contact["normal_stiffness"] = hardness * STEEL["youngs_modulus"]
    _, found = marked(block, contacts=[contact])
    assert found.any() == singular
    if hardness > 1:
        np.testing.assert_array_equal(found, marked(block, supports=[{"surface": "bottom", "fixed": "z"}])[1])


def test_bodies_that_touch_along_an_edge_alone():
    """More than two facets meet there, and no angle is told: singular."""
    p = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 1, 0], [1, 2, 0], [2, 2, 0]], float).T
    p = np.hstack([p, p + np.array([[0.0], [0.0], [1.0]])])
    quads = np.array([[0, 1, 2, 3], [2, 4, 6, 5]])
    order = np.asarray(skfem.refdom.RefHex.p)
    t = np.empty((8, 2), int)
    corner = {(0, 0): 0, (1, 0): 1, (1, 1): 2, (0, 1): 3}
    for k, quad in enumerate(quads):
        for i, (a, b, c) in enumerate(order.T.astype(int).tolist()):
            t[i, k] = quad[corner[a, b]] + 7 * c
    edges = surface_edges(from_skfem(skfem.MeshHex1(p, t), "two cubes"))
    assert edges.nodes[np.isnan(edges.angle)].tolist() == [[2, 9]]
