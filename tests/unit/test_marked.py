"""Tetrahedra refined where they are marked: the same domain and groups, no hanging nodes, good shapes, nested fields.

This file is longer than others, since all properties are checked on the same meshes.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import skfem
from deck_texts import deck_of
from renumbering import renumbered
from selection import some
from test_refining import bent

import fe_squeal
from fe_squeal import from_skfem
from fe_squeal.accuracy import with_discretisation
from fe_squeal.accuracy.prolongation import reference_coordinates
from fe_squeal.errors import MeshError
from fe_squeal.fem.contact import interpolation
from fe_squeal.geometry import Block, make_mesh
from fe_squeal.mesh import load_mesh
from fe_squeal.mesh.building import build_mesh
from fe_squeal.mesh.elements import REFERENCE
from fe_squeal.mesh.groups import NodeSet
from fe_squeal.mesh.marked import refine_marked
from fe_squeal.mesh.measures import area_of, volume_of
from fe_squeal.mesh.refining import refine
from fe_squeal.mesh.subdividing import vtk_nodes
from fe_squeal.mesh.writing import write_loaded
from meshes import BELT, annulus, box, distorted, frequencies, join, make_problem

EXAMPLES = Path(__file__).parents[2] / "examples"
PAD = {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2600.0}
SUPPORTS = [{"surface": "left", "fixed": "xyz"}, {"surface": "top", "fixed": "y"}]


def marks(mesh, seed=0, part=0.15):
    rng = np.random.default_rng(seed)
    return rng.choice(mesh.nelements, max(1, int(part * mesh.nelements)), replace=False)


def near_edge(mesh):
    """Elements at the edge x = z = 0 of a box."""
    on = (np.abs(mesh.p[0]) < 1e-12) & (np.abs(mesh.p[2]) < 1e-12)
    return np.flatnonzero(on[mesh.t].any(axis=0))


def worst_shape(mesh):
    """Three times the inradius over the circumradius, 1 of the regular tetrahedron, of the worst element."""
    x = mesh.p[:, mesh.t].transpose(2, 1, 0)
    six = np.abs(np.linalg.det(x[:, 1:] - x[:, :1]))
    area = sum(np.linalg.norm(np.cross(x[:, b] - x[:, a], x[:, c] - x[:, a]), axis=1) / 2
               for a, b, c in ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)))  # fmt: skip
    products = [np.linalg.norm(x[:, a] - x[:, b], axis=1) * np.linalg.norm(x[:, c] - x[:, d], axis=1)
                for a, b, c, d in ((0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2))]  # fmt: skip
    p, q, r = products
    circumradius = np.sqrt((p + q + r) * (p + q - r) * (p - q + r) * (-p + q + r)) / 4 / six
    return float((3 * (six / 2 / area) / circumradius).min())


def nested(coarse, fine, parents):
    """The operator that writes a displacement on the coarse mesh as one on the fine one."""
    a, b = (p.discretisation.space for p in (coarse, fine))
    parent = np.empty(b.nodes, int)
    parent[b.dofs.element_dofs] = parents
    values = interpolation(a, parent, reference_coordinates(a, parent, b.coordinates.T))
    return lambda u: b.gather(values @ a.expand(u))


@pytest.mark.parametrize("kind", ["tet1", "tet2"])
def test_same_domain_and_groups(kind):
    """Volumes parent by parent, group by group; areas; the groups of the six sides hold the whole boundary and no more,
    which a gap between two elements or a hanging node would add to."""
    coarse = from_skfem(bent(kind))
    half = np.flatnonzero(coarse.mesh.p[0, coarse.mesh.t].mean(axis=0) < 1.0)
    inside = np.flatnonzero(coarse.mesh.f2t[1] >= 0)[::7]
    coarse = replace(coarse, mesh=replace(
        coarse.mesh, _subdomains={**coarse.mesh.subdomains, "half": half},
        _boundaries={**coarse.mesh.boundaries, "inside": inside}))  # fmt: skip
    fine, parents = refine_marked(coarse, marks(coarse.mesh))
    assert (np.diff(parents) >= 0).all() and set(parents) == set(range(coarse.mesh.nelements))
    for i in range(0, coarse.mesh.nelements, 7):
        whole, centre = volume_of(coarse.mesh, np.array([i]))
        parts, same = volume_of(fine.mesh, np.flatnonzero(parents == i))
        assert parts == pytest.approx(whole, rel=1e-12)
        np.testing.assert_allclose(same, centre, rtol=1e-11)
    for name, elements in coarse.mesh.subdomains.items():
        np.testing.assert_array_equal(fine.mesh.subdomains[name], np.flatnonzero(np.isin(parents, elements)))
    for name in coarse.mesh.boundaries:
        if name == "inside" and kind == "tet2":
            continue  # scikit-fem finds no points on bent faces inside
        # Areas of faces that are not flat are integrals of roots, by quadrature; area vectors ∫ n dA of polynomials.
        before, after = (area_of(m.mesh, m.mesh.boundaries[name]) for m in (coarse, fine))
        assert after[0] == pytest.approx(before[0], rel=1e-13 if kind == "tet1" else 3e-4)
        if name != "inside":
            np.testing.assert_allclose(after[0] * after[2], before[0] * before[2], atol=1e-13)
    sides = np.concatenate([f for name, f in fine.mesh.boundaries.items() if name != "inside"])
    np.testing.assert_array_equal(np.sort(sides), fine.mesh.boundary_facets())
    assert (fine.mesh.f2t[1, fine.mesh.boundaries["inside"]] >= 0).all()


@pytest.mark.parametrize("kind", ["tet1", "tet2"])
def test_marked_elements_become_eight_and_far_ones_stay(kind):
    coarse = from_skfem(box(kind, (4, 4, 4)))
    fine, parents = refine_marked(coarse, np.array([0]))
    counts = np.bincount(parents)
    assert counts[0] == 8 and (counts > 1).sum() < 0.15 * len(counts)
    _, parents = refine_marked(coarse, np.arange(len(counts)))
    assert (np.bincount(parents) == 8).all()
    for halvings in (1, 2):
        few, parents = refine_marked(coarse, np.array([0]), halvings)
        assert np.bincount(parents)[0] == 2**halvings and few.mesh.nelements < fine.mesh.nelements
    same, parents = refine_marked(coarse, np.array([], int))
    np.testing.assert_array_equal(parents, np.arange(len(counts)))
    for mesh in (fine, same):  # nodes of elements that are not cut stay where they are to the last bit
        places = [{tuple(x) for x in m.mesh.doflocs.T.tolist()} for m in (coarse, mesh)]
        assert places[0] <= places[1] and (mesh is fine or places[0] == places[1])


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("kind", ["tet1", "tet2"])
def test_a_coarse_field_is_a_fine_one(kind, order):
    """Energy and mass of any field are the same on both: no node hangs, and spaces are nested."""
    mesh = from_skfem(box(kind, (2, 2, 1), (1.0, 0.8, 0.5)))
    refined, parents = refine_marked(mesh, marks(mesh.mesh, 1))
    coarse, fine = (make_problem(m.mesh, order, supports=SUPPORTS) for m in (mesh, refined))
    E = nested(coarse, fine, parents)
    u = np.random.default_rng(3).standard_normal((coarse.unknowns, 4))
    v = np.stack([E(x) for x in u.T], axis=1)
    for name in "MK":
        A, B = (getattr(p.pencil(), name) for p in (coarse, fine))
        energy = u.T @ (A @ u)
        np.testing.assert_allclose(v.T @ (B @ v), energy, atol=1e-11 * energy.max())


def test_children_lie_where_the_parents_own_maps_put_them():
    """Against the straight mesh of the same corners, refined alike: its nodes, carried over by scikit-fem's maps."""
    curved = from_skfem(bent("tet2"))
    corners = curved.mesh.doflocs[:, : curved.mesh.t.max() + 1]
    straight = from_skfem(skfem.MeshTet2.from_mesh(skfem.MeshTet1(corners, curved.mesh.t)))
    fine, parents = refine_marked(curved, marks(curved.mesh))
    flat, same = refine_marked(straight, marks(curved.mesh))
    np.testing.assert_array_equal(parents, same)
    for i in range(10):
        places = flat.mesh.doflocs[:, flat.mesh.dofs.element_dofs[i]]
        X = straight.mesh.mapping().invF(places[:, :, None], tind=parents)
        expected = curved.mesh.mapping().F(X, tind=parents)[:, :, 0]
        np.testing.assert_allclose(fine.mesh.doflocs[:, fine.mesh.dofs.element_dofs[i]], expected, atol=1e-12)


def test_circles_stay_as_round_as_they_were():
    mesh = annulus("tet2", (1, 12, 1), 1.0, 2.0, 0.2)
    rim = np.unique(mesh.dofs.get_facet_dofs(mesh.boundaries["rim"]).flatten())
    x = mesh.doflocs.copy()
    x[:2, rim] *= 2 / np.linalg.norm(x[:2, rim], axis=0)
    loaded = from_skfem(replace(mesh, doflocs=x))
    for seed in range(2):
        loaded, _ = refine_marked(loaded, marks(loaded.mesh, seed))
    rim = np.unique(loaded.mesh.dofs.get_facet_dofs(loaded.mesh.boundaries["rim"]).flatten())
    radius = np.linalg.norm(loaded.mesh.doflocs[:2, rim], axis=0)
    assert np.abs(radius / 2 - 1).max() < (np.pi / 12) ** 4 / 8  # a parabola through three points of a circle


def at_random(mesh):
    return marks(mesh, mesh.nelements, 0.03)


def at_first_corner(mesh):
    return np.flatnonzero((mesh.t == 0).any(axis=0))


@pytest.mark.parametrize(("mesh", "where"), some([
    (box("tet1", (2, 1, 1), (1, 0.5, 0.5)), near_edge),
    (distorted(box("tet1", (3, 3, 3)), 0.1), at_first_corner),
    (annulus("tet1", (1, 12, 1), 1, 2, 0.3), at_random),
    (box("tet1", (3, 3, 1), (1, 1, 0.2)), near_edge),
], lambda mesh, where: mesh.nelements not in (54, 72)), ids=["edge", "corner", "random", "flat"])  # fmt: skip
def test_shapes_settle(mesh, where):
    """After six rounds the worst element is no worse than after four, wherever elements were marked."""
    loaded, worst = from_skfem(mesh), []
    for _ in range(6):
        loaded, _ = refine_marked(loaded, where(loaded.mesh))
        worst.append(worst_shape(loaded.mesh))
    assert worst[5] > 0.999999 * worst[3] > 0.2 * worst_shape(mesh)
    sizes = np.ptp(loaded.mesh.p[:, loaded.mesh.t], axis=1).max(axis=0)
    assert sizes.min() < sizes.max() / 8 and loaded.mesh.nelements > 500


def test_one_tetrahedron_has_parts_of_finitely_many_shapes():
    """Four marked at random in each round: longest edges would bring new shapes every time."""
    point = np.random.default_rng(0).random((3, 4))
    loaded, found = from_skfem(skfem.MeshTet1(point, np.arange(4)[:, None])), []
    for seed in range(8):
        many = loaded.mesh.nelements
        four = np.random.default_rng(seed).choice(many, min(4, many), replace=False)
        loaded, _ = refine_marked(loaded, four, 3 + seed % 2)
        x = loaded.mesh.p[:, loaded.mesh.t].transpose(2, 1, 0)
        sides = np.sort([np.linalg.norm(x[:, a] - x[:, b], axis=1) for a in range(4) for b in range(a)], axis=0)
        size = np.cbrt(np.abs(np.linalg.det(x[:, 1:] - x[:, :1])))
        found.append(len(np.unique((sides / size).round(6), axis=1).T))
    assert 12 < found[-1] == found[-2] == found[-3] <= 72 and loaded.mesh.nelements > 2000


def test_uniform_refinement_between_and_other_meshes():
    """What is known of the cuts belongs to one mesh: on another one they begin anew, at longest edges."""
    once, _ = refine_marked(from_skfem(box("tet1", (2, 2, 2))), np.arange(5))
    between = refine(once)
    other = from_skfem(box("tet1", (3, 3, 3)))
    mixed, _ = renumbered(once.mesh, 1)
    for loaded in (between, replace(once, mesh=other.mesh), replace(once, mesh=mixed)):
        fresh = from_skfem(loaded.mesh)
        (a, parents), (b, same) = (refine_marked(some, np.array([7])) for some in (loaded, fresh))
        np.testing.assert_array_equal(parents, same)
        np.testing.assert_array_equal(a.mesh.p, b.mesh.p)
    again, _ = refine_marked(once, np.arange(5))
    begun, _ = refine_marked(replace(once, bisection=other.bisection), np.arange(5))
    assert again.mesh.nelements > once.mesh.nelements < begun.mesh.nelements
    for mesh in (again.mesh, begun.mesh):
        assert len(mesh.boundary_facets()) == len(np.unique(np.concatenate(list(mesh.boundaries.values()))))


@pytest.mark.parametrize("kind", ["tet1", "tet2"])
def test_node_sets_hold_as_their_faces_and_keep_their_nodes(tmp_path, kind):
    """As of uniform refinement: held are all nodes between those of the set, but the set has no more than it had."""
    (tmp_path / "box.inp").write_text(deck_of(box(kind, (3, 2, 2), (0.1, 0.06, 0.04))))
    coarse = load_mesh(tmp_path / "box.inp")
    one = np.array([coarse.mesh.t[0, 0]])
    coarse = replace(coarse, node_groups={**coarse.node_groups, "one": NodeSet(one, one)})
    fine, _ = refine_marked(coarse, marks(coarse.mesh, 2))
    for name, group in coarse.node_groups.items():
        where = [{tuple(x) for x in m.mesh.doflocs[:, m.node_groups[name].nodes].T.round(9)} for m in (coarse, fine)]
        assert where[0] == where[1] and len(where[0]) == len(group.nodes)
    for order in (1, 2):
        support = {"surface": "left", "fixed": "xz"}
        space = make_problem(fine.mesh, order, supports=[support]).discretisation.space
        nodes = space.nodes_at(fine.node_groups["N_left"].held, between=True)
        np.testing.assert_array_equal(np.flatnonzero(space.fixed) // 3, np.repeat(np.sort(nodes), 2))


def test_what_the_file_said_stays():
    loaded = from_skfem(box("tet1", (2, 1, 1)))
    labels = np.char.add("PAD-1.", np.arange(loaded.mesh.nelements).astype(str))
    loaded = replace(
        loaded, notes=("a",), warnings=("b",), unusable={"c": "d"}, ignore_case=True, length_unit="mm",
        element_labels=labels,
    )  # fmt: skip
    fine, parents = refine_marked(loaded, np.array([3]))
    assert (fine.notes, fine.warnings, fine.unusable, fine.ignore_case, fine.length_unit, fine.source) == (
        ("a",), ("b",), {"c": "d"}, True, "mm", loaded.source)  # fmt: skip
    np.testing.assert_array_equal(fine.element_labels, labels[parents])


@pytest.mark.parametrize("kind", ["tet1", "tet2"])
def test_bodies_that_touch_without_common_nodes_stay_apart(kind):
    """Only the marked one is cut, and both sides of the contact keep their areas."""
    pad, disc = box(kind, (2, 2, 1), corner=(0, 0, 1), name="pad"), box(kind, (2, 2, 1), name="disc")
    loaded = from_skfem(join(pad, disc))
    fine, parents = refine_marked(loaded, loaded.mesh.subdomains["pad"][:3])
    assert len(fine.mesh.subdomains["disc"]) == disc.nelements < len(fine.mesh.subdomains["pad"])
    assert not np.isin(parents[fine.mesh.subdomains["pad"]], loaded.mesh.subdomains["disc"]).any()
    both = [np.unique(fine.mesh.t[:, fine.mesh.subdomains[name]]) for name in ("pad", "disc")]
    assert not len(np.intersect1d(*both))
    for name in ("bottom_pad", "top_disc"):
        assert area_of(fine.mesh, fine.mesh.boundaries[name])[0] == pytest.approx(1, rel=1e-13)


def test_patch():
    """A linear displacement needs no forces on the inside."""
    fine, _ = refine_marked(from_skfem(distorted(box("tet1", (3, 3, 3)), 0.05)), near_edge(box("tet1", (3, 3, 3))))
    problem = make_problem(fine.mesh, 2)
    space = problem.discretisation.space
    u = space.gather(space.coordinates @ np.random.default_rng(2).standard_normal((3, 3)))
    forces = np.abs(space.expand(problem.pencil().K @ u))
    inside = np.setdiff1d(np.arange(space.nodes), space.nodes_of(fine.mesh.boundary_facets()))
    assert len(inside) > 100 and forces[inside].max() < 1e-12 * forces.max()


def test_frequencies_fall_under_refinement():
    """Each space holds the one before, so that no frequency rises."""
    loaded, found = from_skfem(box("tet1", (3, 2, 1), (1.0, 0.5, 0.2))), []
    for halvings in (3, 1, 1, 2):
        found.append(frequencies(make_problem(loaded.mesh, 1, supports=SUPPORTS[:1]), 4))
        loaded, _ = refine_marked(loaded, near_edge(loaded.mesh), halvings)
    assert (np.diff(found, axis=0) < 0).all() and (found[-1] > 0.5 * found[0]).all()


@pytest.mark.slow
def test_a_refined_scene_is_swept_with_error_bars(tmp_path):
    """From a file of the mesh that was refined at the leading edge of the contact: assembled, swept, estimated."""
    loaded = from_skfem(box("tet1", (3, 2, 1), (0.08, 0.05, 0.03)))
    refined, _ = refine_marked(loaded, near_edge(loaded.mesh))
    scene = fe_squeal.parse_scene({
        "mesh": {"file": "none.msh", "order": 1}, "materials": {"lining": PAD},
        "bodies": {"block": {"material": "lining"}},
        "contacts": [{"name": "belt", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e11,
                      "sliding": BELT}],
        "springs": [{"name": "piston", "surface": "top", "direction": [0.3, 0, 1], "stiffness": 2e7},
                    {"name": "a", "surface": "right", "direction": [1, 0, 0], "stiffness": 4e7},
                    {"name": "c", "surface": "right", "direction": [0, 1, 0], "stiffness": 4e7}],
        "effects": {"friction": {"mu": 0.3}},
    })  # fmt: skip
    read = load_mesh(write_loaded(refined, tmp_path / "refined.msh"))
    found = []
    for mesh in (loaded, refined, read):
        problem = fe_squeal.assemble(scene, mesh)
        found.append(with_discretisation(fe_squeal.sweep(problem, np.linspace(0, 1, 4), modes=6)))
    coarse, fine, again = (np.array([p.modes.frequency_hz[:5] for p in result.points]) for result in found)
    np.testing.assert_allclose(again, fine, rtol=1e-9)
    assert (fine[0] < coarse[0]).all()  # without friction each space holds the one before
    bars = [np.array([p.discretisation.imag[:5] for p in result.points]) for result in found]
    assert np.isfinite(bars[1]).mean() > 0.9 and (bars[1][0] < bars[0][0]).all() and (bars[1][0] > 0).all()


def test_imported_meshes(tmp_path):
    """Of gmsh, with a block on a belt; hexahedra are refused with what to do."""
    block = Block(length=0.08, width=0.04, height=0.015, size=0.02, element="tet")
    coarse = build_mesh(make_mesh(block), "block.msh")
    fine, _ = refine_marked(coarse, marks(coarse.mesh))
    assert list(fine.mesh.boundaries) == list(coarse.mesh.boundaries)
    for name, facets in coarse.mesh.boundaries.items():
        assert area_of(fine.mesh, fine.mesh.boundaries[name])[0] == pytest.approx(area_of(coarse.mesh, facets)[0])
    np.testing.assert_array_equal(
        np.sort(np.concatenate(list(fine.mesh.boundaries.values()))).size, len(fine.mesh.boundary_facets())
    )
    assert worst_shape(fine.mesh) > 0.2 * worst_shape(coarse.mesh)
    with pytest.raises(MeshError, match=r"small_brake.inp: .* these are hexahedra; refine them by direction"):
        refine_marked(load_mesh(EXAMPLES / "small_brake.inp", "mm"), np.array([0]))


@pytest.mark.parametrize("bad", [-1, 40])
def test_elements_that_do_not_exist(bad):
    loaded = from_skfem(skfem.MeshTet().refined(1))
    with pytest.raises(MeshError, match=rf"no element {bad} to refine; expected 0 to 39"):
        refine_marked(loaded, np.array([0, bad]))


def test_an_element_that_folds_between_its_corners_is_named():
    """Its Jacobian is positive at corners and quadrature points, which are all that is checked of a mesh."""
    mesh = skfem.MeshTet2.from_mesh(skfem.MeshTet1(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]).T,
                                                   np.arange(4)[:, None]))  # fmt: skip
    middles = REFERENCE["tetra10"][4:]
    moved = [[0.04, -0.08, 0.09], [0.06, -0.11, -0.14], [0.03, 0.08, 0.08], [-0.08, 0.05, 0.34], [-0.05, 0.24, -0.29],
             [0.26, 0.31, -0.17]]  # fmt: skip
    x = mesh.doflocs.copy()
    for at, by in zip(middles, moved, strict=True):
        x[:, int(np.linalg.norm(mesh.doflocs.T - at, axis=1).argmin())] += by
    loaded = replace(from_skfem(replace(mesh, doflocs=x)), element_labels=np.array(["PAD-1.7"]))
    with pytest.raises(MeshError, match=r"PAD-1\.7.* inverted or too distorted"):
        refine_marked(loaded, np.array([0]))


def test_a_mask_is_no_list_of_elements():
    loaded = from_skfem(skfem.MeshTet().refined(1))
    with pytest.raises(MeshError, match="of type bool; expected their numbers"):
        refine_marked(loaded, np.ones(40, bool))


def test_right_handed_nodes():
    """scikit-fem's sorted corners come back in an order of positive volume."""
    mesh = bent("tet1")
    kind, nodes = vtk_nodes(mesh)
    x = mesh.p.T[nodes]
    assert kind == "tetra" and (np.linalg.det(x[:, 1:] - x[:, :1]) > 0).all()
