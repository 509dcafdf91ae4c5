"""Hexahedra and their faces on a lattice of node numbers, and the bodies put together from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Positions of the nodes in a cell of the lattice, in gmsh's order (reference manual, "Node ordering"). A cell is one
# lattice step wide at order 1 and two at order 2; corners come first, then edges, faces and the centre.
_HEX = {
    1: ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
    2: (
        *((0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)),
        *((1, 0, 0), (0, 1, 0), (0, 0, 1), (2, 1, 0), (2, 0, 1), (1, 2, 0)),
        *((2, 2, 1), (0, 2, 1), (1, 0, 2), (0, 1, 2), (2, 1, 2), (1, 2, 2)),
        *((1, 1, 0), (1, 0, 1), (0, 1, 1), (2, 1, 1), (1, 2, 1), (1, 1, 2), (1, 1, 1)),
    ),
}
_QUAD = {
    1: ((0, 0), (1, 0), (1, 1), (0, 1)),
    2: ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)),
}


@dataclass(frozen=True)
class GroupedMesh:
    """Nodes, and the elements and facets of each named group, in gmsh's node order.

    Attributes
    ----------
    points : (n, 3) float, length
    volumes : name -> (m, 8 or 27) int
        Hexahedra with positive Jacobians, numbered from 0 into `points`.
    surfaces : name -> (m, 4 or 9) int
        Facets, their normals pointing out of the body.
    """

    points: Floats
    volumes: Mapping[str, Ints]
    surfaces: Mapping[str, Ints]


def join_meshes(parts: Sequence[GroupedMesh]) -> GroupedMesh:
    """Put meshes side by side, sharing no nodes; group names must differ."""
    starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    placed = list(zip(starts, parts, strict=True))
    return GroupedMesh(
        points=np.vstack([part.points for part in parts]),
        volumes={name: cells + start for start, part in placed for name, cells in part.volumes.items()},
        surfaces={name: cells + start for start, part in placed for name, cells in part.surfaces.items()},
    )


def number_lattice(shape: tuple[int, int, int], periodic: bool = False) -> Ints:
    """Return node numbers (ni, nj, nk); with `periodic` the second axis closes: its first slice is repeated at its end.

    Examples
    --------
    >>> number_lattice((1, 3, 1), periodic=True).ravel().tolist()
    [0, 1, 2, 0]
    """
    ids = np.arange(np.prod(shape), dtype=np.int64).reshape(shape)
    return np.concatenate([ids, ids[:, :1]], axis=1) if periodic else ids


def hexahedra(ids: Ints, order: int) -> Ints:
    """Return the hexahedra (m, 8 or 27) of a lattice (ni, nj, nk) whose axes form a right-handed system."""
    return _cells(ids, _HEX[order], order)


def faces(ids: Ints, axis: int, end: int, order: int) -> Ints:
    """Return the quadrilaterals (m, 4 or 9) on one side of a lattice, normals outward.

    Parameters
    ----------
    axis : 0, 1 or 2
    end : 0 or -1
        The side where the index along `axis` is lowest or highest.
    """
    side = np.take(ids, end, axis=axis)
    # The two axes left, in cyclic order, turn about +axis; take() leaves them in ascending order, reversed for axis 1.
    points_up = axis != 1
    return _cells(side if points_up == (end == -1) else side.T, _QUAD[order], order)


def _cells(ids: Ints, offsets: Sequence[Sequence[int]], order: int) -> Ints:
    columns = [
        ids[tuple(slice(d, length - order + d, order) for d, length in zip(offset, ids.shape, strict=True))].ravel()
        for offset in offsets
    ]
    return np.stack(columns, axis=1)
