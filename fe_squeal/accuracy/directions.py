"""Names for the directions of the axes of hexahedra, and the error of the mesh by body and direction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..assembly.assembly import Assembly
from ..geometry import DiscPad
from .quantities import Split

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = ("quantity", "kind", "change", "scale", "body", "direction", "part")
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


def split_dataframe(split: Split, assembly: Assembly) -> pd.DataFrame:
    """Return the changes of the quantities, split by body and direction, with the columns `COLUMNS`.

    A row is the part of one quantity's change that one body and direction adds; the parts of a quantity add up to its
    `change`. `change`, `scale` and `part` are in units of the quantity: rad/s for Im λ, 1/s for Re λ, the parameter's
    for onsets. Relative errors are meant relative to `scale`.
    """
    import pandas as pd

    hexahedral = assembly.loaded.mesh.elem.refdom.p.shape[1] == _CORNERS
    names = axis_names(assembly) if hexahedral else np.full((split.parts.shape[1], 1), WHOLE)
    directions = list(dict.fromkeys(names.ravel().tolist()))
    rows = []
    for i, quantity in enumerate(split.names):
        for body, cells in assembly.bodies.items():
            for direction in directions:
                part = float(np.where(names[cells] == direction, split.parts[i, cells], 0.0).sum())
                rows.append((quantity, split.kinds[i], split.changes[i], split.scales[i], body, direction, part))
    return pd.DataFrame(rows, columns=list(COLUMNS))
