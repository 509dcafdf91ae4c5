"""One matrix in the hands of MUMPS, through PETSc: what every process does alike to factorise it and to solve."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

# MUMPS' own switches (ICNTL, users' guide, section 6.1) and what it tells (INFOG, section 8.1).
_TRANSPOSED, _ROOT_IN_ONE, _LIMIT, _NULL_PIVOTS = 9, 13, 23, 24
_ERROR, _NEGATIVE, _LARGEST, _SUM, _ZERO = 1, 12, 16, 17, 28
_LEAST = 1  # MB: with so little the factorisation stops behind the analysis, which is all that a forecast needs


@functools.cache
def petsc() -> Any:
    """Return petsc4py's PETSc, or None where it cannot be loaded or has no MUMPS."""
    try:
        import petsc4py

        petsc4py.init(["fe-squeal", "-no_signal_handler"])
        from petsc4py import PETSc
    except (ImportError, OSError):
        return None
    has_mumps = PETSc.Sys.hasExternalPackage("mumps") and PETSc.ScalarType is np.float64
    return PETSc if has_mumps else None


@dataclass(frozen=True)
class Told:
    """What MUMPS says of a factorisation, the same on every process.

    Attributes
    ----------
    error : int
        INFOG(1): 0, or negative.
    negative : int
        Negative pivots of a symmetric matrix.
    zero : int
        Pivots that are zero to working precision.
    largest, total : int, bytes
        What the analysis expects to need on the process that needs most, and on all processes together.
    """

    error: int
    negative: int
    zero: int
    largest: int
    total: int


class PetscMatrix:
    """Rows of a real matrix and, once factorised, this process's part of its factors.

    Parameters
    ----------
    rows : (m, n) sparse
        Rows of this process; process 0 has the first ones.
    n : int
    symmetric, definite : bool
    comm
        Communicator of mpi4py; None for this process alone.
    """

    def __init__(self, rows: sp.csr_array, n: int, symmetric: bool, definite: bool, comm: Any) -> None:
        self._own, self._n, PETSc = rows.shape[0], n, petsc()
        comm = PETSc.COMM_SELF if comm is None else comm
        csr = rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data
        self._matrix = PETSc.Mat().createAIJ(((self._own, n), (self._own, n)), csr=csr, comm=comm)
        if symmetric:
            self._matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        if definite:
            self._matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._kind = "cholesky" if symmetric else "lu"
        self._factor: Any = None

    def factorize(self, megabytes: int = 0, analyse_only: bool = False) -> Told:
        """Factorise with at most so much memory on each process, 0 for as much as it takes, or analyse alone."""
        self._solver = petsc().PC().create(comm=self._matrix.comm)
        self._solver.setOperators(self._matrix)
        self._solver.setType(self._kind)
        self._solver.setFactorSolverType("mumps")
        self._solver.setFactorSetUpSolverType()
        factor = self._solver.getFactorMatrix()
        factor.setMumpsIcntl(_ROOT_IN_ONE, 1)  # or the pivots of the last front are not counted
        factor.setMumpsIcntl(_NULL_PIVOTS, 1)
        factor.setMumpsIcntl(_LIMIT, _LEAST if analyse_only else megabytes)
        self._solver.setUp()
        error, negative, zero, largest, total = (
            int(factor.getMumpsInfog(i)) for i in (_ERROR, _NEGATIVE, _ZERO, _LARGEST, _SUM)
        )
        self._factor = factor
        return Told(error, negative, zero, largest * 10**6, total * 10**6)

    def solve(self, b: np.ndarray, transposed: bool) -> np.ndarray:
        """Return this process's rows (m, k) of A⁻¹ b, or A⁻ᵀ b, for its rows (m, k) of b."""
        PETSc, k = petsc(), b.shape[1]
        sizes = ((self._own, self._n), (None, k))
        B = PETSc.Mat().createDense(sizes, array=np.asfortranarray(b, dtype=float), comm=self._matrix.comm)
        X = PETSc.Mat().createDense(sizes, comm=self._matrix.comm)
        X.setUp()
        # PETSc has blocks of right-hand sides for A alone; MUMPS does the same for Aᵀ.
        self._factor.setMumpsIcntl(_TRANSPOSED, 0 if transposed else 1)
        try:
            self._factor.matSolve(B, X)
        finally:
            self._factor.setMumpsIcntl(_TRANSPOSED, 1)
        x = np.array(X.getDenseArray())
        for matrix in (B, X):
            matrix.destroy()
        return x

    def destroy(self) -> None:
        """Give the memory back, on all processes together."""
        if self._factor is not None:
            self._solver.destroy()
        self._matrix.destroy()
