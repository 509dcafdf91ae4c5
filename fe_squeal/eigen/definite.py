"""Which signs the eigenvalues of a symmetric matrix have."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..errors import NotConvergedError
from .blocks import times
from .linear.choice import negative_eigenvalues

_STEPS, _SEED = 30, 20261127
_ROUNDING = 1e-10  # of the largest |eigenvalue|: one that is smaller counts as zero
_RAISED = 1e-9  # of the diagonal: an eigenvalue nearer to zero, in these units, is zero


def signs_of(A: sp.csr_array) -> set[int]:
    """Return the signs, 1 and −1, that uᵀAu of a symmetric A (n, n) may take; {} for A = 0.

    Ritz values of a Lanczos iteration lie between the smallest and the largest eigenvalue, and tend to these first: a
    sign that they have is there. The other one may be that of far smaller eigenvalues: it is left out only where the
    inertia of A, with its diagonal raised by `_RAISED` times its size, says that there are none.

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
    found = {sign for sign in (1, -1) if (sign * theta > _ROUNDING * size).any()}
    return found if len(found) == 2 or _has_one_sign(part, found) else {1, -1}


def _has_one_sign(A: sp.csr_array, found: set[int]) -> bool:
    """Return whether eigenvalues of A have this sign alone, or are zero; False where that is not known."""
    (sign,) = found or {1}
    diagonal = sign * A.diagonal()
    if diagonal.min() <= 0:  # a row with entries beside a zero on the diagonal has both signs
        return False
    try:
        return negative_eigenvalues(sp.csr_array(sign * A + sp.diags_array(_RAISED * diagonal))) == 0
    except NotConvergedError:
        return False
