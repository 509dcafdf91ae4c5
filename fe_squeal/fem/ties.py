"""Nodes tied to a reference point with six freedoms, rigidly or in the mean, and eliminated exactly.

The displacements u of the nodes follow from unknowns q of their own, u = B q, so that every form K on displacements
becomes BᵀKB. Neither a penalty nor a multiplier is left.

- Rigid: u_i = U + θ × (x_i − x_r), q the six freedoms of the reference point.
- Averaged (distributing couplings, RBE3): the reference follows the rigid motion that is nearest to the nodes',
  minimising ∫|u − U − θ × (x − x_r)|² over the surface, or the sum over the nodes. That is (U, θ) = L u with
  L = (RᵀWR)⁻¹RᵀW, and a force F on the reference acts on the nodes as LᵀF. Here q are the six freedoms and the
  motions with L u = 0, in an orthonormal basis that is found cluster by cluster (the construction of multiwavelets:
  Alpert, SIAM J. Math. Anal. 24, 1993). B then has some 6 log₂ m entries in a row for m nodes, and BᵀKB stays sparse.

- Mean: the same with the three translations alone, which a spring between the means of two surfaces acts on.

Rotations are scaled by the radius of the nodes about the reference, so that all unknowns are displacements in metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

FREEDOMS = ("x", "y", "z", "rx", "ry", "rz")
_LEAF = 8  # nodes in the smallest cluster: more than carry six motions, few enough for sparse columns
_RANK = 1e-6  # part of the radius: nodes nearer to a line than this do not turn about it


@dataclass(frozen=True)
class Tie:
    """Nodes that follow a reference point, or the other way round.

    Attributes
    ----------
    name : str
    rigid : bool
    nodes : (m,) int
    point : (3,) float, m
        The reference.
    block : (3 m, k) sparse
        Displacements of the nodes, 3 i + c component c of node i, from the k unknowns of the tie.
    inverse : (k, 3 m) sparse
        These unknowns from displacements that the tie allows.
    freedoms : (6 or 3, k) sparse
        Translation (m) and rotation (rad) of the reference from the unknowns; of a mean the translation alone.
    fixed : (6 or 3,) bool
        Freedoms of the reference that are held, and so no unknowns.
    motion : (6 or 3, 3 m) float
        All freedoms from displacements of the nodes, also where they are held.
    """

    name: str
    rigid: bool
    nodes: np.ndarray
    point: np.ndarray
    block: sp.csr_array
    inverse: sp.csr_array
    freedoms: sp.csr_array
    fixed: np.ndarray
    motion: np.ndarray


def rigid_columns(x: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the displacements (3 m, 6) of points x (m, 3) in a unit translation and rotation (rad) about a point."""
    r = np.asarray(x) - point
    columns = [np.tile(e, (len(r), 1)) for e in np.eye(3)] + [np.cross(e, r) for e in np.eye(3)]
    return np.stack([c.ravel() for c in columns], axis=1)


def rigid_tie(name: str, nodes: np.ndarray, x: np.ndarray, point: np.ndarray, fixed: np.ndarray) -> Tie:
    """Return the tie of nodes at x (m, 3) to a rigid body.

    Nodes in one place have no rotation, and the body only three freedoms.

    Raises
    ------
    ValueError
        The nodes lie on a line, about which they do not turn.
    """
    R = rigid_columns(x, point)
    radius = _radius(x, point)
    scale = np.array([1.0] * 3 + [1.0 / radius] * 3)
    free = ~np.asarray(fixed)
    spread = np.linalg.svd(x - x.mean(axis=0), compute_uv=False) / radius
    if len(x) == 1 or spread[0] <= _RANK:
        free = free & np.array([True] * 3 + [False] * 3)
    elif spread[1] <= _RANK:
        raise ValueError("its nodes lie on one line, about which they do not turn; expected others beside it")
    columns = np.flatnonzero(free)
    B = R[:, columns] * scale[columns]
    freedoms = np.zeros((6, len(columns)))
    freedoms[columns, np.arange(len(columns))] = scale[columns]
    inverse = np.linalg.pinv(B)
    return Tie(
        name, True, nodes, point, sp.csr_array(B), sp.csr_array(inverse), sp.csr_array(freedoms), ~free,
        np.linalg.pinv(R),
    )  # fmt: skip


def averaged_tie(
    name: str, nodes: np.ndarray, x: np.ndarray, point: np.ndarray, fixed: np.ndarray, moments: np.ndarray
) -> Tie:
    """Return the tie of a reference point to the mean motion of nodes.

    Parameters
    ----------
    moments : (3 m, 6) float
        W R: displacements times it are the translation and the rotation about the reference, summed with weights.

    Raises
    ------
    ValueError
        The nodes lie on a line.
    """
    R, radius = rigid_columns(x, point), _radius(x, point)
    scale = np.array([1.0] * 3 + [radius] * 3)  # of freedoms: a rotation times the radius is a displacement
    gram = (moments / scale).T @ (R / scale)
    if len(x) < 3 or np.linalg.cond(gram) > _RANK**-2:
        raise ValueError("its nodes lie on one line, about which they have no mean rotation; expected others beside it")
    L = np.linalg.solve(gram, (moments / scale).T)  # (6, 3 m): scaled freedoms of the reference
    waves, S = _clusters(L, x, np.ones(3 * len(x), bool))
    back = np.linalg.inv(L @ S)
    columns = np.flatnonzero(~np.asarray(fixed))
    block = sp.csr_array(sp.hstack([waves, sp.csr_array((S @ back)[:, columns])]))
    inverse = sp.csr_array(sp.vstack([waves.T, sp.csr_array(L[columns])]))
    k = waves.shape[1]
    freedoms = sp.csr_array((1 / scale[columns], (columns, k + np.arange(len(columns)))), shape=(6, k + len(columns)))
    motion = L / scale[:, None]
    return Tie(name, False, nodes, point, block, inverse, freedoms, np.asarray(fixed), motion)


def mean_tie(name: str, nodes: np.ndarray, x: np.ndarray, weights: np.ndarray, held: np.ndarray) -> Tie | None:
    """Return the tie of nodes to their mean displacement; None where supports hold all of a component.

    Parameters
    ----------
    weights : (m,) float
        Weights of the nodes in the mean; their sum is 1.
    held : (3 m,) bool
        Displacements that supports hold at zero.
    """
    L = np.kron(weights, np.eye(3))
    L[:, held] = 0.0
    if not L.any(axis=1).all():
        return None
    waves, S = _clusters(L, x, ~held)
    block = sp.csr_array(sp.hstack([waves, sp.csr_array(S @ np.linalg.inv(L @ S))]))
    inverse = sp.csr_array(sp.vstack([waves.T, sp.csr_array(L)]))
    k = waves.shape[1]
    freedoms = sp.csr_array((np.ones(3), (np.arange(3), k + np.arange(3))), shape=(3, k + 3))
    return Tie(name, False, nodes, weights @ x, block, inverse, freedoms, np.zeros(3, bool), L)


def _clusters(L: np.ndarray, x: np.ndarray, active: np.ndarray) -> tuple[sp.csr_array, np.ndarray]:
    """Return an orthonormal basis of L u = 0, (3 m, 3 m − f) sparse, and of what it leaves, (3 m, f), f the rows of L.

    The displacements of each cluster of nodes are rotated so that f directions carry its part of L. The other
    directions belong to the basis; the f are passed to the cluster above, which joins them with those of its other
    half. Displacements that are not active are zero.
    """
    parts: list[tuple[np.ndarray, np.ndarray]] = []  # unknowns that a column has, and its entries

    def gather(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rows and columns (rows, s) that carry L of a cluster."""
        if len(nodes) <= _LEAF:
            rows = (3 * nodes[:, None] + np.arange(3)).ravel()
            rows = rows[active[rows]]
            basis = np.eye(len(rows))
        else:
            spread = np.ptp(x[nodes], axis=0)
            order = nodes[np.argsort(x[nodes, int(np.argmax(spread))], kind="stable")]
            halves = [gather(half) for half in np.array_split(order, 2)]
            rows = np.concatenate([r for r, _ in halves])
            basis = la.block_diag(*(b for _, b in halves))
        if not len(rows):
            return rows, basis
        carried = basis.T @ L[:, rows].T  # (directions, f)
        Q, _ = la.qr(carried)
        kept = min(len(L), len(Q))
        if kept < Q.shape[1]:
            parts.append((rows, basis @ Q[:, kept:]))
        return rows, basis @ Q[:, :kept]

    rows, last = gather(np.arange(len(x)))
    S = np.zeros((3 * len(x), last.shape[1]))
    S[rows] = last
    at, data = 0, []
    for some, columns in parts:
        width = columns.shape[1]
        data.append((np.repeat(some, width), np.tile(at + np.arange(width), len(some)), columns.ravel()))
        at += width
    if not data:
        return sp.csr_array((3 * len(x), 0)), S
    i, j, values = (np.concatenate([d[k] for d in data]) for k in range(3))
    return sp.csr_array((values, (i, j)), shape=(3 * len(x), at)), S


def _radius(x: np.ndarray, point: np.ndarray) -> float:
    r = float(np.sqrt(np.mean(np.sum((x - point) ** 2, axis=1))))
    return r if r > 0 else 1.0
