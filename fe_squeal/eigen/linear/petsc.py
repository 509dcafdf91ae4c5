"""One matrix in the hands of MUMPS, through PETSc: what every process does alike to factorise it and to solve."""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InputError
from ...process.ranks import process_count
from .scratch import remove_scratch_at_exit

# MUMPS' own switches (ICNTL and CNTL, users' guide, section 6) and what it tells (INFOG, section 8).
_TRANSPOSED, _ROOT_IN_ONE, _RELAXED, _OUT_OF_CORE, _LIMIT, _NULL_PIVOTS, _LOW_RANK = 9, 13, 14, 22, 23, 24, 35
_DROPPED = 7  # of CNTL
_COMPRESSED = 2  # of ICNTL(35): factors are compressed, and solves take the compressed ones
_ERROR, _NEGATIVE, _ENTRIES, _ZERO = 1, 12, 20, 28
_OPERATIONS = 1  # of RINFOG
# Which of INFOG tell the memory of the process that needs most and of all processes, by whether blocks are low-rank.
_IN_CORE, _ON_DISK = {False: (16, 17), True: (36, 37)}, {False: (26, 27), True: (38, 39)}
_LEAST = 1  # MB: with so little the factorisation stops behind the analysis, which is all that a forecast needs
_FOLDER = "MUMPS_OOC_TMPDIR"  # where MUMPS looks for the folder of its files
_kept: list[Any] = []  # what PETSc could not destroy: it would try again at the end, and fail with many lines


@functools.cache
def petsc() -> Any:
    """Return petsc4py's PETSc, or None where it cannot be loaded or has no MUMPS.

    Raises
    ------
    InputError
        MPI counts other processes than those that were started, by the variables that tell of them.
    """
    remove_scratch_at_exit()
    try:
        import petsc4py

        petsc4py.init(["fe-squeal", "-no_signal_handler"])
        from petsc4py import PETSc
    except (ImportError, OSError):
        return None
    _require_all(PETSc.COMM_WORLD.size)
    has_mumps = PETSc.Sys.hasExternalPackage("mumps") and PETSc.ScalarType is np.float64
    return PETSc if has_mumps else None


def _require_all(found: int) -> None:
    """Refuse processes that would wait for others that they cannot reach, or each take itself for the first one."""
    if found != (told := process_count()):
        raise InputError(
            f"MPI: petsc4py finds {found} process{'es' * (found > 1)} where what started this one tells of {told};"
            f" expected mpiexec of the MPI that petsc4py belongs to, or srun with --mpi=pmix or pmi2"
        )


@dataclass(frozen=True)
class MumpsOptions:
    """What a scene asks of MUMPS, see `fe_squeal.scene.control.MumpsTable`.

    Attributes
    ----------
    out_of_core : bool
        Whether factors are written to files.
    folder : str
        Where; empty for the system's folder of temporary files.
    low_rank : float
        Relative size of what is dropped from blocks of the factors; 0 keeps everything.
    memory_relaxation : int, optional
        Percent of workspace beyond what the analysis expects.
    """

    out_of_core: bool = False
    folder: str = ""
    low_rank: float = 0.0
    memory_relaxation: int | None = None


@dataclass(frozen=True)
class MumpsReport:
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
    largest_on_disk, total_on_disk : int, bytes
        The same memory with the factors on disk.
    files : int, bytes
        What all factors take, without compression: the size of the files.
    operations : float
        Floating-point operations of the factorisation, without compression.
    """

    error: int
    negative: int
    zero: int
    largest: int
    total: int
    largest_on_disk: int
    total_on_disk: int
    files: int
    operations: float


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

    def factorize(self, options: MumpsOptions, analyse_only: bool = False) -> MumpsReport:
        """Factorise, or analyse alone; files of factors go into `options.folder`, which is this process's own."""
        self._solver = petsc().PC().create(comm=self._matrix.comm)
        self._solver.setOperators(self._matrix)
        self._solver.setType(self._kind)
        self._solver.setFactorSolverType("mumps")
        self._solver.setFactorSetUpSolverType()
        factor = self._solver.getFactorMatrix()
        factor.setMumpsIcntl(_ROOT_IN_ONE, 1)  # or the pivots of the last front are not counted
        factor.setMumpsIcntl(_NULL_PIVOTS, 1)
        factor.setMumpsIcntl(_LIMIT, _LEAST if analyse_only else 0)
        if options.memory_relaxation is not None:
            factor.setMumpsIcntl(_RELAXED, options.memory_relaxation)
        if options.low_rank:
            factor.setMumpsIcntl(_LOW_RANK, _COMPRESSED)
            factor.setMumpsCntl(_DROPPED, options.low_rank)
        if options.out_of_core and not analyse_only:
            factor.setMumpsIcntl(_OUT_OF_CORE, 1)
            os.environ[_FOLDER] = options.folder
        self._solver.setUp()
        self._factor = factor
        error, negative, zero, entries = (factor.getMumpsInfog(i) for i in (_ERROR, _NEGATIVE, _ZERO, _ENTRIES))
        here, disk = (
            [factor.getMumpsInfog(i) * 10**6 for i in told[bool(options.low_rank)]] for told in (_IN_CORE, _ON_DISK)
        )
        # Numbers that do not fit into 32 bits are negative, and count millions.
        files = 8 * (entries if entries >= 0 else -(10**6) * entries)
        operations = factor.getMumpsRinfog(_OPERATIONS)
        return MumpsReport(error, negative, zero, here[0], here[1], disk[0], disk[1], files, operations)

    def solve(self, b: np.ndarray, transposed: bool) -> tuple[np.ndarray, int]:
        """Return this process's rows (m, k) of A⁻¹ b, or A⁻ᵀ b, for its rows (m, k) of b, and MUMPS' error.

        The error is INFOG(1), the same on every process: negative where rows are not known, which are NaN then. PETSc
        itself would raise it as an error of its own, with another number.
        """
        PETSc, k = petsc(), b.shape[1]
        sizes = ((self._own, self._n), (None, k))
        B = PETSc.Mat().createDense(sizes, array=np.asfortranarray(b, dtype=float), comm=self._matrix.comm)
        X = PETSc.Mat().createDense(sizes, comm=self._matrix.comm)
        X.setUp()
        # PETSc has blocks of right-hand sides for A alone; MUMPS does the same for Aᵀ.
        self._factor.setMumpsIcntl(_TRANSPOSED, 0 if transposed else 1)
        error = 0
        try:
            self._factor.matSolve(B, X)
        except PETSc.Error:
            error = self._factor.getMumpsInfog(_ERROR)
            if error >= 0:  # not one of MUMPS, and perhaps of this process alone
                raise
        finally:
            self._factor.setMumpsIcntl(_TRANSPOSED, 1)
        x = np.array(X.getDenseArray()) if error >= 0 else np.full(b.shape, np.nan)
        for matrix in (B, X):
            matrix.destroy()
        return x, error

    def destroy(self) -> None:
        """Give the memory back, on all processes together."""
        if self._factor is not None:
            self._factor.destroy()  # a reference of its own: petsc4py frees what several processes share only when told
            try:
                self._solver.destroy()
            except petsc().Error:  # its files of factors, which MUMPS would remove, are gone
                _kept.append(self._solver)
        self._matrix.destroy()
