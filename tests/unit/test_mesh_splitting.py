"""Mixed meshes split into tetrahedra: nothing hangs, volume and boundary stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mesh_measures import area, grid_of_kinds, volume

from fe_squeal.errors import MeshError
from fe_squeal.mesh.building import build_mesh
from fe_squeal.mesh.elements import corner_count
from fe_squeal.mesh.node_sets import find_nodes
from fe_squeal.mesh.raw import CellBlock, RawMesh

LINEAR = ["hexahedron", "wedge", "pyramid"]
QUADRATIC = ["hexahedron20", "wedge15", "pyramid13"]
FULL = ["hexahedron27", "wedge18", "pyramid14"]


def shear(x):
    return x @ np.array([[1.0, 0.2, 0.1], [0.0, 1.0, 0.3], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    "kinds", [LINEAR, ["wedge"], ["pyramid", "hexahedron"], QUADRATIC, FULL, ["hexahedron20", "wedge"]]
)
@pytest.mark.parametrize("seed", [0, 1])
def test_split_grids_conform(kinds, seed):
    """det(shear) = 1: volume 1; every boundary face of a cube gives two triangles, none is left inside."""
    n = 3
    mesh = build_mesh(grid_of_kinds(n, kinds, shear, seed), "grid.msh").mesh
    boundary = mesh.boundary_facets()
    assert len(boundary) == 6 * n * n * 2
    assert volume(mesh) == pytest.approx(1.0, rel=1e-12)
    corners = mesh.p[:, mesh.facets[:, boundary]] - shear(np.full((1, 3), 0.5)).T[:, :, None]
    # Areas of the parallelepiped's faces, by the rows of the map.
    a, b, c = np.eye(3) @ np.array([[1.0, 0.2, 0.1], [0.0, 1.0, 0.3], [0.0, 0.0, 1.0]])
    exact = 2 * sum(np.linalg.norm(np.cross(u, v)) for u, v in ((a, b), (b, c), (c, a)))
    assert area(mesh, boundary) == pytest.approx(exact, rel=1e-12)
    assert corners.shape[1] == 3


def test_curved_split_stays_curved():
    """Quadratic cells of a quarter ring: the volume error falls as h^4 or better, far below the straight one's."""

    def ring(x):
        r, t = 1 + x[:, 0], np.pi / 2 * x[:, 1]
        return np.column_stack([r * np.cos(t), r * np.sin(t), x[:, 2]])

    exact, errors = 3 * np.pi / 4, {}
    for n in (2, 4):
        for name, kinds in (("curved", QUADRATIC), ("straight", LINEAR)):
            errors[name, n] = abs(volume(build_mesh(grid_of_kinds(n, kinds, ring, 3), "r.msh").mesh) / exact - 1)
    assert errors["curved", 4] < 1e-3 * 1 and errors["curved", 4] < errors["straight", 4] / 20
    assert np.log2(errors["curved", 2] / errors["curved", 4]) > 3.5


def test_tetrahedra_of_both_orders_are_promoted():
    raw = grid_of_kinds(2, ["tetra", "tetra10"], shear, 5)
    loaded = build_mesh(raw, "both.msh")
    assert type(loaded.mesh).__name__ == "MeshTet2"
    assert volume(loaded.mesh) == pytest.approx(1.0, rel=1e-12)
    assert any("linear elements beside quadratic ones" in note for note in loaded.notes)


def test_hexahedra_of_all_orders_become_27_nodes():
    loaded = build_mesh(grid_of_kinds(2, ["hexahedron", "hexahedron20", "hexahedron27"], shear, 5), "both.msh")
    assert type(loaded.mesh).__name__ == "MeshHex2"
    assert volume(loaded.mesh) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("kinds", [["hexahedron20"], ["hexahedron", "hexahedron27"], QUADRATIC, ["tetra10"]])
def test_every_node_belongs_to_an_element(kinds):
    """Of a cube that lies off the origin: its extent is that of all nodes."""
    loaded = build_mesh(grid_of_kinds(2, kinds, lambda x: x + 5.0, 5), "off.msh")
    mesh = loaded.mesh
    np.testing.assert_allclose(np.ptp(mesh.p, axis=1), 1.0)
    assert mesh.p.shape[1] == mesh.doflocs.shape[1] == mesh.dofs.N == len(loaded.added)


def test_missing_midside_nodes_are_filled_from_the_neighbour():
    raw = grid_of_kinds(1, ["tetra10"], lambda x: x + 0.05 * x**2, 2)
    whole = volume(build_mesh(raw, "a.bdf").mesh)
    nodes = raw.blocks[0].nodes.copy()
    nodes[0, 4:] = -1
    holes = RawMesh(raw.points, raw.node_labels, (CellBlock("tetra10", nodes, raw.blocks[0].labels),), {}, {})
    loaded = build_mesh(holes, "b.bdf")
    assert any("without some of their midside nodes" in note for note in loaded.notes)
    # Only edges that no neighbour has become straight.
    assert volume(loaded.mesh) == pytest.approx(whole, rel=0.02)


def arched(x):
    x, y, z = x.T
    return np.column_stack([x, y, z + 0.3 * x**2 * y**2 * z**2])


@pytest.mark.parametrize(("left_out", "error"), [("one side", 1e-12), ("both sides", 2e-3), ("all", 2e-3)])
def test_missing_centres_are_those_of_the_neighbour_or_of_the_map(left_out, error):
    """Of a face that one cell alone lacks, the mesh is the whole one; not so where the map of the edges is taken."""
    raw = grid_of_kinds(2, ["hexahedron27"], arched, 2)
    whole, (block,) = volume(build_mesh(raw, "a.inp").mesh), raw.blocks
    nodes, faces = block.nodes.copy(), np.flatnonzero(np.isin(block.nodes[0], block.nodes[1:]))
    centre = next(j for j in faces if j >= 20)  # of a face that the first cell shares
    if left_out == "all":
        nodes[:, 20:] = -1
    else:
        nodes[(nodes == nodes[0, centre]) & ((np.arange(8) == 0) | (left_out == "both sides"))[:, None]] = -1
    loaded = build_mesh(replace(raw, blocks=(replace(block, nodes=nodes),)), "b.inp")
    assert volume(loaded.mesh) == pytest.approx(whole, rel=error)
    assert loaded.added.sum() == {"one side": 0, "both sides": 1, "all": 44}[left_out]


def test_hexahedra_of_20_nodes_fit_those_of_27():
    """In a face between them both have the same centre, though the map of 20 nodes has it elsewhere."""
    mixed, whole = (volume(build_mesh(grid_of_kinds(2, kinds, arched, 5), "a.msh").mesh)
                    for kinds in (["hexahedron20", "hexahedron27"], ["hexahedron27"]))  # fmt: skip
    assert mixed == pytest.approx(whole, rel=2e-3)


@pytest.mark.parametrize("kind", ["tetra10", "wedge15"])
def test_midside_nodes_that_lie_apart_are_refused(kind):
    raw = grid_of_kinds(1, [kind], lambda x: x, 2)
    nodes, points, count = raw.blocks[0].nodes.copy(), raw.points, corner_count(kind)
    shared = nodes[0, count:][np.isin(nodes[0, count:], nodes[1:, count:])][0]
    points = np.vstack([points, points[shared] + 0.02])
    nodes[0][nodes[0] == shared] = len(points) - 1
    broken = RawMesh(points, np.arange(len(points)), (CellBlock(kind, nodes, raw.blocks[0].labels),), {}, {})
    with pytest.raises(MeshError, match="midside node there lies elsewhere"):
        build_mesh(broken, "gap.inp")


@pytest.mark.parametrize("kinds", [QUADRATIC, FULL, ["hexahedron20", "tetra10"]])
def test_nodes_of_sets_stay_when_cells_are_split(kinds):
    """All nodes of a face, its corners alone, its other nodes alone, and one node by its number."""
    raw, top = grid_with_top(kinds)
    ends = np.unique(np.concatenate([block.nodes[:, : corner_count(block.kind)].ravel() for block in raw.blocks]))
    sets = {"top": top, "corners": np.intersect1d(top, ends), "middles": np.setdiff1d(top, ends)}
    loaded = build_mesh(replace(raw, node_groups=sets), "top.inp")
    for name, rows in sets.items():
        found = loaded.mesh.doflocs[:, loaded.node_groups[name].nodes].T
        np.testing.assert_allclose(np.unique(found.round(9), axis=0), np.unique(raw.points[rows].round(9), axis=0))
        assert not np.isin(loaded.node_groups[name].held, _columns(loaded, np.setdiff1d(ends, rows))).any()
    # Between nodes of the face only those are held with it that the file does not have.
    others = np.setdiff1d(loaded.node_groups["corners"].held, loaded.node_groups["corners"].nodes)
    assert loaded.added[others].all() and not loaded.added[_columns(loaded, np.arange(len(raw.points)))].any()
    at = loaded.mesh.doflocs[:, find_nodes(loaded, str(sets["middles"][0]), "nodes").nodes]
    np.testing.assert_allclose(at[:, 0], raw.points[sets["middles"][0]], atol=1e-12)


@pytest.mark.parametrize("kinds", [["tetra10", "tetra"], ["hexahedron20", "hexahedron"], ["wedge15", "hexahedron"]])
def test_node_sets_cover_faces_whose_midside_nodes_were_added(kinds):
    """Faces of linear cells beside quadratic ones; with a midside node of the file left out, its two faces are none."""
    raw, top = grid_with_top(kinds)
    middle = np.intersect1d(raw.blocks[0].nodes[:, corner_count(kinds[0]) :], top)
    sets = {"top": top, "less": np.setdiff1d(top, middle[:1])}
    mesh = build_mesh(replace(raw, node_groups=sets), "top.inp").mesh
    assert area(mesh, mesh.boundaries["top"]) == pytest.approx(1.0, rel=1e-12)
    assert 0.4 < area(mesh, mesh.boundaries["less"]) < 0.9


@pytest.mark.parametrize("kind", ["hexahedron20", "hexahedron", "hexahedron27"])
def test_centres_are_held_with_all_nodes_around_them(kind):
    """Of the face of 2 x 2 hexahedra; corners alone hold no more than themselves where the file has other nodes."""
    raw, top = grid_with_top([kind])
    if kind == "hexahedron":  # of 20 nodes, none of whose midside nodes the file has
        (block,) = raw.blocks
        nodes = np.pad(block.nodes, ((0, 0), (0, 12)), constant_values=-1)
        raw = replace(raw, blocks=(replace(block, kind="hexahedron20", nodes=nodes),))
    corners = top[np.abs(raw.points[top] * 2 % 1).max(axis=1) < 1e-9]
    loaded = build_mesh(replace(raw, node_groups={"top": top, "corners": corners}), "a.inp")
    held = {name: len(group.held) for name, group in loaded.node_groups.items()}
    assert held == {"top": 25, "corners": 25 if kind == "hexahedron" else 9}


def grid_with_top(kinds):
    """Return a unit cube of some kinds of cells, and the nodes of its face z = 1."""
    raw = grid_of_kinds(2, kinds, lambda x: x, 4)
    return raw, np.flatnonzero(np.abs(raw.points[:, 2] - 1) < 1e-9)


def _columns(loaded, numbers):
    """Return the columns (n,) of the mesh's nodes that nodes of the file are."""
    known, columns = loaded.node_numbers[""]
    return columns[np.searchsorted(known, numbers)]
