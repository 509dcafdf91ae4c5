"""The choice of a sparse direct solver: PARDISO where it is there, SuperLU otherwise."""

from __future__ import annotations

import scipy.sparse as sp

from .dense import DenseFactor
from .factor import Factor, Solve
from .pardiso import PardisoFactor, has_pardiso
from .superlu import SuperLUFactor, superlu_memory

_FULL = 1000  # unknowns up to which a full matrix goes to LAPACK


def factorize(A: sp.csr_array, symmetric: bool) -> Factor:
    """Factorise a sparse matrix with the best solver that is installed.

    Parameters
    ----------
    A : (n, n) sparse, real or complex
    symmetric : bool
        Whether A = Aᵀ, also where it is complex.

    Raises
    ------
    NotConvergedError
        If a pivot is zero. PARDISO perturbs what rounding leaves of a singular matrix, which backward errors then show.
    TooLargeError
        If the factors do not fit into memory.
    """
    if A.shape[0] <= _FULL and A.nnz > A.shape[0] ** 2 / 2 and not symmetric:
        return DenseFactor(A)
    return PardisoFactor(A, symmetric) if has_pardiso() else SuperLUFactor(A, symmetric)


def factor_memory(A: sp.csr_array, symmetric: bool, definite: bool = False) -> int:
    """Return the bytes that the factors of a matrix will take, without computing them.

    PARDISO's analysis knows; for SuperLU it is what factors of meshes of solids take, to a factor of three.
    """
    if has_pardiso():
        return PardisoFactor(A, symmetric, definite, analyse_only=True).memory
    return superlu_memory(A, symmetric)


def solver_name() -> str:
    """Return the name of the sparse solver that `factorize` takes."""
    return "PARDISO (MKL)" if has_pardiso() else "SuperLU (SciPy)"


def factorize_complex(A: sp.csr_array) -> tuple[Solve, Solve]:
    """Return functions that apply A⁻¹ and A⁻ᴴ of a complex matrix."""
    factor = factorize(sp.csr_array(A, dtype=complex), symmetric=False)
    return factor.solve, factor.solve_adjoint


