"""Which signs the eigenvalues of a symmetric matrix have, roughly and at the price of some products."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from .blocks import times

_STEPS, _SEED = 30, 20261127
_ROUNDING = 1e-10  # of the largest |eigenvalue|: one that is smaller counts as zero


def signs_of(A: sp.csr_array) -> set[int]:
    """Return the signs, 1 and −1, that uᵀAu of a symmetric A (n, n) takes, by Lanczos iteration; {} for A = 0.

    Ritz values lie between the smallest and the largest eigenvalue, and tend to these first: a sign that is told is
    there. One is missed where the eigenvalues that have it are far smaller than the others.

    Examples
    --------
    >>> [sorted(signs_of(sp.csr_array(np.diag(d)))) for d in ([2.0, 0.0], [-1.0, -3.0], [1.0, -1.0], [0.0, 0.0])]
    [[1], [-1], [-1, 1], []]
    """
    rows = np.flatnonzero(np.diff(A.indptr))  # most terms act on a part of the unknowns
    if not len(rows):
        return set()
    part = sp.csr_array(A[rows][:, rows]) if len(rows) < A.shape[0] else A
    Q = np.zeros((len(rows), 0))
    v, largest = np.random.default_rng(_SEED).standard_normal(len(rows)), 0.0
    while Q.shape[1] < min(_STEPS, len(rows)) and (length := float(np.linalg.norm(v))) > _ROUNDING * largest:
        Q = np.column_stack([Q, v / length])
        v = times(part, Q[:, -1:])[:, 0]
        largest = max(largest, float(np.linalg.norm(v)))
        for _ in range(2):
            v = v - Q @ (Q.T @ v)
    theta = la.eigvalsh(Q.T @ times(part, Q))
    size = float(np.abs(theta).max())
    return {sign for sign in (1, -1) if (sign * theta > _ROUNDING * size).any()}
