"""The parametric meshes have the volumes and areas of closed forms, by gmsh's own quadrature of the files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
from brakes import BRAKE, ROW, Kind, exact, group_cells

from fe_squeal.geometry import Block, DiscPad, write_mesh


def integrals(path: Path) -> dict[str, float]:
    """Volume or area of every group by gmsh's own reading of the file; asserts that no Jacobian is negative."""
    sums = {}
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        for dimension, tag in gmsh.model.getPhysicalGroups():
            total = 0.0
            for entity in gmsh.model.getEntitiesForPhysicalGroup(dimension, tag):
                (kind,) = gmsh.model.mesh.getElementTypes(dimension, entity)
                # Exact for the Jacobians of 27-node hexahedra, which are of degree 5 in each direction.
                points, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss8")
                _, determinants, _ = gmsh.model.mesh.getJacobians(kind, points, entity)
                assert determinants.min() > 0.0
                total += float(np.sum(determinants.reshape(-1, len(weights)) @ weights))
            sums[gmsh.model.getPhysicalName(dimension, tag)] = total
    finally:
        gmsh.finalize()
    return sums


VARIANTS: list[dict[str, Any]] = [
    {},
    {"geometry_order": 1},
    {"pads": 1, "gap": 0.001},
    {"pad_angle_deg": 360},
    {"pad_angle_deg": 340, "size": 1.0, "geometry_order": 1},  # as coarse as it gets
    {"back_plate_thickness": 0, "refinement": 2},
    {"pad_outer_radius": 0.14, "disc_layers": 3, "pad_layers": 2, "back_plate_layers": 2},
]


@pytest.mark.parametrize("change", VARIANTS, ids=str)
def test_hexahedra_have_the_volumes_and_areas_of_their_curves(change: dict[str, Any], tmp_path: Path) -> None:
    geometry = DiscPad(**{**BRAKE, **change})
    found = integrals(write_mesh(geometry, tmp_path / "brake.msh"))
    # Polynomials integrated exactly: rounding only. The arc lengths of the cylinders are roots: Gauss's error as well.
    assert found == pytest.approx(exact(geometry, geometry.geometry_order), rel=1e-11)
    h = max(math.pi / geometry.disc_counts[1], geometry.pad_angle / geometry.pad_counts[1] / 2)
    true = exact(geometry, None)
    bound = h**4 / 30 if geometry.geometry_order == 2 else 2 * h**2 / 3
    for body in ("disc", "pad_1"):
        assert 0.0 < 1.0 - found[body] / true[body] < bound  # as the docstring of DiscPad promises


@pytest.mark.parametrize("change", [{}, {"geometry_order": 1}, {"pads": 1}, {"pad_angle_deg": 360}], ids=str)
def test_tetrahedra_have_the_true_volumes_and_areas(change: dict[str, Any], tmp_path: Path) -> None:
    geometry = DiscPad(**{**BRAKE, **change}, element="tet")
    found = integrals(write_mesh(geometry, tmp_path / "brake.msh"))
    # An edge may be half as long again as asked for; the bounds of the hexahedra then hold with h = 0.75 size / radius,
    # and the errors of the two circles of a ring, each relative to its own disc, add up over the ring's smaller area.
    h = 0.75 * geometry.size / geometry.inner_radius
    circles = (geometry.outer_radius**2 + geometry.inner_radius**2) / (
        geometry.pad_outer_radius**2 - geometry.pad_inner_radius**2
    )
    bound = circles * (h**4 / 30 if geometry.geometry_order == 2 else 2 * h**2 / 3)
    assert found == pytest.approx(exact(geometry, None), rel=bound)


@pytest.mark.slow
@pytest.mark.parametrize("element", ["hex", "tet"])
@pytest.mark.parametrize("order", [1, 2])
def test_blocks_and_belt_fill_their_boxes(element: Kind, order: int, tmp_path: Path) -> None:
    row = Block(**ROW, element=element, geometry_order=order)
    path = write_mesh(row, tmp_path / "row.msh")
    boxes = {f"block_{n}": (-0.14 + 0.1 * (n - 1), 0.08, 0.04, 0.0, 0.015) for n in (1, 2, 3)}
    boxes["belt"] = (-0.17, 0.34, 0.04, -0.012, 0.012)
    expected, places = {}, {}
    for body, (x, length, width, z, height) in boxes.items():
        prefix, suffix = ("belt_", "") if body == "belt" else ("", body.removeprefix("block"))
        expected[body] = length * width * height
        for side, axis, value, area in (
            ("left", 0, x, width * height),
            ("right", 0, x + length, width * height),
            ("front", 1, -width / 2, length * height),
            ("back", 1, width / 2, length * height),
            ("bottom", 2, z, length * width),
            ("top", 2, z + height, length * width),
        ):
            expected[prefix + side + suffix] = area
            places[prefix + side + suffix] = (axis, value)
    assert integrals(path) == pytest.approx(expected, rel=1e-10)  # gmsh places nodes to 1e-12 of its box
    points, cells = group_cells(path)
    for name, (axis, value) in places.items():
        np.testing.assert_allclose(points[cells[name], axis], value, atol=1e-12)
    bodies = [set(cells[body].ravel()) for body in boxes]
    assert sum(map(len, bodies)) == len(points)  # so no two share a node
