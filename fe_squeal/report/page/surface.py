"""The surface of the bodies and the shapes on it, thinned so that a page can show it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fe_squeal.report.results import Shape
from fe_squeal.report.shapes import (
    Floats,
    Integers,
    ShapeGrid,
    axis_frame,
    boundary_triangles,
    sharp_edges,
)

MOST_NODES = 20_000  # so that a browser moves a shape smoothly: 40 000 triangles take 50 ms a frame (measured)
BUDGET = 5_000_000  # bytes of the page for points, triangles and shapes; Plotly takes 4.8 MB of the 12 MB of a page
_NODE, _PER_SHAPE = 16 + 32, 16  # bytes in base64: of a node's place and its two triangles, and of its displacement
_ROUNDS = 40  # bisections for the size of the lattice


@dataclass(frozen=True)
class PageSurface:
    """The surface of all bodies: triangles and sharp edges between some nodes of a grid.

    Attributes
    ----------
    nodes : (n,) int
        Nodes of the grid; a node of two bodies is listed for each.
    triangles : (t, 3) int
        Positions in `nodes`; the triangles of a body follow each other.
    bounds : (bodies + 1,) int
        The first triangle of each body, and t.
    edges : (m, 2) int
        The sharp edges, as positions in `nodes`.
    whole : int
        Number of nodes on the surface before it was thinned.
    """

    nodes: Integers
    triangles: Integers
    bounds: Integers
    edges: Integers
    whole: int

    @property
    def is_thinned(self) -> bool:
        """Whether nodes were left out."""
        return len(self.nodes) < self.whole


def make_surface(grid: ShapeGrid, most: int = MOST_NODES) -> PageSurface:
    """Return the surface of the bodies of a grid, with at most `most` nodes."""
    triangles, body = boundary_triangles(grid)
    count = len(grid.body_names)
    key = triangles + body[:, None] * len(grid.points)  # gives a node a number for each body that it is on
    used, inverse = np.unique(key, return_inverse=True)
    triangles = np.asarray(inverse).reshape(-1, 3)
    nodes, owner = used % len(grid.points), used // len(grid.points)
    edges = sharp_edges(grid.points[nodes], triangles)
    whole = len(nodes)
    if whole > most:
        kept, place = _thinned(grid.points[nodes], owner, most)
        nodes, triangles, edges = nodes[kept], place[triangles], place[edges]
        triangles, body = _proper(triangles, body)
        edges = np.unique(np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1), axis=0)
    order = np.argsort(body, kind="stable")
    bounds = np.searchsorted(body[order], np.arange(count + 1))
    return PageSurface(nodes, triangles[order], bounds, edges, whole)


def _thinned(points: Floats, owner: Integers, most: int) -> tuple[Integers, Integers]:
    """Return the nodes that are kept, at most `most`, and for each node the position of the kept node in its place.

    Of all nodes of a body in one cell of a regular lattice, one is kept. The size of the cells is found by bisection.
    """
    size = float(np.ptp(points, axis=0).max())
    low, high = 0.0, size
    best: tuple[Integers, Integers] | None = None
    for _ in range(_ROUNDS):
        middle = (low + high) / 2 if low else high / 2
        cell = np.floor((points - points.min(axis=0)) / middle).astype(np.int64)
        counts = cell.max(axis=0) + 1
        key = ((owner * counts[0] + cell[:, 0]) * counts[1] + cell[:, 1]) * counts[2] + cell[:, 2]
        _, first, place = np.unique(key, return_index=True, return_inverse=True)
        if len(first) <= most:
            best, high = (first, np.asarray(place).ravel()), middle
            if len(first) > 0.9 * most:
                break
        else:
            low = middle
    assert best is not None
    return best


def _proper(triangles: Integers, body: Integers) -> tuple[Integers, Integers]:
    """Return the triangles that still have three different corners, each once, and their bodies."""
    flat = (triangles[:, [0, 1, 2]] == triangles[:, [1, 2, 0]]).any(axis=1)
    triangles, body = triangles[~flat], body[~flat]
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return triangles[first], body[first]


def shape_data(
    grid: ShapeGrid, shapes: Sequence[Shape], axis: Sequence[float], most: int = MOST_NODES
) -> tuple[dict[str, Any], list[str]]:
    """Return the surface and its shapes for the page, and sentences on what was thinned or left out.

    Everything is turned so that the axis becomes z. Places are written as float32, displacements as 16-bit integers, in
    which 32767 is the largest amplitude. Branches whose shapes have no room are listed under "left_out".

    Parameters
    ----------
    grid : ShapeGrid
    shapes : sequence of Shape
        With a largest amplitude of 1.
    axis : (3,) float
        Axis of the disc, or normal of the belt.
    most : int
        Number of nodes, at most.
    """
    room = max(BUDGET // (_NODE + _PER_SHAPE * min(len(shapes), 40)), 2000)
    surface = make_surface(grid, min(most, room))
    kept = list(shapes)[: max(int((BUDGET / max(len(surface.nodes), 1) - _NODE) / _PER_SHAPE), 1)]
    said = []
    if surface.is_thinned:
        said.append(
            f"The surface has {surface.whole} nodes; the page shows {len(surface.nodes)} of them, and the files in"
            " shapes/ all."
        )
    if len(kept) < len(shapes):
        said.append(f"The page has the first {len(kept)} of {len(shapes)} shapes; the others are in shapes/.")
    frame = axis_frame(axis)
    data = {
        "points": _encoded(grid.points[surface.nodes] @ frame.T, np.float32),
        "triangles": _encoded(surface.triangles, np.uint32),
        "edges": _encoded(surface.edges, np.uint32),
        "bounds": surface.bounds.tolist(),
        "bodies": list(grid.body_names),
        "size": grid.size,
        "shapes": [],
        "left_out": [shape.info["branch"] for shape in shapes[len(kept) :] if "branch" in shape.info],
    }
    for shape in kept:
        u = shape.u[surface.nodes] @ frame.T
        both = np.concatenate([u.real, u.imag], axis=1)  # (n, 6)
        data["shapes"].append({**shape.info, "u": _encoded(np.rint(32767 * both), np.int16)})
    return data, said


def _encoded(values: NDArray[Any], kind: type[np.generic]) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<")).tobytes()).decode()
