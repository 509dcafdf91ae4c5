"""Meshes written and read back: places, groups, surfaces, node sets, frequencies; Gmsh finds the same volumes."""

from dataclasses import replace

import gmsh
import numpy as np
import pytest
from deck_texts import deck_of
from selection import some
from test_marked import marks
from test_refining import bent

import fe_squeal
from fe_squeal import from_skfem
from fe_squeal.errors import MeshError, OutputError
from fe_squeal.mesh import load_mesh
from fe_squeal.mesh.building import build_mesh
from fe_squeal.mesh.elements import REFERENCE
from fe_squeal.mesh.groups import NodeSet
from fe_squeal.mesh.marked import refine_marked
from fe_squeal.mesh.measures import area_of, volume_of
from fe_squeal.mesh.node_sets import find_nodes
from fe_squeal.mesh.raw import CellBlock, RawMesh
from fe_squeal.mesh.refining import refine
from fe_squeal.mesh.writing import write_loaded
from meshes import KINDS, STEEL, box, frequencies, join, make_problem


def with_more(mesh):
    """Groups that overlap, facets inside, elements in no group, and a node set whose held nodes are others."""
    half = np.flatnonzero(mesh.p[0, mesh.t].mean(axis=0) < 1.0)
    inside = np.flatnonzero(mesh.f2t[1] >= 0)[::5]
    both = np.union1d(mesh.boundaries["left"], mesh.boundaries["top"])
    loaded = from_skfem(replace(
        mesh, _subdomains={"half": half, "some": half[::2], "one": half[:1]},
        _boundaries={**mesh.boundaries, "inside": inside, "both": both}))  # fmt: skip
    nodes = np.unique(mesh.t[:2, 0])
    more = np.union1d(nodes, mesh.t[0, -1:])  # too few for a face of the boundary, which would be a surface group too
    return replace(loaded, node_groups={"points": NodeSet(nodes, more), "two words": NodeSet(more[:1], more[:1])})


def places(mesh, columns):
    return sorted(map(tuple, mesh.doflocs[:, columns].T.tolist()))


def same(loaded, again):
    """Compare groups by their members' places, which are unique."""
    for old, new, of in (("subdomains", "t", volume_of), ("boundaries", "facets", area_of)):
        before, after = (getattr(m.mesh, old) for m in (loaded, again))
        assert set(before) == set(after)
        for name in before:
            found = [np.sort(m.mesh.p[:, getattr(m.mesh, new)[:, g[name]]].mean(axis=1)[0])
                     for m, g in ((loaded, before), (again, after))]  # fmt: skip
            np.testing.assert_allclose(found[1], found[0], rtol=1e-14, atol=1e-15)
            if name != "inside":
                sizes = [of(m.mesh, g[name])[0] for m, g in ((loaded, before), (again, after))]
                assert sizes[1] == pytest.approx(sizes[0], rel=1e-13)


@pytest.mark.parametrize("kind", some(KINDS, lambda kind: kind != "hex2"))
def test_everything_reads_back(tmp_path, kind):
    loaded = with_more(bent(kind))
    again = load_mesh(write_loaded(loaded, tmp_path / "bent.msh"))
    assert type(again.mesh) is type(loaded.mesh) and list(tmp_path.iterdir()) == [tmp_path / "bent.msh"]
    np.testing.assert_array_equal(*(np.unique(m.mesh.doflocs, axis=1) for m in (loaded, again)))
    same(loaded, again)
    assert set(again.node_groups) == {"points", "two words"}
    for name, group in loaded.node_groups.items():
        for which in ("nodes", "held"):
            assert places(again.mesh, getattr(again.node_groups[name], which)) == places(
                loaded.mesh, getattr(group, which))  # fmt: skip
    millimetres = load_mesh(write_loaded(loaded, tmp_path / "mm.msh", "mm"), "mm")
    np.testing.assert_allclose(millimetres.mesh.p, again.mesh.p, rtol=1e-15)


@pytest.mark.parametrize("kind", some(KINDS, lambda kind: kind == "tet2"))
def test_gmsh_finds_the_same_volumes(tmp_path, kind):
    """Element by element in gmsh's own maps, so that the order of all nodes is right; facets too."""
    loaded = from_skfem(bent(kind))
    write_loaded(loaded, tmp_path / "bent.msh")
    gmsh.initialize(["", "-v", "1"], interruptible=False)
    try:
        gmsh.open(str(tmp_path / "bent.msh"))
        names = {gmsh.model.getPhysicalName(d, tag): (d, tag) for d, tag in gmsh.model.getPhysicalGroups()}
        for groups, of in ((loaded.mesh.subdomains, volume_of), (loaded.mesh.boundaries, area_of)):
            for name, members in groups.items():
                total = 0.0
                for entity in gmsh.model.getEntitiesForPhysicalGroup(*names[name]):
                    for number in gmsh.model.mesh.getElementTypes(names[name][0], entity):
                        where, weight = gmsh.model.mesh.getIntegrationPoints(number, "Gauss6")
                        det = gmsh.model.mesh.getJacobians(number, where, entity)[1].reshape(-1, len(weight))
                        assert (det > 0).all()
                        total += float((det @ weight).sum())
                assert total == pytest.approx(of(loaded.mesh, members)[0], rel=1e-12 if of is volume_of else 1e-3)
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("kind", ["tet1", "tet2", "hex1"])
def test_refined_meshes_hold_and_swing_alike(tmp_path, kind):
    """Of a deck, with the node sets of a refined mesh: those at which springs act, and those that rest."""
    (tmp_path / "box.inp").write_text(deck_of(box(kind, (2, 2, 1), (0.1, 0.06, 0.04))))
    coarse = load_mesh(tmp_path / "box.inp")
    fine = refine(coarse) if kind == "hex1" else refine_marked(coarse, marks(coarse.mesh))[0]
    assert any(len(group.held) > len(group.nodes) for group in fine.node_groups.values())
    again = load_mesh(write_loaded(fine, tmp_path / "fine.msh"))
    same(fine, again)
    tables = {"supports": [{"nodes": "N_left", "fixed": "xyz"}],
              "springs": [{"name": "s", "nodes": "N_right", "direction": [0, 0, 1], "stiffness": 1e6}]}  # fmt: skip
    found = [frequencies(problem(mesh, **tables), 5) for mesh in (fine, again)]
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)
    np.testing.assert_array_equal(*(len(problem(m, **tables).discretisation.space.free) for m in (fine, again)))


def problem(loaded, **tables):
    scene = {"mesh": {"file": "none.msh", "order": 1}, "materials": {"steel": STEEL},
             "bodies": {"block": {"material": "steel"}}, **tables}  # fmt: skip
    return fe_squeal.assemble(fe_squeal.parse_scene(scene), loaded)


def test_numbers_of_nodes_stay(tmp_path):
    """A scene that names nodes by their numbers finds the same ones."""
    (tmp_path / "box.inp").write_text(deck_of(box("tet1", (2, 1, 1)), first=100))
    loaded = load_mesh(tmp_path / "box.inp")
    again = load_mesh(write_loaded(loaded, tmp_path / "box.msh"))
    for number in ("101", "105, 112"):
        before, after = (places(m.mesh, find_nodes(m, number, "nodes").nodes) for m in (loaded, again))
        assert before == after


def test_bodies_that_touch_keep_their_own_nodes(tmp_path):
    pad, disc = box("hex1", (2, 2, 1), corner=(0, 0, 1), name="pad"), box("hex1", (2, 2, 1), name="disc")
    loaded = from_skfem(join(pad, disc))
    again = load_mesh(write_loaded(loaded, tmp_path / "two.msh"))
    assert again.mesh.nvertices == loaded.mesh.nvertices
    assert (again.mesh.f2t[1, again.mesh.boundaries["bottom_pad"]] < 0).all()


def test_points_with_a_name_are_node_sets(tmp_path):
    """Those without are none, since a number means a node."""
    gmsh.initialize(["", "-v", "1"], interruptible=False)
    try:
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [1], 1, "block")
        gmsh.model.addPhysicalGroup(0, [1, 2], 7, "bolts")
        gmsh.model.addPhysicalGroup(0, [3], 8)
        gmsh.model.addPhysicalGroup(0, [4], 9000)
        gmsh.model.addPhysicalGroup(1, [1], 9, "edge")
        gmsh.model.mesh.generate(3)
        for version in (2.2, 4.1):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.write(str(tmp_path / "box.msh"))
            loaded = load_mesh(tmp_path / "box.msh")
            assert list(loaded.node_groups) == ["bolts"] and len(loaded.node_groups["bolts"].nodes) == 2
            assert len(find_nodes(loaded, "8", "nodes").nodes) == 1
            with pytest.raises(MeshError, match=r'no node set "bolt" .* did you mean "bolts"'):
                find_nodes(loaded, "bolt", "nodes")
            with pytest.raises(MeshError, match=r'no node set "edge" .*: it is a physical group of curves'):
                find_nodes(loaded, "edge", "nodes")
            assert loaded.unusable["9000"].startswith("it is a physical group of points without a name")
    finally:
        gmsh.finalize()


def test_what_cannot_be_written(tmp_path):
    loaded = from_skfem(box("hex1", (1, 1, 1)))
    with pytest.raises(OutputError, match=r"expected a name that ends in \.msh"):
        write_loaded(loaded, tmp_path / "box.inp")
    with pytest.raises(OutputError, match=r"cannot be written \(No such file or directory\)"):
        write_loaded(loaded, tmp_path / "none" / "box.msh")
    bad = replace(loaded, mesh=loaded.mesh.with_subdomains({'a"b': [0]}))
    with pytest.raises(OutputError, match="expected no quotation marks"):
        write_loaded(bad, tmp_path / "box.msh")
    assert not list(tmp_path.iterdir()) and make_problem(loaded.mesh).unknowns > 0


def test_a_mesh_that_was_read_back_is_written_as_before(tmp_path):
    """To the byte, whatever the order of its groups: a run that goes on ends with the file of an unbroken one."""
    loaded = with_more(box("tet2", (2, 1, 1), (0.06, 0.03, 0.02)))
    first = write_loaded(loaded, tmp_path / "a.msh")
    again = write_loaded(load_mesh(first), tmp_path / "b.msh")
    assert first.read_bytes() == again.read_bytes()


@pytest.mark.parametrize("kind", ["tetra", "tetra10"])
def test_nodes_that_are_numbered_from_zero_are_numbered_from_one(tmp_path, kind):
    """Gmsh knows no node 0, and would take another one for it."""
    nodes = np.arange(len(REFERENCE[kind]))
    raw = RawMesh(REFERENCE[kind], nodes, (CellBlock(kind, nodes[None], np.array([0])),), {"a": np.array([0])}, {})
    loaded = build_mesh(raw, "a.vtu")
    assert loaded.node_numbers[""][0].min() == 0
    write_loaded(loaded, tmp_path / "a.msh")
    gmsh.initialize(["", "-v", "1"], interruptible=False)
    try:
        gmsh.open(str(tmp_path / "a.msh"))
        assert sorted(gmsh.model.mesh.getNodes()[0].tolist()) == (nodes + 1).tolist()
        _, [element], _ = gmsh.model.mesh.getElements(3)
        assert gmsh.model.mesh.getElementQualities(element, "volume") == pytest.approx([1 / 6], rel=1e-12)
    finally:
        gmsh.finalize()
    assert load_mesh(tmp_path / "a.msh").node_numbers[""][0].min() == 1
