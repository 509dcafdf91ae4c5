"""Small algebra with blocks of vectors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la

from ..blocks import combine

_DEPENDENT = 1e-4  # eigenvalue of a Gram matrix of unit vectors: what is left to the next correction


def lift(V: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return V y for a real V and a complex y without a complex copy of V."""
    return _by_parts(lambda x: combine(V, x), y) if np.iscomplexobj(y) else combine(V, y)


def real_columns(x: np.ndarray) -> np.ndarray:
    """Return real and imaginary parts of the columns, without those that are zero."""
    if not np.iscomplexobj(x):
        return x
    parts = np.hstack([x.real, x.imag])
    size = np.linalg.norm(parts, axis=0)
    return np.asarray(parts[:, size > 1e-14 * size.max(initial=0.0)])


def _by_parts(apply: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """Return a real linear map of complex columns, most of which are real."""
    columns = x.reshape(len(x), -1)
    result = apply(np.ascontiguousarray(columns.real)).astype(complex)
    mixed = np.flatnonzero(columns.imag.any(axis=0))
    if len(mixed):
        result[:, mixed] += 1j * apply(np.ascontiguousarray(columns.imag[:, mixed]))
    return result.reshape(len(result), *x.shape[1:])


def normalising(gram: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return T such that XT is orthonormal, given XᵀPX, of some columns and without what depends on the others."""
    if not len(columns):
        return np.zeros((len(gram), 0))
    root = np.sqrt(gram.diagonal()[columns])
    w, v = la.eigh(gram[np.ix_(columns, columns)] / np.outer(root, root))
    T = np.zeros((len(gram), np.count_nonzero(w > _DEPENDENT)))
    T[columns] = v[:, w > _DEPENDENT] / np.sqrt(w[w > _DEPENDENT]) / root[:, None]
    return T
