"""A brake of quadratic tetrahedra in a file, as another program would have meshed it: chamfered pads with a slot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fe_squeal import parse_scene
from fe_squeal.geometry.gmsh_session import gmsh_model
from fe_squeal.scene import Scene

if TYPE_CHECKING:
    from types import ModuleType

INNER, OUTER, THICKNESS = 0.06, 0.12, 0.016  # m: the disc
PAD_INNER, PAD_OUTER, ANGLE = 0.078, 0.116, np.radians(58)
LINING, PLATE = 0.011, 0.006  # m: thicknesses
SLOT, DEPTH = 0.003, 0.007  # m: width and depth of the slot in the middle of a lining, along the radius
CHAMFER, RISE = 0.008, 0.003  # m: length and height of the chamfers at both ends
_FLAT = 1e-5  # m: surfaces of a smaller height are flat
MATERIALS = {
    "iron": {"youngs_modulus": 1.1e11, "poisson_ratio": 0.26, "density": 7100.0},
    "steel": {"youngs_modulus": 2.05e11, "poisson_ratio": 0.29, "density": 7800.0},
    "lining": {"youngs_modulus": 5.0e9, "poisson_ratio": 0.25, "density": 2500.0},
}
SPRINGS = {"piston": ([0, 0, 1], 8.0e7), "abutment": ([0, 1, 0], 6.0e7), "guide": ([1, 0, 0], 2.0e7)}  # N/m


def chamfered_scene(path: Path) -> Scene:
    """Return the scene of a mesh that `write_chamfered` has written."""
    sides = (1, 2)
    springs = [
        {"name": f"{name}_{i}", "surface": f"pad_back_{i}", "direction": along, "stiffness": k * (1 - 0.1 * (i - 1))}
        for i in sides for name, (along, k) in SPRINGS.items()
    ]  # fmt: skip
    contacts = [
        {"name": f"pad_{i}", "surface": f"pad_face_{i}", "counterface": f"disc_face_{i}", "normal_stiffness": 4.0e11,
         "sliding": {"axis": [0, 0, 1], "speed": 8.0}} for i in sides
    ]  # fmt: skip
    bodies: dict[str, Any] = {
        "disc": {"material": "iron"},
        "linings": {"material": "lining", "groups": [f"pad_{i}" for i in sides]},
        "plates": {"material": "steel", "groups": [f"plate_{i}" for i in sides]},
    }
    return parse_scene({
        "mesh": {"file": str(path), "order": 2}, "materials": MATERIALS, "bodies": bodies, "springs": springs,
        "contacts": contacts, "supports": [{"surface": "hub", "fixed": "xyz"}], "effects": {"friction": {"mu": 0.5}},
        "sweep": {"parameter": "mu", "from": 0.0, "to": 0.8, "points": 9}, "solve": {"max_frequency": 7000.0},
    })  # fmt: skip


def write_chamfered(path: Path, size: float) -> Path:
    """Write the mesh, with elements of a size, m, as a file of gmsh, and return its path."""
    with gmsh_model("chamfered", {"General.Terminal": 0, "Mesh.MeshSizeMax": size}) as gmsh:
        occ = gmsh.model.occ
        _ring(occ, -THICKNESS / 2, THICKNESS, INNER, OUTER)
        for side in (1, -1):
            lining, plate = _pad(occ, side)
            occ.fragment(lining, plate)  # which then have the nodes between them in common
        occ.synchronize()
        _name(gmsh)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.optimize("Netgen")
        gmsh.model.mesh.setOrder(2)
        gmsh.model.mesh.optimize("HighOrder")
        gmsh.write(str(path))
    return path


def _ring(occ: Any, z: float, height: float, inner: float, outer: float, angle: float = 2 * np.pi) -> list:
    """Return the volume between two cylinders, symmetric about the x axis."""
    whole, hole = (occ.addCylinder(0, 0, z, 0, 0, height, r, angle=angle) for r in (outer, inner))
    volumes = occ.cut([(3, whole)], [(3, hole)])[0]
    occ.rotate(volumes, 0, 0, 0, 0, 0, 1, -angle / 2)
    return volumes


def _pad(occ: Any, side: int) -> tuple[list, list]:
    """Return lining and back plate of the pad above (1) or below (−1) the disc."""
    face = side * THICKNESS / 2
    lining = _ring(occ, min(face, face + side * LINING), LINING, PAD_INNER, PAD_OUTER, ANGLE)
    cuts = [(3, occ.addBox(0.05, -SLOT / 2, min(face, face + side * DEPTH), 0.09, SLOT, DEPTH))]
    for end in (1, -1):
        corners = [occ.addPoint(0.05, y, z) for y, z in ((0, 0), (-end * CHAMFER, 0), (0, side * RISE))]
        edges = [occ.addLine(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
        triangle = occ.addPlaneSurface([occ.addCurveLoop(edges)])
        wedge = [entity for entity in occ.extrude([(2, triangle)], 0.09, 0, 0) if entity[0] == 3]
        occ.translate(wedge, 0, 0, face)
        occ.rotate(wedge, 0, 0, 0, 0, 0, 1, end * ANGLE / 2)
        cuts += wedge
    lining = occ.cut(lining, cuts)[0]
    back = face + side * LINING
    return lining, _ring(occ, min(back, back + side * PLATE), PLATE, PAD_INNER, PAD_OUTER, ANGLE)


def _name(gmsh: ModuleType) -> None:
    """Name volumes and surfaces by where they are."""
    groups: dict[tuple[int, str], list[int]] = {}
    for _, tag in gmsh.model.getEntities(3):
        z = gmsh.model.occ.getCenterOfMass(3, tag)[2]
        pad = "1" if z > 0 else "2"
        body = "disc" if abs(z) < _FLAT else f"pad_{pad}" if abs(z) < THICKNESS / 2 + LINING else f"plate_{pad}"
        groups.setdefault((3, body), []).append(tag)
        for _, surface in gmsh.model.getBoundary([(3, tag)], oriented=False):
            z = gmsh.model.occ.getCenterOfMass(2, surface)[2]
            box = gmsh.model.getBoundingBox(2, surface)
            flat, height = box[5] - box[2] < _FLAT, abs(z) - THICKNESS / 2
            if body == "disc":
                name = f"disc_face_{'1' if z > 0 else '2'}" if flat else "hub" if box[3] < INNER + 1e-4 else ""
            elif body.startswith("pad"):
                name = f"pad_face_{pad}" if flat and abs(height) < _FLAT else ""
            else:
                name = f"pad_back_{pad}" if flat and abs(height - LINING - PLATE) < _FLAT else ""
            if name:
                groups.setdefault((2, name), []).append(surface)
    for (dimension, name), tags in groups.items():
        gmsh.model.addPhysicalGroup(dimension, tags, name=name)
