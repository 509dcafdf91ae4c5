"""Modes of a damped projection between values at which they are known, from a smaller projection with two sides.

LAPACK finds all modes of a projection of r vectors, several times as many as are asked for, and with damping of
matrices twice as large. Right modes between two values lie nearly in the span of those at a few values, left ones in
that of left ones. Each of these spans has fewer directions than the basis, which has both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la

from ..eigen.growth import may_grow_dense
from ..eigen.pencil import FreeMotions, Modes, Pencil
from ..eigen.quality import modes_from_lambda, modes_from_theta
from ..eigen.request import Request
from .estimate import GUARDED
from .projection import Projection
from .quadratic import Quadratic
from .vectors import of_length, real_columns, thin_svd

# These numbers were chosen with three models of benchmarks/gallery in sight (Rayleigh, loss, rotating): they decide how
# often LAPACK has to solve after all, not how exact the modes are.
_CUT = 3.0  # times √tolerance: directions of the spans of unit modes that are shorter are left out
_ABOVE = 0.01  # length of modes above the neighbours of those asked for, which need not be spanned as closely
_PAYS = 0.7  # of the vectors of the basis: with more in a span LAPACK on all of the basis costs no more
_MORE = 4  # modes above those asked for
_LIMIT = 1.05  # times the highest frequency asked for: up to there modes are above those asked for
_ENOUGH = 1e-3  # times the tolerance: errors against the basis that are smaller add nothing to those of the basis
_TWINS, _ALIKE = 1e-6, 1e-3  # of |λ|, and of the likeness of shapes: nearer ones may be one mode, found twice
# A mode may be missing if, from some mode on, more than a third of the |λ| are larger by this part than at the nodes on
# both sides.
_RISES, _MANY = 5e-3, 1 / 3
_NAMES = "node_right", "node_left", "node_sizes", "node_swings"  # of what is stored of each node


@dataclass(frozen=True)
class _Node:
    """What is known at a value: columns (r, ·) that span right and left modes, and of all modes |λ|, by rising size.

    With (k,) bool, whether each of these swings.
    """

    value: float
    right: np.ndarray
    left: np.ndarray
    sizes: np.ndarray
    swings: np.ndarray


class TwoSided:
    """Right and left modes of a growing basis at some values, and what follows for values between these.

    With columns U that span the right modes and W the left ones, WᴴQ(λ)U has the modes between in which each eigenvalue
    is off by the product of the errors of its vectors. These are then corrected with factors of the projected Q(s) at a
    complex s nearby: φ − Q(s)⁻¹Q(λ)φ, and the left ones likewise, until both residuals show that λ is that of the
    projection within a part of the tolerance. (Two-sided Galerkin projection: Benner, Gugercin, Willcox,
    SIAM Rev. 57, 2015.)

    Parameters
    ----------
    tolerance : float
        Of eigenvalues, relative.
    is_real : bool
        Whether the matrices are real, so that the spans are.
    """

    def __init__(self, tolerance: float, is_real: bool) -> None:
        self._tolerance, self._is_real = tolerance, is_real
        self._nodes: list[_Node] = []
        self._spans: tuple[int, np.ndarray, np.ndarray] | None = None  # of so many nodes

    def __len__(self) -> int:
        return len(self._nodes)

    def add(self, value: float, every: Modes, exact: Modes, near: float) -> None:
        """Take over the modes at a value, in coordinates of the basis as it is now.

        Parameters
        ----------
        every : Modes
            All up to the highest frequency that is looked at.
        exact : Modes
            The same as vectors that are exact, but for those that decay without swinging.
        near : float, rad/s
            Up to this |λ| they are asked for, or neighbours of such modes.
        """
        assert exact.left is not None
        lengths = np.where(np.abs(exact.lam) <= near, 1.0, _ABOVE)
        right, left = (of_length(x, lengths) for x in (exact.right, exact.left))
        if self._is_real:
            right, left = real_columns(right), real_columns(left)
        lam = every.lam[np.argsort(np.abs(every.lam), kind="stable")]
        self._nodes.append(_Node(value, right, left, np.abs(lam), _swing(lam)))

    def emptied(self) -> TwoSided:
        """Return the same without any node."""
        return TwoSided(self._tolerance, self._is_real)

    def restored(self, arrays: Mapping[str, np.ndarray], numbers: Mapping[str, Any]) -> TwoSided:
        """Return the same with the nodes that `stored` gave: arrays (r, ·) and (k,) of each, and their values."""
        found = self.emptied()
        for i, value in enumerate(numbers["values"]):
            found._nodes.append(_Node(value, *(arrays[f"{name}_{i}"] for name in _NAMES)))
        return found

    def stored(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return what `restored` needs: arrays, and numbers that JSON can hold."""
        parts = ((n.right, n.left, n.sizes, n.swings) for n in self._nodes)
        arrays = {f"{name}_{i}": a for i, part in enumerate(parts) for name, a in zip(_NAMES, part, strict=True)}
        return arrays, {"values": [n.value for n in self._nodes]}

    def modes(
        self, basis: Projection, value: float, request: Request, highest: float, count: int | None = None
    ) -> Modes | None:
        """Return the modes asked for at a value and maybe a few above, in coordinates of a basis; None if not sure.

        Parameters
        ----------
        basis : Projection
            With damping, or complex; its first vectors are those that the nodes were found on.
        highest : float, rad/s
            Up to `GUARDED` times this the modes at the nodes are known.
        count : int, optional
            How many nodes count, the first ones; all of them.
        """
        nodes = self._nodes[:count]
        around = _around(nodes, value)
        if around is None or basis.has_slow or basis.free_motions(value).motions.shape[1]:
            return None
        if not all(n.swings.all() for n in around):  # a mode that does not swing there, and has no vector, may here
            return None
        sides = self._sides(nodes)
        if sides[0].shape[1] > _PAYS * len(basis):
            return None
        M, C, K, symmetric = basis.matrices(value)
        if may_grow_dense(M, C, K, GUARDED * highest):  # beyond what is looked for here
            return None
        U, W = (np.pad(x, ((0, len(M) - len(x)), (0, 0))) for x in sides)
        quadratic = Quadratic(M, C, K, highest)
        try:
            lam, right, left = quadratic.projected(U, W)
        except la.LinAlgError:
            return None
        asked = _asked(lam, request)
        if asked is None or not _swing(lam).all() or _is_missing(lam, asked[0], around):
            return None
        kept = slice(asked[1])
        pairs = quadratic.corrected(lam[kept], right[:, kept], left[:, kept], asked[0], _ENOUGH * self._tolerance)
        if pairs is None:
            return None
        pencil = Pencil(M, K, C, symmetric, None, FreeMotions.none(len(M)))
        modes_from = modes_from_theta if C is None else modes_from_lambda
        values = -(pairs[0] ** 2) if C is None else pairs[0]
        modes = modes_from(pencil, values, pairs[1], pairs[2], "two-sided projection", second_order=True)
        return modes if _swing(modes.lam).all() and not _has_twins(*pairs[:2]) else None

    def _sides(self, nodes: Sequence[_Node]) -> tuple[np.ndarray, np.ndarray]:
        """Return orthonormal columns that span the right modes at the nodes, and as many that span the left ones."""
        if self._spans is None or self._spans[0] != len(nodes):
            rows = max(len(n.right) for n in nodes)
            found = []
            for side in ([n.right for n in nodes], [n.left for n in nodes]):
                columns = np.hstack([np.pad(x, ((0, rows - len(x)), (0, 0))) for x in side])
                U, s, _ = thin_svd(columns)
                found.append((U, int(np.count_nonzero(s > _CUT * self._tolerance**0.5))))
            (U, m), (W, n) = found
            size = max(m, n)
            self._spans = len(nodes), _filled(U[:, :m], W, size), _filled(W[:, :n], U, size)
        return self._spans[1:]


def _swing(lam: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(lam.real) < lam.imag)


def _around(nodes: Sequence[_Node], value: float) -> tuple[_Node, _Node] | None:
    """Return the nearest nodes on both sides of a value, which may be that of a node; None outside all of them."""
    below, above = [n for n in nodes if n.value <= value], [n for n in nodes if n.value >= value]
    if not below or not above:
        return None
    return max(below, key=lambda n: n.value), min(above, key=lambda n: n.value)


def _asked(lam: np.ndarray, request: Request) -> tuple[int, int] | None:
    """Return how many of the λ, by rising frequency, are asked for, and how many are kept; None if they are fewer."""
    if request.max_frequency_hz is not None:
        limit = 2 * np.pi * request.max_frequency_hz
        return int(np.count_nonzero(lam.imag <= limit)), int(np.count_nonzero(lam.imag <= _LIMIT * limit))
    assert request.count is not None
    return (request.count, request.count + _MORE) if len(lam) >= request.count else None


def _is_missing(lam: np.ndarray, wanted: int, around: tuple[_Node, _Node]) -> bool:
    """Return whether a mode may be missing.

    Every mode above it then has the number of the one below, so that the i-th smallest |λ| is larger than at the nodes
    on both sides by more than these differ, unless two modes are close together. If none is missing, this happens to
    single modes whose frequency rises and falls between the nodes.
    """
    sizes = np.sort(np.abs(lam))[:wanted]
    if any(len(n.sizes) < len(sizes) for n in around):
        return True
    a, b = (n.sizes[: len(sizes)] for n in around)
    above = sizes > np.maximum(a, b) * (1 + _RISES) + np.abs(a - b)
    first = int(np.argmax(above))
    return bool(above[first:].mean() > _MANY) if above.any() else False


def _has_twins(lam: np.ndarray, right: np.ndarray) -> bool:
    """Return whether two of the modes (r, k), of unit length, may be one that was found twice."""
    near = np.abs(lam[:, None] - lam[None, :]) <= _TWINS * np.abs(lam)
    alike = np.abs(right.conj().T @ right) > 1 - _ALIKE
    return bool(np.triu(near & alike, 1).any())


def _filled(U: np.ndarray, others: np.ndarray, size: int) -> np.ndarray:
    """Return orthonormal columns U (r, m) with as many directions of others (r, ·) as make them `size` columns."""
    if U.shape[1] == size:
        return U
    outside = others[:, :size] - U @ (U.conj().T @ others[:, :size])
    more = thin_svd(outside)[0]
    return np.hstack([U, more[:, : size - U.shape[1]]])
