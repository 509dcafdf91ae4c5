"""Factors by SuperLU, which SciPy brings along."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ..memory import require_memory
from .factor import SingularError, by_parts

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
        return by_parts(lambda x: self._lu.solve(x, trans=trans), b)


def superlu_memory(A: sp.csr_array, symmetric: bool) -> int:
    """Return the bytes that SuperLU's factors of a solid's matrix take, to a factor of three."""
    entries = _FILL[symmetric] * A.shape[0] ** (4 / 3)
    return int(entries * (A.dtype.itemsize + 4))
