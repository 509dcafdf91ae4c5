"""Universal files: as Gmsh writes them beside the same mesh in its own format, and datasets that are damaged."""

from __future__ import annotations

import gmsh
import numpy as np
import pytest
from mesh_measures import area, volume

from fe_squeal.decks.scene import draft_of
from fe_squeal.errors import MeshError
from fe_squeal.mesh import load_mesh
from fe_squeal.mesh.elements import QUADRATIC
from fe_squeal.mesh.loading import read_raw


def write_cylinder(folder, kind, order):
    """A cylinder of radius 10 and height 4, of groups "solid" and "side", as .unv and .msh with the same numbers."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        if kind == "tetra":
            gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, 4, 10)
        else:
            disk = gmsh.model.occ.addDisk(0, 0, 0, 10, 10)
            gmsh.model.occ.extrude([(2, disk)], 0, 0, 4, numElements=[2], recombine=True)
        gmsh.model.occ.synchronize()
        if kind == "hexahedron":
            gmsh.option.setNumber("Mesh.RecombineAll", 1)
            gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 2)
        side = [tag for _, tag in gmsh.model.getEntities(2) if abs(gmsh.model.occ.getCenterOfMass(2, tag)[2] - 2) < 1]
        gmsh.model.addPhysicalGroup(3, [1], name="solid")
        gmsh.model.addPhysicalGroup(2, side, name="side")
        for option, value in (("MeshSizeMin", 5.0), ("MeshSizeMax", 5.0), ("SecondOrderIncomplete", 1)):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(folder / "a.msh"))
        gmsh.option.setNumber("Mesh.SaveGroupsOfElements", 1)
        gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", 1)
        gmsh.write(str(folder / "a.unv"))
    finally:
        gmsh.finalize()
    return folder / "a.unv"


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("kind", ["tetra", "hexahedron", "wedge"])
def test_elements_are_those_of_gmsh(tmp_path, kind, order):
    """Every node of every element at the same place, so the order of corners and midside nodes too."""
    path = write_cylinder(tmp_path, kind, order)
    (ours,), (other,) = (read_raw(p).blocks for p in (path, path.with_suffix(".msh")))
    assert ours.kind == other.kind == (kind if order == 1 else QUADRATIC[kind])
    places = [read_raw(p).points[b.nodes] for p, b in ((path, ours), (path.with_suffix(".msh"), other))]
    np.testing.assert_allclose(*places, rtol=0, atol=1e-12)
    loaded = load_mesh(path, "mm")
    known = load_mesh(path.with_suffix(".msh"), "mm")
    assert volume(loaded.mesh, loaded.mesh.subdomains["solid"]) == pytest.approx(volume(known.mesh), rel=1e-12)
    if order == 2:
        assert volume(loaded.mesh) == pytest.approx(400e-9 * np.pi, rel=5e-3)
    facets = [m.mesh.boundaries["side"] for m in (loaded, known)]
    assert area(loaded.mesh, facets[0]) == pytest.approx(area(known.mesh, facets[1]), rel=1e-12)


BEAM = """    -1
   164
         2mm                           2
  0.10000000000000000D+04  0.10000000000000000D+01  0.10000000000000000D+01
  0.27314999999999998D+03
    -1
    -1
  2411
{nodes}    -1
    -1
  2412
        11       118         7         3         7        10
         1         2         3         4         5         6         7         8
         9        10
        12        21         1         1         7         2
         0         1         1
         1         3
        13       161         1         1         7         1
         1
        14        92         1         1         7         6
         1         2         3         4         5         6
    -1
    -1
  2467
         1         0         0         0         0         0         0         2
fixed end
         7         1         0         0         7         3         0         0
         2         0         0         0         0         0         0         1
FACE
         8        14         0         0
         3         0         0         0         0         0         0         1
CS
         1         1         0         0
    -1
"""
PLACES = [(0, 0, 0), (5, 0, 0), (10, 0, 0), (5, 5, 0), (0, 10, 0), (0, 5, 0), (0, 0, 5), (5, 0, 5), (0, 5, 5),
          (0, 0, 10)]  # fmt: skip


def tetrahedron(system=1, beside=1):
    rows = (f"{i:10d}{system if i == 3 and system > 1 else beside:10d}         1        11\n"
            + "".join(f"{v:25.16E}" for v in p).replace("E", "D") + "\n" for i, p in enumerate(PLACES, 1))  # fmt: skip
    return BEAM.format(nodes="".join(rows))


def test_groups_units_and_what_is_no_solid(tmp_path):
    path = tmp_path / "tet.unv"
    path.write_text(tetrahedron())
    loaded = load_mesh(path, "mm")
    assert volume(loaded.mesh) == pytest.approx(1e-6 / 6, rel=1e-12)
    assert set(loaded.mesh.subdomains) == {"property_7", "material_3"}
    assert area(loaded.mesh, loaded.mesh.boundaries["FACE"]) == pytest.approx(0.5e-4, rel=1e-12)
    assert len(loaded.node_groups["fixed end"].nodes) == 2 and "CS" in loaded.unusable
    assert any("descriptor 161" in note for note in loaded.notes)
    draft = draft_of(path)
    assert 'length_unit = "mm"' in draft.text()  # though it is but 10 across


@pytest.mark.parametrize(("change", "sentence"), [
    (lambda t: t[:700], r"cut off"), (lambda t: t.replace("2411", "  15"), r"no nodes \(dataset 2411\)"),
    (lambda t: t.replace("2412", " 780"), r"no solids \(dataset 2412\)"),
    (lambda t: t.replace(" 9        10\n", " 9        77\n"), r"element.*11.*77"),
    (lambda t: t.replace("118         7         3         7        10", "117         7         3         7        10"),
     r"dataset 2412 at line \d+.*FE descriptor 117"),
    (lambda t: t.replace("        10\n         1", "         9\n         1"), r"11 has 10 nodes; expected 9"),
    (lambda t: t.replace("0.5000000000000000D", "0.50000x0000000000D").replace("5.00000", "5.x0000"), r"dataset 2411"),
    (lambda t: tetrahedron(system=2), r"several coordinate systems"),
    (lambda t: t.replace("0         2\nfixed", "0         5\nfixed"), r"dataset 2467"),
])  # fmt: skip
def test_damaged_files_are_refused_in_a_sentence(tmp_path, change, sentence):
    path = tmp_path / "tet.unv"
    path.write_text(change(tetrahedron()))
    with pytest.raises(MeshError, match=sentence) as caught:
        load_mesh(path)
    assert "\n" not in str(caught.value) and "tet.unv" in str(caught.value)


def system(number, kind=0, turn=0.0, origin=(0.0, 0.0, 0.0)):
    rows = [(np.cos(turn), np.sin(turn), 0), (-np.sin(turn), np.cos(turn), 0), (0, 0, 1), origin]
    text = "".join("".join(f"{v:25.16E}" for v in row).replace("E", "D") + "\n" for row in rows)
    head = "    -1\n  2420\n         1\nPart\n" if number == 1 else ""
    return head + f"{number:10d}{kind:10d}        11\nCS{number}\n{text}"


@pytest.mark.parametrize(("own", "refused"), [
    ({}, False), ({"origin": (0.0, 0.0, 1.0)}, True), ({"turn": 1.0}, True), ({"kind": 1}, True), ({"kind": 2}, True),
])  # fmt: skip
@pytest.mark.parametrize("behind", [False, True])
def test_nodes_in_a_system_of_their_own_are_refused(tmp_path, own, refused, behind):
    """Before and behind the nodes; system 2, turned, is the file's own and has no nodes."""
    path, systems = tmp_path / "tet.unv", system(1, **own) + system(2, turn=2.0) + "    -1\n"
    path.write_text(tetrahedron() + systems if behind else systems + tetrahedron())
    if refused:
        with pytest.raises(MeshError, match=r"nodes .* in coordinate system 1, which dataset 2420 .* not the gl"):
            load_mesh(path)
    else:
        assert volume(load_mesh(path, "mm").mesh) == pytest.approx(1e-6 / 6, rel=1e-12)


def test_systems_that_are_not_defined_are_told(tmp_path):
    path = tmp_path / "tet.unv"
    path.write_text(tetrahedron(beside=4))
    assert any("coordinate system 4 of nodes" in note for note in load_mesh(path).notes)
