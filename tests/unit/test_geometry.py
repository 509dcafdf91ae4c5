"""What the analysis relies on in the parametric meshes: symmetry, gluing, separation, and names of groups."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from brakes import BLOCK, BRAKE, ROW, Kind, exact, group_cells
from scipy.spatial import cKDTree

from fe_squeal.geometry import Block, DiscPad, write_mesh
from fe_squeal.geometry.grouped import GroupedMesh
from fe_squeal.geometry.structured import structured_block, structured_disc_pad


def test_one_block_has_plain_names(tmp_path: Path) -> None:
    _, cells = group_cells(write_mesh(Block(**BLOCK), tmp_path / "block.msh"))
    assert set(cells) == {"block", "bottom", "top", "left", "right", "front", "back"}
    assert len(cells["block"]) == 8 * 4 * 2


@pytest.mark.slow
@pytest.mark.parametrize("element", ["hex", "tet"])
@pytest.mark.parametrize("angle", [50, 360])
def test_groups_lie_where_they_should_and_share_the_right_nodes(element: Kind, angle: int, tmp_path: Path) -> None:
    geometry = DiscPad(**{**BRAKE, "pad_angle_deg": angle}, element=element)
    points, cells = group_cells(write_mesh(geometry, tmp_path / "brake.msh"))
    radius, theta, z = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0]), points[:, 2]
    places = {"hub": (radius, 0.07), "rim": (radius, 0.13), "disc_face_1": (z, 0.006), "disc_face_2": (z, -0.006)}
    for pad, sign in (("1", 1), ("2", -1)):
        places |= {f"pad_face_{pad}": (z, sign * 0.006), f"pad_back_{pad}": (z, sign * 0.022)}
        places |= {f"pad_inner_edge_{pad}": (radius, 0.085), f"pad_outer_edge_{pad}": (radius, 0.128)}
        if angle < 360:
            half = math.radians(25)
            places |= {f"pad_leading_{pad}": (theta, -half), f"pad_trailing_{pad}": (theta, half)}
    for name, (coordinate, value) in places.items():
        on = cells[name].ravel()
        if element == "tet" and name.startswith(("hub", "rim", "pad_inner", "pad_outer")):
            on = cells[name][:, :3].ravel()  # mid-nodes of edges that gmsh had to straighten may leave the circle
        np.testing.assert_allclose(coordinate[on], value, atol=1e-12)

    nodes = {name: set(c.ravel()) for name, c in cells.items()}
    for pad in ("1", "2"):
        glued = np.array(sorted(nodes[f"pad_{pad}"] & nodes[f"back_plate_{pad}"]))
        in_plane = np.flatnonzero(np.abs(np.abs(z) - 0.017) < 1e-12)
        in_plane = in_plane[np.sign(z[in_plane]) == (1 if pad == "1" else -1)]
        assert set(glued) == set(in_plane) and len(glued) > 0
        assert not nodes["disc"] & nodes[f"pad_{pad}"]
    assert not nodes["pad_1"] & nodes["pad_2"]
    used = set().union(*(nodes[name] for name in ("disc", "pad_1", "pad_2", "back_plate_1", "back_plate_2")))
    assert used == set(range(len(points)))


def nearest(points: np.ndarray, images: np.ndarray, tolerance: float) -> np.ndarray:
    """Match images to points one to one, within the tolerance; return the index of each image's point."""
    found = cKDTree(points).query(images)
    distance, index = np.asarray(found[0]), np.asarray(found[1])
    assert distance.max() <= tolerance
    assert len(set(index)) == len(points)
    return index


@pytest.mark.parametrize("order", [1, 2])
def test_one_sector_turns_the_disc_onto_itself(order: int) -> None:
    geometry = DiscPad(**BRAKE, geometry_order=order)
    mesh = structured_disc_pad(geometry)
    disc = mesh.volumes["disc"]
    points = mesh.points[: disc.max() + 1]
    angle = 2 * math.pi / geometry.disc_counts[1]
    turn = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
    image = nearest(points, points @ turn.T, 1e-15 * 0.2)  # a few roundings of coordinates up to 0.13
    assert {tuple(sorted(c)) for c in image[disc]} == {tuple(sorted(c)) for c in disc}
    nearest(points, points * [-1.0, 1.0, 1.0], 0.0)  # quarters are copies of each other: equal to the last bit


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("axis", [1, 2])
def test_brake_is_its_own_mirror_image(order: int, axis: int) -> None:
    mesh = structured_disc_pad(DiscPad(**BRAKE, geometry_order=order, gap=0.0003))
    mirror = np.ones(3)
    mirror[axis] = -1.0
    # Disc and pad faces are apart by the gap, so nearest neighbours are unique; to the last bit, hence 0.
    image = nearest(mesh.points, mesh.points * mirror, 0.0)
    swap = {"_1": "_2", "_2": "_1"} if axis == 2 else {}
    for name, cells in mesh.volumes.items():
        other = mesh.volumes[name[:-2] + swap.get(name[-2:], name[-2:])]
        assert {tuple(sorted(c)) for c in image[cells]} == {tuple(sorted(c)) for c in other}


def outflow(mesh: GroupedMesh, prefix: str, suffix: str) -> float:
    """Integral of x·n/3 over the plane facets of a body; its volume if they are closed and point outwards.

    The origin is moved, for seen from the axis the ends of a pad would count nothing.
    """
    total = 0.0
    for name, cells in mesh.surfaces.items():
        if name.startswith(prefix) and name.endswith(suffix):
            x = mesh.points[cells[:, :4]] - [0.3, 0.5, 0.7]
            normals = 0.5 * np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])  # length: the facet's area
            total += float(np.sum(x.mean(axis=1) * normals)) / 3
    return total


def test_facets_of_hexahedra_point_outwards() -> None:
    for angle in (50, 360):
        geometry = DiscPad(**{**BRAKE, "pad_angle_deg": angle, "geometry_order": 1})
        mesh, volumes = structured_disc_pad(geometry), exact(geometry, 1)
        for pad in ("_1", "_2"):
            assert outflow(mesh, "pad", pad) == pytest.approx(
                volumes[f"pad{pad}"] + volumes[f"back_plate{pad}"], rel=1e-9
            )
        whole = volumes["disc"] + 2 * (volumes["pad_1"] + volumes["back_plate_1"])
        assert outflow(mesh, "", "") == pytest.approx(whole, rel=1e-9)
    for order in (1, 2):
        row = structured_block(Block(**ROW, geometry_order=order))
        assert outflow(row, "", "_2") == pytest.approx(0.08 * 0.04 * 0.015, rel=1e-9)
        assert outflow(row, "belt", "") == pytest.approx(0.34 * 0.04 * 0.012, rel=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_file_holds_the_mesh_to_the_last_bit(order: int, tmp_path: Path) -> None:
    geometry = DiscPad(**BRAKE, geometry_order=order)
    mesh = structured_disc_pad(geometry)
    points, cells = group_cells(write_mesh(geometry, tmp_path / "brake.msh"))
    assert set(cells) == set(mesh.volumes) | set(mesh.surfaces)
    for name, expected in {**mesh.volumes, **mesh.surfaces}.items():
        corners = 8 if name in mesh.volumes else 4  # what follows the corners, meshio numbers otherwise than gmsh
        np.testing.assert_array_equal(points[cells[name][:, :corners]], mesh.points[expected[:, :corners]])
        found, given = points[cells[name]].reshape(-1, 3), mesh.points[expected].reshape(-1, 3)
        np.testing.assert_array_equal(np.unique(found, axis=0), np.unique(given, axis=0))


def test_mid_nodes_lie_on_circles_and_halfway_along_straight_edges() -> None:
    mesh = structured_disc_pad(DiscPad(**BRAKE))
    for cells in mesh.volumes.values():
        x = mesh.points[cells]
        for middle, (a, b) in {8: (0, 1), 10: (0, 4), 16: (4, 5), 12: (1, 5)}.items():
            np.testing.assert_allclose(x[:, middle], 0.5 * (x[:, a] + x[:, b]), rtol=0, atol=3e-17)  # two roundings
        radius = np.hypot(x[..., 0], x[..., 1])
        for middle, corner in {9: 0, 11: 1, 17: 4, 18: 5}.items():
            np.testing.assert_allclose(radius[:, middle], radius[:, corner], rtol=4e-16)


def test_counts_follow_the_size_and_double() -> None:
    even = DiscPad(**{**BRAKE, "size": 0.01, "thickness": 0.02, "pad_thickness": 0.01})
    half = DiscPad(**{**BRAKE, "size": 0.005, "thickness": 0.02, "pad_thickness": 0.01})
    assert even.disc_counts == (6, 64, 2)  # 2 pi 0.1 / 0.01 = 62.8, to the nearest multiple of 4
    assert half.disc_counts == (12, 124, 4)  # 125.7: rounding again
    assert even.refined(2).disc_counts == (12, 128, 4)  # and here every element is halved
    assert even.pad_counts == (4, 9, 1, 1)
    assert even.refined(3).pad_counts == (12, 27, 3, 3)
    assert even.refined(2).refined(3) == even.refined(6)
    assert even.refined(2).edge_length == 0.005
    block = Block(**BLOCK)
    assert block.block_counts == (8, 4, 2)
    assert Block(**{**BLOCK, "size": 0.005}).block_counts == (16, 8, 3)
    assert Block(**{**BLOCK, "height": 0.02}).block_counts == (8, 4, 2)
    assert Block(**{**BLOCK, "height": 0.02, "size": 0.005}).block_counts == (16, 8, 4)


@pytest.mark.slow
@pytest.mark.parametrize("element", ["hex", "tet"])
def test_refined_meshes_have_more_elements(element: Kind, tmp_path: Path) -> None:
    geometry = DiscPad(**BRAKE, element=element)
    _, coarse = group_cells(write_mesh(geometry, tmp_path / "coarse.msh"))
    _, fine = group_cells(write_mesh(geometry.refined(2), tmp_path / "fine.msh"))
    ratio = len(fine["disc"]) / len(coarse["disc"])
    assert ratio == 8 if element == "hex" else 3 < ratio < 12
