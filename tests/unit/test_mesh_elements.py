"""Node orders against VTK, Gmsh and scikit-fem; shape functions; curved geometry against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_measures import area, single, volume

from fe_squeal.errors import MeshError
from fe_squeal.mesh.building import build_mesh
from fe_squeal.mesh.elements import (
    FACES,
    MESH_CLASS,
    REFERENCE,
    SHAPE,
    corner_count,
    matching,
    mirror_order,
    quadrature,
    shape_functions,
    shape_gradients,
    skfem_order,
)
from fe_squeal.mesh.gmsh_cells import NODES, SOLIDS
from fe_squeal.mesh.raw import CellBlock, RawMesh

VTK = {
    "tetra": "vtkTetra", "tetra10": "vtkQuadraticTetra", "hexahedron": "vtkHexahedron", "wedge15": "vtkQuadraticWedge",
    "hexahedron20": "vtkQuadraticHexahedron", "hexahedron27": "vtkTriQuadraticHexahedron", "wedge": "vtkWedge",
    "wedge18": "vtkBiQuadraticQuadraticWedge",
}  # fmt: skip
EXACT = {"tetra": 1 / 6, "hexahedron": 1.0, "wedge": 0.5, "pyramid": 4 / 3}
# Parabola through the points of an arc at 0, 45 and 90 degrees: triangle plus 2/3 chord times sagitta, over r^2.
PARABOLIC = 0.5 + 2 / 3 * (np.sqrt(2) - 1)


@pytest.mark.parametrize("kind", VTK)
def test_reference_nodes_are_vtks(kind):
    import vtk

    cell = getattr(vtk, VTK[kind])()
    theirs = np.array(cell.GetParametricCoords()).reshape(-1, 3)[: cell.GetNumberOfPoints()]
    assert np.array_equal(theirs, REFERENCE[kind])


def test_gmsh_orders_are_gmshs_own():
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        for number, (kind, order) in SOLIDS.items():
            _, _, _, count, local, _ = gmsh.model.mesh.getElementProperties(number)
            local = local.reshape(-1, 3)
            if SHAPE[kind] == "hexahedron":
                local = (local + 1) / 2
            elif SHAPE[kind] == "wedge":
                local = local * [1, 1, 0.5] + [0, 0, 0.5]
            assert count == NODES[number]
            assert np.allclose(local[order or slice(None)], REFERENCE[kind], atol=1e-14)
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("kind", REFERENCE)
def test_shape_functions_are_nodal_and_sum_to_one(kind):
    assert np.allclose(shape_functions(kind, REFERENCE[kind]), np.eye(len(REFERENCE[kind])), atol=1e-12)
    x, w = quadrature(kind)
    assert np.allclose(shape_functions(kind, x).sum(axis=1), 1, atol=1e-12)
    assert np.allclose(shape_gradients(kind, x).sum(axis=1), 0, atol=1e-12)
    # The gradient of the identity map is the identity.
    assert np.allclose(np.einsum("kd,qke->qde", REFERENCE[kind], shape_gradients(kind, x)), np.eye(3), atol=1e-12)
    assert w.sum() == pytest.approx(EXACT[SHAPE[kind]], rel=1e-12)


@pytest.mark.parametrize("shape", FACES)
def test_faces_are_counterclockwise_from_outside(shape):
    x = REFERENCE[shape]
    total = 0.0
    for face in FACES[shape]:
        a = x[list(face)]
        for i in range(1, len(face) - 1):  # divergence theorem: the volume is a third of the flux of x
            total += np.dot(a[0], np.cross(a[i], a[i + 1])) / 6
    assert total == pytest.approx(EXACT[shape], rel=1e-14)


@pytest.mark.parametrize("kind", MESH_CLASS)
def test_quadratic_maps_come_out_exactly(kind):
    """A polynomial map of the reference cell, given at the nodes, is scikit-fem's own map everywhere."""
    quadratic = kind != SHAPE[kind]
    rng = np.random.default_rng(1)
    bend = rng.uniform(-0.05, 0.05, (3, 3, 3)) * quadratic
    linear = np.eye(3) + rng.uniform(-0.2, 0.2, (3, 3))

    def move(x):
        return x @ linear.T + np.einsum("ijk,nj,nk->ni", bend, x, x)

    mesh = build_mesh(single(kind, move), "one.msh").mesh
    assert isinstance(mesh, MESH_CLASS[kind])
    x = rng.uniform(0, 1, (20, 3)) / (3 if SHAPE[kind] == "tetra" else 1)
    assert np.allclose(mesh.mapping().F(x.T)[:, 0].T, move(x), atol=1e-14)
    assert np.array_equal(REFERENCE[kind][skfem_order(kind)], mesh.elem.doflocs)


def sector(inner, outer):
    """Hexahedron -> quarter of a ring; the middle nodes land on the arcs."""

    def move(x):
        r, t = inner + (outer - inner) * x[:, 0], np.pi / 2 * x[:, 1]
        return np.column_stack([r * np.cos(t), r * np.sin(t), x[:, 2]])

    return move


@pytest.mark.parametrize("kind", ["hexahedron20", "hexahedron27"])
def test_ring_sector_of_hexahedra_has_the_parabolic_volume(kind):
    mesh = build_mesh(single(kind, sector(1.0, 2.0)), "ring.inp").mesh
    assert volume(mesh) == pytest.approx(3 * PARABOLIC, rel=1e-13)
    assert volume(mesh) == pytest.approx(3 * np.pi / 4, rel=0.02)  # the true sector, one element for 90 degrees
    ends = [f for f in mesh.boundary_facets() if np.ptp(mesh.p[2, mesh.facets[:, f]]) == 0]
    assert area(mesh, np.array(ends)) == pytest.approx(6 * PARABOLIC, rel=1e-12)


def test_quarter_cylinder_of_wedges_keeps_its_volume_when_split():
    def move(x):
        t = np.arctan2(x[:, 1], x[:, 0])
        stretch = (x[:, 0] + x[:, 1]) / np.maximum(np.hypot(x[:, 0], x[:, 1]), 1e-300)
        return np.column_stack(
            [
                stretch * np.hypot(x[:, 0], x[:, 1]) * np.cos(t),
                stretch * np.hypot(x[:, 0], x[:, 1]) * np.sin(t),
                x[:, 2],
            ]
        )

    loaded = build_mesh(single("wedge15", move), "quarter.inp")
    assert loaded.mesh.nelements == 3 and type(loaded.mesh).__name__ == "MeshTet2"
    assert volume(loaded.mesh) == pytest.approx(PARABOLIC, rel=1e-12)
    assert "1 wedges split into 3 tetrahedra" in loaded.notes


@pytest.mark.parametrize("kind", REFERENCE)
def test_mirrored_cells_are_the_same_body(kind):
    raw = single(kind)
    left = raw.blocks[0].nodes[:, mirror_order(kind)]
    turned = build_mesh(
        type(raw)(raw.points, raw.node_labels, (type(raw.blocks[0])(kind, left, np.array([7])),), {}, {}), "m.inp"
    )
    assert any("left-handed throughout" in note for note in turned.notes)
    assert volume(turned.mesh) == pytest.approx(EXACT[SHAPE[kind]], rel=1e-12)


def cells_at(kind, *places):
    """Reference cells, each in a size and moved, with labels 7, 8, ...; where nodes meet they are the same one."""
    points = np.concatenate([size * REFERENCE[kind] + shift for size, *shift in places])
    _, first, nodes = np.unique(points, axis=0, return_index=True, return_inverse=True)
    rows = nodes.reshape(len(places), -1)
    return RawMesh(points[first], first + 1, (CellBlock(kind, rows, 7 + np.arange(len(rows))),), {}, {})


@pytest.mark.parametrize("kind", ["tetra10", "hexahedron20", "hexahedron27", "wedge15", "pyramid13"])
def test_a_large_element_beside_smaller_ones_is_refused(kind):
    """The top of the small one is the middle of an edge of the large one; a third element is far away."""
    shift = REFERENCE[kind][corner_count(kind)] - 0.5 * REFERENCE[SHAPE[kind]][-1]
    with pytest.raises(MeshError, match=r"^a\.inp: elements 7, 8 have a node that is a corner of one and a midside"):
        build_mesh(cells_at(kind, (1.0, 0, 0, 0), (0.5, *shift), (1.0, 9, 9, 9)), "a.inp")
    fitting = build_mesh(cells_at(kind, (1.0, 0, 0, 0), (0.5, 5, 5, 5), (1.0, 9, 9, 9)), "a.inp")
    assert volume(fitting.mesh) == pytest.approx(2.125 * EXACT[SHAPE[kind]], rel=1e-12)


def test_a_midside_node_of_two_edges_is_refused():
    """Elements 7 and 9 touch with nodes of their own, but for one; 7 and 8 share corners, and midside nodes are apart.

    The nodes that are left over for 7 and 8 are as many as are missing, and more.
    """
    raw = cells_at("hexahedron20", (1.0, 0, 0, 0), (1.0, 0, 0, -1), (1.0, 0, 0, 1))
    rows, places = raw.blocks[0].nodes.copy(), raw.points[raw.blocks[0].nodes]
    own = [(1, slice(8, 20)), (2, slice(0, 8)), (2, slice(9, 20))]  # node 8 of element 9 stays that of 7
    points = [raw.points]
    for cell, columns in own:
        rows[cell, columns] = sum(map(len, points)) + np.arange(len(rows[cell, columns]))
        points.append(places[cell, columns])
    points = np.concatenate(points)
    raw = RawMesh(points, np.arange(len(points)), (CellBlock("hexahedron20", rows, np.array([7, 8, 9])),), {}, {})
    with pytest.raises(MeshError, match=r"elements 7, 9 have a node .* or a midside node of two edges or faces"):
        build_mesh(raw, "a.inp")


def test_matching_refuses_other_node_sets():
    with pytest.raises(ValueError, match="differ"):
        matching(np.zeros((1, 3)), np.ones((1, 3)))
    assert corner_count("pyramid13") == 5
