"""Whether bodies, what holds them, and materials are the same all around an axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fe_squeal
from fe_squeal.errors import SceneError
from fe_squeal.fem import revolution
from fe_squeal.fem.materials import Material, material_axes, stiffness_tensor
from fe_squeal.fem.motion import SteadyMotion
from fe_squeal.mesh.groups import NodeSet
from meshes import KINDS, STEEL, annulus, box, join, make_problem, mapped, rotation

INNER, OUTER = 0.1, 0.2
ELASTICITY = stiffness_tensor(Material(**STEEL))
ROTATION = {"rotation": {"bodies": ["disc"], "axis": [0, 0, 1.0], "speed": 50.0}}


def about_z(speed, centre=(0.0, 0.0, 0.0)):
    return SteadyMotion(np.array([0.0, 0.0, speed]), np.array(centre))


def rounded(section):
    """Map a square about the origin (2, k) onto the disc in it."""
    size = np.linalg.norm(section, axis=0)
    return section * np.abs(section).max(axis=0) / np.where(size > 0, size, 1.0)


def solid_disc(cells=8):
    square = box("hex1", (cells, cells, 1), size=(2.0, 2.0, 0.2), corner=(-1.0, -1.0, 0.0), name="disc")
    return mapped(square, lambda x: np.vstack([rounded(x[:2]), x[2]]))


def check(mesh, motion):
    revolution.check_revolution(mesh, np.arange(mesh.nelements), motion, "rotor")


@pytest.mark.parametrize("around", [8, 24])
@pytest.mark.parametrize("kind", KINDS)
def test_bodies_of_revolution_are_accepted(kind, around):
    turning = rotation()
    mesh = annulus(kind, (2, around, 1), INNER, OUTER, 0.02)
    cones = mapped(mesh, lambda x: np.vstack([x[:2] * (1 + 3 * x[2]), x[2] + 0.3 * np.linalg.norm(x[:2], axis=0)]))
    for shape in (mesh, cones):
        check(mapped(shape, lambda x: turning @ x + 0.3), SteadyMotion(5.0 * turning[:, 2], np.full(3, 0.3)))


def torus(around, across):
    """Tetrahedra in a ring of round section, turned at random in the section so that no edge runs around the axis."""
    mesh = annulus("tet1", (across, around, across), 0.7, 1.3, 0.6, bottom=-0.3)
    turn = np.exp(1j * np.random.default_rng(3).uniform(-0.5, 0.5, mesh.p.shape[1]) / across)

    def bent(x):
        dr, z = rounded(np.stack([np.linalg.norm(x[:2], axis=0) - 1.0, x[2]]))
        section = (dr + 1j * z) * turn
        return np.vstack([x[:2] / np.linalg.norm(x[:2], axis=0) * (1 + section.real), section.imag])

    return mapped(mesh, bent)


@pytest.mark.parametrize("mesh", [torus(12, 3), torus(36, 6), solid_disc()], ids=["coarse torus", "torus", "axis"])
def test_curved_meridians_and_facets_on_the_axis_are_accepted(mesh):
    check(mesh, about_z(1.0))


def sector():
    block = box("hex1", (2, 4, 1), size=(1.0, 1.0, 0.2), corner=(1.0, 0.0, 0.0))
    return mapped(block, lambda x: np.stack([x[0] * np.cos(x[1]), x[0] * np.sin(x[1]), x[2]]))


def disc_with_hole():
    mesh = solid_disc(16)
    x, y, _ = mesh.p[:, mesh.t].mean(axis=1)
    return mesh.restrict(np.flatnonzero(np.hypot(x - 0.5, y) > 0.2))


OTHER = {
    "hole beside the axis": (disc_with_hole(), about_z(1.0)),
    "block": (box("hex1", (2, 2, 1), corner=(-0.5, -0.5, 0.0)), about_z(1.0)),
    "block beside the axis": (box("tet1", (3, 2, 1), corner=(4.0, 0.0, 0.0)), about_z(1.0)),
    "5 % off": (annulus("hex1", (2, 12, 1), 0.5, 1.0, 0.1), about_z(1.0, (0.05, 0.0, 0.0))),
    "solid, 5 % off": (solid_disc(), about_z(1.0, (0.0, 0.05, 0.0))),
    "torus, off": (torus(24, 6), about_z(1.0, (0.3, 0.0, 0.0))),
    "tilted": (annulus("tet2", (2, 24, 1), 0.5, 1.0, 0.1), SteadyMotion(np.array([0.05, 0.0, 1.0]), np.zeros(3))),
    "sector": (sector(), about_z(1.0)),
}


@pytest.mark.parametrize(("mesh", "motion"), OTHER.values(), ids=OTHER)
def test_other_bodies_are_refused(mesh, motion):
    with pytest.raises(SceneError, match=r'body "rotor" is not a body of revolution .* at \[.* slope of .* at most'):
        check(mesh, motion)


def test_material_may_have_the_axis_of_the_body_only():
    moduli = {"youngs_modulus": [9e9, 9e9, 3e9], "poisson_ratio": [0.2, 0.2, 0.3], "density": 2e3}
    across = Material(**moduli, shear_modulus=[2e9, 2e9, 9e9 / 2.6])
    square, axis = Material(**moduli, shear_modulus=[2e9, 2e9, 9e9]), about_z(7.0)
    assert revolution.is_transversal(ELASTICITY, SteadyMotion(np.array([1.0, 2.0, 3.0]), np.zeros(3)))
    assert revolution.is_transversal(stiffness_tensor(across), axis)
    assert not revolution.is_transversal(stiffness_tensor(square), axis)
    assert not revolution.is_transversal(stiffness_tensor(across, material_axes((0, 1, 0), (0, 0, 1))), axis)


@pytest.mark.parametrize(
    ("changed", "is_one"),
    [
        ({}, True), ({"shear_modulus": [2e9, 2e9, 3.46e9]}, True), ({"shear_modulus": [2e9, 2e9, 3.45e9]}, False),
        ({"youngs_modulus": [9e9, 9.005e9, 3e11]}, True), ({"youngs_modulus": [9e9, 9.05e9, 3e11]}, False),
        ({"shear_modulus": [2e9, 2.01e9, 9e9 / 2.6]}, False),
    ],
)  # fmt: skip
def test_moduli_may_be_rounded(changed, is_one):
    """However stiff the material is along its axis, each value counts beside the others of its kind."""
    given = {"youngs_modulus": [9e9, 9e9, 3e11], "poisson_ratio": [0.01, 0.01, 0.3], "density": 2e3,
             "shear_modulus": [2e9, 2e9, 9e9 / 2.6], **changed}  # fmt: skip
    tensor = stiffness_tensor(Material(**given))
    assert revolution.is_transversal(tensor, about_z(7.0)) == is_one
    turned = stiffness_tensor(Material(**given), rotation())
    assert revolution.is_transversal(turned, SteadyMotion(rotation()[2], np.zeros(3))) == is_one


def test_the_message_has_the_shear_modulus_that_is_expected():
    ply = {"youngs_modulus": [9e9, 9e9, 3e9], "poisson_ratio": [0.2, 0.2, 0.3], "density": 2e3,
           "shear_modulus": [2e9, 2e9, 3.6e9]}  # fmt: skip
    mesh = annulus("hex1", (1, 8, 1), INNER, OUTER, 0.02)
    with pytest.raises(SceneError, match=r"nu12\)\) = 3.46154e\+09 Pa to some 0.1 %; given G12 = 3.6e\+09 Pa$"):
        make_problem(mesh, order=1, materials={"ply": ply}, effects=ROTATION)


def around(mesh, group, part):
    """Return the mesh with the group cut down to the facets whose middle has an angle in `part`."""
    facets = mesh.boundaries[group]
    x, y, _ = mesh.p[:, mesh.facets[:, facets]].mean(axis=1)
    return mesh.with_boundaries({group: facets[part(np.arctan2(y, x))]})


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [8, 40])
def test_what_holds_a_rotating_body_goes_around_the_axis(kind, n):
    make_problem(annulus(kind, (1, n, 1), INNER, OUTER, 0.02), order=1,
                 supports=[{"surface": "hub", "fixed": "xyz"}], effects=ROTATION)  # fmt: skip


def held_on(mesh, places):
    """The disc, held on the nodes at these places (k, 3)."""
    loaded = fe_squeal.from_skfem(mesh)
    nodes = np.unique([np.linalg.norm(loaded.mesh.p.T - x, axis=1).argmin() for x in places])
    assert len(nodes) == len(places)
    loaded = replace(loaded, node_groups={"SET": NodeSet(nodes, nodes)})
    scene = {"mesh": {"file": "none.msh", "order": 1}, "materials": {"steel": STEEL}, "bodies": {"disc": {
        "material": "steel"}}, "supports": [{"nodes": "SET", "fixed": "xyz"}], "effects": ROTATION}  # fmt: skip
    return fe_squeal.assemble(fe_squeal.parse_scene(scene), loaded)


CENTRE = [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize("off", [0.0, 1e-6])
def test_what_is_on_the_axis_is_the_same_all_around(off):
    """Every turn leaves it where it is: a bearing in the centre, alone or with the ring around it."""
    mesh = mapped(solid_disc(4), lambda x: x + np.array([[off], [0.0], [0.0]]))
    rim = [[np.cos(a), np.sin(a), 0.0] for a in np.arange(16) * np.pi / 8]
    for places in (CENTRE, [*CENTRE, [0.0, 0.0, 0.2]], rim, [*CENTRE, *rim]):
        held_on(mesh, places)
    with pytest.raises(SceneError, match=r"supports\[0\] acts on .*harmonic 1 has 0.5 of its number"):
        held_on(mesh, [*CENTRE, [1.0, 0.0, 0.0]])


@pytest.mark.parametrize("cells", [4, 5])
def test_a_flat_face_with_the_axis_in_it_is_a_ring(cells):
    """Its facets have a corner on the axis, or one of them has the axis in its middle; a sector of it is none."""
    mesh = solid_disc(cells)
    held = {"order": 1, "supports": [{"surface": "top_disc", "fixed": "xyz"}], "effects": ROTATION}
    make_problem(mesh, **held)
    with pytest.raises(SceneError, match="harmonic 1 "):
        make_problem(around(mesh, "top_disc", lambda a: np.cos(a) > 0.1), **held)


@pytest.mark.parametrize(
    ("part", "harmonic"), [(lambda a: np.cos(5 * a) > 0.5, 5), (lambda a: np.abs(a) < 2.9, 1)], ids=["bolts", "gap"]
)
@pytest.mark.parametrize("table", ["supports", "springs"])
def test_bolts_do_not_turn_with_the_body(part, harmonic, table):
    mesh = around(annulus("hex1", (1, 60, 1), INNER, OUTER, 0.02), "hub", part)
    holding = {
        "supports": [{"surface": "hub", "fixed": "xyz"}],
        "springs": [{"name": "bearing", "surface": "hub", "direction": [1.0, 0, 0], "stiffness": 1e6}],
    }  # fmt: skip
    with pytest.raises(SceneError, match=rf"{table}\[0\] acts on the rotating body .*harmonic {harmonic} "):
        make_problem(mesh, order=1, **{table: holding[table]}, effects=ROTATION)
    make_problem(mesh, order=1, **{table: holding[table]})


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({}, ["turn about the axis", "tilt"]),
        ({"supports": [{"surface": "hub", "fixed": "z"}]}, ["turn about the axis"]),
        ({"supports": [{"surface": "hub", "fixed": "xyz"}]}, []),
        ({"effects": {**ROTATION, "preload": {"pressures": {"rim": 1.0}}, "stress_stiffening": {}}}, []),
        ({"springs": [{"name": "s", "surface": "hub", "direction": [0, 0, 1.0], "stiffness": 1e9}]}, ["turn"]),
    ],
)
def test_a_body_free_to_turn_is_spoken_of(tables, said):
    if "stress_stiffening" in tables.get("effects", {}):
        tables = {**tables, "supports": [{"surface": "hub", "fixed": "xyz"}]}
    problem = make_problem(annulus("hex1", (1, 24, 1), INNER, OUTER, 0.02), order=1, **{"effects": ROTATION, **tables})
    found = [w for w in problem.discretisation.warnings if "stress_stiffening" in w]
    assert len(found) == bool(said)
    for word in ("turn", "tilt"):
        assert not said or (word in found[0]) == any(word in w for w in said)


def test_every_second_facet_is_no_ring():
    """Twelve facets around the axis show six waves, and no more: the two ends of what they can tell are both whole."""
    mesh = around(annulus("hex1", (1, 12, 1), INNER, OUTER, 0.02), "hub", lambda a: np.floor(a / (np.pi / 6)) % 2 == 0)
    with pytest.raises(SceneError, match="harmonic 6 "):
        make_problem(mesh, order=1, supports=[{"surface": "hub", "fixed": "xyz"}], effects=ROTATION)


@pytest.mark.parametrize(
    ("kind", "counterface", "refused"),
    [("tied", "hub_b", True), ("tied", "rigid", True), ("frictionless", "hub_b", True),
     ("frictionless", "rigid", False)],
)  # fmt: skip
def test_contacts_that_turn_with_their_bodies_go_around_the_axis(kind, counterface, refused):
    """Rings that are joined over a part alone are no body of revolution, though each of them is.

    A rigid face without friction may stand still before a part of a ring that turns.
    """
    sizes = {"a": (INNER, 0.15), "b": (0.15, OUTER)}
    rings = join(*(annulus("hex1", (1, 12, 1), *radii, 0.02, name=name) for name, radii in sizes.items()))
    glue = {"name": "c", "surface": "rim_a", "counterface": counterface, "normal_stiffness": 1e14, "kind": kind}
    turning = {"rotation": {**ROTATION["rotation"], "bodies": ["a", "b"]}}
    make_problem(rings, order=1, contacts=[glue], effects=turning)
    patch = around(rings, "rim_a", lambda a: np.abs(a) < 1)
    if not refused:
        make_problem(patch, order=1, contacts=[glue], effects=turning)
        return
    with pytest.raises(SceneError, match=r"contacts\.c, on rim_a, acts on the rotating body .a. .*harmonic 1 "):
        make_problem(patch, order=1, contacts=[glue], effects=turning)
    make_problem(patch, order=1, contacts=[glue])


@pytest.mark.parametrize("joint", ["nodes", "glue", "rigid"])
def test_bodies_that_turn_as_one_are_free_as_one(joint):
    """A disc and its hat: turned by itself each of them would strain the other, and seem to be held."""
    if joint == "nodes":
        whole = annulus("hex1", (2, 24, 1), INNER, OUTER, 0.02, name="a")
        inner = np.linalg.norm(whole.p[:2, whole.t].mean(axis=1), axis=0) < (INNER + OUTER) / 2
        mesh = whole.with_subdomains({"a": np.flatnonzero(inner), "b": np.flatnonzero(~inner)})
    else:
        parts = {"a": (INNER, 0.15), "b": (0.15, OUTER)}
        mesh = join(*(annulus("hex1", (1, 24, 1), *radii, 0.02, name=name) for name, radii in parts.items()))
        mesh = mesh.with_boundaries({"both": np.concatenate([mesh.boundaries[f"top_{name}"] for name in parts])})
    tables = {
        "nodes": {}, "rigid": {"rigid": [{"name": "plate", "surface": "both"}]},
        "glue": {"contacts": [{"name": "c", "surface": "rim_a", "counterface": "hub_b", "normal_stiffness": 1e14,
                               "kind": "tied"}]},
    }[joint]  # fmt: skip
    turning = {"rotation": {**ROTATION["rotation"], "bodies": ["a", "b"]}}
    problem = make_problem(mesh, order=1, effects=turning, **tables)
    [told] = [w for w in problem.discretisation.warnings if "stress_stiffening" in w]
    assert "bodies a and b together are free to turn about the axis and to tilt" in told


MIDDLE = (INNER + OUTER) / 2


def nested(kind, inner, outer):
    """Two rings, one in the other, with so many elements around."""
    radii = {"a": (INNER, MIDDLE), "b": (MIDDLE, OUTER)}
    return join(*(annulus(kind, (1, n, 1), *r, 0.02, name=name)
                  for (name, r), n in zip(radii.items(), (inner, outer), strict=True)))  # fmt: skip


def rotating_rings(mesh, bodies=("a", "b"), supports=(), **contact):
    """Rings, of which both turn or one does, with a contact between them."""
    contact = {"name": "c", "surface": "rim_a", "counterface": "hub_b", "kind": "tied", "normal_stiffness": 1e12,
               **contact}  # fmt: skip
    rotation = {"rotation": {**ROTATION["rotation"], "bodies": list(bodies)}}
    return make_problem(mesh, order=1, contacts=[contact], supports=list(supports), effects=rotation)


def free(problem):
    """Return who is free to what, as warnings have it."""
    return [w.removeprefix("effects.rotation: ").split(";")[0] for w in problem.discretisation.warnings if "free" in w]


def cut(count):
    """A ring whose layers of elements are so many bodies, which share nodes."""
    mesh = annulus("hex1", (1, 12, 3), INNER, OUTER, 0.03)
    layer = (mesh.p[2, mesh.t].mean(axis=0) / 0.03 * count).astype(int)
    return replace(mesh, _subdomains={"abc"[i]: np.flatnonzero(layer == i) for i in range(count)})


SPRINGS = [{"name": "s", "surface": "hub", "direction": [0, 0, 1.0], "stiffness": 1e9}]
WHO = {1: "body a is", 2: "bodies a and b together are", 3: "bodies a, b and c together are"}


@pytest.mark.parametrize("count", WHO)
def test_a_rotor_is_as_free_in_one_body_as_in_several(count):
    for tables, what in (
        ({}, "turn about the axis and to tilt"), ({"springs": SPRINGS}, "turn about the axis"),
        ({"supports": [{"surface": "top", "fixed": "xyz"}]}, None),
    ):  # fmt: skip
        for speed in (0.1, 300.0):
            rotation = {"rotation": {"bodies": list("abc"[:count]), "axis": [0, 0, 1.0], "speed": speed}}
            problem = make_problem(cut(count), order=1, effects=rotation, **tables)
            assert free(problem) == ([] if what is None else [f"{WHO[count]} free to {what}"])


BOTH = "turn about the axis and to tilt"
SMOOTH = {"kind": "frictionless", "sliding": {"axis": [0, 0, 1.0], "speed": 50.0}}  # normals across the rotation
HUB = [{"surface": "hub_a", "fixed": "xyz"}]


@pytest.mark.parametrize(
    ("contact", "supports", "said"),
    [
        ({}, [], [f"bodies a and b together are free to {BOTH}"]),
        ({}, HUB, []),
        # Glue that is softer than ten times Ω²M holds neither against the other.
        ({"normal_stiffness": 1.0}, [], [f"body {b} is free to {BOTH}" for b in "ab"]),
        ({"normal_stiffness": 1.0}, HUB, [f"body b is free to {BOTH}"]),
        # Without friction rings turn in each other, and tilt together.
        (
            SMOOTH, [],
            [*(f"body {b} is free to turn about the axis" for b in "ab"), "bodies a and b together are free to tilt"],
        ),
        (SMOOTH, HUB, ["body b is free to turn about the axis"]),
    ],
)
def test_what_is_glued_is_free_together(contact, supports, said):
    # Of long rings none tilts in the other.
    mesh = mapped(nested("hex1", 12, 12), lambda x: x * np.array([[1.0], [1.0], [10.0]]))
    assert free(rotating_rings(mesh, supports=supports, **contact)) == said


def test_a_rotor_in_one_bearing_is_free_to_tilt_about_it():
    """The middle moves as it tilts, which the bearing at the end lets it."""
    mesh = mapped(annulus("hex1", (1, 12, 4), INNER, OUTER, 0.02), lambda x: x * np.array([[1.0], [1.0], [20.0]]))
    bearings = [
        {"name": f"{side}{i}", "surface": side, "direction": np.eye(3)[i].tolist(), "stiffness": 1e9}
        for side in ("bottom", "top") for i in range(2)
    ]  # fmt: skip
    assert free(make_problem(mesh, order=1, springs=bearings[:2], effects=ROTATION)) == ["body disc is free to tilt"]
    assert free(make_problem(mesh, order=1, springs=bearings, effects=ROTATION)) == []
    one_way = [bearings[0], bearings[2]]
    assert free(make_problem(mesh, order=1, springs=one_way, effects=ROTATION)) == ["body disc is free to tilt"]
