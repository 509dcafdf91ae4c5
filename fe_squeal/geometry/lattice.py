"""Hexahedra, and faces of them, on a lattice: an array (ni, nj, nk) of node numbers along three axes of a body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Positions of the nodes of an element in the lattice, in gmsh's order (reference manual, "Node ordering"). An element
# is one step of the lattice wide at order 1, and two at order 2; corners come first, then edges, faces and the centre.
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
    """Return node numbers (ni, nj, nk) int of a lattice.

    With `periodic` the second axis is closed, as around a disc: its first slice is repeated at the end, so the shape is
    (ni, nj + 1, nk).

    Examples
    --------
    >>> number_lattice((1, 3, 1), periodic=True).ravel().tolist()
    [0, 1, 2, 0]
    """
    ids = np.arange(np.prod(shape), dtype=np.int64).reshape(shape)
    return np.concatenate([ids, ids[:, :1]], axis=1) if periodic else ids


def hexahedra(ids: Ints, order: int) -> Ints:
    """Return the nodes (m, 8 or 27) of the hexahedra of a lattice (ni, nj, nk) whose axes are a right-handed system."""
    return _cells(ids, _HEX[order], order)


def faces(ids: Ints, axis: int, end: int, order: int) -> Ints:
    """Return the nodes (m, 4 or 9) of the quadrilaterals on one side of a lattice, with normals that point outward.

    Parameters
    ----------
    ids : (ni, nj, nk) int
        The lattice.
    axis : 0, 1 or 2
        The axis across the side.
    end : 0 or -1
        The side where the index along `axis` is lowest, or highest.
    order : 1 or 2
    """
    side = np.take(ids, end, axis=axis)
    # The normal of a face is +axis if its two axes are in cyclic order. take() leaves them in ascending order, which is
    # the reverse of the cyclic one for axis 1.
    points_up = axis != 1
    return _cells(side if points_up == (end == -1) else side.T, _QUAD[order], order)


def _cells(ids: Ints, offsets: Sequence[Sequence[int]], order: int) -> Ints:
    columns = [
        ids[tuple(slice(d, length - order + d, order) for d, length in zip(offset, ids.shape, strict=True))].ravel()
        for offset in offsets
    ]
    return np.stack(columns, axis=1)
