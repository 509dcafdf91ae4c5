"""How far apart two surfaces may lie and count as touching, where the scene does not say it."""

from __future__ import annotations

import numpy as np
import skfem

from .facets import facet_corners, facet_edges
from .surfaces import Surface

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
    count. Facets whose middle nodes lie on the face leave next to nothing.

    Parameters
    ----------
    facets : (f,) int
        Boundary facets.
    """
    return float(np.median(bends(mesh, facets)[1])) if len(facets) else 0.0


def bends(mesh: skfem.Mesh, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles that facets leave out of a curved face, and how far their middles lie from it.

    A straight facet of width h on a face of curvature κ stands for the angle κ h and leaves κ h²/8. The angle φ between
    the normals of two neighbours, at the middle of the edge between them, tells κ = φ/((h + h')/2). Of the neighbours
    of a facet the one counts that it bends most against. Facets whose middle nodes lie on the face bend themselves, and
    φ is next to nothing; where middle nodes lie on straight edges, it is that of facets without them.

    Parameters
    ----------
    facets : (f,) int
        Boundary facets.

    Returns
    -------
    angle : (f,) float, rad
    sagitta : (f,) float, m
    """
    angles, heights = np.zeros((2, len(facets)))
    if not len(facets):
        return angles, heights
    edges = facet_edges(mesh, facets)
    corners = mesh.p.T[facet_corners(mesh, facets, mesh.f2t[0, facets])]  # (f, 4, 3), cyclic
    chords = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])[edges.facet]
    start, end = mesh.p.T[edges.nodes[:, 0]], mesh.p.T[edges.nodes[:, 1]]
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    off = corners[edges.facet] - start[:, None]
    beside = off - np.einsum("eci,ei->ec", off, along)[..., None] * along[:, None]
    width = np.linalg.norm(beside, axis=2).max(axis=1)  # of the facet, across this edge
    key = edges.nodes
    order = np.lexsort(key.T)
    same = np.flatnonzero((key[order[1:]] == key[order[:-1]]).all(axis=1))
    a, b = order[same], order[same + 1]
    angle, whole = (_between(n[a], n[b]) for n in (edges.normals, chords))
    sharp = np.maximum(angle, np.minimum(whole, np.pi - whole)) > _SHARP  # corners may run either way around a facet
    curvature = np.where(sharp, 0.0, 2 * angle / np.maximum(width[a] + width[b], np.finfo(float).tiny))
    for one in (a, b):
        np.maximum.at(angles, edges.facet[one], curvature * width[one])
        np.maximum.at(heights, edges.facet[one], curvature * width[one] ** 2 / 8)
    return angles, heights


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the angles (n,) float, rad, between vectors a and b (n, 3) float of any length."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ni,ni->n", a, b))
