"""Names for the directions of the axes of hexahedra, and the error of the mesh by body and direction."""

from __future__ import annotations

import numpy as np

from ..assembly.assembly import Assembly
from ..geometry import DiscPad

WHOLE = "all"  # the direction of tetrahedra, whose axes mean nothing
_CORNERS = 8


def axis_names(assembly: Assembly) -> np.ndarray:
    """Return the direction (m, 3) str of each of the three axes of each hexahedron.

    An axis is named after the direction that it is closest to: "radial", "around" or "axial" where a disc turns about
    an axis (z for a parametric brake, else the axis of the first contact that has one), "x", "y" or "z" elsewhere.
    """
    mesh = assembly.loaded.mesh
    corners = mesh.p[:, mesh.t]  # (3, 8, m)
    places = np.asarray(mesh.elem.refdom.p)  # (3, 8)
    axis, centre = _axis(assembly)
    middle = corners.mean(axis=1).T - centre
    count = len(middle)
    if axis is None:
        names, directions = np.array(["x", "y", "z"]), np.repeat(np.eye(3)[:, None], count, axis=1)
    else:
        radius = middle - np.outer(middle @ axis, axis)
        radial = radius / np.maximum(np.linalg.norm(radius, axis=1, keepdims=True), np.finfo(float).tiny)
        names = np.array(["radial", "around", "axial"])
        directions = np.stack([radial, np.cross(axis, radial), np.repeat(axis[None], count, axis=0)])
    found = []
    for a in range(3):
        edge = corners[:, places[a] > 0.5].mean(axis=1) - corners[:, places[a] < 0.5].mean(axis=1)
        found.append(names[np.abs(np.einsum("nmi,im->nm", directions, edge)).argmax(axis=0)])
    return np.stack(found, axis=1)


def _axis(assembly: Assembly) -> tuple[np.ndarray | None, np.ndarray]:
    """Return the axis of rotation as a unit vector and a point on it, m; None and the origin where nothing turns."""
    if isinstance(assembly.scene.mesh.geometry, DiscPad):
        return np.array([0.0, 0.0, 1.0]), np.zeros(3)
    for contact in assembly.scene.contacts:
        if contact.sliding is not None and contact.sliding.axis is not None:
            axis = np.array(contact.sliding.axis, float)
            return axis / np.linalg.norm(axis), np.array(contact.sliding.centre or (0.0, 0.0, 0.0), float)
    return None, np.zeros(3)


def element_directions(assembly: Assembly) -> np.ndarray:
    """Return (m, a) str: `axis_names` of hexahedra, `WHOLE` for tetrahedra, which have no axes to tell apart."""
    mesh = assembly.loaded.mesh
    hexahedral = mesh.elem.refdom.p.shape[1] == _CORNERS
    return axis_names(assembly) if hexahedral else np.full((mesh.nelements, 1), WHOLE)
