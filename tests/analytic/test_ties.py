"""Rigid bodies and averaged reference points: closed forms, virtual work, and dense elimination by another way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
import skfem

import fe_squeal
from fe_squeal.assembly.forces import force_balance
from fe_squeal.errors import SceneError
from fe_squeal.fem.ties import averaged_tie, rigid_columns
from fe_squeal.mesh.groups import NodeSet
from fe_squeal.run.free import free_motion_warnings
from meshes import STEEL, box, frequencies, join, make_problem

SIZE = (0.1, 0.06, 0.04)
MASS = STEEL["density"] * np.prod(SIZE)
MIDDLE = np.array(SIZE) / 2


def dense(problem):
    pencil = problem.pencil()
    return pencil.K.toarray(), pencil.M.toarray()


def eigenvalues(K, M, count):
    return la.eigh(K, M, eigvals_only=True, subset_by_index=[0, count - 1])


def test_a_whole_block_made_rigid_is_a_rigid_body():
    """Six unknowns; M is that of the block about its centre, springs at the reference give ω² = k/m and k_θ/J."""
    a, b, c = SIZE
    springs = [{"direction": [2, 0, 0], "stiffness": 1e6}, {"direction": [0, 1, 0], "stiffness": 4e6},
               {"direction": [0, 0, 1], "stiffness": 9e6}, {"axis": [1, 0, 0], "stiffness": 1e3},
               {"axis": [0, 1, 0], "stiffness": 2e3}, {"axis": [0, 0, 3], "stiffness": 4e3}]  # fmt: skip
    mesh = box("tet1", (2, 2, 2), SIZE)
    mesh = mesh.with_boundaries({"all": np.flatnonzero(mesh.f2t[1] < 0)})
    tables = {"name": "r", "surface": "all", "reference": MIDDLE.tolist(), "springs": springs}
    problem = make_problem(mesh, order=1, rigid=[{**tables, "mass": 0.5, "inertia": [0.1, 0.2, 0.3, 0.0, 0.0, 0.0]}])
    assert problem.unknowns == 6 + 3  # the node in the middle of the block is not on its surface
    problem = make_problem(box("tet1", (2, 1, 1), SIZE).with_boundaries({"all": lambda x: x[0] >= 0}), order=1, rigid=[
        {**tables, "mass": 0.5, "inertia": [0.1, 0.2, 0.3, 0.0, 0.0, 0.0]}])  # fmt: skip
    assert problem.unknowns == 6
    J = MASS / 12 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) + [0.1, 0.2, 0.3]
    expected = np.sqrt(np.concatenate([np.array([1e6, 4e6, 9e6]) / (MASS + 0.5), np.array([1e3, 2e3, 4e3]) / J]))
    np.testing.assert_allclose(frequencies(problem, 6), np.sort(expected) / (2 * np.pi), rtol=1e-10)


@pytest.mark.parametrize("kind", ["hex1", "tet2"])
def test_rigid_face_by_the_null_space_of_its_constraints(kind):
    """The same eigenvalues as on an orthonormal basis of all displacements that leave the face rigid."""
    mesh = box(kind, (2, 2, 1), SIZE)
    free = make_problem(mesh, order=2, supports=[{"surface": "right", "fixed": "xyz"}])
    tied = make_problem(mesh, order=2, supports=[{"surface": "right", "fixed": "xyz"}],
                        rigid=[{"name": "cap", "surface": "left"}])  # fmt: skip
    space = free.discretisation.space
    nodes = np.unique(space.nodes_of(space.mesh.boundaries["left"]))
    R = rigid_columns(space.coordinates[nodes], np.zeros(3))
    P = np.eye(len(R)) - R @ np.linalg.pinv(R)  # of displacements of the face what is not rigid
    at = np.searchsorted(space.free, (3 * nodes[:, None] + np.arange(3)).ravel())
    C = np.zeros((len(R), free.unknowns))
    C[:, at] = P
    Z = la.null_space(C, rcond=1e-9)
    K, M = dense(free)
    assert Z.shape[1] == tied.unknowns == free.unknowns - len(R) + 6
    expected = eigenvalues(Z.T @ K @ Z, Z.T @ M @ Z, 8)
    np.testing.assert_allclose(eigenvalues(*dense(tied), 8), expected, rtol=1e-8)


@pytest.mark.parametrize(("where", "order"), [("surface", 2), ("nodes", 2), ("nodes", 3)])
def test_averaged_reference_by_a_dense_update(where, order, tmp_path):
    """Mass, inertia and springs on L u, added to the free matrices as rank-six terms, give the same eigenvalues.

    With order 3 the nodes are those of a mesh of 27-node hexahedra.
    """
    from deck_texts import deck_of

    mesh = box("hex1", (3, 3, 2) if order == 2 else (2, 1, 1), SIZE)
    (tmp_path / "a.inp").write_text(deck_of(mesh))
    loaded = fe_squeal.load_mesh(tmp_path / "a.inp")
    if order == 3:
        curved = skfem.MeshHex2.from_mesh(mesh).with_boundaries(mesh.boundaries).with_subdomains(mesh.subdomains)
        loaded = fe_squeal.from_skfem(curved)
        left = np.flatnonzero(np.isclose(loaded.mesh.doflocs[0], loaded.mesh.doflocs[0].min()))
        loaded = replace(loaded, node_groups={"N_left": NodeSet(left, left)})
    base = {"mesh": {"file": "a.inp", "order": order}, "materials": {"steel": STEEL},
            "bodies": {"block": {"material": "steel"}}, "supports": [{"surface": "right", "fixed": "xyz"}]}  # fmt: skip
    point, inertia = [-0.05, 0.02, 0.03], [2e-3, 3e-3, 4e-3, 2e-4, -1e-4, 3e-4]
    group = "left" if where == "surface" else "N_left"
    table = {"name": "knuckle", where: group, "reference": point, "mass": 0.7, "inertia": inertia,
             "springs": [{"direction": [1, 2, 0], "stiffness": 3e7},
                         {"axis": [0, 0, 1], "stiffness": 2e5}]}  # fmt: skip
    free = fe_squeal.assemble(fe_squeal.parse_scene(base), loaded)
    tied = fe_squeal.assemble(fe_squeal.parse_scene({**base, "averaged": [table]}), loaded)
    assert tied.unknowns == free.unknowns
    space = free.discretisation.space
    if where == "surface":
        patch = space.surface(loaded.mesh.boundaries["left"])
    else:
        patch = space.patch(loaded.node_groups["N_left"].nodes)
    R = rigid_columns(patch.points, np.array(point))
    W = np.repeat(patch.weights, 3)
    V = np.stack([space.along(patch.values, e).toarray() for e in np.eye(3)], axis=1).reshape(-1, free.unknowns)
    L = np.linalg.solve(R.T @ (W[:, None] * R), R.T @ (W[:, None] * V))
    xx, yy, zz, xy, xz, yz = inertia
    J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    d = np.array([1, 2, 0]) / np.sqrt(5)
    K, M = dense(free)
    K = K + 3e7 * np.outer(d @ L[:3], d @ L[:3]) + 2e5 * np.outer(L[5], L[5])
    M = M + 0.7 * L[:3].T @ L[:3] + L[3:].T @ J @ L[3:]
    np.testing.assert_allclose(eigenvalues(*dense(tied), 10), eigenvalues(K, M, 10), rtol=1e-8)


def test_held_reference_of_an_averaged_face():
    """The face deforms, but does not move in the mean: eigenvalues on the null space of L."""
    mesh = box("hex1", (3, 2, 2), SIZE)
    free = make_problem(mesh)
    tied = make_problem(mesh, averaged=[{"name": "c", "surface": "left", "fixed": "xyz rx ry rz"}])
    (tie,) = tied.discretisation.space.ties
    C = np.zeros((6, free.unknowns))
    C[:, (3 * tie.nodes[:, None] + np.arange(3)).ravel()] = tie.motion
    Z = la.null_space(C)
    K, M = dense(free)
    np.testing.assert_allclose(eigenvalues(*dense(tied), 6), eigenvalues(Z.T @ K @ Z, Z.T @ M @ Z, 6), rtol=1e-8)
    assert tied.free_motions().motions.shape[1] == 0


def test_load_on_a_reference_is_spread_as_rbe3_does():
    """Four nodes at the corners of a square of side 2: F/4 each; of a moment M about its axis M/(4 r) tangentially."""
    x = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0.0]])
    tie = averaged_tie("r", np.arange(4), x, np.zeros(3), np.zeros(6, bool), rigid_columns(x, np.zeros(3)))
    np.testing.assert_allclose((tie.motion.T @ [0, 0, 8.0, 0, 0, 0]).reshape(4, 3), [[0, 0, 2.0]] * 4, atol=1e-14)
    f = (tie.motion.T @ [0, 0, 0, 0, 0, 8.0]).reshape(4, 3)
    np.testing.assert_allclose(f, np.cross([0, 0, 1.0], x), atol=1e-14)  # 8 = 4 · √2 · |f|, |f| = √2
    # A force beside the middle: its resultant and moment about the middle stay.
    point = np.array([3.0, -2.0, 5.0])
    beside = averaged_tie("r", np.arange(4), x, point, np.zeros(6, bool), rigid_columns(x, point))
    F = np.array([1.0, -4.0, 2.0])
    f = (beside.motion.T @ [*F, 0, 0, 0]).reshape(4, 3)
    np.testing.assert_allclose(f.sum(axis=0), F, atol=1e-13)
    np.testing.assert_allclose(np.cross(x, f).sum(axis=0), np.cross(point, F), atol=1e-12)


@pytest.mark.parametrize(
    ("fixed", "held", "free"),
    [("xyz rx ry rz", "", 12), ("x", "", 17), ("xyz rz", "", 14), ("xyz rx ry rz", "bottom_b", 6),
     ("", "bottom_b", 12)],
)  # fmt: skip
def test_parts_whose_mean_motion_is_held_move_against_each_other(fixed, held, free):
    """Of six motions of each of three parts the held freedoms of their mean take one each: K is zero on all others."""
    blocks = join(*(box("hex1", (1, 1, 1), SIZE, (0.12 * i, 0.01 * i, 0.0), name) for i, name in enumerate("abc")))
    tops = np.concatenate([blocks.boundaries[f"top_{name}"] for name in "abc"])
    mesh = replace(blocks, _boundaries={**blocks.boundaries, "tops": tops})
    supports = [{"surface": held, "fixed": "xyz"}] if held else []
    problem = make_problem(mesh, order=1, supports=supports,
                           averaged=[{"name": "ref", "surface": "tops", "fixed": fixed}])  # fmt: skip
    K, M = dense(problem)
    theta = la.eigh(K, M, eigvals_only=True)
    assert (np.abs(theta) < 1e-9 * theta[-1]).sum() == free
    Z = problem.free_motions().motions
    assert Z.shape[1] == np.linalg.matrix_rank(Z) == free
    assert np.abs(K @ Z).max() < 1e-12 * np.abs(K).max() * np.abs(Z).max()


def test_thousands_of_averaged_nodes_stay_sparse():
    """B of 2 500 nodes: L u = 0 for its basis, its inverse is exact, and it has some 6 log₂ m entries in a row."""
    m = 2500
    grid = np.linspace(0, 1, 50)
    x = np.stack([*map(np.ravel, np.meshgrid(grid, grid)), np.zeros(m)], axis=1)
    tie = averaged_tie("r", np.arange(m), x, x.mean(axis=0), np.zeros(6, bool), rigid_columns(x, x.mean(axis=0)))
    B = tie.block
    assert B.shape == (3 * m, 3 * m) and B.nnz < 3 * m * (24 + 6 * np.log2(m))
    E = tie.inverse @ B
    assert abs(E - sp.eye_array(3 * m)).max() < 1e-10
    waves = B[:, :-6]
    assert np.abs(tie.motion @ waves).max() < 1e-12
    np.testing.assert_allclose(tie.motion @ B[:, -6:].toarray(), tie.freedoms[:, -6:].toarray(), atol=1e-10)


def test_stiffness_with_an_averaged_face_stays_sparse():
    """A face of 400 nodes, whose 1200 unknowns would be coupled in full: K has three times the entries, not eight."""
    mesh = box("hex1", (2, 19, 19), SIZE)
    ties = [], [{"name": "a", "surface": "left"}]
    free, tied = (make_problem(mesh, order=1, averaged=tie).pencil().K.nnz for tie in ties)
    assert free < tied < 3.5 * free < 0.6 * (free + 1200**2)


def test_parts_in_one_rigid_body_move_together():
    """Two blocks apart, tied at one face each: six free motions instead of twelve; with its reference held none."""
    mesh = join(box("hex1", (2, 1, 1), SIZE, name="a"), box("hex1", (2, 1, 1), SIZE, (0.3, 0, 0), name="b"))
    facets = np.concatenate([mesh.boundaries["right_a"], mesh.boundaries["left_b"]])
    mesh = mesh.with_boundaries({"both": np.sort(facets)})
    assert make_problem(mesh).free_motions().motions.shape[1] == 12
    tied = make_problem(mesh, rigid=[{"name": "r", "surface": "both", "mass": 2.0}])
    assert tied.free_motions().motions.shape[1] == 6
    assert abs(tied.pencil().K @ tied.free_motions().motions).max() < 1e-9 * abs(tied.pencil().K).max()
    held = make_problem(mesh, rigid=[{"name": "r", "surface": "both", "fixed": "xyz rx ry rz"}])
    assert held.free_motions().motions.shape[1] == 0


def blocks_pinned(pinned, **rigid):
    """Two blocks side by side, the first one clamped, with corners (y, z) of the faces that touch made rigid: first
    those of the first block, then those of the other one."""
    mesh = join(box("hex1", (2, 1, 1), SIZE, name="a"), box("hex1", (2, 1, 1), SIZE, (SIZE[0], 0, 0), name="b"))
    loaded = fe_squeal.from_skfem(mesh)
    mesh = loaded.mesh
    own = np.isin(np.arange(mesh.nvertices), mesh.t[:, mesh.subdomains["b"]])
    corner = [(i, SIZE[0], SIZE[1] * y, SIZE[2] * z) for i, side in enumerate(pinned) for y, z in side]
    nodes = np.sort([np.abs(np.vstack([own, mesh.p]).T - c).sum(axis=1).argmin() for c in corner])
    loaded = replace(loaded, node_groups={"PIN": NodeSet(nodes, nodes)})
    scene = {"mesh": {"file": "none.msh", "order": 1}, "materials": {"steel": STEEL},
             "bodies": {name: {"material": "steel"} for name in "ab"},
             "supports": [{"surface": "left_a", "fixed": "xyz"}],
             "rigid": [{"name": "pin", "nodes": "PIN", **rigid}]}  # fmt: skip
    return fe_squeal.assemble(fe_squeal.parse_scene(scene), loaded)


CORNERS = [(0, 0), (1, 0), (0, 1), (1, 1)]


@pytest.mark.parametrize(
    ("pinned", "rigid", "turns"),
    [
        (([(0, 0)], [(0, 0)]), {}, 3), (([(0, 0)], [(0, 0)]), {"reference": [0.0, 0.0, 0.5]}, 3),
        ((CORNERS, [(1, 0)]), {}, 3), ((CORNERS, CORNERS[:2]), {}, 1), ((CORNERS, CORNERS[:3]), {}, 0),
        ((CORNERS, CORNERS[:2]), {"fixed": "xyz rx ry rz"}, 1),
    ],
)  # fmt: skip
def test_a_rigid_body_with_a_point_or_a_line_of_a_block_is_a_joint(pinned, rigid, turns):
    """A pin leaves three rotations of the other block, a hinge one: as many zeros as K has, and they are told."""
    problem = blocks_pinned(pinned, **rigid)
    stiff = np.linalg.eigvalsh(dense(problem)[0])
    found = problem.free_motions().motions
    assert np.count_nonzero(np.abs(stiff) < 1e-9 * stiff[-1]) == turns == found.shape[1]
    assert problem.is_held() == (not turns)
    told = free_motion_warnings(problem)
    assert len(told) == bool(turns) and all("body b turns about" in line and "body a" not in line for line in told)


def test_a_free_rigid_part_beside_an_elastic_one():
    """All nodes of one block rigid and free: six modes at zero exactly, then those of the other one alone, to rounding.

    What is left of the stiffness of its elements is rounding; beside its small mass that would be a frequency.
    """
    elastic, small = box("hex2", (2, 1, 1), SIZE, name="a"), box("hex2", (1, 1, 1), (1e-3,) * 3, (0.3, 0, 0), name="b")
    mesh = join(elastic, small)
    cells = mesh.subdomains["b"]
    mesh = mesh.with_boundaries({"skin": np.flatnonzero(np.isin(mesh.f2t[0], cells) & (mesh.f2t[1] < 0))})
    held = [{"surface": "left_a", "fixed": "xyz"}]
    tied = make_problem(mesh, order=1, supports=held, rigid=[{"name": "r", "surface": "skin"}])
    found = frequencies(tied, 9)
    np.testing.assert_array_equal(found[:6], 0)
    alone = make_problem(mesh, order=1, supports=[*held, {"surface": "skin", "fixed": "xyz"}])
    np.testing.assert_allclose(found[6:], frequencies(alone, 3), rtol=1e-9)


def test_forces_through_a_rigid_cap_are_in_balance():
    """A pressure on one end, a spring at the reference of the other: it carries all of it."""
    mesh = box("hex1", (3, 2, 2), SIZE)
    cap = {"name": "cap", "surface": "left", "fixed": "yz rx ry rz", "reference": [0.0, 0.03, 0.02],
           "springs": [{"direction": [1, 0, 0], "stiffness": 1e8}]}  # fmt: skip
    (part,) = force_balance(make_problem(mesh, rigid=[cap], effects={"preload": {"pressures": {"right": 2e6}}}))
    force = 2e6 * SIZE[1] * SIZE[2]
    np.testing.assert_allclose(part.applied, [-force, 0, 0], atol=1e-9 * force)
    np.testing.assert_allclose(part.springs["cap.0"], [force, 0, 0], rtol=1e-8)
    assert part.residual < 1e-8


def test_numbers_of_a_reference_can_be_swept():
    """Mass and springs recombine; the place of the reference does not move with a problem."""
    mesh = box("hex1", (2, 1, 1), SIZE)
    table = {"name": "r", "surface": "left", "mass": 0.5, "reference": [0.0, 0.0, 0.0],
             "springs": [{"direction": [1, 0, 0], "stiffness": 1e6}]}  # fmt: skip
    problem = make_problem(mesh, rigid=[table])
    assert problem.is_affine("rigid.r.springs.0.stiffness") and problem.is_affine("rigid.r.mass")
    other = make_problem(mesh, rigid=[{**table, "mass": 2.0, "springs": [{"direction": [1, 0, 0], "stiffness": 5e6}]}])
    same = problem.at({"rigid.r.mass": 2.0, "rigid.r.springs.0.stiffness": 5e6})
    for A, B in zip(dense(same), dense(other), strict=True):
        np.testing.assert_allclose(A, B, atol=1e-12 * np.abs(B).max())
    with pytest.raises(SceneError, match="expected another scene"):
        problem.at({"rigid.r.reference.0": 0.1})


@pytest.mark.parametrize(("tables", "message"), [
    ({"rigid": [{"name": "a", "surface": "left"}, {"name": "b", "surface": "bottom"}]},
     r'rigid\[1\].surface: "bottom" shares \d+ nodes with rigid\[0\]'),
    ({"rigid": [{"name": "a", "surface": "left"}], "supports": [{"surface": "bottom", "fixed": "x"}]},
     r'rigid\[0\].surface: \[\[supports\]\] hold \d+ nodes of "left"'),
    ({"rigid": [{"name": "a", "surface": "left"}, {"name": "a", "surface": "right"}]}, "expected different names"),
    ({"rigid": [{"name": "a", "surface": "left", "fixed": "xx"}]}, "each once"),
    ({"rigid": [{"name": "a", "surface": "left", "fixed": "xyzw"}]}, "expected any of x, y, z, rx"),
    ({"averaged": [{"name": "a", "surface": "left", "inertia": [1.0, 1.0, -3.0, 0.0, 0.0, 0.0]}]}, "negative moment"),
    ({"averaged": [{"name": "a", "surface": "lefft"}]}, r'averaged\[0\].surface: .* did you mean "left"'),
])  # fmt: skip
def test_messages(tables, message):
    with pytest.raises(fe_squeal.errors.InputError, match=message):
        make_problem(box("hex1", (2, 1, 1), SIZE), **tables)


def test_spring_between_large_faces_stays_sparse_and_is_the_same(monkeypatch):
    """Springs between two faces of 49 nodes, of which one has a held edge: by their means as unknowns, and in full."""
    a, b = box("hex1", (1, 6, 6), SIZE, name="a"), box("hex1", (1, 6, 6), SIZE, (0.2, 0, 0), name="b")
    mesh = join(a, b)
    springs = [{"name": n, "surface": "right_a", "to": "left_b", "direction": d, "stiffness": s}
               for n, d, s in (("u", [1, 0, 0], 1e8), ("v", [0, 1, 2], 3e7))]  # fmt: skip
    supports = [{"surface": "left_a", "fixed": "xyz"}, {"surface": "bottom_b", "fixed": "z"}]
    found = []
    for many in (40, 10**9):
        monkeypatch.setattr("fe_squeal.assembly.ties._MANY", many)
        problem = make_problem(mesh, order=1, springs=springs, supports=supports)
        entries = max(t.matrix.nnz for t in problem.terms if t.name.startswith("spring"))
        found.append((frequencies(problem, 6), problem.unknowns, entries, problem.free_motions().motions.shape[1]))
    (sparse, n, few, free), (full, m, many, as_free) = found
    assert n == m and few <= 16 < 49**2 < many and free == as_free
    np.testing.assert_allclose(sparse, full, rtol=1e-7, atol=1e-6 * full.max())
