"""Unstructured tetrahedral meshes of the parametric geometries, made by gmsh with its OpenCASCADE kernel."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import numpy as np

from fe_squeal.errors import MeshError
from fe_squeal.geometry.block import Block
from fe_squeal.geometry.disc_pad import DiscPad
from fe_squeal.geometry.gmsh_session import gmsh_model
from fe_squeal.mesh.gmsh_cells import GmshCells, raw_mesh
from fe_squeal.mesh.raw import RawMesh

DimTags = list[tuple[int, int]]


def write_tetrahedra(geometry: DiscPad | Block, path: Path) -> None:
    """Mesh a geometry with tetrahedra of its edge length and write the mesh as a gmsh file.

    Raises
    ------
    MeshError
        gmsh cannot be imported or fails, or elements are so large that following the circles turns them inside out.
    OSError
        The file cannot be written.
    """
    with _meshed(geometry) as gmsh:
        try:
            gmsh.write(str(path))
        except Exception as error:  # gmsh raises bare exceptions
            raise OSError(str(error)) from error


def mesh_tetrahedra(geometry: DiscPad | Block) -> RawMesh:
    """Return the mesh of a geometry with tetrahedra of its edge length.

    Raises
    ------
    MeshError
        gmsh cannot be imported or fails, or elements are so large that following the circles turns them inside out.
    """
    with _meshed(geometry) as gmsh:
        model = gmsh.model
        labels, points, _ = model.mesh.getNodes()
        names = {(d, tag): model.getPhysicalName(d, tag) for d, tag in model.getPhysicalGroups()}
        cells = []
        for d, tag in sorted(model.getEntities()):
            groups = tuple(int(g) for g in model.getPhysicalGroupsForEntity(d, tag))
            for kind, numbers, nodes in zip(*model.mesh.getElements(d, tag), strict=True) if groups else ():
                width = len(nodes) // len(numbers)
                cells.append(GmshCells(int(kind), numbers.astype(int), nodes.astype(int).reshape(-1, width), groups))
    # gmsh also meshes the curves that bodies were revolved from. A file would not have their nodes: they are left out.
    used = np.isin(labels, np.concatenate([some.nodes.ravel() for some in cells]))
    return raw_mesh("the geometry", labels[used].astype(int), points.reshape(-1, 3)[used], cells, names)


@contextmanager
def _meshed(geometry: DiscPad | Block) -> Iterator[ModuleType]:
    """Mesh a geometry with gmsh, and return gmsh with this mesh as its model for the block."""
    options = {
        "General.Terminal": 0,
        "General.AbortOnError": 2,  # errors become exceptions
        "General.NumThreads": 1,  # one thread and one seed: the same file each time
        "Mesh.RandomSeed": 1,
        "Mesh.RandomFactor": 1e-9,
        "Mesh.RandomFactor3D": 1e-12,
        "Mesh.Algorithm": 6,  # frontal Delaunay
        "Mesh.Algorithm3D": 1,  # Delaunay
        "Mesh.MeshSizeMin": geometry.edge_length,
        "Mesh.MeshSizeMax": geometry.edge_length,
        "Mesh.MeshSizeFromCurvature": 0,
        "Mesh.MeshSizeFromPoints": 1,
        "Mesh.MeshSizeExtendFromBoundary": 1,
        "Mesh.RecombineAll": 0,
        "Mesh.SubdivisionAlgorithm": 0,
        "Mesh.MeshSizeFactor": 1,
        "Mesh.ElementOrder": geometry.geometry_order,
        "Mesh.SecondOrderLinear": 0,
        "Mesh.HighOrderOptimize": 0,
        "Mesh.Optimize": 1,
        "Mesh.SaveAll": 0,
        "Mesh.SaveParametric": 0,
        "Mesh.Binary": 0,
        "Mesh.MshFileVersion": 4.1,
        "Mesh.ScalingFactor": 1,
        "Geometry.OCCAutoFix": 1,
    }
    with gmsh_model("fe_squeal", options) as gmsh:
        try:
            if isinstance(geometry, DiscPad):
                volumes, surfaces = _build_disc_pad(gmsh, geometry)
            else:
                volumes, surfaces = _build_block(gmsh, geometry)
            _name_groups(gmsh, volumes, surfaces)
            gmsh.model.mesh.generate(3)
            _check_jacobians(gmsh, geometry)
        except (MeshError, MemoryError):
            raise
        except Exception as error:  # gmsh raises bare exceptions
            raise MeshError(f"gmsh could not mesh the geometry: {error}; try another size") from error
        yield gmsh  # behind the clauses above: what the block raises is no failure of gmsh


def _build_disc_pad(gmsh: ModuleType, geometry: DiscPad) -> tuple[dict[str, int], dict[str, list[int]]]:
    """Build the bodies; return the volume of each name and the surfaces of each name."""
    occ = gmsh.model.occ
    half = 0.5 * geometry.thickness
    width = geometry.outer_radius - geometry.inner_radius
    disc = _sector(gmsh, geometry.inner_radius, width, -half, geometry.thickness, 360.0)
    volumes = {"disc": disc}
    bodies = {"": [disc]}
    for number in range(1, geometry.pads + 1):
        sign = 1.0 if number == 1 else -1.0
        z = sign * (half + geometry.gap)
        inner, across = geometry.pad_inner_radius, geometry.pad_outer_radius - geometry.pad_inner_radius
        angle = geometry.pad_angle_deg
        volumes[f"pad_{number}"] = _sector(gmsh, inner, across, z, sign * geometry.pad_thickness, angle)
        bodies[f"_{number}"] = [volumes[f"pad_{number}"]]
        if geometry.has_back_plate:
            z += sign * geometry.pad_thickness
            plate = _sector(gmsh, inner, across, z, sign * geometry.back_plate_thickness, angle)
            # `fragment` makes lining and back plate share one surface and its nodes. The disc is not among its bodies,
            # so it shares nothing with the pad.
            _, parts = occ.fragment([(3, volumes[f"pad_{number}"])], [(3, plate)])
            volumes[f"pad_{number}"], volumes[f"back_plate_{number}"] = parts[0][0][1], parts[1][0][1]
            bodies[f"_{number}"] = [volumes[f"pad_{number}"], volumes[f"back_plate_{number}"]]
    occ.synchronize()

    surfaces: dict[str, list[int]] = {}
    for suffix, tags in bodies.items():
        for surface in _outer_surfaces(gmsh, tags):
            name = _disc_surface(gmsh, surface, geometry) if not suffix else _pad_surface(gmsh, surface, geometry)
            surfaces.setdefault(name + suffix, []).append(surface)
    return volumes, surfaces


def _sector(gmsh: ModuleType, inner: float, width: float, z: float, height: float, angle_deg: float) -> int:
    """Revolve a rectangle about the z axis by an angle; return the tag of the volume, which is centred on +x."""
    occ = gmsh.model.occ
    low, high = sorted((z, z + height))
    angle = math.radians(angle_deg)
    corners = [(inner, low), (inner + width, low), (inner + width, high), (inner, high)]
    points = [occ.addPoint(r, 0.0, z) for r, z in corners]
    lines = [occ.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    face = [(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))]
    if angle_deg < 360.0:
        occ.rotate(face, 0, 0, 0, 0, 0, 1, -0.5 * angle)
    swept: DimTags = occ.revolve(face, 0, 0, 0, 0, 0, 1, angle)
    return next(tag for dimension, tag in swept if dimension == 3)


def _outer_surfaces(gmsh: ModuleType, volumes: list[int]) -> list[int]:
    """Return the surfaces of a body of several volumes, without those between these volumes."""
    boundary: DimTags = gmsh.model.getBoundary([(3, tag) for tag in volumes], combined=True, oriented=False)
    return sorted(tag for _, tag in boundary)


def _cylinder_radius(gmsh: ModuleType, surface: int) -> float | None:
    """Return the radius of a cylindrical surface about the z axis, None for a plane surface."""
    if gmsh.model.getType(2, surface) == "Plane":
        return None
    low, high = gmsh.model.getParametrizationBounds(2, surface)
    x, y, _ = gmsh.model.getValue(2, surface, [0.5 * (a + b) for a, b in zip(low, high, strict=True)])
    return math.hypot(x, y)


def _disc_surface(gmsh: ModuleType, surface: int, geometry: DiscPad) -> str:
    radius = _cylinder_radius(gmsh, surface)
    if radius is not None:
        return "hub" if radius < 0.5 * (geometry.inner_radius + geometry.outer_radius) else "rim"
    return "disc_face_1" if gmsh.model.occ.getCenterOfMass(2, surface)[2] > 0.0 else "disc_face_2"


def _pad_surface(gmsh: ModuleType, surface: int, geometry: DiscPad) -> str:
    radius = _cylinder_radius(gmsh, surface)
    if radius is not None:
        middle = 0.5 * (geometry.pad_inner_radius + geometry.pad_outer_radius)
        return "pad_inner_edge" if radius < middle else "pad_outer_edge"
    _, y, z = gmsh.model.occ.getCenterOfMass(2, surface)
    low, high = gmsh.model.getParametrizationBounds(2, surface)
    normal = gmsh.model.getNormal(surface, [0.5 * (a + b) for a, b in zip(low, high, strict=True)])
    if abs(normal[2]) < 0.5:
        return "pad_leading" if y < 0.0 else "pad_trailing"
    middle = 0.5 * (geometry.thickness + geometry.pad_thickness + geometry.back_plate_thickness) + geometry.gap
    return "pad_face" if abs(z) < middle else "pad_back"


def _build_block(gmsh: ModuleType, geometry: Block) -> tuple[dict[str, int], dict[str, list[int]]]:
    """Build the bodies; return the volume of each name and the surfaces of each name."""
    boxes = {
        ("block", "", geometry.suffix(number)): (
            (geometry.left_of(number), -0.5 * geometry.width, 0.0),
            (geometry.length, geometry.width, geometry.height),
        )
        for number in range(1, geometry.count + 1)
    }
    if geometry.has_belt:
        extent = (geometry.belt_length, geometry.belt_width, geometry.belt_thickness)
        boxes["belt", "belt_", ""] = ((-0.5 * extent[0], -0.5 * extent[1], -extent[2]), extent)

    add_box = gmsh.model.occ.addBox
    volumes = {name + suffix: add_box(*corner, *extent) for (name, _, suffix), (corner, extent) in boxes.items()}
    gmsh.model.occ.synchronize()
    surfaces: dict[str, list[int]] = {}
    sides = {(0, -1): "left", (0, 1): "right", (1, -1): "front", (1, 1): "back", (2, -1): "bottom", (2, 1): "top"}
    for (name, prefix, suffix), (corner, extent) in boxes.items():
        for surface in _outer_surfaces(gmsh, [volumes[name + suffix]]):
            centre = gmsh.model.occ.getCenterOfMass(2, surface)
            offset = [(c - a) / e - 0.5 for c, a, e in zip(centre, corner, extent, strict=True)]
            axis = max(range(3), key=lambda i: abs(offset[i]))
            surfaces[prefix + sides[axis, 1 if offset[axis] > 0 else -1] + suffix] = [surface]
    return volumes, surfaces


def _name_groups(gmsh: ModuleType, volumes: dict[str, int], surfaces: dict[str, list[int]]) -> None:
    for tag, (name, volume) in enumerate(volumes.items(), start=1):
        gmsh.model.addPhysicalGroup(3, [volume], tag, name)
    for tag, (name, members) in enumerate(sorted(surfaces.items()), start=len(volumes) + 1):
        gmsh.model.addPhysicalGroup(2, members, tag, name)


def _check_jacobians(gmsh: ModuleType, geometry: DiscPad | Block) -> None:
    mesh = gmsh.model.mesh

    def least() -> float:
        _, elements, _ = mesh.getElements(3)
        return min(float(min(mesh.getElementQualities(tags, "minDetJac"))) for tags in elements)

    if geometry.geometry_order == 2 and least() <= 0.0:
        mesh.optimize("HighOrder")
    if least() <= 0.0:
        raise MeshError(
            f"size = {geometry.edge_length:g}: the elements are too large for the curvature and turn inside out; "
            "choose a smaller size or geometry_order = 1"
        )
