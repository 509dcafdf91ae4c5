"""Rigid motions of the parts of a mesh: what a scene leaves free is among them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from .spaces import DisplacementSpace
from .ties import Tie

_HELD = 1e-9  # displacement at supports, of a motion of order one, that still counts as rounding


def rigid_motions(space: DisplacementSpace) -> np.ndarray:
    """Return the rigid motions (n, k) of every connected part of the mesh that its supports allow.

    A part turns about its centre, by an angle that moves its nodes by one in the mean. Elastic stiffness leaves all
    these motions free; springs and contacts may hold them. Parts whose mean motion is held together may move against
    each other, so that what is held is looked at for all of them at once.
    """
    part = connected_parts(space)
    together = [np.unique(part[tie.nodes]) for tie in space.ties if tie.fixed.any()]
    group = _connected(part.max() + 1, *_members(together))
    columns = []
    for i in range(group.max() + 1):
        parts = [np.flatnonzero(part == p) for p in np.flatnonzero(group == i)]
        nodes = np.concatenate(parts)
        R = la.block_diag(*(_motions_of(space.coordinates[p]) for p in parts))  # (3 nodes, 6 parts)
        rows = (3 * nodes[:, None] + np.arange(3)).ravel()
        held = np.vstack([R[space.fixed[rows]], *(_held_by(tie, nodes, R) for tie in space.ties)])
        if len(held):
            _, s, turn = la.svd(held, full_matrices=held.shape[0] < R.shape[1])
            s = np.append(s, np.zeros(R.shape[1] - len(s)))
            R = R @ turn[s <= _HELD * np.sqrt(len(held))].T
        for column in R.T:
            nodal = np.zeros(3 * space.nodes)
            nodal[rows] = column
            columns.append(space.gather(nodal.reshape(-1, 3)))
    return np.stack(columns, axis=1) if columns else np.zeros((space.unknowns, 0))


def _motions_of(x: np.ndarray) -> np.ndarray:
    """Return the rigid motions (3 m, 6) of nodes x (m, 3), of order one."""
    x = x - x.mean(axis=0)
    x = x / np.sqrt(np.mean(np.sum(x**2, axis=1)))
    motions = [np.tile(e, (len(x), 1)) for e in np.eye(3)] + [np.cross(e, x) for e in np.eye(3)]
    return np.stack([m.ravel() for m in motions], axis=1)


def _held_by(tie: Tie, nodes: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return how far motions R (3 nodes, 6) of some nodes move the held freedoms of a tie's reference point."""
    place = np.full(max(int(nodes.max()), int(tie.nodes.max())) + 1, -1)
    place[nodes] = np.arange(len(nodes))
    at = place[tie.nodes]
    moved = np.where((at >= 0)[:, None, None], R.reshape(-1, 3, R.shape[1])[at], 0.0)
    return np.asarray((tie.motion @ moved.reshape(-1, R.shape[1]))[tie.fixed])


def connected_parts(space: DisplacementSpace) -> np.ndarray:
    """Return the number of the part of the mesh that each node belongs to, (nodes,) int: connected, or tied rigidly."""
    nodes = space.dofs.element_dofs  # (local nodes, elements)
    elements = np.broadcast_to(np.arange(nodes.shape[1]), nodes.shape)
    tied, body = _members([tie.nodes for tie in space.ties if tie.rigid])
    items, sets = np.append(nodes, tied), np.append(elements, nodes.shape[1] + body)
    return _connected(space.nodes, items, sets)


def _members(sets: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the items of all sets, (m,) int, and the number of the set that each is in, (m,) int."""
    items = np.concatenate([np.zeros(0, int), *sets])
    return items, np.repeat(np.arange(len(sets)), [len(s) for s in sets])


def _connected(count: int, items: np.ndarray, sets: np.ndarray) -> np.ndarray:
    """Return the number of the group of each of some items, (count,) int: those of one set are in one group.

    Parameters
    ----------
    items, sets : (m,) int
        An item, and a set that it is in.
    """
    shape = (count, int(sets.max(initial=-1)) + 1)
    incidence = sp.csr_array((np.ones(len(items), bool), (items, sets)), shape=shape)
    both = sp.block_array([[None, incidence], [incidence.T, None]])
    return np.asarray(connected_components(both, directed=False)[1][:count])
