"""All eigenvalues of small problems by LAPACK on the linearisation, independent of the package."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp


def full(A):
    return A.toarray() if sp.issparse(A) else np.asarray(A)


def companion(M, C, K, unit=1.0):
    """Return the matrix whose eigenvectors are (u, λu)ᵀ, with (λ²M + λC + K)u = 0 and λ in some unit; C may be None."""
    M, K = full(M), full(K)
    n = len(M)
    damping = np.zeros((n, n)) if C is None else la.solve(M, full(C)) / unit
    return np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(M, K) / unit**2, -damping]])


def all_eigenvalues(M, C, K, unit=1.0):
    """Return all 2n eigenvalues λ. The unit should be about the largest |λ|, so that all blocks are of one size."""
    return unit * la.eigvals(companion(M, C, K, unit))
