"""Abaqus files as CAE and HyperMesh write them: parts, instances, sets, surfaces, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from deck_texts import deck_of
from mesh_measures import area, centre, volume

from fe_squeal.errors import MeshError
from fe_squeal.mesh import load_mesh, surface_group, volume_group
from fe_squeal.mesh.readers.abaqus.read import read_abaqus
from fe_squeal.mesh.readers.sources import Sources
from meshes import box

DATA = Path(__file__).parents[1] / "data"
TET = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n*ELEMENT, TYPE=C3D4, ELSET=E\n1, 1, 2, 3, 4\n"


def written(tmp_path, text, name="a.inp"):
    (tmp_path / name).write_text(text)
    return load_mesh(tmp_path / name)


def test_brake_instances_are_placed():
    """pad-1 stands on the disc; pad-2 is moved to x = 2 and turned by 180 degrees about the line x = 2, z = 0."""
    loaded = load_mesh(DATA / "mesh_brake.inp")
    mesh = loaded.mesh
    assert volume(mesh) == pytest.approx(1.0 + 2.0 + 2.0, rel=1e-13)
    for name, middle in (("disc-1", [1, 0.5, 0.25]), ("pad-1", [0.5, 0.5, 1.5]), ("pad-2", [1.5, 0.5, -1.0])):
        corners = np.unique(mesh.t[:, volume_group(loaded, name)])
        assert np.allclose(mesh.p[:, corners].mean(axis=1), middle, atol=1e-14)
    assert list(loaded.element_labels) == ["disc-1.1", "pad-1.10", "pad-1.20", "pad-2.10", "pad-2.20"]


@pytest.mark.parametrize(("name", "size", "middle"), [
    ("disc_face", 2.0, [1, 0.5, 0.5]),  # one instance: the plain name does
    ("pad-1.pad_face", 1.0, [0.5, 0.5, 0.5]),
    ("pad-2.pad_face", 1.0, [1.5, 0.5, 0.0]),
    ("pad_face", 2.0, [1.0, 0.5, 0.25]),  # two instances: the union
    ("back_2", 1.0, [1.5, 0.5, -2.0]),  # assembly surface through INSTANCE=
    ("all_of_pad_1", 10.0, [0.5, 0.5, 1.5]),  # no face label: all free faces of two unit cubes
    ("held", 2.0, [1.0, 0.5, 0.0]),  # assembly node set with GENERATE
    ("back_nodes", 1.0, [0.5, 0.5, 2.5]),  # *SURFACE, TYPE=NODE
    ("PAD-1.Back", 1.0, [0.5, 0.5, 2.5]),  # Abaqus does not mind case
])  # fmt: skip
def test_brake_surfaces(name, size, middle):
    loaded = load_mesh(DATA / "mesh_brake.inp")
    facets = surface_group(loaded, name)
    assert area(loaded.mesh, facets) == pytest.approx(size, rel=1e-12)
    assert np.allclose(centre(loaded.mesh, facets), middle, atol=1e-12)


def test_brake_element_sets():
    loaded = load_mesh(DATA / "mesh_brake.inp")
    expected = {"both_uppers": 2, "upper": 2, "pad-2.upper": 1, "pad-1.Set-1": 2, "disc-1.Set-1": 1}
    assert {name: len(volume_group(loaded, name)) for name in expected} == expected
    with pytest.raises(MeshError, match='several parts have a set of that name; take one of them, such as "pad-'):
        volume_group(loaded, "Set-1")
    with pytest.raises(MeshError, match=r'no surface group "pad_facee" in mesh_brake\.inp; did you mean "pad_face"'):
        surface_group(loaded, "pad_facee")
    with pytest.raises(MeshError, match="that is a volume group"):
        surface_group(loaded, "both_uppers")


def test_flat_file_of_wedge_and_tetrahedron():
    """Wedge 1/2, tetrahedron over its top to z = 3: base 1/2, height 2."""
    loaded = load_mesh(DATA / "mesh_flat.inp", length_unit="mm")
    mesh = loaded.mesh
    assert volume(mesh) == pytest.approx((0.5 + 1 / 3) * 1e-9, rel=1e-12)
    assert volume(mesh, volume_group(loaded, "wedge")) == pytest.approx(0.5e-9, rel=1e-12)
    assert len(volume_group(loaded, "My Solids")) == 4
    slanted = np.sqrt(2.0)  # the wedge's side through (1, 0) and (0, 1), height 1
    for name, size in (
        ("BOTTOM", 0.5),
        ("SIDE", slanted),
        ("LOWER", 0.5),
        ("TIP", 1 + 1 + np.sqrt(6) * np.sqrt(1.5) / 2),
    ):
        assert area(mesh, surface_group(loaded, name)) == pytest.approx(size * 1e-6, rel=1e-12), name
    assert len(surface_group(loaded, "FREE")) == 1 + 3 + 3 * 2
    assert "1 wedges split into 3 tetrahedra" in loaded.notes
    assert "1 elements of type S3 are no solids and no part of the mesh" in loaded.notes
    assert "2 nodes that no volume element uses are left out" in loaded.notes
    with pytest.raises(MeshError, match="covers no whole face"):
        surface_group(loaded, "EDGE")
    # Shells over faces of solids make a surface group, others none.
    assert area(mesh, surface_group(loaded, "skin")) == pytest.approx(0.5e-6, rel=1e-12)
    with pytest.raises(MeshError, match=r'no volume group "skin" .* that is a surface group'):
        volume_group(loaded, "skin")
    with pytest.raises(MeshError, match="its shell elements are no faces of solid elements"):
        surface_group(loaded, "STRAY")


@pytest.mark.parametrize(
    ("face", "on"),
    [
        ("S1", lambda x: x[2] == 0),
        ("S2", lambda x: x[2] == 1),
        ("S3", lambda x: x[1] == 0),
        ("S4", lambda x: x[0] == 1),
        ("S5", lambda x: x[1] == 1),
        ("S6", lambda x: x[0] == 0),
    ],
)
def test_faces_of_the_brick(tmp_path, face, on):
    """Abaqus: S1 1-2-3-4, S2 5-8-7-6, S3 1-5-6-2, S4 2-6-7-3, S5 3-7-8-4, S6 4-8-5-1. C3D20R over two lines."""
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    edges = [(1, 2), (2, 3), (3, 4), (4, 1), (5, 6), (6, 7), (7, 8), (8, 5), (1, 5), (2, 6), (3, 7), (4, 8)]
    points = corners + [tuple(np.mean([corners[a - 1], corners[b - 1]], axis=0)) for a, b in edges]
    text = "*node\n" + "".join(f"{i + 1}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(points))
    text += "*element, type=C3D20R, elset=brick\n1, " + ", ".join(map(str, range(1, 16))) + ",\n"
    text += ", ".join(map(str, range(16, 21))) + f"\n*surface, name=face\nbrick, {face}\n"
    loaded = written(tmp_path, text)
    assert type(loaded.mesh).__name__ == "MeshHex2" and volume(loaded.mesh) == pytest.approx(1.0, rel=1e-13)
    facets = surface_group(loaded, "FACE")
    assert len(facets) == 1 and on(loaded.mesh.p[:, loaded.mesh.facets[:, facets[0]]]).all()


@pytest.mark.parametrize(("face", "nodes"), [("S1", "123"), ("S2", "142"), ("S3", "243"), ("S4", "341")])
def test_faces_of_the_tetrahedron(tmp_path, face, nodes):
    loaded = written(tmp_path, TET + f"*SURFACE, NAME=F\nE, {face}\n")
    at = {"1": (0, 0, 0), "2": (1, 0, 0), "3": (0, 1, 0), "4": (0, 0, 1)}
    found = loaded.mesh.p[:, loaded.mesh.facets[:, surface_group(loaded, "F")[0]]].T
    assert {tuple(map(int, p)) for p in found} == {at[n] for n in nodes}


@pytest.mark.parametrize(
    ("face", "nodes"), [("S1", "123"), ("S2", "465"), ("S3", "1452"), ("S4", "2563"), ("S5", "3641")]
)
def test_faces_of_the_wedge(tmp_path, face, nodes):
    points = {"1": (0, 0, 0), "2": (1, 0, 0), "3": (0, 1, 0), "4": (0, 0, 1), "5": (1, 0, 1), "6": (0, 1, 1)}
    text = "*NODE\n" + "".join(f"{n}, {x}, {y}, {z}\n" for n, (x, y, z) in points.items())
    loaded = written(tmp_path, text + f"*ELEMENT, TYPE=C3D6\n1, 1, 2, 3, 4, 5, 6\n*SURFACE, NAME=F\n1, {face}\n")
    found = loaded.mesh.p[:, loaded.mesh.facets[:, surface_group(loaded, "F")]].reshape(3, -1).T
    assert {tuple(map(int, p)) for p in found} == {points[n] for n in nodes}


@pytest.mark.parametrize("given", [27, 21, 20])
def test_brick_of_27_nodes_has_its_centres_where_abaqus_puts_them(tmp_path, given):
    """Node 21 is the centre, 22 ... 27 the centres of S1 ... S6: with them wrong the brick would fold. 0: left out."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], float)
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    faces = [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    points = [
        *corners,
        *(corners[list(e)].mean(axis=0) for e in edges),
        corners.mean(axis=0),
        *(corners[list(f)].mean(axis=0) for f in faces),
    ]
    text = "*NODE\n" + "".join(f"{i + 1}, {p[0]}, {p[1]}, {p[2]}\n" for i, p in enumerate(points[:given]))
    text += (
        "*ELEMENT, TYPE=C3D27\n1, "
        + ", ".join(map(str, range(1, 16)))
        + ",\n"
        + ", ".join(str(n if n <= given else 0) for n in range(16, 28))
        + "\n"
    )
    mesh = written(tmp_path, text).mesh
    x = np.random.default_rng(0).uniform(0, 1, (3, 9))
    assert np.allclose(mesh.mapping().F(x)[:, 0], x, atol=1e-14)


def test_includes_and_inputs_are_followed(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "nodes.txt").write_text(
        "** nodes\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 0., 0., 1.\n"
    )
    (tmp_path / "mesh.inc").write_text("*NODE, INPUT=sub/nodes.txt\n*ELEMENT, TYPE=C3D4,\nELSET=BODY\n5, 1, 2, 3, 4\n")
    loaded = written(tmp_path, "*INCLUDE, INPUT=mesh.inc\n")
    assert volume(loaded.mesh, volume_group(loaded, "BODY")) == pytest.approx(1 / 6, rel=1e-13)
    with pytest.raises(MeshError, match=r'line 1: the included file "mesh\.icn" does not .*; did you mean "mesh\.inc"'):
        written(tmp_path, "*INCLUDE, INPUT=mesh.icn\n")
    with pytest.raises(MeshError, match=r"does loop\.inp include itself"):
        written(tmp_path, "*INCLUDE, INPUT=loop.inp\n", "loop.inp")


@pytest.mark.parametrize(("text", "message"), [
    ("*NGEN\n1, 5, 1\n", r"\*NGEN is not read; write out all nodes"),
    ("hello\n", "no Abaqus keywords"),
    ("*NODE\n1, 0, zero, 0\n", '"zero" in the data line "1, 0, zero, 0" is not a number'),
    ("*NODE\n1.5, 0, 0, 0\n", "node numbers must be whole numbers"),
    ("*NODE\n1, 0, 0, 0\n", "no volume elements; expected tetrahedra"),
    (TET + "*ELEMENT, TYPE=C3D4\n2, 1, 2, 3\n", 'need a number and 4 nodes each; see the data line "2, 1, 2, 3"'),
    (TET + "*ELEMENT, TYPE=C3D4\n2, 1, 2, 3, 77\n", "element 2 refers to node 77, which the file does not define"),
    (TET + "*ELEMENT, TYPE=C3D4\n2, 1, 2, 3, 3\n", "element 2 has the same node twice"),
    (TET + "*ELEMENT, TYPE=C3D4\n2, 2, 3, 1, 4\n", "element 2 is a copy of another element"),
    (TET + "*NODE\n1, 5, 0, 0\n", "node number 1 is defined more than once at different places"),
    (TET + "*ELSET, ELSET=A\nB\n", 'set "A" refers to element set "B", which does not exist'),
    (TET + "*ELSET, ELSET=A\nB\n*ELSET, ELSET=B\nA\n", "contains itself"),
    (TET + "*ELSET, ELSET=A\n7\n", '"A" refers to number 7, which is none of the elements'),
    (TET + "*NSET, NSET=A, GENERATE\n4, 1\n", "GENERATE takes first, last and step"),
    (TET + "*NSET\n1\n", r"\*NSET without a name"),
    (TET + "*NSET, NSET=A, ELSET=EE\n", 'set "A" refers to element set "EE", which does not exist; did you mean "E"'),
    (TET + "*SURFACE, NAME=F\nE, S5\n", r'face "S5" does not exist on a solid with 4 faces; expected S1 \.\.\. S4'),
    (TET + "*SURFACE, NAME=F\nEE, S1\n", '"F" refers to element set "EE", which does not exist; did you mean "E"'),
    (TET + "*SURFACE, NAME=F, COMBINE=UNION\nG\n", '"F" is a union of surface "G", which does not exist'),
    (TET + "*SURFACE, NAME=F, COMBINE=UNION\n", '"F" is a union of nothing; expected the names of surfaces'),
    (TET + "*SURFACE, NAME=F, COMBINE=UNION\nG\n*SURFACE, NAME=G, COMBINE=UNION\nF\n", '"F" is a union of itself'),
    (TET + "*SURFACE, NAME=A\nE, S1\n*SURFACE, NAME=B, TYPE=NODE\n1\n*SURFACE, NAME=F, COMBINE=UNION\nA, B\n",
     '"F" is a union of surfaces of elements and of nodes'),
    ("*INSTANCE, NAME=A, PART=P\n*END INSTANCE\n", 'instance "A" is of part "P", which does not exist'),
    (TET.replace("4, 0, 0, 1", "4, 0, 0, nan"), "the coordinates of node 4 are not finite"),
    (TET.replace("4, 0, 0, 1", "4, 1, 1, 0"), r'element 1 has zero volume \(group "E"\)'),
])  # fmt: skip
def test_what_is_refused(tmp_path, text, message):
    with pytest.raises(MeshError, match=message) as caught:
        written(tmp_path, text)
    assert str(caught.value).startswith("a.inp:") and "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["hex1", "hex2", "tet2"])
def test_nodes_of_an_element_set(tmp_path, kind):
    """Of the first element alone, midside nodes too: of a part, and of one of its instances."""
    text = deck_of(box(kind, (2, 1, 1), name="P"))
    own = "*Elset, elset=FIRST\n1\n*Nset, nset=OF, elset=FIRST\n"
    placed = "*Instance, name=A-1, part=A\n0., 0., 3.\n*End Instance\n"
    both = "*Nset, nset=ALL, instance=A-1, elset=FIRST\n*Nset, nset=ALL\nA-1.OF\n"
    text = f"*Part, name=A\n{text}{own}*End Part\n*Assembly, name=X\n{placed}{both}*End Assembly\n"
    (tmp_path / "a.inp").write_text(text)
    raw = read_abaqus(Sources(tmp_path / "a.inp"))
    first = next(np.unique(block.nodes[0][block.nodes[0] >= 0]) for block in raw.blocks)
    for name in ("A-1.OF", "ALL"):
        np.testing.assert_array_equal(raw.node_groups[name], first)


def test_nodes_of_springs_are_not_those_of_an_element_set(tmp_path):
    springs = "*ELEMENT, TYPE=SPRING1, ELSET=S\n7, 1\n*ELSET, ELSET=BOTH\nE, S\n*NSET, NSET=N, ELSET=BOTH\n"
    with pytest.raises(MeshError, match=r'"N" is of the nodes of element set "BOTH", which has elements that'):
        written(tmp_path, TET + springs)


def test_cylindrical_nodes(tmp_path):
    loaded = written(tmp_path, TET.replace("*NODE", "*NODE, SYSTEM=C").replace("3, 0, 1, 0", "3, 1, 90., 0"))
    assert volume(loaded.mesh) == pytest.approx(1 / 6, rel=1e-13)
