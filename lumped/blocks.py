"""Parts of a system that move without the others, each of which has its own spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg as la
from scipy.sparse.csgraph import connected_components

from .spectrum import Complexes, Spectrum, solve_eigenvalues, solve_spectrum
from .springs import Floats

_ENTRY = 8 * np.finfo(float).eps  # of the largest entries of its row and column: rounding of sums of a few products
_COUPLING = 1e-10  # of the geometric mean of the stiffness of two parts
_PART = 64 * np.finfo(float).eps  # of a matrix, times n: a smaller part outside a subspace is rounding


@dataclass(frozen=True)
class Block:
    """The system q̈ + C q̇ + (A + μ B) q = 0 of which no part moves without the rest.

    Attributes
    ----------
    A, B : (n, n) arrays, 1/s²
    C : (n, n) array, 1/s
        Zero throughout if the block has no damping.
    """

    A: Floats
    B: Floats
    C: Floats
    undamped: bool = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "undamped", not self.C.any())

    def eigenvalues(self, mu: float) -> Complexes:
        """Return all λ, (2n,), rad/s."""
        return solve_eigenvalues(np.eye(len(self.A)), self.C, self.A + mu * self.B)

    def spectrum(self, mu: float | Floats) -> Spectrum:
        """Return all λ with their uncertainty, for one μ or an array of them."""
        return solve_spectrum(np.eye(len(self.A)), self.C, self.A + np.asarray(mu)[..., None, None] * self.B)


def split_blocks(A: Floats, B: Floats, C: Floats) -> list[Block]:
    """Split a system into blocks, so that its eigenvalues are those of all blocks at every μ.

    Where a motion stays undamped at every μ, it is in a block without damping. First coordinates are grouped which
    drive each other. Then symmetries are sought, as of two equal pads: a subspace that A, B and C do not leave holds
    an eigenvector of any combination of them, and is what the three make of that vector.

    Parameters
    ----------
    A, B, C : (n, n) arrays
        Of q̈ + C q̇ + (A + μ B) q = 0.

    Examples
    --------
    >>> import numpy as np
    >>> A = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 5.0]])
    >>> blocks = split_blocks(A, np.diag([1.0, 1.0], -1), np.diag([0.0, 0.0, 1.0]))
    >>> [(len(b.A), b.undamped) for b in blocks]
    [(2, True), (1, False)]
    >>> [len(b.A) for b in split_blocks(A[:2, :2], A[:2, :2], A[:2, :2])]  # sum and difference
    [1, 1]
    """
    A, B, C = (_without_rounding(X) for X in (A, B, C))
    if np.abs(C).max() <= _ENTRY * np.sqrt(np.abs(A).max()):  # less than rounding of the stiffness does to any Re λ
        C = np.zeros_like(C)
    _, label = connected_components((A != 0) | (B != 0) | (C != 0), directed=True, connection="strong")
    blocks = []
    for k in np.unique(label):
        i = np.flatnonzero(label == k)
        blocks += _split_symmetric([X[np.ix_(i, i)] for X in (A, B, C)], [np.abs(X).max() for X in (B, C)])
    return blocks


def _without_rounding(X: Floats) -> Floats:
    size = np.abs(X)
    return np.where(size > _ENTRY * np.sqrt(size.max(1))[:, None] * np.sqrt(size.max(0)), X, 0.0)


def _split_symmetric(matrices: Sequence[Floats], sizes: Sequence[float]) -> list[Block]:
    n = len(matrices[0])
    A, *others = matrices
    matrices = [A, *(X if np.abs(X).max() > n * _PART * size else 0 * X for X, size in zip(others, sizes, strict=True))]
    operators = [X / np.abs(X).max() for X in matrices if X.any()]
    if n > 1 and operators:
        weights = np.random.default_rng(7).uniform(0.5, 1.0, len(operators))
        _, vectors = np.linalg.eig(sum(w * X for w, X in zip(weights, operators, strict=True)))
        for v in vectors.T:
            V = _reached(v, operators, n * _PART)
            rest = la.null_space(V.T)
            if V.shape[1] < n and _are_apart(A, V, rest):
                return [b for W in (V, rest) for b in _split_symmetric([W.T @ X @ W for X in matrices], sizes)]
    return [Block(*matrices)]


def _are_apart(A: Floats, V: Floats, W: Floats) -> bool:
    """Return whether what couples two subspaces is small beside the softer of them, too, not just beside all of A."""
    coupling, first, second = (float(np.abs(X).max()) for X in (W.T @ A @ V, V.T @ A @ V, W.T @ A @ W))
    rounding = len(A) * _ENTRY * float((np.abs(W.T) @ np.abs(A) @ np.abs(V)).max())
    return coupling <= _COUPLING * np.sqrt(first) * np.sqrt(second) + rounding


def _reached(v: Complexes, operators: Sequence[Floats], tolerance: float) -> Floats:
    """Return an orthonormal basis of the smallest real subspace with v that no operator leaves."""
    V = np.zeros((len(v), 0))
    new = np.column_stack([v.real, v.imag])
    while V.shape[1] < len(v):
        for _ in range(2):  # twice, since rounding leaves something the first time
            new = new - V @ (V.T @ new)
        u, s, _ = np.linalg.svd(new, full_matrices=False)
        u = u[:, s > tolerance]
        if not u.shape[1]:
            break
        V = np.linalg.qr(np.column_stack([V, u]))[0]
        new = np.column_stack([X @ u for X in operators])
    return V
