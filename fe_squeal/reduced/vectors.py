"""Linear algebra with blocks of vectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..eigen.linear.spread_matrix import sizes_times

_MARGIN = 10.0  # factor of |z|ᵀ|K||z|, since left vectors are longer than z
DEPENDENT = 1e-4  # eigenvalue of a Gram matrix of unit vectors: directions below are left to the next correction


@dataclass(frozen=True)
class SlowMotions:
    """Motions that are hardly held, in a projected problem: their eigenvalues are known far less well than others.

    In zᵀKz of such a motion almost all cancels, and what remains has the rounding of |z|ᵀ|K||z|. That is far more than
    the rounding of the entries of VᵀKV, from which it could not be told.

    Attributes
    ----------
    sizes : (k,) float, N/m
        |z|ᵀ|K||z| of motions z of unit mass, with a margin.
    coordinates : (k, r) float
        ZᵀMV: coordinates @ y is how much of each motion the vector Vy has.
    """

    sizes: np.ndarray
    coordinates: np.ndarray

    @classmethod
    def of(cls, K: sp.csr_array, Z: np.ndarray, coordinates: np.ndarray) -> SlowMotions:
        """Return the slow motions Z (n, k), of unit mass, with their `coordinates` ZᵀMV."""
        return cls(_MARGIN * np.einsum("ij,ij->j", np.abs(Z), sizes_times(K, np.abs(Z))), coordinates)

    def on(self, V: np.ndarray) -> SlowMotions:
        """Return the same for the smaller basis whose columns have the coordinates V (r, s) in this one."""
        return SlowMotions(self.sizes, self.coordinates @ V)

    @property
    def cancelled(self) -> np.ndarray:
        """(r, r) sizes of the sums that cancel in the projected stiffness, for `Pencil`."""
        W = np.abs(self.coordinates)
        return np.asarray(W.T @ (self.sizes[:, None] * W))


def real_columns(x: np.ndarray) -> np.ndarray:
    """Return the real and imaginary parts of columns x (n, k) as real columns, without those that are zero."""
    if not np.iscomplexobj(x):
        return x
    parts = np.hstack([x.real, x.imag])
    size = np.linalg.norm(parts, axis=0)
    return np.compress(size > 1e-14 * size.max(initial=0.0), parts, axis=1)  # rows stay contiguous


def interior_nodes(low: float, high: float, count: int) -> np.ndarray:
    """Return Chebyshev's nodes between two values, the best places to interpolate from.

    Examples
    --------
    >>> interior_nodes(0.0, 2.0, 1).round(9).tolist()
    [1.0]
    """
    wave = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    return np.asarray((low + high - (high - low) * wave) / 2)


def of_length(x: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return modes (n, k) scaled to lengths (k,), without zero ones, as left modes of a defective λ = 0 are."""
    length = np.linalg.norm(x, axis=0)
    return np.asarray(x[:, length > 0] * (lengths[length > 0] / length[length > 0]))


def unit_columns(right: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Return the real and imaginary parts of right and left modes, both (n, k), each mode of unit length.

    Left modes that are zero are left out.
    """
    return np.hstack([real_columns(of_length(x, np.ones(x.shape[1]))) for x in (right, left)])


def thin_svd(X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return U (n, k), s (k,) and Vᴴ (k, m) of X (n, m) = U diag(s) Vᴴ, k the smaller number.

    LAPACK's divide and conquer is fast, and now and then does not converge on columns that are rounding; QR iteration
    takes its place there.
    """
    try:
        U, s, V = la.svd(X, full_matrices=False, check_finite=False)
    except la.LinAlgError:
        U, s, V = la.svd(X, full_matrices=False, check_finite=False, lapack_driver="gesvd")
    return U, s, V


def range_of(columns: np.ndarray, least: float, exact: np.ndarray) -> np.ndarray:
    """Return orthonormal columns that span `exact` (n, l) and the main directions of `columns` (n, k).

    These are the left singular vectors whose singular values are larger than `least` times the largest one.
    """
    Q = la.qr(exact, mode="economic")[0]
    U, s, _ = thin_svd(columns - Q @ (Q.T @ columns))
    return np.hstack([Q, U[:, s > least * s.max(initial=0.0)]])


def normalising(gram: np.ndarray, columns: np.ndarray, dependent: float) -> np.ndarray:
    """Return T such that XT, made of some columns of X, has (XT)ᵀP(XT) = 1, given XᵀPX.

    Directions in which these columns depend on each other are left out: those with an eigenvalue of the Gram matrix of
    unit vectors up to `dependent`.
    """
    if not len(columns):
        return np.zeros((len(gram), 0))
    root = np.sqrt(gram.diagonal()[columns])
    w, v = la.eigh(gram[np.ix_(columns, columns)] / np.outer(root, root))
    T = np.zeros((len(gram), np.count_nonzero(w > dependent)))
    T[columns] = v[:, w > dependent] / np.sqrt(w[w > dependent]) / root[:, None]
    return T
