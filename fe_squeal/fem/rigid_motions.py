"""Rigid motions of the parts of a mesh: what a scene leaves free is among them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from .spaces import DisplacementSpace

_HELD = 1e-9  # displacement at supports, of a motion of order one, that still counts as rounding


def rigid_motions(space: DisplacementSpace) -> np.ndarray:
    """Return the rigid motions (n, k) of all parts of the mesh that its supports and ties allow.

    A part turns about its centre, by an angle that moves its nodes by one in the mean. Elastic stiffness leaves all
    these motions free; springs and contacts may hold them. Parts that share nodes or are tied move alike there: if that
    is a point, as of a ball joint, or a line, as of a hinge, they turn against each other. What is held is therefore
    looked at for all parts at once that are joined, or whose mean motion is held together.
    """
    node, part, _ = firm_parts(space)
    group = _groups(space)[node]
    columns = []
    for i in range(group.max() + 1):
        nodes, parts = node[group == i], part[group == i]
        own = np.split(nodes, np.flatnonzero(np.diff(parts)) + 1)
        R = sp.csr_array(sp.block_diag([_motions_of(space.coordinates[p]) for p in own]))  # (3 nodes, 6 parts)
        held, turn = _constraints(space, nodes, parts, R), np.eye(R.shape[1])
        if len(held):
            _, s, turn = la.svd(held, full_matrices=held.shape[0] < R.shape[1])
            s = np.append(s, np.zeros(R.shape[1] - len(s)))
            turn = turn[s <= _HELD * np.sqrt(len(held))]
        for column in (R @ turn.T).T:
            nodal = np.zeros(3 * space.nodes)
            nodal[_components(nodes)] = column
            columns.append(space.gather(nodal.reshape(-1, 3)))
    return np.stack(columns, axis=1) if columns else np.zeros((space.unknowns, 0))


def firm_parts(space: DisplacementSpace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the parts of the mesh that are connected by facets.

    Elements with a facet in common do not turn against each other; those with no more than an edge or a node do.

    Returns
    -------
    node, part : (m,) int
        The nodes of one part after the other, ascending in each, and the numbers of the parts. A node may be in
        several.
    of_element : (elements,) int
        The part of each element.
    """
    mesh, nodes = space.mesh, space.dofs.element_dofs
    inner = mesh.f2t[:, mesh.f2t[1] >= 0]
    graph = sp.coo_array((np.ones(inner.shape[1], bool), (inner[0], inner[1])), shape=(mesh.nelements,) * 2)
    count, of_element = connected_components(graph, directed=False)
    owner = np.broadcast_to(of_element, nodes.shape).ravel()
    members = sp.csr_array((np.ones(nodes.size, bool), (owner, nodes.ravel())), shape=(count, space.nodes))
    part, node = members.nonzero()
    return node, part, of_element


def _groups(space: DisplacementSpace) -> np.ndarray:
    """Return the number of the group of each node, (nodes,) int: joined, or their mean motion held together."""
    joined = connected_parts(space)
    together = [np.unique(joined[tie.nodes]) for tie in space.ties if tie.fixed.any()]
    return _connected(joined.max() + 1, *_members(together))[joined]


def _motions_of(x: np.ndarray) -> np.ndarray:
    """Return the rigid motions (3 m, 6) of nodes x (m, 3), of order one."""
    x = x - x.mean(axis=0)
    x = x / np.sqrt(np.mean(np.sum(x**2, axis=1)))
    motions = [np.tile(e, (len(x), 1)) for e in np.eye(3)] + [np.cross(e, x) for e in np.eye(3)]
    return np.stack([m.ravel() for m in motions], axis=1)


def _components(nodes: np.ndarray) -> np.ndarray:
    """Return the rows of the components of displacements of nodes."""
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def _constraints(space: DisplacementSpace, nodes: np.ndarray, parts: np.ndarray, R: sp.csr_array) -> np.ndarray:
    """Return what supports, shared nodes and ties do not allow of motions R (3 m, k) of parts, (constraints, k).

    Parameters
    ----------
    nodes, parts : (m,) int
        The nodes of each part, one part after the other.
    """
    place = np.full(space.nodes, -1)
    place[nodes] = np.arange(len(nodes))  # in one of the parts that share a node
    again = np.flatnonzero(place[nodes] != np.arange(len(nodes)))
    found = [R[space.fixed[_components(nodes)]], R[_components(again)] - R[_components(place[nodes[again]])]]
    for tie in space.ties:
        at = place[tie.nodes]
        if at.min() < 0 or not (tie.fixed.any() or (tie.rigid and np.ptp(parts[at]))):
            continue
        u = R[_components(at)]
        # Of a rigid body B B⁺u is the nearest motion that it allows, with what is held in it.
        found.append(u - tie.block @ (tie.inverse @ u) if tie.rigid else sp.csr_array(tie.motion[tie.fixed]) @ u)
    return np.vstack([rows.toarray() for rows in found])


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
