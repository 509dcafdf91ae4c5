"""Factors by LAPACK of small matrices that are full."""

from __future__ import annotations

import warnings

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ...errors import NotConvergedError
from .factor import SingularError


class DenseFactor:
    """LU factors by LAPACK of a small matrix that is full, as projections are.

    Raises
    ------
    SingularError
        If a pivot is zero.
    NotConvergedError
        If an entry is not finite.
    """

    negative_pivots: int | None = None

    def __init__(self, A: sp.csr_array | np.ndarray) -> None:
        full = A if isinstance(A, np.ndarray) else A.toarray()
        # Units may differ by any factor: without scaling the pivots would be chosen by them.
        self._rows = _unit_of(np.abs(full).max(axis=1))
        self._columns = _unit_of((self._rows[:, None] * np.abs(full)).max(axis=0))
        with warnings.catch_warnings():
            warnings.simplefilter("error", la.LinAlgWarning)
            try:
                self._lu = la.lu_factor(self._rows[:, None] * full * self._columns)
            except la.LinAlgWarning as error:
                raise SingularError(f"LAPACK: the matrix is singular: {error}") from error
            except ValueError as error:
                raise NotConvergedError(f"LAPACK: the matrix cannot be factorised: {error}") from error

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b for b (n,) or (n, k)."""
        return self._apply(self._rows, b, 0, self._columns)

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b for b (n,) or (n, k)."""
        return self._apply(self._columns, b, 1, self._rows)

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b for b (n,) or (n, k)."""
        return self._apply(self._columns, b, 2, self._rows)

    def _apply(self, before: np.ndarray, b: np.ndarray, which: int, after: np.ndarray) -> np.ndarray:
        shape = (-1, *[1] * (b.ndim - 1))
        return np.asarray(after.reshape(shape) * la.lu_solve(self._lu, before.reshape(shape) * b, trans=which))


def _unit_of(size: np.ndarray) -> np.ndarray:
    """Return factors that bring sizes to about one: powers of two, which add no rounding."""
    return np.asarray(2.0 ** -np.round(np.log2(np.where(size > 0, size, 1.0))))
