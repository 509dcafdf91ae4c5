"""MUMPS through petsc4py, in one process or, under mpiexec, in several."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from ...errors import NotConvergedError, TooLargeError
from ...process.ranks import local_count, process_count
from ..memory import available_memory, memory_text, require_memory
from .factor import DefiniteFactor, Factor, SingularError, Solve, solve_real_parts
from .half import inverse_root
from .petsc import Told, petsc
from .processes import give_up, new_handle, together

_NO_ROOM = {-8, -9, -11, -13, -14, -17, -18, -19, -20, -22}  # MUMPS' errors of workspace that is too small
_SINGULAR = {-6, -10}
_FORECAST = 20_000  # unknowns from which on the analysis is done once more beforehand, to refuse what cannot fit


def has_mumps() -> bool:
    """Whether petsc4py with MUMPS can be loaded."""
    return petsc() is not None


class MumpsFactor:
    """LU or LDLᵀ factors of a real or complex matrix.

    Debian's PETSc is one of real numbers: a complex A is factorised as [[Re A, −Im A], [Im A, Re A]].

    Raises
    ------
    SingularError
        If a pivot is zero to working precision.
    TooLargeError
    """

    def __init__(self, A: sp.csr_array, symmetric: bool, definite: bool = False) -> None:
        self._complex = np.iscomplexobj(A)
        self._n = A.shape[0]
        self._symmetric = symmetric
        real = _real_form(A) if self._complex else _sorted(A)
        self._size = real.shape[0]
        if self._size >= _FORECAST:
            require_memory(_here(told_of(real, symmetric and not self._complex, definite)), self._n)
        self._handle = new_handle()
        told = together(
            "factorize", real, handle=self._handle, n=self._size, symmetric=symmetric and not self._complex,
            definite=definite, megabytes=0, analyse_only=False,
        )  # fmt: skip
        self._raise(told)
        counts = symmetric and not self._complex
        self.negative_pivots: int | None = told.negative if counts else None

    def _raise(self, told: Told) -> None:
        if told.error in _NO_ROOM:
            raise TooLargeError(
                f"MUMPS: the factors of {self._n} unknowns need about {memory_text(_here(told))} of memory, and"
                f" {memory_text(available_memory())} are free on this machine"
            )
        if told.error in _SINGULAR or (told.error >= 0 and told.zero):
            raise SingularError("MUMPS: the matrix is singular to working precision")
        if told.error < 0:
            raise NotConvergedError(f"MUMPS failed with error {told.error}")

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b."""
        return self._apply(b, False)

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""
        return self._apply(b.conj(), True).conj() if self._complex else self._apply(b, not self._symmetric)

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b; of the real form of a complex matrix it is the transposed one."""
        return self._apply(b, True) if self._complex else self.solve_transposed(b)

    def _apply(self, b: np.ndarray, transposed: bool) -> np.ndarray:
        if not self._complex:
            return solve_real_parts(lambda c: self._real(c, transposed), b)
        columns = b.reshape(self._n, -1)
        x = self._real(np.vstack([columns.real, columns.imag]), transposed)
        return np.asarray(x[: self._n] + 1j * x[self._n :]).reshape(b.shape)

    def _real(self, b: np.ndarray, transposed: bool) -> np.ndarray:
        columns = np.asarray(b, dtype=float).reshape(self._size, -1)
        if not columns.shape[1]:
            return np.zeros(b.shape)
        x: np.ndarray = together(
            "solve", columns, handle=self._handle, n=self._size, columns=columns.shape[1], transposed=transposed
        )
        if not np.isfinite(x).all():
            raise SingularError("MUMPS: the matrix is singular to working precision")
        return x.reshape(b.shape)

    def __del__(self) -> None:
        if getattr(self, "_handle", None) is not None:
            give_up(self._handle)


class MumpsDefinite(MumpsFactor):
    """Factors of a real symmetric positive definite matrix."""

    def __init__(self, A: sp.csr_array) -> None:
        super().__init__(A, symmetric=True)  # with pivoting, which tells what is not definite
        if self.negative_pivots:
            raise NotConvergedError(f"the matrix is not positive definite: {self.negative_pivots} pivots are negative")
        self._matrix = A
        self._root: Callable[[np.ndarray], np.ndarray] | None = None

    def half_solve(self, b: np.ndarray) -> np.ndarray:
        """Return Z b with ZZᵀ = A⁻¹ to two per cent: PETSc gives no solves with L alone."""
        if self._root is None:
            self._root = inverse_root(self._matrix, self.solve, _definite_solve)
        return self._root(b)


def _definite_solve(A: sp.csr_array) -> Solve:
    return MumpsFactor(A, symmetric=True, definite=True).solve


def _sorted(A: sp.csr_array) -> sp.csr_array:
    A = sp.csr_array(A, dtype=float, copy=True)
    A.sum_duplicates()
    return A


def _real_form(A: sp.csr_array) -> sp.csr_array:
    return _sorted(sp.block_array([[A.real, -A.imag], [A.imag, A.real]], format="csr"))


def told_of(A: sp.csr_array, symmetric: bool, definite: bool) -> Told:
    """Return what the analysis of a real matrix tells, without its factors."""
    told: Told = together(
        "factorize", A, handle=new_handle(), n=A.shape[0], symmetric=symmetric, definite=definite, megabytes=0,
        analyse_only=True,
    )  # fmt: skip
    return told


def _here(told: Told) -> int:
    """Return the bytes that the processes of this machine take at most."""
    return told.largest * local_count()


class Mumps:
    """MUMPS as a `LinearSolver`; only where `has_mumps()`."""

    @property
    def name(self) -> str:
        """With the number of processes, where there are several."""
        count = process_count()
        return "MUMPS (PETSc)" if count == 1 else f"MUMPS (PETSc), {count} processes"

    def factorize(self, A: sp.csr_array, symmetric: bool) -> Factor:
        """Return LU or LDLᵀ factors; those of a real symmetric matrix know its inertia."""
        return MumpsFactor(A, symmetric)

    def factorize_definite(self, A: sp.csr_array) -> DefiniteFactor:
        """Return factors of a definite matrix."""
        return MumpsDefinite(A)

    def memory(self, A: sp.csr_array, symmetric: bool, definite: bool = False) -> int:
        """Return the bytes that MUMPS' analysis expects of the processes on this machine."""
        real = _real_form(A) if np.iscomplexobj(A) else _sorted(A)
        return _here(told_of(real, symmetric and not np.iscomplexobj(A), definite))


MUMPS = Mumps()
