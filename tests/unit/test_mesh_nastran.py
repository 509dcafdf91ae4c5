"""Nastran bulk data: small, large and free fields, continuations, coordinate systems, names in comments."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mesh_measures import area, volume

from fe_squeal.errors import MeshError
from fe_squeal.mesh import load_mesh, surface_group, volume_group

DATA = Path(__file__).parents[1] / "data"
GRIDS = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,0.,1.,0.\nGRID,4,,0.,0.,1.\n"


def written(tmp_path, text):
    (tmp_path / "a.bdf").write_text(text)
    return load_mesh(tmp_path / "a.bdf")


def test_hypermesh_deck():
    loaded = load_mesh(DATA / "mesh_hypermesh.bdf")
    assert volume(loaded.mesh) == pytest.approx(2.0, rel=1e-13)
    assert list(volume_group(loaded, "3")) == list(volume_group(loaded, "pad")) == [0]
    assert area(loaded.mesh, surface_group(loaded, "pad_face")) == pytest.approx(1.0, rel=1e-13)
    assert list(surface_group(loaded, "4")) == list(surface_group(loaded, "pad_face"))
    assert loaded.notes == ("1 entries RBE2 are no solids or shells and are left out",)


def test_free_fields_and_polar_coordinates():
    """Quadrangle (1,0) (2,0) (0,2) (0,1), 3 high, of two wedges."""
    loaded = load_mesh(DATA / "mesh_free.bdf")
    assert volume(loaded.mesh, volume_group(loaded, "ring")) == pytest.approx(4.5, rel=1e-12)
    assert area(loaded.mesh, surface_group(loaded, "8")) == pytest.approx(1.5, rel=1e-12)
    assert sorted(set(loaded.element_labels)) == ["10", "11"]


def _card(name, values):
    """Small fields with +n continuation marks in column 73, as Patran writes them."""
    fields = [str(v) for v in values]
    lines = []
    for i in range(0, len(fields), 8):
        mark = i // 8
        head = name if i == 0 else f"+{mark}"
        tail = f"+{mark + 1}" if i + 8 < len(fields) else ""
        lines.append(head.ljust(8) + "".join(f.rjust(8) for f in fields[i : i + 8]).ljust(64) + tail)
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(("name", "kind"), [("CHEXA", "hexahedron20"), ("CPENTA", "wedge15"), ("CTETRA", "tetra10")])
def test_midside_nodes_in_nastrans_order(tmp_path, name, kind):
    """Bottom edges, upright edges, top edges; a wrong order would change the volume or fold the element."""
    corner = {"CHEXA": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
              "CPENTA": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
              "CTETRA": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]}[name]  # fmt: skip
    edge = {"CHEXA": "12 23 34 41 15 26 37 48 56 67 78 85", "CPENTA": "12 23 31 14 25 36 45 56 64",
            "CTETRA": "12 23 31 14 24 34"}[name].split()  # fmt: skip
    points = [*corner, *(tuple(np.mean([corner[int(a) - 1], corner[int(b) - 1]], axis=0)) for a, b in edge)]
    text = "".join(
        f"GRID*   {i + 1:16d}{'':16s}{x:16.9f}{y:16.9f}*\n*       {z:16.9f}\n" for i, (x, y, z) in enumerate(points)
    )
    loaded = written(tmp_path, "BEGIN BULK\n" + text + _card(name, [5, 9, *range(1, len(points) + 1)]) + "ENDDATA\n")
    mesh = loaded.mesh
    assert type(mesh).__name__ == ("MeshHex2" if name == "CHEXA" else "MeshTet2")
    assert volume(mesh) == pytest.approx({"CHEXA": 1.0, "CPENTA": 0.5, "CTETRA": 1 / 6}[name], rel=1e-12)
    x = np.full((3, 1), 0.2)
    if name == "CHEXA":
        assert np.allclose(mesh.mapping().F(x)[:, 0], x, atol=1e-14)
    # Straight edges: every node of a quadratic mesh is a corner or the middle of an edge.
    middles = mesh.p[:, mesh.edges].mean(axis=1)
    stored = mesh.doflocs[:, mesh.dofs.edge_dofs[0]]
    assert np.allclose(stored, middles, atol=1e-14)


def test_spherical_system_in_a_shifted_one(tmp_path):
    """CORD2S within CORD2R: node 4 at radius 1, polar angle 0 above (5, 0, 0)."""
    text = (
        "CORD2R,1,0,5.,0.,0.,5.,0.,1.\n,6.,0.,0.\nCORD2S,2,1,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n"
        "GRID,1,2,0.,0.,0.\nGRID,2,2,1.,90.,0.\nGRID,3,2,1.,90.,90.\nGRID,4,2,1.,0.,0.\nCTETRA,1,1,1,2,3,4\n"
    )
    mesh = written(tmp_path, text).mesh
    assert np.allclose(sorted(mesh.p.T.tolist()), [[5, 0, 0], [5, 0, 1], [5, 1, 0], [6, 0, 0]], atol=1e-14)


def test_systems_of_grid_points(tmp_path):
    """CORD1S of grid points in a CORD2R, which is defined in a CORD1R: the same node 4; two systems on one card."""
    text = (
        "CORD1S,2,11,12,13\nCORD1R,6,11,13,14,5,11,12,13\nCORD1R,3,21,22,23\nCORD2R,1,3,5.,0.,0.,5.,0.,1.\n,6.,0.,0.\n"
        "GRID,11,1,0.,0.,0.\nGRID,12,1,0.,0.,1.\nGRID,13,1,1.,0.,0.\nGRID,14,,5.,1.,0.\n"
        "GRID,21,,0.,0.,0.\nGRID,22,,0.,0.,2.\nGRID,23,,3.,0.,0.\n"
        "GRID,1,2,0.,0.,0.\nGRID,2,2,1.,90.,0.\nGRID,3,2,1.,90.,90.\nGRID,4,5,0.,0.,1.\nCTETRA,1,1,1,2,3,4\n"
    )
    mesh = written(tmp_path, text).mesh
    assert np.allclose(sorted(mesh.p.T.tolist()), [[5, 0, 0], [5, 0, 1], [5, 1, 0], [6, 0, 0]], atol=1e-14)


@pytest.mark.parametrize(("suffix", "line", "nodes", "element"), [
    (".inp", "*INCLUDE, INPUT={}\n", "*NODE\n1, 0., 0., 0.\n2, {}, 0., 0.\n3, 0., 1., 0.\n4, 0., 0., 1.\n",
     "*ELEMENT, TYPE=C3D4, ELSET=BODY\n5, 1, 2, 3, 4\n"),
    (".bdf", "  INCLUDE '{}'\n", GRIDS.replace("1.,0.,0.", "{},0.,0."), "CTETRA,1,1,1,2,3,4\n"),
], ids=["Abaqus", "Nastran"])  # fmt: skip
def test_includes_of_includes_are_beside_them_or_beside_the_mesh_file(tmp_path, suffix, line, nodes, element):
    """Where there is one in both places, Abaqus takes that beside the job, Nastran that beside the including file."""
    (tmp_path / "sub").mkdir()
    path = tmp_path / f"a{suffix}"
    path.write_text(line.format("sub/b.inc"))
    for name, places, length in (("sub/c.inc", ["sub/c.inc"], 2), ("c.inc", ["sub/c.inc"], 2),
                                 ("c.inc", ["sub/c.inc", "c.inc"], 3 if suffix == ".inp" else 2)):  # fmt: skip
        (tmp_path / "sub" / "b.inc").write_text(line.format(name) + element)
        for place in places:
            (tmp_path / place).write_text(nodes.format("2." if "/" in place else "3."))
        assert load_mesh(path).mesh.p[0].max() == pytest.approx(length)


@pytest.mark.parametrize(("text", "message"), [
    ("CORD1R,1,1,2,9\n" + GRIDS, r"line 1: CORD1R 1 is not readable \(GRID 9 does not exist\)"),
    ("CORD1R,1,2,3,4\n" + GRIDS.replace("GRID,2,", "GRID,2,1"), "GRID 2 is given in coordinate system 1, which"),
    ("hello\n", "no GRID entries; expected Nastran bulk data"),
    (GRIDS + "CTETRA,1,1,1,2,3,9\n", "element 1 refers to node 9, which the file does not define"),
    (GRIDS + "CTETRA,1,1,1,2,3\n", "CTETRA 1 needs 4 corner nodes; some are blank"),
    (GRIDS + "CTETRA,1,x,1,2,3,4\n", 'CTETRA 1 has "x" where a whole number is expected'),
    (GRIDS.replace("GRID,2,", "GRID,2,7") + "CTETRA,1,1,1,2,3,4\n", "GRID 2 is given in coordinate system 7, which"),
    (GRIDS.replace("1.,0.,0.", "1.,a,0.") + "CTETRA,1,1,1,2,3,4\n", "GRID 2 is not readable"),
    (GRIDS + "GRID,5,,0.,0.,-1.\nCTETRA,2,1,1,2,5,3\nCTETRA,3,1,1,2,3,5\n", "3 is a copy of another"),
    (GRIDS + "GRID,5,,1.,1.,1.\nCTETRA,1,1,1,2,3,4\nCTETRA,2,6,2,3,4,5\nCTETRA,3,1,1,2,4,5\n", r"3 is inverted.*\"1\""),
    ("CORD2R,1,2,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nGRID,1,1,0.,0.,0.\n", "defined in system 2, which the file does not"),
])  # fmt: skip
def test_what_is_refused(tmp_path, text, message):
    with pytest.raises(MeshError, match=message):
        written(tmp_path, text)
