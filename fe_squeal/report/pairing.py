"""Pair shapes on different meshes by their MAC at common points of the bodies' surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from fe_squeal.report.mac import mac
from fe_squeal.report.shapes import Complexes, Floats, Integers, ShapeGrid, boundary_triangles

ALIKE = 0.6  # MAC: two shapes with this or a larger one are taken for the same mode
_MOST_POINTS = 2000  # points of a body, at most: enough for shapes with some ten waves
_NEAR = 12  # triangles around a point: of so many the closest is found exactly
_SEED = 20261122  # of the choice of points


@dataclass(frozen=True)
class BodySurface:
    """The surface of one body: triangles (t, 3) int between the points of a grid."""

    grid: ShapeGrid
    triangles: Integers

    @property
    def nodes(self) -> Integers:
        """Positions of the points on the surface."""
        return np.unique(self.triangles)


def surfaces(grid: ShapeGrid) -> dict[str, BodySurface]:
    """Return the surfaces of the bodies by name."""
    triangles, body = boundary_triangles(grid)
    return {name: BodySurface(grid, triangles[body == b]) for b, name in enumerate(grid.body_names)}


@dataclass(frozen=True)
class CommonPoints:
    """Points at which shapes on two grids are compared: nodes of the first, and the nearest places on the second.

    Attributes
    ----------
    nodes : (p,) int
        The points, as nodes of the first grid.
    corners : (p, 3) int
        Nodes of the triangle of the second grid that is nearest to each point.
    weights : (p, 3) float
        Barycentric coordinates of the nearest place in this triangle.
    distance : (p,) float, m
        Distance of each point from this place.
    """

    nodes: Integers
    corners: Integers
    weights: Floats
    distance: Floats

    def on_second(self, u: Complexes) -> Complexes:
        """Return displacements (p, 3) at the points from those (n, 3) of the second grid's nodes."""
        return np.asarray(np.einsum("pc,pcd->pd", self.weights, u[self.corners]))


def common_points(first: ShapeGrid, second: ShapeGrid) -> tuple[CommonPoints | None, list[str]]:
    """Return common points of the bodies that both grids have by name, and the names of bodies that only one has."""
    a, b = surfaces(first), surfaces(second)
    names = [name for name in a if name in b]
    parts = [_common(a[name], b[name]) for name in names]
    alone = sorted(set(a) ^ set(b))
    if not parts:
        return None, alone
    return CommonPoints(*(np.concatenate([getattr(p, k) for p in parts]) for k in CommonPoints.__annotations__)), alone


def _common(first: BodySurface, second: BodySurface) -> CommonPoints:
    nodes = first.nodes
    if len(nodes) > _MOST_POINTS:
        nodes = np.sort(np.random.default_rng(_SEED).choice(nodes, _MOST_POINTS, replace=False))
    x, corners = first.grid.points[nodes], second.grid.points[second.triangles]
    count = min(_NEAR, len(corners))
    near = np.atleast_2d(cKDTree(corners.mean(axis=1)).query(x, k=count)[1]).reshape(len(x), count)
    weights = _barycentric(x[:, None], corners[near])  # (p, near, 3)
    at = np.einsum("pkc,pkcd->pkd", weights, corners[near])
    distance = np.linalg.norm(at - x[:, None], axis=2)
    best, row = distance.argmin(axis=1), np.arange(len(x))
    return CommonPoints(nodes, second.triangles[near[row, best]], weights[row, best], distance[row, best])


def _barycentric(x: Floats, corners: Floats) -> Floats:
    """Return barycentric weights (..., 3) of a place in each triangle close to x (..., 3).

    It is the projection of x on the triangle's plane, moved into the triangle if it is outside.
    """
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    u, v, w = b - a, c - a, x - a
    uu, uv, vv = ((p * q).sum(axis=-1) for p, q in ((u, u), (u, v), (v, v)))
    wu, wv = (w * u).sum(axis=-1), (w * v).sum(axis=-1)
    det = np.maximum(uu * vv - uv**2, np.finfo(float).tiny)
    s, t = (vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det
    weights = np.clip(np.stack([1 - s - t, s, t], axis=-1), 0.0, None)
    return np.asarray(weights / np.maximum(weights.sum(axis=-1, keepdims=True), np.finfo(float).tiny))


def mac_matrix(first: Sequence[Complexes], second: Sequence[Complexes], points: CommonPoints) -> Floats:
    """Return the MAC (k, l) of k shapes on the first grid with l shapes on the second."""
    there = [points.on_second(u) for u in second]
    return np.array([[mac(u[points.nodes], v) for v in there] for u in first]).reshape(len(first), len(second))


def pair_shapes(values: Floats) -> list[tuple[int, int, float]]:
    """Return the pairs (i, j, MAC) of rows and columns with the largest sum, without those below `ALIKE`.

    Examples
    --------
    >>> pair_shapes(np.array([[0.9, 0.7], [0.8, 0.1], [0.2, 0.5]]))
    [(0, 1, 0.7), (1, 0, 0.8)]
    """
    known = np.where(np.isfinite(values) & (values >= ALIKE), values, 0.0)
    rows, columns = linear_sum_assignment(-known)
    return [(int(i), int(j), float(values[i, j])) for i, j in zip(rows, columns, strict=True) if known[i, j] > 0]
