"""How far apart two surfaces may lie and count as touching, where the scene does not say it."""

from __future__ import annotations

import numpy as np
import skfem

from .facets import facet_corners
from .spaces import Surface

GAP_TOLERANCE = 0.02  # of the mean facet size of the pad
_SHARP = np.radians(50.0)  # between normals: an edge with a larger angle belongs to the body, not to its mesh


def default_gap_tolerance(mesh: skfem.Mesh, pad: Surface, counter_facets: np.ndarray) -> float:
    """Return 2 % of the mean facet size of the pad, and what straight facets of either side leave out of a curved face.

    Parameters
    ----------
    mesh : skfem.Mesh
    pad : Surface
    counter_facets : (f,) int

    Returns
    -------
    float, m
    """
    size = float(np.sqrt(pad.area / len(pad.facets)))
    return GAP_TOLERANCE * size + sagitta(mesh, pad.facets) + sagitta(mesh, counter_facets)


def sagitta(mesh: skfem.Mesh, facets: np.ndarray) -> float:
    """Return how far the middle of a straight facet lies from the curved face that it stands for, the median, m.

    The median is that of a face which is curved as a whole: a chamfer or a rounded edge around a flat face does not
    count. Facets with middle nodes follow the face, and leave next to nothing.

    Parameters
    ----------
    facets : (f,) int
        Boundary facets.
    """
    return float(np.median(bends(mesh, facets)[1])) if len(facets) else 0.0


def bends(mesh: skfem.Mesh, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles that straight facets stand for, and how far their middles lie from the curved face.

    A facet of width h on a face of curvature κ stands for the angle κ h and leaves κ h²/8. The angle φ between the
    normals of two neighbours of widths h and h' tells κ = φ/((h + h')/2). Of the neighbours of a facet the one counts
    that it bends most against. Both are zero for facets with middle nodes.

    Parameters
    ----------
    facets : (f,) int
        Boundary facets.

    Returns
    -------
    angle : (f,) float, rad
    sagitta : (f,) float, m
    """
    if isinstance(mesh, skfem.MeshTet2 | skfem.MeshHex2):
        return np.zeros(len(facets)), np.zeros(len(facets))
    corners = facet_corners(mesh, facets, mesh.f2t[0, facets])  # (f, 4), cyclic
    x = mesh.p.T[corners]
    normals = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)  # (f, 4, 2)
    along = mesh.p.T[ends[:, :, 1]] - mesh.p.T[ends[:, :, 0]]
    length = np.linalg.norm(along, axis=2, keepdims=True)
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    off = x[:, None] - mesh.p.T[ends[:, :, 0]][:, :, None]  # (f, edges, corners, 3)
    beside = off - np.einsum("feci,fei->fec", off, along)[..., None] * along[:, :, None]
    width = np.linalg.norm(beside, axis=3).max(axis=2)  # of the facet, across each of its edges
    facet, edge = np.nonzero(length[:, :, 0] > 0)  # triangles have one edge of no length
    key = np.sort(ends[facet, edge], axis=1)
    order = np.lexsort(key.T)
    same = np.flatnonzero((key[order[1:]] == key[order[:-1]]).all(axis=1))
    a, b = order[same], order[same + 1]
    n, m = normals[facet[a]], normals[facet[b]]
    # Corners may run either way around a facet.
    angle = np.arctan2(np.linalg.norm(np.cross(n, m), axis=1), np.abs(np.einsum("ki,ki->k", n, m)))
    h, other = width[facet[a], edge[a]], width[facet[b], edge[b]]
    curvature = np.where(angle <= _SHARP, 2 * angle / np.maximum(h + other, np.finfo(float).tiny), 0.0)
    angles, heights = np.zeros((2, len(facets)))
    for one, size in ((a, h), (b, other)):
        np.maximum.at(angles, facet[one], curvature * size)
        np.maximum.at(heights, facet[one], curvature * size**2 / 8)
    return angles, heights
