"""The parametric brake and blocks that tests of geometries use, their exact sizes, and a reader of their files."""

import math
from pathlib import Path
from typing import Any, Literal

import meshio
import numpy as np
from scipy.integrate import quad

from fe_squeal.geometry import DiscPad

Kind = Literal["hex", "tet"]
BRAKE: dict[str, Any] = dict(
    inner_radius=0.07,
    outer_radius=0.13,
    thickness=0.012,
    pad_inner_radius=0.085,
    pad_outer_radius=0.128,
    pad_angle_deg=50,
    pad_thickness=0.011,
    back_plate_thickness=0.005,
    size=0.014,
)
BLOCK: dict[str, Any] = dict(length=0.08, width=0.04, height=0.015, size=0.01)
ROW: dict[str, Any] = {**BLOCK, "count": 3, "spacing": 0.02, "belt_thickness": 0.012, "belt_margin_x": 0.03}


def group_cells(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the points (n, 3) and the cells of every group of a mesh file, as meshio reads them."""
    mesh = meshio.read(path)
    names = {(int(tag), int(dimension)): name for name, (tag, dimension) in mesh.field_data.items()}
    cells: dict[str, list[np.ndarray]] = {}
    for block, tags in zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True):
        cells.setdefault(names[int(tags[0]), block.dim], []).append(block.data)
    return mesh.points, {name: np.vstack(blocks) for name, blocks in cells.items()}


def area_factor(h: float, order: int) -> float:
    """Return the area of a sector of angle 2h whose arc is replaced by a chord or a parabola, over the true area."""
    return math.sin(2 * h) / (2 * h) if order == 1 else math.sin(h) * (4 - math.cos(h)) / (3 * h)


def arc_factor(h: float, order: int) -> float:
    """Return the length of the chord or parabola of `area_factor`, over that of the arc."""
    if order == 1:
        return math.sin(h) / h
    return quad(lambda t: math.hypot(2 * (1 - math.cos(h)) * t, math.sin(h)), 0, 1, epsabs=1e-14)[0] / h


def exact(g: DiscPad, order: int | None) -> dict[str, float]:
    """Return the volumes and areas of the groups: those of the structured mesh, or the true ones for order None."""

    def factors(half_angle: float) -> tuple[float, float]:
        return (1.0, 1.0) if order is None else (area_factor(half_angle, order), arc_factor(half_angle, order))

    plane, arc = factors(math.pi / g.disc_counts[1])
    face = math.pi * (g.outer_radius**2 - g.inner_radius**2) * plane
    values = {
        "disc": face * g.thickness,
        "disc_face_1": face,
        "disc_face_2": face,
        "hub": 2 * math.pi * g.inner_radius * g.thickness * arc,
        "rim": 2 * math.pi * g.outer_radius * g.thickness * arc,
    }
    plane, arc = factors(g.pad_angle / g.pad_counts[1] / 2)
    face = g.pad_angle / 2 * (g.pad_outer_radius**2 - g.pad_inner_radius**2) * plane
    height = g.pad_thickness + g.back_plate_thickness
    for number in range(1, g.pads + 1):
        values[f"pad_{number}"] = face * g.pad_thickness
        values[f"pad_face_{number}"] = values[f"pad_back_{number}"] = face
        values[f"pad_inner_edge_{number}"] = g.pad_angle * g.pad_inner_radius * height * arc
        values[f"pad_outer_edge_{number}"] = g.pad_angle * g.pad_outer_radius * height * arc
        if g.has_back_plate:
            values[f"back_plate_{number}"] = face * g.back_plate_thickness
        if not g.is_ring:
            end = (g.pad_outer_radius - g.pad_inner_radius) * height
            values[f"pad_leading_{number}"] = values[f"pad_trailing_{number}"] = end
    return values
