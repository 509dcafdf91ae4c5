"""Scenes that are told or refused because they cannot be meant so: faces that nothing joins, impossible motions."""

from __future__ import annotations

import re

import numpy as np
import pytest
import skfem

import fe_squeal
from fe_squeal.errors import MeshError, SceneError
from fe_squeal.mesh.building import build_mesh
from fe_squeal.mesh.raw import CellBlock, RawMesh
from meshes import BELT, STEEL, annulus, box, join, make_problem, mapped

PAD = {"surface": "bottom_a", "counterface": "top_b", "normal_stiffness": 1e12, "sliding": BELT}


def blocks(lift=0.0):
    return join(*(box("hex1", (2, 2, 1), name=name, corner=(0, 0, z)) for name, z in (("a", lift), ("b", -1.0))))


def told(mesh, **tables):
    return list(make_problem(mesh, 1, **tables).discretisation.warnings)


def test_faces_that_lie_on_each_other_and_are_not_joined_are_told():
    (sentence,) = told(blocks())
    assert sentence.startswith("4 faces of body a lie on faces of body b, and nothing joins them")
    assert told(blocks(), contacts=[PAD]) == [] and told(blocks(lift=0.1)) == []
    spring = {"name": "s", "surface": "bottom_a", "to": "top_b", "direction": [0, 0, 1], "stiffness": 1.0}
    assert told(blocks(), springs=[spring]) == []


@pytest.mark.parametrize(("kind", "other", "count"), [
    ("hex1", (2, 2), 4), ("hex1", (4, 4), 16), ("hex1", (3, 3), 9), ("tet1", (4, 2), 16), ("hex2", (2, 2), 4),
])  # fmt: skip
@pytest.mark.parametrize("bend", [0.0, 0.2])
def test_faces_that_lie_on_others_are_told_whatever_their_nodes(kind, other, count, bend):
    """Of meshes that differ, as where nodes hang; flat and on a slope; not where a small gap is between them."""

    def stacked(gap):
        parts = [box(kind, (*n, 1), name=name, corner=(0, 0, z))
                 for name, n, z in (("a", (2, 2), gap), ("b", other, -1.0))]  # fmt: skip
        return mapped(join(*parts), lambda x: np.stack([x[0], x[1], x[2] + bend * x[0]]) + 7.0)

    (sentence,) = told(stacked(0.0))
    assert sentence.startswith(f"{count} faces of body a lie on faces of body b, and nothing joins them")
    assert told(stacked(1e-4)) == []


FRICTION = {"friction": {"mu": 0.3}}
IDLE = {"rayleigh": {}}
DAMPED = {"rayleigh": {"beta": 1e-7}}
NO_NUMBERS = "has no effect: all its numbers are zero"


@pytest.mark.parametrize(
    ("contact", "effects", "said"),
    [
        ({"friction_ratio": 3.0}, FRICTION, []),
        ({"friction_ratio": 3.0}, {}, ["[effects.friction], which reads it, is not on"]),
        ({"friction_ratio": 3.0, "kind": "frictionless"}, {}, ["the contact is frictionless"]),
        ({"friction_ratio": 3.0, "kind": "tied"}, {}, ["the contact is tied"]),
        ({"friction_ratio": 0.0, "kind": "frictionless"}, {}, []),
        ({"kind": "frictionless"}, {}, []),
    ],
)  # fmt: skip
def test_a_ratio_of_friction_that_nothing_reads_is_told(contact, effects, said):
    found = told(blocks(), contacts=[{**PAD, "name": "pad", **contact}], effects=effects)
    assert found == [f"contacts.pad.friction_ratio has no effect: {sentence}" for sentence in said]


def test_axes_of_an_isotropic_material_are_told():
    """With the same numbers as lists the material has axes, which are read."""
    axes, tables = [[0, 1, 0], [1, 0, 0]], {"materials": {"steel": STEEL}}
    body = {"body": {"groups": ["a", "b"], "material": "steel", "axes": axes}}
    (sentence,) = told(blocks(), bodies=body, contacts=[PAD], **tables)
    assert sentence == "bodies.body.axes has no effect: the material steel is isotropic"
    E, nu = STEEL["youngs_modulus"], STEEL["poisson_ratio"]
    lists = {"youngs_modulus": [E] * 3, "poisson_ratio": [nu] * 3, "shear_modulus": [E / (2 + 2 * nu)] * 3}
    assert told(blocks(), bodies=body, contacts=[PAD], materials={"steel": {**STEEL, **lists}}) == []


@pytest.mark.parametrize(
    ("effects", "own", "more", "on", "said"),
    [
        (IDLE, {}, {}, (), [f"effects.rayleigh {NO_NUMBERS}"]),
        ({}, IDLE, {}, (), [f"bodies.a.rayleigh {NO_NUMBERS}"]),
        (DAMPED, {}, {}, ("rayleigh",), []),
        (IDLE, DAMPED, {}, ("rayleigh",), [f"effects.rayleigh {NO_NUMBERS}"]),
        (DAMPED, IDLE, {}, ("rayleigh",), []),  # which takes the damping of the whole model away
        (IDLE, {}, {"sweep": {"parameter": "effects.rayleigh.beta", "from": 0.0, "to": 1e-7, "points": 2}},
         ("rayleigh",), []),
        (FRICTION, IDLE, {"study": {"parameters": {"bodies.a.rayleigh.beta": {"uniform": {"low": 0.0, "high": 1e-7}}}}},
         ("friction", "rayleigh"), []),
    ],
)  # fmt: skip
def test_damping_of_zero_is_told_and_is_no_effect_that_is_on(effects, own, more, on, said):
    """Unless the sweep or the study gives it another number."""
    data = {
        "mesh": {"file": "x.msh", "order": 1}, "materials": {"steel": STEEL}, "contacts": [PAD], "effects": effects,
        "bodies": {"a": {"material": "steel", **own}, "b": {"material": "steel"}}, **more,
    }  # fmt: skip
    scene = fe_squeal.parse_scene(data)
    problem = fe_squeal.assemble(scene, fe_squeal.from_skfem(blocks()))
    assert scene.effect_names == on and list(problem.discretisation.warnings) == said
    assert any(term.slot == "C" for term in problem.terms) == (DAMPED in (effects, own))


LOSSY = {"structural_damping": {}}
NO_LOSS = ["effects.structural_damping has no effect: no material of a body has a loss_factor"]


def loss_over(material):
    return {"sweep": {"parameter": f"materials.{material}.loss_factor", "from": 0.0, "to": 0.1, "points": 2}}


@pytest.mark.parametrize(
    ("loss", "more", "said"),
    [
        ({}, {}, NO_LOSS),
        ({"steel": 0.1}, {}, []),
        ({"unused": 0.1}, {}, NO_LOSS),
        ({}, loss_over("steel"), []),
        ({}, loss_over("unused"), NO_LOSS),
        ({}, {"study": {"parameters": {"materials.steel.loss_factor": {"uniform": {"low": 0.0, "high": 0.1}}}}}, []),
    ],
)  # fmt: skip
def test_structural_damping_of_no_body_is_told(loss, more, said):
    """Unless the sweep or the study gives a material of a body a loss factor."""
    materials = {name: {**STEEL, "loss_factor": loss.get(name, 0.0)} for name in ("steel", "unused")}
    assert told(blocks(), materials=materials, contacts=[PAD], effects=LOSSY, **more) == said


@pytest.mark.parametrize(
    ("fixed", "said"),
    [
        ("", []),
        ("x ry", []),
        ("z", ["springs[0]"]),
        ("xyz", ["mass", "springs[0]", "springs[1]"]),
        ("rx rz", ["springs[2]"]),
        ("rx ry rz", ["inertia", "springs[2]"]),
    ],
)
@pytest.mark.parametrize("ties", ["rigid", "averaged"])
def test_what_acts_on_held_freedoms_of_a_reference_alone_is_told(ties, fixed, said):
    springs = [{"direction": [0, 0, 1], "stiffness": 1e6}, {"direction": [1, 0, -1], "damping": 1.0},
               {"axis": [1, 0, 0], "stiffness": 1e3}]  # fmt: skip
    tie = {"name": "cap", "surface": "top_a", "mass": 1.0, "inertia": [1, 1, 1, 0, 0, 0], "springs": springs}
    found = told(blocks(), contacts=[PAD], **{ties: [{**tie, "fixed": fixed}]})
    assert found == [f'{ties}[0].{key} has no effect: fixed = "{fixed}" holds all that it acts on' for key in said]


@pytest.mark.parametrize("gap", [1e-3, 1.0])
def test_a_gap_tolerance_before_a_rigid_counterface_is_told(gap):
    rigid = {**PAD, "name": "pad", "counterface": "rigid"}
    sentence = "contacts.pad.gap_tolerance has no effect: the counterface is rigid, and touches everywhere"
    assert told(blocks(lift=0.1), contacts=[{**rigid, "gap_tolerance": gap}]) == [sentence]
    assert told(blocks(lift=0.1), contacts=[rigid]) == []


@pytest.mark.parametrize("effect", ["friction_damping", "falling_friction"])
def test_effects_of_friction_where_none_acts_are_told(effect):
    """A contact of ratio zero slides without friction; the sweep may give it some."""
    table = {"contact_pressure": 1e6, **({"slope": -0.1} if effect == "falling_friction" else {})}
    effects, without = {**FRICTION, effect: table}, {**PAD, "name": "pad", "friction_ratio": 0.0}
    both = [without, {**PAD, "name": "other", "surface": "front_a", "counterface": "rigid"}]
    over = {"sweep": {"parameter": "contacts.pad.friction_ratio", "from": 0.0, "to": 1.0, "points": 2}}
    sentence = f"effects.{effect} has no effect: friction_ratio is 0 in every contact that slides"
    assert told(blocks(), contacts=[without], effects=effects) == [sentence]
    assert not [w for w in told(blocks(), contacts=both, effects=effects) if "no effect" in w]
    assert told(blocks(), contacts=[without], effects=effects, **over) == []


def test_hexahedra_on_tetrahedra_that_cut_their_faces_the_other_way_are_told():
    """They share all nodes. Where the diagonals of the hexahedra, which are split, are the same, they are joined."""
    z = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    cube = np.stack([[0, 1, 1, 0] * 2, [0, 0, 1, 1] * 2, z], axis=1)
    points = np.vstack([cube, [(0.5, 0.5, -1.0)]])
    for tetrahedra, count in (([[0, 1, 2, 8], [0, 2, 3, 8]], 0), ([[0, 1, 3, 8], [1, 2, 3, 8]], 4)):
        blocks = (CellBlock("hexahedron", np.arange(8)[None], np.array([1])),
                  CellBlock("tetra", np.array(tetrahedra)[:, [0, 2, 1, 3]], np.array([2, 3])))  # fmt: skip
        loaded = build_mesh(RawMesh(points, np.arange(9), blocks, {"block": np.arange(3)}, {}), "a.inp")
        found = told(loaded.mesh)
        assert [s[:42] for s in found] == ["4 faces of body block lie on faces of body"][: bool(count)]


@pytest.mark.parametrize(("first", "surface", "counterface", "count"), [
    ("bottom_a", "bottom_a", "top_b", 4), ("bottom_a", "top_b", "bottom_a", 4), ("bottom_a", "target", "contact", 1),
    ("bottom_a", "contact", "target", 1), ("rest", "contact", "target", 0), ("rest", "target", "contact", 0),
])  # fmt: skip
def test_contacts_that_act_twice_are_told(first, surface, counterface, count):
    """By their faces, since other programs write both halves of a symmetric pair with names of their own."""
    mesh = blocks()
    middles = mesh.p[:, mesh.facets].mean(axis=1)

    def quarter(of, x, y):
        facets = mesh.boundaries[of]
        return facets[(np.abs(middles[:2, facets] - [[x], [y]]) < 0.3).all(axis=0)]

    parts = {"contact": quarter("bottom_a", 0.25, 0.25), "target": quarter("top_b", 0.25, 0.25)}
    parts["rest"] = np.setdiff1d(mesh.boundaries["bottom_a"], parts["contact"])
    two = {**PAD, "surface": surface, "counterface": counterface, "name": "two"}
    found = told(mesh.with_boundaries(parts), contacts=[{**PAD, "surface": first, "name": "one"}, two])
    sentences = [s for s in found if s.startswith("contacts one and two act between the same faces")]
    assert len(sentences) == bool(count)
    assert all(f': {count} of "bottom_a" are in both' in s for s in sentences)


def test_surfaces_of_a_contact_that_share_nodes_are_told():
    mesh = blocks()
    p, t = mesh.p.copy(), mesh.t.copy()
    # The row at x = 0 of both surfaces becomes one row, as when a preprocessor merges nodes that lie on each other.
    rows = [np.flatnonzero((np.abs(p[2]) < 1e-9) & (np.abs(p[0]) < 1e-9) & np.isin(np.arange(p.shape[1]), t[:, e]))
            for e in mesh.subdomains.values()]  # fmt: skip
    for node in rows[1]:
        t[t == node] = rows[0][np.argmin(np.linalg.norm(p[:, rows[0]] - p[:, [node]], axis=0))]
    used, where = np.unique(t, return_inverse=True)
    merged = skfem.MeshHex(p[:, used], where.reshape(t.shape)).with_subdomains(mesh.subdomains)
    free = merged.boundary_facets()
    flat = free[np.abs(merged.p[2][merged.facets[:, free]]).max(axis=0) < 1e-9]
    of_a = np.isin(merged.f2t[0, flat], mesh.subdomains["a"])
    merged = merged.with_boundaries({"bottom_a": flat[of_a], "top_b": flat[~of_a]})
    assert "its two surfaces share 3 nodes, and are glued there" in told(merged, contacts=[{**PAD, "name": "c"}])[0]


@pytest.mark.parametrize(("direction", "count"), [([1.0, 0.0, 0.0], 0), ([1.0, 0.0, 0.05], 0), ([1.0, 0.0, 0.3], 1)])
def test_a_motion_into_the_surface_is_told(direction, count):
    sliding = {"direction": direction, "speed": 1.0}
    found = told(blocks(), contacts=[{**PAD, "sliding": sliding}])
    assert len([w for w in found if "velocity is normal to the surface" in w]) == count


def test_a_pressure_inside_the_mesh_is_refused():
    middle = {"middle": lambda x: np.abs(x[2] - 0.5) < 1e-9}
    mesh = box("hex1", (2, 2, 2)).with_boundaries(middle, boundaries_only=False)
    with pytest.raises(SceneError, match=r'effects\.preload\.pressures\.middle: "middle" lies inside the mesh'):
        make_problem(mesh, 1, effects={"preload": {"pressures": {"middle": 1e6}}})


def test_an_empty_group_is_refused():
    mesh = box("hex1", (2, 2, 2)).with_boundaries({"nothing": lambda x: x[0] > 2})
    with pytest.raises(MeshError, match=r'supports.*surface group "nothing" in .* is empty'):
        make_problem(mesh, 1, supports=[{"surface": "nothing", "fixed": "xyz"}])


@pytest.mark.parametrize(
    ("effects", "said"),
    [({"friction": {"mu": -0.1}, "friction_damping": {"contact_pressure": 1e6}}, r"friction\.mu = -0\.1; expected"),
     ({"preload": {"pressures": {"top_a": 1e6}, "mu": 0.4}}, r"given preload\.mu = 0\.4 without friction")],
)  # fmt: skip
def test_effects_that_contradict_each_other_are_refused(effects, said):
    with pytest.raises(SceneError, match=said):
        make_problem(blocks(), 1, contacts=[PAD], effects=effects)


def test_a_sweep_over_values_that_the_scene_does_not_allow_is_refused():
    effects = {"friction": {"mu": 0.1}, "friction_damping": {"contact_pressure": 1e6}}
    problem = make_problem(blocks(), 1, contacts=[PAD], effects=effects)
    with pytest.raises(SceneError, match=r"mu = -0\.2: .* expected mu >= 0"):
        fe_squeal.sweep(problem, [-0.2, 0.2], modes=4)
    with pytest.raises(SceneError, match=r"given -1\.0; expected a number > 0"):
        fe_squeal.sweep(problem, [-1.0, 1e12], "contacts.contact_1.normal_stiffness", modes=4)


def test_reversed_sliding_is_a_negative_mu_where_nothing_damps_slip():
    forth = make_problem(blocks(), 1, contacts=[PAD], effects={"friction": {"mu": 0.3}})
    back = {**PAD, "sliding": {"direction": [-1.0, 0.0, 0.0], "speed": 1.0}}
    reversed_ = make_problem(blocks(), 1, contacts=[back], effects={"friction": {"mu": 0.3}})
    K = [p.pencil({"mu": mu}).K for p, mu in ((forth, -0.3), (reversed_, 0.3))]
    assert abs(K[0] - K[1]).max() <= 1e-12 * abs(K[0]).max()


def test_places_in_another_unit_are_told():
    """An axis 100 m from a model of 1 m, and a reference; not an axis whose centre is a far point of itself."""
    axis = {"axis": [0.0, 0.0, 1.0], "speed": 1.0}
    far = [PAD | {"sliding": {**axis, "centre": [100.0, 0.0, 0.0]}}]
    assert any("the axis of sliding lies" in sentence for sentence in told(blocks(), contacts=far))
    along = [PAD | {"sliding": {**axis, "centre": [0.5, 0.5, 100.0]}}]
    assert not any("lies" in sentence for sentence in told(blocks(), contacts=along))
    rigid = [{"name": "r", "surface": "top_a", "reference": [50.0, 0.0, 17.0]}]
    assert any("rigid[0]: the reference lies" in sentence for sentence in told(blocks(), rigid=rigid, contacts=[PAD]))


@pytest.mark.parametrize(("stiffness", "is_told"), [(1e3, True), (1.2e4, True), (1e10, False), (1e14, False),
                                                   (1e22, True)])  # fmt: skip
def test_a_contact_stiffness_far_from_that_of_materials_is_told(stiffness, is_told):
    found = told(blocks(), contacts=[PAD | {"normal_stiffness": stiffness}])
    assert any("normal_stiffness" in sentence and "usual" in sentence for sentence in found) == is_told


def test_two_contacts_that_move_one_body_differently_are_told():
    mesh = join(*(box("hex1", (1, 1, 1), name=name, corner=(0, 0, -z)) for z, name in enumerate("abc")))
    both = [PAD | {"name": "one"}, {**PAD, "name": "two", "surface": "top_c", "counterface": "bottom_b"}]
    assert not any("differently" in sentence for sentence in told(mesh, contacts=both))
    both[1]["sliding"] = {**BELT, "speed": -BELT["speed"]}
    assert any("contacts one and two move body b differently" in sentence for sentence in told(mesh, contacts=both))


def wheel(**effects):
    """A wheel that a soft spring holds against turning, pressed by a ring of shoes; k of its turning, N m/rad."""
    rings = join(annulus("hex2", (1, 12, 1), 0.05, 0.08, 0.02, name="w"),
                 annulus("hex2", (1, 12, 1), 0.08, 0.10, 0.02, name="s"))  # fmt: skip
    along = (("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1]))
    problem = make_problem(
        rings, 2, materials={"st": STEEL, "so": {**STEEL, "youngs_modulus": 2e9}},
        bodies={"w": {"material": "st"}, "s": {"material": "so"}},
        averaged=[{"name": "hub", "surface": "hub_w", "reference": [0, 0, 0.01], "fixed": "xyz rx ry",
                   "springs": [{"axis": [0, 0, 1], "stiffness": 50.0}]}],
        springs=[{"name": n, "surface": "rim_s", "direction": d, "stiffness": 1e8} for n, d in along],
        contacts=[{"name": "c", "surface": "hub_s", "counterface": "rim_w", "normal_stiffness": 1e12,
                   "kind": "frictionless", "sliding": {"axis": [0, 0, 1], "speed": 5.0}}],
        effects={"preload": {"pressures": {"rim_s": 2e6}}, **effects},
    )  # fmt: skip
    found = problem.discretisation
    space, nodes = found.space, np.unique(found.space.dofs.element_dofs[:, found.bodies["w"]])
    u = np.zeros((space.nodes, 3))
    u[nodes] = np.cross([0, 0, 1], space.coordinates[nodes])
    turned = space.gather(u)
    return found, turned @ (problem.pencil().K @ turned)


def test_stress_stiffening_beside_a_curved_pressed_contact_is_told_with_its_size():
    """Even pressure on a wheel has no moment, however it is turned; K_σ alone gives −p r A = −∫f·x of the forces."""
    (plain, soft), (stiffened, k) = wheel(), wheel(stress_stiffening={})
    force = stiffened.static_state.contacts["c"].normal_force
    assert soft == pytest.approx(50.0, rel=1e-3) and k == pytest.approx(50.0 - 0.08 * force, rel=1e-2)
    assert not any("curved" in sentence for sentence in plain.warnings)
    (told_of,) = [sentence for sentence in stiffened.warnings if "its surface is curved and pressed" in sentence]
    size = float(re.search(r"about ([\d.e+]+) N m/rad", told_of).group(1))
    assert size == pytest.approx(0.08 * force, rel=0.01)
