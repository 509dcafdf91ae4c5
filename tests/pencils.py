"""Sparse pencils of every class with awkward spectra, and their eigenvalues by LAPACK alone."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from dense import all_eigenvalues

from fe_squeal.eigen.dense import DENSE_LIMIT
from fe_squeal.eigen.pencil import Pencil

N = DENSE_LIMIT + 20


def sparse(A):
    return sp.csr_array(np.asarray(A))


def definite(rng, n):
    """Draw a full symmetric positive definite matrix."""
    A = rng.standard_normal((n, n))
    return A @ A.T / n + 0.1 * np.eye(n)


def chain(friction=0.0, damping=0.0, n=N, eta=0.0, seed=1):
    """Return a chain of unequal masses and springs, with loss factors up to eta, some follower forces, and dashpots."""
    rng = np.random.default_rng(seed)
    M = sp.diags_array(rng.uniform(0.5, 2.0, n)).tocsr()
    k = rng.uniform(1.0, 3.0, n + 1)
    loss = 1 + 1j * eta * rng.uniform(0.0, 1.0, n + 1) if eta else 1.0
    main, off = (k * loss)[:-1] + (k * loss)[1:], -(k * loss)[1:-1]
    K = sp.diags_array([main, off, off], offsets=[0, 1, -1]).tocsr()
    # Where the product of two opposite off-diagonal entries is negative, pairs flutter. With this at a few places the
    # spectrum is well conditioned; at all places modes would grow exponentially along the chain.
    i = np.linspace(20, n - 20, 8).astype(int)
    F = sp.csr_array((3 * k[i + 1], (i, i + 1)), shape=(n, n))
    C = sp.diags_array(damping * rng.uniform(0.0, 1.0, n)).tocsr() if damping else None
    return Pencil(M, sp.csr_array(K + friction * F), C, symmetric=not friction)


def reference(pencil):
    """Return the λ with Im λ ≥ 0 of the linearisation, by LAPACK."""
    lam = all_eigenvalues(pencil.M, pencil.C, pencil.K)
    lam = lam[lam.imag >= 0]
    return lam[np.argsort(lam.imag)]


def distance(a, b):
    """Return the largest distance of a value of a from the nearest value of b."""
    return max(np.abs(b - x).min() for x in a)
