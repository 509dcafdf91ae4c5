"""Gmsh, VTK and XDMF files, meshes from Python, and the gate's answers."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
import skfem
from mesh_measures import area, centre, grid_of_kinds, volume

from fe_squeal.errors import MeshError
from fe_squeal.mesh import from_skfem, load_mesh, surface_group, volume_group
from fe_squeal.mesh.building import build_mesh
from fe_squeal.mesh.elements import REFERENCE
from fe_squeal.mesh.raw import CellBlock, RawMesh

DATA = Path(__file__).parents[1] / "data"
BOXES = sorted(path.name for path in DATA.glob("mesh_boxes_*.msh"))


def test_all_four_gmsh_kinds_are_there():
    assert [f"mesh_boxes_{v}_{m}.msh" for v in ("22", "41") for m in ("ascii", "binary")] == BOXES


@pytest.mark.parametrize("name", BOXES)
def test_gmsh_boxes(name):
    """Boxes 2 x 1 x 0.5 and 1 x 1 x 1; group 9 without a name holds both, 12 two faces; written by Gmsh 4.15."""
    loaded = load_mesh(DATA / name)
    for group, size in (("disc", 1.0), ("pad", 1.0), ("9", 2.0)):
        assert volume(loaded.mesh, volume_group(loaded, group)) == pytest.approx(size, rel=1e-12)
    for group, size, middle in (
        ("disc face", 2.0, [1, 0.5, 0.5]),
        ("pad_face", 1.0, [0.5, 0.5, 0.5]),
        ("12", 3.0, None),
    ):
        facets = surface_group(loaded, group)
        assert area(loaded.mesh, facets) == pytest.approx(size, rel=1e-12)
        if middle:
            assert np.allclose(centre(loaded.mesh, facets), middle, atol=1e-12)
    # Disc and pad touch but keep their own nodes.
    assert not np.intersect1d(
        loaded.mesh.t[:, volume_group(loaded, "disc")], loaded.mesh.t[:, volume_group(loaded, "pad")]
    ).size
    with pytest.raises(MeshError, match=f'no volume group "Disc" in {name}; did you mean "disc"'):
        volume_group(loaded, "Disc")


def test_gmsh_second_order_cylinder(tmp_path):
    """Full mixed second order (27, 18 and 14 nodes do not occur together here): the volume error is of h^4."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        disk = gmsh.model.occ.addDisk(0, 0, 0, 0.1, 0.1)
        solid = gmsh.model.occ.extrude([(2, disk)], 0, 0, 0.02, numElements=[1], recombine=True)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [solid[1][1]], name="disc")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.03)
        gmsh.model.mesh.generate(3)
        for order in (1, 2):
            gmsh.model.mesh.setOrder(order)
            gmsh.write(str(tmp_path / f"{order}.msh"))
    finally:
        gmsh.finalize()
    exact = np.pi * 0.1**2 * 0.02
    straight, curved = (volume(load_mesh(tmp_path / f"{order}.msh").mesh) / exact - 1 for order in (1, 2))
    assert straight < -5e-3 and abs(curved) < 5e-5


def test_vtu_with_surface_nodes_of_its_own():
    loaded = load_mesh(DATA / "mesh_two_tets.vtu")
    assert volume(loaded.mesh) == pytest.approx(1 / 3, rel=1e-13)
    assert {"body:5", "body:6", "lining:0", "lining:1", "lining"} == set(loaded.mesh.subdomains)
    facets = surface_group(loaded, "body:8")
    assert area(loaded.mesh, facets) == pytest.approx(0.5, rel=1e-13)
    assert np.allclose(centre(loaded.mesh, facets), [1 / 3, 0, -1 / 3])
    assert any("matched to the volume by coordinates" in note for note in loaded.notes)


def test_surface_nodes_of_its_own_between_two_bodies_is_a_guess():
    points = np.array(
        [
            (0, 0, 0),
            (1, 0, 0),
            (0, 1, 0),
            (0, 0, 1),
            (0, 0, 0),
            (1, 0, 0),
            (0, 1, 0),
            (0, 0, -1),
            (0, 0, 0),
            (1, 0, 0),
            (0, 1, 0),
        ],
        float,
    )
    block = CellBlock("tetra", np.array([[0, 1, 2, 3], [4, 6, 5, 7]]), np.arange(2))
    raw = RawMesh(points, np.arange(11), (block,), {}, {"face": [np.array([[8, 9, 10]])]})
    with pytest.raises(MeshError, match=r'no surface group "face" in a.vtu: .* lies where two bodies touch'):
        surface_group(build_mesh(raw, "a.vtu"), "face")
    own = RawMesh(points, np.arange(11), (block,), {}, {"face": [np.array([[0, 1, 2]])]})
    assert np.array_equal(build_mesh(own, "a.vtu").mesh.boundaries["face"].shape, (1,))


@pytest.mark.parametrize(("face", "why"), [
    ((0, 1, 4), "1 of its 2 triangles are no face of a volume element"),
    ((1, 5, 6), "1 of its 2 cells lie on no face of a volume element"),  # on nodes of its own
])  # fmt: skip
def test_a_loose_shell_costs_its_own_group_alone(face, why):
    """The group is left out whole, with a note, and says why if asked for; a node set of its name is not taken."""
    points = np.vstack([REFERENCE["tetra"], [(1, 1, 1), (2, 0, 0), (2, 1, 0)]])
    block = CellBlock("tetra", np.array([[0, 1, 2, 3], [1, 2, 3, 4]]), np.arange(2))
    surfaces = {"shim": [np.array([(0, 1, 2), face])], "lining": [np.array([[0, 1, 3]])]}
    raw = RawMesh(points, np.arange(7), (block,), {}, surfaces, {"shim": np.array([0, 1, 2])})
    loaded = build_mesh(raw, "a.bdf")
    assert set(loaded.mesh.boundaries) == {"lining"} and surface_group(loaded, "lining").shape == (1,)
    with pytest.raises(MeshError, match=f'no surface group "shim" in a.bdf: {why}'):
        surface_group(loaded, "shim")
    assert any("left out: shim" in note for note in loaded.notes) and "shim" in loaded.node_groups


def test_node_groups_of_med_files(tmp_path):
    """Families of nodes: one may be in several groups, and a group may have several families."""
    mesh = meshio.Mesh(REFERENCE["tetra"], [("tetra", np.array([[0, 1, 2, 3]]))])
    mesh.point_data["point_tags"] = np.array([0, 2, 3, 3])
    mesh.point_tags = {2: ["bolts", "feet"], 3: ["feet"]}
    mesh.write(tmp_path / "a.med")
    loaded = load_mesh(tmp_path / "a.med")
    found = {name: loaded.mesh.p[:, group.nodes].T.tolist() for name, group in loaded.node_groups.items()}
    assert found == {"bolts": [[1, 0, 0]], "feet": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}
    assert len(surface_group(loaded, "feet")) == 1


def test_regions_that_are_written_with_fractions_are_told(tmp_path):
    parts = {"region": [np.array([3.0])], "stress": [np.array([0.25])]}
    meshio.Mesh(REFERENCE["tetra"], [("tetra", np.array([[0, 1, 2, 3]]))], cell_data=parts).write(tmp_path / "a.vtu")
    loaded = load_mesh(tmp_path / "a.vtu")
    for name in ("region", "region:3"):
        with pytest.raises(MeshError, match=f'no volume group "{name}" .*"region" is of floating-point numbers'):
            volume_group(loaded, name)
    assert set(loaded.unusable) == {"region", "region:3"}


@pytest.mark.parametrize("suffix", ["vtu", "vtk"])
def test_files_written_by_vtk(tmp_path, suffix):
    """vtkXMLUnstructuredGridWriter's and vtkUnstructuredGridWriter's own output: two cubes and a wedge."""
    import pyvista as pv

    cube = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], float)
    beside = cube + np.array([3, 0, 0])
    points = np.vstack([cube, beside, [(6, 0, 0), (7, 0, 0), (6, 1, 0), (6, 0, 2), (7, 0, 2), (6, 1, 2)]])
    cells = np.hstack([[8, *range(8)], [8, *range(8, 16)], [6, *range(16, 22)], [4, 0, 1, 2, 3]])
    grid = pv.UnstructuredGrid(cells, [12, 12, 13, 9], points)
    grid.cell_data["region"] = np.array([1, 2, 2, 7], dtype=np.int32)
    grid.save(tmp_path / f"cubes.{suffix}")
    loaded = load_mesh(tmp_path / f"cubes.{suffix}")
    assert volume(loaded.mesh, volume_group(loaded, "1")) == pytest.approx(1.0, rel=1e-12)
    assert volume(loaded.mesh, volume_group(loaded, "region:2")) == pytest.approx(2.0, rel=1e-12)
    assert area(loaded.mesh, surface_group(loaded, "7")) == pytest.approx(1.0, rel=1e-12)
    assert "2 hexahedra split into 12 tetrahedra" in loaded.notes and "1 wedges split into 3 tetrahedra" in loaded.notes


@pytest.mark.parametrize(
    ("number", "kind", "exact"), [(26, "wedge15", 0.5), (27, "pyramid13", 4 / 3), (25, "hexahedron20", 1.0)]
)
def test_quadratic_cells_of_vtk(tmp_path, number, kind, exact):
    """meshio's own table lacks the quadratic wedge and pyramid."""
    import pyvista as pv

    count = len(REFERENCE[kind])
    pv.UnstructuredGrid(np.array([count, *range(count)]), [number], REFERENCE[kind]).save(tmp_path / "one.vtu")
    mesh = load_mesh(tmp_path / "one.vtu").mesh
    assert volume(mesh) == pytest.approx(exact, rel=1e-12)
    stored = mesh.doflocs[:, mesh.dofs.edge_dofs[0]]
    assert np.allclose(stored, mesh.p[:, mesh.edges].mean(axis=1), atol=1e-14)


def test_xdmf_with_mixed_topology():
    loaded = load_mesh(DATA / "mesh_mixed.xdmf")
    assert volume(loaded.mesh, volume_group(loaded, "11")) == pytest.approx(24.0, rel=1e-13)
    assert area(loaded.mesh, surface_group(loaded, "region:22")) == pytest.approx(6.0, rel=1e-13)


@pytest.mark.parametrize(
    ("cls", "exact"), [(skfem.MeshTet1, 1.0), (skfem.MeshTet2, 1.0), (skfem.MeshHex1, 1.0), (skfem.MeshHex2, 1.0)]
)
def test_meshes_from_python(cls, exact):
    mesh = cls().refined().with_boundaries({"top": lambda x: x[2] == 1.0}).with_subdomains({"all": lambda x: x[0] >= 0})
    loaded = from_skfem(mesh, "mine")
    assert volume(loaded.mesh, volume_group(loaded, "all")) == pytest.approx(exact, rel=1e-13)
    assert area(loaded.mesh, surface_group(loaded, "top")) == pytest.approx(1.0, rel=1e-13)
    with pytest.raises(MeshError, match='no surface group "botom" in mine; valid: top'):
        surface_group(loaded, "botom")


def test_bad_meshes_from_python():
    flat = skfem.MeshTet1().translated((0, 0, 0)).scaled((1.0, 1.0, 0.0))
    with pytest.raises(MeshError, match="have zero volume"):
        from_skfem(flat)
    with pytest.raises(MeshError, match="MeshTri1 is not supported; expected one of MeshTet1"):
        from_skfem(skfem.MeshTri())
    with pytest.raises(MeshError, match='boundary "b" must hold indices from 0 to'):
        from_skfem(skfem.MeshHex().with_boundaries({"b": np.array([99])}))
    twisted = skfem.MeshHex()
    p = twisted.p.copy()
    p[:, [4, 5]] = p[:, [5, 4]]
    with pytest.raises(MeshError, match="element 0 is inverted or too distorted"):
        from_skfem(skfem.MeshHex(p, twisted.t))


def test_inverted_elements_are_named_and_counted():
    raw = grid_of_kinds(2, ["tetra"], lambda x: x, 0)
    nodes = raw.blocks[0].nodes.copy()
    nodes[3:10] = nodes[3:10][:, [1, 0, 2, 3]]
    bad = RawMesh(
        raw.points,
        raw.node_labels,
        (CellBlock("tetra", nodes, 100 + np.arange(len(nodes))),),
        {"pad": np.arange(8)},
        {},
    )
    with pytest.raises(MeshError) as caught:
        build_mesh(bad, "x.inp")
    assert str(caught.value) == (
        "x.inp: elements 103, 104, 105, 106, 107 and 2 more are inverted or too distorted (negative "
        'Jacobian) (group "pad"); check the node order and repair the mesh'
    )


def test_curved_element_that_folds_inside_is_refused():
    """Corners alone look right: the middle of an edge is pushed through the opposite face."""
    raw = grid_of_kinds(1, ["tetra10"], lambda x: x, 0)
    points = raw.points.copy()
    node = raw.blocks[0].nodes[0, 9]
    points[node] += [-0.9, -0.9, -0.9]
    with pytest.raises(MeshError, match="inverted or too distorted"):
        build_mesh(RawMesh(points, raw.node_labels, raw.blocks, {}, {}), "x.inp")


def test_files_that_are_no_meshes(tmp_path):
    cases = {"missing.msh": "no such mesh file", "empty.msh": "the file is empty", "folder.inp": "this is a folder",
             "text.msh": "not a readable", "text.vtu": "not a readable", "text.xdmf": "not a readable",
        "zip.xyz": "no mesh format is known",
             "binary.inp": "is not a text file", "two.obj": "no volume elements|not a readable"}  # fmt: skip
    (tmp_path / "empty.msh").touch()
    (tmp_path / "folder.inp").mkdir()
    for name in ("text.msh", "text.vtu", "text.xdmf", "zip.xyz"):
        (tmp_path / name).write_text("no mesh here\n")
    (tmp_path / "binary.inp").write_bytes(b"*NODE\n\0\1\2")
    (tmp_path / "two.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for name, message in cases.items():
        with pytest.raises(MeshError, match=message):
            load_mesh(tmp_path / name)
    with pytest.raises(MeshError, match=r'did you mean "empty\.msh"'):
        load_mesh(tmp_path / "emty.msh")
    with pytest.raises(MeshError, match='length_unit "inch" is not known; valid: m, mm'):
        load_mesh(tmp_path / "empty.msh", "inch")
