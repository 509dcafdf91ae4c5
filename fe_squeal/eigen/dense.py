"""All modes of small problems by LAPACK."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from .pencil import Modes, Pencil
from .quality import modes_from_lambda, modes_from_theta

DENSE_LIMIT = 400  # unknowns up to which all modes come from LAPACK: a second at most
METHOD = "dense (LAPACK)"


def solve_dense(pencil: Pencil) -> Modes:
    """Return all finite modes of a small pencil.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> K = sp.csr_array(np.array([[2.0, -1.0], [-1.0, 2.0]]))
    >>> solve_dense(Pencil(sp.eye_array(2, format="csr"), K, symmetric=True)).lam.imag**2
    array([1., 3.])
    """
    K, M = pencil.K.toarray(), pencil.M.toarray()
    if pencil.C is not None:
        return _solve_quadratic(pencil)
    if pencil.symmetric:
        try:
            theta, phi = la.eigh(K, M)
            return modes_from_theta(pencil, theta, phi, phi, METHOD)
        except la.LinAlgError:
            pass  # M is singular: some eigenvalues are infinite, which QZ handles
    try:
        # With M = LLᵀ the standard problem L⁻¹KL⁻ᵀ is several times cheaper than QZ.
        L = la.cholesky(M, lower=True)
        A = la.solve_triangular(L, la.solve_triangular(L, K, lower=True).T, lower=True).T
        theta, *sides = la.eig(A, left=True, right=True)
        left, right = (la.solve_triangular(L, v, lower=True, trans="T") for v in sides)
    except la.LinAlgError:
        theta, left, right = _finite(*la.eig(K, M, left=True, right=True))
    if not theta.imag.any():
        theta, right, left = theta.real, right.real, left.real
    return modes_from_theta(pencil, theta, right, left, METHOD)


def _solve_quadratic(pencil: Pencil) -> Modes:
    """Linearise [[0, I], [−K, −C]] z = λ [[I, 0], [0, M]] z, z = (u, λu), with time in units of 1/ω0.

    With M = LLᵀ it is a standard problem in Lᵀu, several times cheaper than QZ, which is left for a singular M.
    """
    assert pencil.C is not None
    M, C, K = (A.toarray() for A in (pencil.M, pencil.C, pencil.K))
    n = len(M)
    omega0 = np.sqrt(max(la.norm(K), np.finfo(float).tiny) / la.norm(M))
    identity = np.eye(n)
    try:
        L = la.cholesky(M, lower=True)
        K, C = (la.solve_triangular(L, la.solve_triangular(L, A, lower=True).T, lower=True).T for A in (K, C))
        A = np.block([[np.zeros((n, n)), identity], [-K / omega0**2, -C / omega0]])
        lam, left, right = la.eig(A, left=True, right=True)
        right, left = (la.solve_triangular(L, v, lower=True, trans="T") for v in (right[:n], left[n:]))
    except la.LinAlgError:
        scale = la.norm(M) * omega0**2
        A = np.block([[np.zeros((n, n)), identity], [-K / scale, -C * omega0 / scale]])
        lam, left, right = _finite(*la.eig(A, la.block_diag(identity, M * omega0**2 / scale), left=True, right=True))
        right, left = right[:n], left[n:]
    lam = lam * omega0
    keep = lam.imag >= 0
    # The lower half of a left vector of this linearisation is a left mode.
    return modes_from_lambda(pencil, lam[keep], right[:, keep], left[:, keep], METHOD)


def _finite(w: np.ndarray, vl: np.ndarray, vr: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    keep = np.isfinite(w)
    return w[keep], vl[:, keep], vr[:, keep]

