"""Descriptors of modes against closed forms of plates and rings, combined doublets, and axes off the origin."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.fem import gyroscopics
from fe_squeal.fem.descriptors import make_describer
from fe_squeal.fem.motion import SteadyMotion
from fe_squeal.problem.terms import Term
from meshes import STEEL, annulus, box, join, make_problem, mapped, modes_of, rotation

OUTER, INNER, THICKNESS = 0.2, 0.1, 0.004
Z = np.array([0.0, 0.0, 1.0])


def described(problem, shapes, axis=Z, centre=(0.0, 0.0, 0.0), turning=("disc",)):
    model = problem.discretisation
    masses = {t.name.removeprefix("mass."): t.matrix for t in problem.terms if t.slot == "M"}
    describer = make_describer(model.space, masses, model.bodies, turning, axis, np.array(centre))
    return describer.describe(problem.terms, problem.parameters, np.asarray(shapes))


@functools.cache
def free_disc(kind="hex2", counts=(4, 40, 1)):
    return make_problem(annulus(kind, counts, INNER, OUTER, THICKNESS))


@functools.cache
def clamped_modes():
    mesh = annulus("hex2", (8, 24, 1), INNER, OUTER, THICKNESS)
    problem = make_problem(mesh, supports=[{"surface": "hub", "fixed": "xyz"}])
    return problem, modes_of(problem, 26)


# Diameters and circles in rising order of frequency, of Kirchhoff's plate clamped at half its radius. A doublet has two
# modes. test_annular_disc checks the frequencies.
CLAMPED = [(0, 0), (1, 0), (1, 0), (2, 0), (2, 0), (3, 0), (3, 0)]
SECOND = {(0, 1): 2073.8, (1, 1): 2114.6, (2, 1): 2237.3, (3, 1): 2442.9}


def test_clamped_plate_has_the_diameters_and_circles_of_its_closed_form():
    problem, modes = clamped_modes()
    found = described(problem, modes.right)
    names = list(zip(found["nodal_diameters"], found["nodal_circles"], strict=True))
    assert names[:7] == CLAMPED
    for name, hz in SECOND.items():
        near = [f for f, other in zip(modes.frequency_hz, names, strict=True) if other == name]
        assert len(near) == (2 if name[0] else 1)
        np.testing.assert_allclose(near, hz, rtol=0.015)
    shares = [share for share, (n, _) in zip(found["nodal_diameters_share"], names, strict=True) if n <= 5]
    assert min(shares) > 0.999  # a body of revolution: one harmonic alone, as far as the mesh is fine enough for it
    assert min(found["out_of_plane"]) > 0.99  # thin: rotary inertia is (h/λ)²
    assert found["body"] == ["disc"] * len(names) and found["body_share"] == pytest.approx([1.0] * len(names))
    assert found["travelling"] == [0.0] * len(names)


@pytest.mark.slow
def test_free_plate_and_ring():
    """A free plate begins with two diameters; a ring bends in its plane with n = 2, 3, ... and no circle."""
    problem = free_disc()
    modes = modes_of(problem, 12)
    found = described(problem, modes.right)
    elastic = modes.frequency_hz > 1.0
    names = [n for n, some in zip(zip(found["nodal_diameters"], found["nodal_circles"], strict=True), elastic,
                                  strict=True) if some]  # fmt: skip
    assert names[:5] == [(2, 0), (2, 0), (0, 1), (3, 0), (3, 0)]
    ring = make_problem(
        annulus("hex2", (1, 32, 1), 0.198, 0.202, 0.02),
        supports=[{"surface": s, "fixed": "z"} for s in ("top", "bottom")],
    )
    modes = modes_of(ring, 9)
    found = described(ring, modes.right)
    assert [n for n, f in zip(found["nodal_diameters"], modes.frequency_hz, strict=True) if f > 1.0][:4] == [2, 2, 3, 3]
    assert max(found["out_of_plane"]) < 1e-12


def waves(problem, n, profile, axis=Z, centre=(0.0, 0.0, 0.0)):
    """Return (unknowns, 2): profile(r) cos nθ and profile(r) sin nθ along the axis, θ right-handed about it."""
    x = problem.discretisation.space.coordinates - centre
    flat = x - np.outer(x @ axis, axis)
    first = np.cross(axis, [0.3, -0.5, 0.9])
    first /= np.linalg.norm(first)
    theta = np.arctan2(flat @ np.cross(axis, first), flat @ first)
    w = profile(np.linalg.norm(flat, axis=1))
    u = [np.outer(w * f(n * theta), axis) for f in (np.cos, np.sin)]
    return np.stack([problem.discretisation.space.gather(v) for v in u], axis=1)


@pytest.mark.parametrize("seed", range(3))
def test_waves_on_a_disc_that_is_turned_and_off_the_origin(seed):
    """α cos nθ + β sin nθ: −2 Im(α* β) / (|α|² + |β|²) is the part that runs with the turning, whatever the frame."""
    rng = np.random.default_rng(seed)
    R, centre = rotation(seed), rng.uniform(-1.0, 1.0, 3)
    mesh = annulus("tet2", (2, 36, 1), INNER, OUTER, 0.02)
    problem = make_problem(mapped(mesh, lambda x: R @ x + centre[:, None]))
    axis = R[:, 2]
    n = 2 + 3 * seed
    pair = waves(problem, n, lambda r: (r - 0.16) * (r - 0.08), axis, centre)
    alpha, beta = rng.standard_normal((2, 2)) @ [1.0, 1j]
    shapes = pair @ np.array([[1.0, 1.0, alpha], [-1j, 1j, beta]])  # e^{−inθ}, e^{inθ} and a mixture
    found = described(problem, shapes, axis, centre)
    assert found["nodal_diameters"] == [n] * 3
    assert found["nodal_circles"] == [1] * 3
    expected = -2 * np.imag(np.conj(alpha) * beta) / (abs(alpha) ** 2 + abs(beta) ** 2)
    assert found["travelling"] == pytest.approx([1.0, -1.0, expected], abs=2e-3)  # the mesh is not quite even
    assert found["out_of_plane"] == pytest.approx([1.0] * 3, abs=1e-12)
    there = described(problem, shapes, -axis, centre)["travelling"]  # the other way around
    assert there == pytest.approx([-1.0, 1.0, -expected], abs=2e-3)


def test_mixed_shapes_give_the_two_strongest_with_their_shares():
    """∫ over θ of cos² is the same for all n > 0, so that the shares are the squares of the amplitudes."""
    problem = free_disc()
    three, five, seven = (waves(problem, n, np.ones_like)[:, 0] for n in (3, 5, 7))
    u = np.sqrt(0.6) * three + np.sqrt(0.3) * five + np.sqrt(0.1) * seven
    found = described(problem, u[:, None])
    assert (found["nodal_diameters"], found["other_nodal_diameters"]) == ([3], [5])
    assert found["nodal_diameters_share"] == pytest.approx([0.6], abs=1e-6)
    assert found["other_share"] == pytest.approx([0.3], abs=1e-6)
    assert found["travelling"] == [0.0]


def test_a_mesh_too_coarse_for_a_harmonic_names_the_lowest_that_it_could_be():
    """Twelve linear elements around have twelve nodes: cos 9θ and cos 3θ are one and the same there."""
    problem = make_problem(annulus("hex1", (2, 12, 1), INNER, OUTER, THICKNESS), order=1)
    shapes = np.stack([waves(problem, n, np.ones_like)[:, 0] for n in (3, 5)], axis=1)
    assert described(problem, shapes)["nodal_diameters"] == [3, 5]


@pytest.mark.slow
def test_a_turning_disc_splits_into_waves_with_and_against_it():
    """In the frame that does not turn the wave that runs with the disc has ω + nΩ, the other one ω − nΩ."""
    problem = free_disc("hex2", (2, 20, 1))
    model, motion = problem.discretisation, SteadyMotion(np.array([0.0, 0.0, 40.0]), np.zeros(3))
    elements = np.arange(model.space.mesh.nelements)
    G = gyroscopics.gyroscopic_matrices(model.space, elements, STEEL["density"], motion)
    G = G if hasattr(G, "shape") else G[0]
    turning = replace(problem, terms=(*problem.terms, Term("gyroscopic", "C", G, symmetric=False, skew=True)))
    modes = solve_modes(turning.pencil(), Request(count=16))
    found = described(turning, modes.right)
    f, n, way = modes.frequency_hz, found["nodal_diameters"], found["travelling"]
    pair = [i for i in range(len(f)) if n[i] == 2 and f[i] > 30.0][:2]
    assert f[pair[1]] - f[pair[0]] > 5.0
    assert [way[i] for i in pair] == pytest.approx([-1.0, 1.0], abs=0.02)


def test_the_body_that_moves_most_and_what_has_no_axis():
    """Two loose blocks: a shape in which one moves alone; nothing turns, so that there are no diameters."""
    problem = make_problem(join(box("hex1", (1, 1, 1), name="a"), box("hex1", (1, 1, 1), (1, 1, 1), (3, 0, 0), "b")), 1)
    space = problem.discretisation.space
    right = space.coordinates[:, 0] > 2
    u = np.where(right[:, None], [3.0, 0.0, 4.0], [0.6, 0.0, 0.8])
    found = described(problem, space.gather(u)[:, None], turning=())
    assert found["body"] == ["b"] and found["body_share"] == pytest.approx([25 / 26])
    assert found["out_of_plane"] == pytest.approx([16 / 25])
    assert found["nodal_diameters"] == found["nodal_circles"] == [None]
    still = described(problem, np.zeros((problem.unknowns, 1)), turning=())
    assert still["body"] == [None] and still["out_of_plane"] == [None]


def test_coordinates_of_a_small_model_describe_the_same_shapes():
    problem, modes = clamped_modes()
    model = problem.discretisation
    masses = {t.name.removeprefix("mass."): t.matrix for t in problem.terms if t.slot == "M"}
    describer = make_describer(model.space, masses, model.bodies, ("disc",), Z, np.zeros(3))
    V = np.linalg.qr(np.real(modes.right))[0]
    y = np.linalg.lstsq(V, modes.right, rcond=None)[0]
    small = [replace(t, matrix=V.T @ (t.matrix @ V)) for t in problem.terms]
    whole = describer.describe(problem.terms, problem.parameters, V @ y)
    there = describer.on(V).describe(small, problem.parameters, y)
    for name, entries in whole.items():
        expected = entries if isinstance(entries[0], str | int) else pytest.approx(entries, abs=1e-9)
        assert there[name] == expected, name


def sliding_disc(**more):
    """A disc under a rigid pad that covers a quarter of it; nothing holds the disc but springs at its hub."""
    mesh = annulus("hex1", (2, 16, 1), INNER, OUTER, 0.02)
    corner = mesh.p[:, mesh.facets].mean(axis=1)
    on_top = mesh.boundaries["top"]
    quarter = on_top[(corner[0, on_top] > 0) & (corner[1, on_top] > 0)]
    mesh = mesh.with_boundaries({"quarter": quarter})
    springs = [{"name": f"s{i}", "surface": "hub", "direction": np.eye(3)[i].tolist(), "stiffness": 1e8}
               for i in range(3)]  # fmt: skip
    contact = {"name": "c", "surface": "quarter", "counterface": "rigid", "normal_stiffness": 1e9,
               "sliding": {"axis": [0.0, 0.0, 1.0], "speed": 5.0}}  # fmt: skip
    return make_problem(mesh, 1, springs=springs, contacts=[contact], effects={"friction": {"mu": 0.3}}, **more)


@pytest.mark.parametrize("surfaces", [["quarter"], ["rim"], ["top", "bottom"]])
def test_an_averaged_point_on_which_nothing_acts_changes_no_description(surfaces):
    """Its nodes follow from other unknowns, and move as before; with both faces they are all nodes of the disc."""
    idle = {"averaged": [{"name": name, "surface": name} for name in surfaces]}
    columns = []
    for problem in (sliding_disc(), sliding_disc(**idle)):
        modes = modes_of(problem, 8)
        columns.append(described(problem, modes.right))
    for name, entries in columns[0].items():
        expected = entries if isinstance(entries[0], str | int) else pytest.approx(entries, abs=1e-3)
        assert columns[1][name] == expected, name


def test_a_block_under_a_rigid_plate_moves_along_the_axis():
    mesh = box("hex1", (2, 2, 1))
    problem = make_problem(mesh, 1, rigid=[{"name": "plate", "surface": "top"}])
    space = problem.discretisation.space
    for way, share in (([0.0, 0.0, 1.0], 1.0), ([3.0, 0.0, 4.0], 16 / 25)):
        u = space.gather(np.tile(way, (space.nodes, 1)))
        assert described(problem, u[:, None], turning=())["out_of_plane"] == pytest.approx([share])


def test_a_belt_in_a_bore_has_no_direction_out_of_plane():
    mesh = annulus("hex1", (1, 12, 1), 0.05, 0.1, 0.02)
    contact = {"name": "c", "surface": "hub", "counterface": "rigid", "normal_stiffness": 1e9,
               "sliding": {"direction": [0.0, 0.0, 1.0], "speed": 5.0}}  # fmt: skip
    problem = make_problem(mesh, 1, contacts=[contact], effects={"friction": {"mu": 0.1}})
    found = problem.describer.describe(problem.terms, problem.parameters, modes_of(problem, 4).right)
    assert found["out_of_plane"] == [None] * len(found["body"]) and found["body"][0] == "disc"


@pytest.mark.parametrize("guide", [{"direction": [1.0, 0.0, 0.0]}, {"axis": [1.0, 0.0, 0.0]}], ids=["belt", "bush"])
@pytest.mark.parametrize("turned", [False, True])
def test_the_order_of_contacts_changes_no_description(guide, turned):
    """A guide that slides without friction is no axis of the disc, wherever it stands in the scene."""
    mesh = annulus("hex1", (2, 16, 1), INNER, OUTER, 0.02)
    mesh = join(mesh, box("hex1", (2, 2, 1), (0.05, 0.05, 0.02), (0.1, 0.0, 0.02), "pad"))
    slides = {"name": "c", "surface": "bottom_pad", "counterface": "top", "normal_stiffness": 1e9,
              "sliding": {"axis": [0.0, 0.0, 1.0], "speed": 5.0}}  # fmt: skip
    guides = {"name": "g", "surface": "top_pad", "counterface": "rigid", "normal_stiffness": 1e8,
              "kind": "frictionless", "sliding": {**guide, "speed": 1.0}}  # fmt: skip
    effects = {"friction": {"mu": 0.3}} | ({"rotation": {"bodies": ["disc"]}} if turned else {})
    held, found = [{"surface": "hub", "fixed": "xyz"}], []
    for contacts in ([slides, guides], [guides, slides]):
        problem = make_problem(mesh, 1, supports=held, contacts=contacts, effects=effects)
        found.append(problem.describer.describe(problem.terms, problem.parameters, modes_of(problem, 4).right))
    assert found[0]["nodal_diameters"] == found[1]["nodal_diameters"] and 2 in found[1]["nodal_diameters"]
    assert found[0]["out_of_plane"] == pytest.approx(found[1]["out_of_plane"], abs=1e-6)


def test_a_centre_may_lie_anywhere_on_the_axis_about_which_contacts_turn_a_disc():
    mesh = annulus("hex1", (2, 16, 1), INNER, OUTER, 0.02)
    mesh = join(mesh, box("hex1", (2, 2, 1), (0.05, 0.05, 0.02), (0.1, 0.0, 0.02), "pad"))
    mesh = join(mesh, box("hex1", (2, 2, 1), (0.05, 0.05, 0.02), (0.1, 0.0, -0.02), "below"))
    found = []
    for height in (0.0, 0.01):
        sliding = {"axis": [0.0, 0.0, 1.0], "speed": 5.0, "centre": [0.0, 0.0, height]}
        contacts = [
            {"name": "a", "surface": "bottom_pad", "counterface": "top", "normal_stiffness": 1e9,
             "sliding": {**sliding, "centre": [0.0, 0.0, 0.0]}},
            {"name": "b", "surface": "top_below", "counterface": "bottom", "normal_stiffness": 1e9, "sliding": sliding},
        ]  # fmt: skip
        held = [{"surface": "hub", "fixed": "xyz"}]
        problem = make_problem(mesh, 1, supports=held, contacts=contacts, effects={"friction": {"mu": 0.3}})
        found.append(problem.describer.describe(problem.terms, problem.parameters, modes_of(problem, 8).right))
    assert found[0]["nodal_diameters"] == found[1]["nodal_diameters"] and 2 in found[1]["nodal_diameters"]
