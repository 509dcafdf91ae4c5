"""SuperLU, which SciPy brings along."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu, spsolve_triangular

from ...errors import NotConvergedError
from ..memory import require_memory
from .factor import DefiniteFactor, Factor, SingularError, solve_real_parts

# Entries of SuperLU's factors of solids over n to the 4/3, by whether the matrix is symmetric.
_FILL = {True: 13.0, False: 45.0}


class SuperLUFactor:
    """LU factors by SuperLU."""

    negative_pivots: int | None = None

    def __init__(self, A: sp.csr_array, symmetric: bool) -> None:
        self._complex = np.iscomplexobj(A)
        require_memory(superlu_memory(A, symmetric), A.shape[0])
        try:
            ordering = "MMD_AT_PLUS_A" if symmetric else "COLAMD"
            self._lu = splu(sp.csc_array(A), permc_spec=ordering, options={"SymmetricMode": symmetric})
        except RuntimeError as error:
            raise SingularError(f"SuperLU: the shifted matrix cannot be factorised: {error}") from error

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b."""
        return self._apply("N", b)

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""
        return self._apply("T", b)

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b."""
        return self._apply("H", b)

    def _apply(self, trans: str, b: np.ndarray) -> np.ndarray:
        if self._complex:
            return np.asarray(self._lu.solve(np.asarray(b, dtype=complex), trans=trans))
        return solve_real_parts(lambda x: self._lu.solve(x, trans=trans), b)


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


def superlu_memory(A: sp.csr_array, symmetric: bool) -> int:
    """Return the bytes that SuperLU's factors of a solid's matrix take, to a factor of three."""
    entries = _FILL[symmetric] * A.shape[0] ** (4 / 3)
    return int(entries * (A.dtype.itemsize + 4))


class SuperLU:
    """SuperLU as a `LinearSolver`: always there, slower, and without inertia."""

    name = "SuperLU (SciPy)"

    def factorize(self, A: sp.csr_array, symmetric: bool) -> Factor:
        """Return LU factors."""
        return SuperLUFactor(A, symmetric)

    def factorize_definite(self, A: sp.csr_array) -> DefiniteFactor:
        """Return LDLᵀ factors."""
        return SuperLUCholesky(A)

    def memory(self, A: sp.csr_array, symmetric: bool, definite: bool = False) -> int:
        """Return what factors of meshes of solids take, to a factor of three."""
        return superlu_memory(A, symmetric)


SUPERLU = SuperLU()
