"""Cholesky factors of positive definite matrices, whole and by halves."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu, spsolve_triangular

from ...errors import NotConvergedError
from ..memory import require_memory
from .pardiso import PardisoFactor, has_pardiso
from .superlu import superlu_memory


class DefiniteFactor(Protocol):
    """Factors A = LLᵀ, up to the order of rows."""

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b for b (n,) or (n, k) real."""

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return the same: A is symmetric."""

    def half_solve(self, b: np.ndarray) -> np.ndarray:
        """Return L⁻ᵀ b, so that for random b of unit covariance the result has A⁻¹."""


def factorize_definite(A: sp.csr_array) -> DefiniteFactor:
    """Factorise a symmetric positive definite matrix.

    Raises
    ------
    NotConvergedError
        If it is not positive definite.
    """
    if not (A.diagonal() > 0).all():  # PARDISO takes it for granted, and may crash
        raise NotConvergedError("the matrix is not positive definite: its diagonal is not")
    return PardisoCholesky(A) if has_pardiso() else SuperLUCholesky(A)


class PardisoCholesky(PardisoFactor):
    """LLᵀ by PARDISO."""

    def __init__(self, A: sp.csr_array) -> None:
        super().__init__(A, symmetric=True, definite=True)

    def half_solve(self, b: np.ndarray) -> np.ndarray:
        """Return L⁻ᵀ b."""
        self._iparm[11] = 0
        return self._call(333, b)


class SuperLUCholesky:
    """LDLᵀ by SuperLU without pivoting off the diagonal."""

    def __init__(self, A: sp.csr_array) -> None:
        require_memory(superlu_memory(A, True), A.shape[0])
        options = {"SymmetricMode": True, "DiagPivotThresh": 0.0}
        try:
            self._lu = splu(sp.csc_array(A), permc_spec="MMD_AT_PLUS_A", options=options)
        except RuntimeError as error:
            raise NotConvergedError(f"SuperLU: {error}") from error
        pivots = self._lu.U.diagonal()
        if not (pivots > 0).all() or (self._lu.perm_r != self._lu.perm_c).any():
            raise NotConvergedError("the matrix is not positive definite")
        self._root = np.sqrt(pivots)

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b."""
        return np.asarray(self._lu.solve(b))

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return the same: A is symmetric."""
        return self.solve(b)

    def half_solve(self, b: np.ndarray) -> np.ndarray:
        """Return L⁻ᵀ b."""
        scaled = self._root.reshape(-1, *[1] * (b.ndim - 1)) * b
        return np.asarray(spsolve_triangular(sp.csr_array(self._lu.U), scaled, lower=False))[self._lu.perm_c]
