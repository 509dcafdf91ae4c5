"""Where lines from points of one surface meet the facets of another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import skfem
from scipy.spatial import cKDTree

from .cells import geometry_map

_NEWTON_STEPS = 25
_INSIDE = 1e-6  # slack of reference coordinates: a point on an edge belongs to the facets on both sides
_BATCH = 200_000  # candidate (point, facet) pairs treated at once


@dataclass(frozen=True)
class Hits:
    """Where lines from points meet facets: distance along the line (inf: nowhere), element, reference coordinates."""

    distance: np.ndarray
    elements: np.ndarray
    reference: np.ndarray

    def joined(self, own: np.ndarray, other: Hits) -> Hits:
        """Return those of some of the points, (q,) bool, and behind them those of other points."""
        return Hits(
            np.concatenate([self.distance[own], other.distance]), np.concatenate([self.elements[own], other.elements]),
            np.concatenate([self.reference[:, own], other.reference], axis=1),
        )  # fmt: skip


def locate_along(
    mesh: skfem.Mesh, facets: np.ndarray, points: np.ndarray, normals: np.ndarray, farthest: float = 0.0
) -> Hits:  # fmt: skip
    """Meet lines x = p − s n with facets whose outward normal is along n; the nearest meeting counts.

    Solves F(Y(ξ)) + s n = p for (ξ, s) by Newton's method on the facet's own, possibly curved, geometry; s > 0 is
    a gap.

    Parameters
    ----------
    facets : (f,) int
    points, normals : (q, 3) float
    farthest : float, m
        Meetings with |s| up to this are found, and others as far away as a facet is wide.

    Returns
    -------
    Hits
        distance (q,) m, elements (q,) int, reference (3, q).
    """
    elements = mesh.f2t[0, facets]
    local = np.argmax(mesh.t2f[:, elements] == facets, axis=0)
    corners, ref = mesh.p[:, mesh.facets[:, facets]], np.asarray(mesh.refdom.p)
    centres = corners.mean(axis=1).T
    # Twice the corner radius encloses any facet that is curved within reason.
    radii = 2 * np.linalg.norm(corners - centres.T[:, None], axis=0).max(axis=0)
    best = Hits(np.full(len(points), np.inf), np.zeros(len(points), int), np.zeros((3, len(points))))
    # Most points meet a facet next to them. Only the others are followed as far as is asked, which takes more pairs.
    for away in (0.0, farthest) if farthest else (0.0,):
        rows = np.flatnonzero(np.isinf(best.distance))
        point_of, facet_of = _candidates(centres, radii, points[rows], normals[rows], away)
        for start in range(0, len(point_of), _BATCH):
            i, f = rows[point_of[start : start + _BATCH]], facet_of[start : start + _BATCH]
            s, Y = _meet(mesh, elements[f], local[f], ref, points[i], normals[i])
            # Later entries of equal index win, so write from the farthest to the nearest.
            order = np.argsort(-np.abs(s), kind="stable")
            order = order[np.abs(s[order]) < np.abs(best.distance[i[order]])]
            best.distance[i[order]], best.elements[i[order]] = s[order], elements[f[order]]
            best.reference[:, i[order]] = Y[:, order]
    return best


def _candidates(
    centres: np.ndarray, radii: np.ndarray, points: np.ndarray, normals: np.ndarray, farthest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of points and facets (k,) whose lines may meet: the line passes by the middle within the radius."""
    if not len(points):
        return np.zeros(0, int), np.zeros(0, int)
    tree, reach = cKDTree(centres), np.linalg.norm(np.ptp(points, axis=0)) * 1e-9 + radii.max() + farthest
    counts = np.cumsum(tree.query_ball_point(points, reach, return_length=True))
    parts = np.unique(np.searchsorted(counts, np.arange(_BATCH, counts[-1], _BATCH)))  # a batch of pairs at once
    point_of, facet_of = [], []
    for rows in np.split(np.arange(len(points)), parts):
        lists = tree.query_ball_point(points[rows], reach, return_sorted=True)
        i = np.repeat(rows, [len(c) for c in lists])
        f = np.concatenate([np.zeros(0, int), *(np.asarray(c, int) for c in lists)])
        way = centres[f] - points[i]
        along = np.einsum("ki,ki->k", way, normals[i])
        beside = np.linalg.norm(way - along[:, None] * normals[i], axis=1)
        near = (beside <= radii[f]) & (np.abs(along) <= radii[f] + farthest)
        point_of.append(i[near])
        facet_of.append(f[near])
    return np.concatenate(point_of), np.concatenate(facet_of)


def _meet(
    mesh: skfem.Mesh, elements: np.ndarray, local: np.ndarray, ref: np.ndarray, points: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return distance along the normal (inf: no meeting) and reference coordinates, one facet per point."""
    facet_corners = np.array([[c[0], c[1], c[-1]] for c in mesh.refdom.facets])[local]  # (k, 3)
    origin = ref[:, facet_corners[:, 0]]
    edges = np.stack([ref[:, facet_corners[:, 1]] - origin, ref[:, facet_corners[:, 2]] - origin], axis=1)
    triangle = len(mesh.refdom.facets[0]) == 3
    xi = np.full((2, len(elements)), 1 / 3 if triangle else 0.5)
    s, singular = np.zeros(len(elements)), np.zeros(len(elements), bool)
    scale = np.linalg.norm(np.ptp(mesh.p, axis=1))
    # Pairs that have not converged yet. Nearly all need two or three steps; rounding keeps a few from ending for more.
    going = np.arange(len(elements))
    for _ in range(_NEWTON_STEPS):
        e, n = edges[:, :, going], normals[going]
        x, J = geometry_map(mesh, elements[going], origin[:, going] + np.einsum("iak,ak->ik", e, xi[:, going]))
        residual = x.T + s[going, None] * n - points[going]
        A = np.concatenate([np.einsum("ijk,jak->kia", J, e), n[:, :, None]], axis=2)
        singular[going] = flat = np.abs(np.linalg.det(A)) <= 1e-12 * np.prod(np.linalg.norm(A, axis=1), axis=1)
        A[flat] = np.eye(3)  # the line lies in the facet: no meeting
        step = np.linalg.solve(A, residual[:, :, None])[:, :, 0]
        xi[:, going] = np.clip(xi[:, going] - step[:, :2].T, -1.0, 2.0)
        s[going] -= step[:, 2]
        going = going[(np.abs(step[:, 2]) > 1e-15 * scale) | (np.abs(step[:, :2]) > 1e-13).any(axis=1)]
        if not len(going):
            break
    Y = origin + np.einsum("iak,ak->ik", edges, xi)
    x, J = geometry_map(mesh, elements, Y)
    outward = np.linalg.solve(np.transpose(J, (2, 1, 0)), mesh.refdom.normals[local][:, :, None])[:, :, 0]
    inside = (xi >= -_INSIDE).all(axis=0) & ((xi.sum(axis=0) if triangle else xi.max(axis=0)) <= 1 + _INSIDE)
    met = np.linalg.norm(x.T + s[:, None] * normals - points, axis=1) <= 1e-9 * scale
    facing = np.einsum("ki,ki->k", outward, normals) > 0
    return np.where(inside & met & facing & ~singular, s, np.inf), Y
