"""Supports and springs on node sets: against surfaces of the same nodes, and against hand-made matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from deck_texts import deck_of

import fe_squeal
from fe_squeal.accuracy.prolongation import prolongation
from fe_squeal.errors import MeshError, SceneError
from fe_squeal.mesh import load_mesh
from fe_squeal.mesh.groups import NodeSet
from fe_squeal.mesh.refining import refine
from meshes import STEEL, annulus, box, frequencies, modes_of

SIZE = (0.1, 0.06, 0.04)
BODY = {"materials": {"steel": STEEL}, "bodies": {"block": {"material": "steel"}}}


def loaded_box(tmp_path, kind, extra="", counts=(3, 2, 2)):
    (tmp_path / "box.inp").write_text(deck_of(box(kind, counts, SIZE)) + extra)
    return load_mesh(tmp_path / "box.inp")


def problem_on(loaded, order=2, **tables):
    scene = fe_squeal.parse_scene({"mesh": {"file": "none.inp", "order": order}, **{**BODY, **tables}})
    return fe_squeal.assemble(scene, loaded)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("kind", ["hex1", "hex2", "tet1", "tet2"])
def test_all_nodes_of_a_face_hold_as_the_face(tmp_path, kind, order):
    """A deck's node set of the face holds exactly what the surface does, whichever nodes the elements have added."""
    loaded = loaded_box(tmp_path, kind)
    held = [problem_on(loaded, order, supports=[{**where, "fixed": "xz"}]).discretisation.space.fixed
            for where in ({"surface": "left"}, {"nodes": "N_left"})]  # fmt: skip
    assert held[0].sum() > 0
    np.testing.assert_array_equal(*held)


@pytest.mark.parametrize("kind", ["hex1", "hex2", "tet1"])
def test_springs_act_at_the_nodes_of_the_deck_alone(tmp_path, kind):
    """Neither nodes that order 2 adds, nor the last 7 of a 27-node hexahedron, nor those of a refined mesh count."""
    loaded = loaded_box(tmp_path, kind)
    spring = [{"name": "s", "nodes": "N_left", "direction": [1, 0, 0], "stiffness": 12.0}]
    count = len(loaded.node_groups["N_left"].nodes)
    for mesh in (loaded, refine(loaded)):
        (K,) = [t.matrix for t in problem_on(mesh, springs=spring).terms if t.name == "spring.s"]
        np.testing.assert_allclose(np.sort(K.diagonal())[-count:], 1 / count)
        assert K.trace() == pytest.approx(1) and K.nnz == count


def test_springs_at_corners_are_those_of_a_rigid_body(tmp_path):
    """Four springs k/4 at the bottom's corners under a stiff block: ω² = k/m upwards; rocking k/4 Σ r²/J.

    The block's own compliance lowers them by about k L/(E A) ~ 1e-6.
    """
    k, (a, b, c) = 2e4, SIZE
    loaded = loaded_box(tmp_path, "hex1", counts=(2, 2, 2))
    corners = np.flatnonzero((np.abs(loaded.mesh.p[2]) < 1e-9) & np.isin(loaded.mesh.p[0].round(9), [0, a])
                             & np.isin(loaded.mesh.p[1].round(9), [0, b]))  # fmt: skip
    loaded = replace(loaded, node_groups={"corners": NodeSet(corners, corners)})
    problem = problem_on(loaded, springs=[{"name": "up", "nodes": "corners", "direction": [0, 0, 1], "stiffness": k}])
    x = problem.discretisation.space.coordinates
    up = problem.terms[[t.name for t in problem.terms].index("spring.up")]
    K = up.matrix.toarray() * k
    expected = np.zeros(problem.unknowns)
    for at in ([0, 0, 0], [a, 0, 0], [0, b, 0], [a, b, 0]):
        expected[3 * int(np.argmin(np.linalg.norm(x - at, axis=1))) + 2] = k / 4
    np.testing.assert_allclose(K, np.diag(expected), atol=1e-12 * k)
    m = STEEL["density"] * a * b * c
    lowest = frequencies(problem, 6)[3:]  # sliding along x, y and turning about z stay free
    upwards = np.sqrt(k / m) / (2 * np.pi)
    assert np.abs(lowest / upwards - 1).min() < 1e-5


def test_spring_between_two_node_sets_takes_their_means(tmp_path):
    """K = k r rᵀ, r the mean over one set less that over the other."""
    loaded = loaded_box(tmp_path, "tet1")
    problem = problem_on(loaded, order=1, springs=[
        {"name": "s", "nodes": "N_left", "to": "N_right", "direction": [0, 0, -3], "stiffness": 7.0}])  # fmt: skip
    r = np.zeros((loaded.mesh.nvertices, 3))
    for name, sign in (("N_left", 1), ("N_right", -1)):
        rows = loaded.node_groups[name].nodes
        r[rows, 2] = sign / len(rows)
    (s,) = [t.matrix * 7.0 for t in problem.terms if t.name == "spring.s"]
    np.testing.assert_allclose(s.toarray(), 7.0 * np.outer(r, r), atol=1e-14)


@pytest.mark.parametrize("kind", ["tet1", *(pytest.param(k, marks=pytest.mark.slow) for k in ("hex1", "hex2", "tet2"))])
def test_refined_sets_hold_no_more_than_the_functions_of_the_coarse_mesh_do(tmp_path, kind):
    """A displacement of the coarse problem is one of the refined problem, and faces that are held stay so in full."""
    loaded = loaded_box(tmp_path, kind)
    fine = refine(loaded)
    tables = {"supports": [{"nodes": "N_left", "fixed": "xyz"}, {"nodes": "N_top", "fixed": "z"}]}
    spaces = [problem_on(mesh, **tables).discretisation.space for mesh in (loaded, fine)]
    E = prolongation(*spaces)
    u = np.random.default_rng(1).standard_normal(spaces[0].unknowns)
    assert np.linalg.norm(spaces[1].expand(E @ u)) > 1
    coarse, there = spaces[0].expand(u), spaces[1].expand(E @ u)
    same = [int(np.argmin(np.linalg.norm(spaces[1].coordinates - x, axis=1))) for x in spaces[0].coordinates]
    np.testing.assert_allclose(there[same], coarse, atol=1e-12)
    on_face = problem_on(fine, supports=[{"surface": "left", "fixed": "xyz"}, {"surface": "top", "fixed": "z"}])
    np.testing.assert_array_equal(spaces[1].fixed, on_face.discretisation.space.fixed)


def test_nodes_of_a_turning_disc_have_to_go_around(tmp_path):
    """Four bolts on a disc of 16 elements around do not turn with it; a whole ring of nodes may hold it."""
    ring = annulus("hex1", (1, 16, 1), 0.05, 0.1, 0.01)
    (tmp_path / "disc.inp").write_text(deck_of(ring))
    loaded = load_mesh(tmp_path / "disc.inp")
    x, y, z = loaded.mesh.p
    angle = np.degrees(np.arctan2(y, x)).round(6) % 90
    bolts = np.flatnonzero((np.hypot(x, y) < 0.06) & (np.abs(z) < 1e-9) & (np.minimum(angle, 90 - angle) < 1e-3))
    assert len(bolts) == 4
    loaded = replace(loaded, node_groups={**loaded.node_groups, "bolts": NodeSet(bolts, bolts)})
    pad = {"bodies": {"disc": {"material": "steel"}}, "effects": {"rotation": {"bodies": ["disc"],
           "axis": [0, 0, 1], "centre": [0, 0, 0], "speed": 5.0}}}  # fmt: skip
    problem_on(loaded, supports=[{"nodes": "N_hub", "fixed": "xyz"}], **pad)
    with pytest.raises(SceneError, match=r"on the rotating body \"disc\" at nodes that do not go evenly"):
        problem_on(loaded, supports=[{"nodes": "bolts", "fixed": "xyz"}], **pad)


@pytest.mark.parametrize(("table", "message"), [
    ({"supports": [{"nodes": "N_lefft", "fixed": "x"}]},
     r'supports\[0\]\.nodes: no node set "N_lefft" .*mean "N_left"'),
    ({"supports": [{"nodes": "block", "fixed": "x"}]}, "that is a volume group"),
    ({"supports": [{"nodes": "left", "fixed": "x"}]}, 'that is a surface group; write surface = "left"'),
    ({"supports": [{"nodes": "N_left", "surface": "left", "fixed": "x"}]}, "given surface and nodes; expected one"),
    ({"supports": [{"fixed": "x"}]}, "given neither surface nor nodes"),
    ({"springs": [{"name": "s", "nodes": "N_left", "to": "right", "direction": [1, 0, 0], "stiffness": 1.0}]},
     r'springs\[0\]\.to: no node set "right"'),
])  # fmt: skip
def test_messages(tmp_path, table, message):
    with pytest.raises((SceneError, MeshError), match=message):
        problem_on(loaded_box(tmp_path, "tet1"), **table)


def test_only_midside_nodes_need_order_2(tmp_path):
    """Displacements of order 1 have no unknown in the middle of an edge."""
    loaded = loaded_box(tmp_path, "tet2")
    middles = {"middles": NodeSet(*[np.array([loaded.mesh.nvertices])] * 2)}
    support = [{"nodes": "middles", "fixed": "x"}]
    assert problem_on(replace(loaded, node_groups=middles), supports=support).discretisation.space.fixed.sum() == 1
    with pytest.raises(SceneError, match="middles of edges"):
        problem_on(replace(loaded, node_groups=middles), order=1, supports=support)


def test_point_supports_leave_the_body_where_it_is(tmp_path):
    """Three points held against six rigid motions: none is free, and with two of them there is one (turning)."""
    loaded = loaded_box(tmp_path, "hex1")
    p = loaded.mesh.p.T
    corner = [int(np.argmin(np.linalg.norm(p - x, axis=1))) for x in ([0, 0, 0], [SIZE[0], 0, 0], [0, SIZE[1], 0])]
    loaded = replace(loaded, node_groups={f"p{i}": NodeSet(*[np.array([c])] * 2) for i, c in enumerate(corner)})
    supports = [{"nodes": "p0", "fixed": "xyz"}, {"nodes": "p1", "fixed": "yz"}, {"nodes": "p2", "fixed": "z"}]
    assert modes_of(problem_on(loaded, supports=supports), 1).frequency_hz[0] > 100
    assert modes_of(problem_on(loaded, supports=supports[:2]), 1).frequency_hz[0] == 0


def test_nodes_by_their_numbers(tmp_path):
    """A list of numbers in the deck is the set of these nodes, on the refined mesh too."""
    loaded = loaded_box(tmp_path, "tet1")
    numbers, columns = loaded.node_numbers[""]
    face = loaded.node_groups["N_left"].nodes
    listed = ", ".join(str(n) for n, c in zip(numbers, columns, strict=True) if c in face)
    given = problem_on(loaded, supports=[{"nodes": listed, "fixed": "xyz"}])
    expected = problem_on(loaded, supports=[{"surface": "left", "fixed": "xyz"}])
    np.testing.assert_array_equal(given.discretisation.space.fixed, expected.discretisation.space.fixed)
    fine = [problem_on(refine(p.source.loaded), supports=p.source.scene.model_dump(exclude_none=True)["supports"])
            for p in (given, expected)]  # fmt: skip
    np.testing.assert_array_equal(*[p.discretisation.space.fixed for p in fine])
    with pytest.raises(MeshError, match=r"no node 99999 in .*; expected one from 1 to"):
        problem_on(loaded, supports=[{"nodes": "1, 99999", "fixed": "x"}])
