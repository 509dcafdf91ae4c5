"""Hexahedra and their faces on a lattice of node numbers."""

from __future__ import annotations

from collections.abc import Sequence

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
