"""The lowest modes of a definite pencil by block Lanczos iteration: solves with many right-hand sides at once."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..errors import NotConvergedError
from .blocks import combine, cross, put_combined, times
from .columns import ColumnStore, store_for
from .linear.factor import DefiniteFactor

_SEED, _BLOCK, _MOST = 20251121, 24, 60
_ROOM = 8  # vectors for each mode for which room is set aside at the start; pages not yet written take no memory
_RANK = 1e-12  # eigenvalue of a Gram matrix, relative to the largest, below which a direction is linearly dependent
_NOTHING = 1e-14  # of a product: what is left of it after orthogonalisation is rounding


def lowest_modes(
    factor: DefiniteFactor, M: sp.csr_array, sigma: float, count: int, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return θ (count,), rising, and vectors of unit mass of K φ = θ M φ, all θ > σ.

    A solve takes as long as reading the factors from memory, and a block of right-hand sides reads them once for all.
    The iteration keeps its whole basis V orthogonal, and of MV the last block alone: Vᵀ(MW) takes one more product with
    M than (MV)ᵀW, and half the memory. (Golub and Underwood, in: Mathematical Software III, 1977; Grimes, Lewis and
    Simon, SIAM J. Matrix Anal. Appl. 15, 1994.)

    Parameters
    ----------
    factor : DefiniteFactor
        Factors of K − σM.
    M : (n, n) sparse, positive semidefinite
    count : int
        Fewer are returned where the rank of M is smaller.
    tolerance : float
        Relative error of the vectors; the error of θ is its square.

    Raises
    ------
    NotConvergedError
    """
    n = M.shape[0]
    stored: ColumnStore = store_for(n)(n, min(n, _ROOM * count + _BLOCK))
    H = np.zeros((0, 0))
    W = factor.solve(times(M, np.random.default_rng(_SEED).standard_normal((n, min(n, _BLOCK)))))
    X, MX, _ = _unit(W, times(M, W), 0.0)
    while True:
        m, k = len(H) + X.shape[1], X.shape[1]
        if m > stored.room:
            stored = _doubled(stored, m - k, n)
        stored.put(m - k, X)
        V = stored.columns(m)
        W = factor.solve(MX)
        H = np.pad(H, ((0, k), (0, k)))
        for _ in range(2):
            inside = cross(V, times(M, W))
            W = W - combine(V, inside)
            H[:, m - k :] += inside
        # Where the rank of M is exhausted, what is left has hardly any mass, and would be motions without any.
        least = _NOTHING * float(np.linalg.norm(H[:, m - k :], axis=0).max())
        nu, s = la.eigh(np.triu(H) + np.triu(H, 1).T)
        nu, s = nu[::-1], s[:, ::-1]
        X, MX, R = _unit(W, times(M, W), least)
        residual = np.linalg.norm(R @ s[m - k :], axis=0)
        if not X.shape[1] or m >= n or (m > count and (residual[:count] <= tolerance * np.abs(nu[:count])).all()):
            found = np.flatnonzero(nu[:count] > len(nu) * np.finfo(float).eps * nu[0])
            return sigma + 1 / nu[found], combine(V, s[:, found])
        if m > max(_MOST * _BLOCK, 8 * count):
            raise NotConvergedError(f"block Lanczos: {count} modes not found with {m} vectors")


def _doubled(store: ColumnStore, count: int, n: int) -> ColumnStore:
    """Return a store with twice the room that begins with the first columns of another one."""
    larger = type(store)(n, 2 * store.room)
    put_combined(larger, 0, store.columns(count))
    return larger


def _unit(W: np.ndarray, MW: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return X of unit mass, MX, and R with W = XR; directions that are linearly dependent are left out.

    So are those of a size, the root of their mass, that is at most `least`.
    """
    w, v = la.eigh(cross(W, MW))
    keep = (w > _RANK * max(w.max(initial=0.0), np.finfo(float).tiny)) & (w > least**2)
    root = np.sqrt(w[keep])
    T = v[:, keep] / root
    return combine(W, T), combine(MW, T), np.asarray(root[:, None] * v[:, keep].T)
