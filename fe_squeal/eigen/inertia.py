"""How many modes of a symmetric pencil lie below a frequency, by Sylvester's law of inertia."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..errors import NotConvergedError
from .dense import DENSE_LIMIT
from .linear.choice import factorize, negative_eigenvalues
from .linear.factor import LinearSolver
from .linear.spread_matrix import in_rows
from .pencil import Pencil


def count_below(pencil: Pencil, omega: float, linear_solver: LinearSolver | str = "auto") -> int | None:
    """Return how many θ = −λ² of a symmetric pencil lie below omega² (rad/s), by the inertia of K − ω²M.

    None where the factorisation gives no inertia. Negative θ (divergence) count as well, each once.
    """
    return count_beneath(pencil, omega**2, linear_solver)


def count_beneath(pencil: Pencil, theta: float, linear_solver: LinearSolver | str = "auto") -> int | None:
    """Return how many θ of a symmetric pencil lie below one, rad²/s², which may be negative; see `count_below`."""
    try:
        shifted = in_rows(pencil.K - theta * pencil.M)
        pivots = negative_eigenvalues(shifted, linear_solver)
    except NotConvergedError:
        return None
    return finite_below(pencil, pivots, linear_solver)


def finite_below(
    pencil: Pencil, negative_pivots: int | None, linear_solver: LinearSolver | str = "auto"
) -> int | None:
    """Return how many of the negative pivots of K − sM are finite θ < s; None where that is not known."""
    if negative_pivots is None:
        return None
    infinite = negative_at_infinity(pencil, linear_solver)
    return None if infinite is None else negative_pivots - infinite


def negative_at_infinity(pencil: Pencil, linear_solver: LinearSolver | str) -> int | None:
    """Return the number of negative eigenvalues that K − sM keeps for s → −∞, where no finite θ gives any.

    With Z the null space of M ≥ 0, every positive or negative eigenvalue of ZᵀKZ is an infinite eigenvalue of the
    pencil that keeps this sign at all s. Every zero one belongs to a Jordan block [[m, 0], [0, 0]], [[k, b], [b, 0]] of
    it, whose determinant −b² says that it has one negative eigenvalue at all s; an independent constraint by a Lagrange
    multiplier makes one such block. So the number sought is that of the eigenvalues of ZᵀKZ that are not positive. Z
    are the unknowns whose rows of M are zero; without any, which is usual, there is nothing to do.
    """
    rows = np.flatnonzero(pencil.M.diagonal() == 0)
    if not len(rows):
        return 0
    K = sp.csr_array(pencil.K[rows][:, rows])
    filled = np.flatnonzero(abs(K).sum(axis=1) > 0)
    free, K = len(rows) - len(filled), sp.csr_array(K[filled][:, filled])
    if not len(filled):
        return free
    if len(filled) > DENSE_LIMIT:
        try:
            pivots = factorize(K, True, linear_solver).negative_pivots
        except NotConvergedError:  # singular, and too large to tell by how much
            return None
        return None if pivots is None else free + pivots
    dense = K.toarray()
    d = 1 / np.sqrt(np.abs(dense).max(axis=1))
    w = la.eigvalsh(d[:, None] * dense * d)
    return free + int(np.count_nonzero(w <= len(w) * np.finfo(float).eps * np.abs(w).max()))
