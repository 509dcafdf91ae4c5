"""MUMPS through petsc4py, in one process or, under mpiexec, in several."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import NotConvergedError, SceneError, TooLargeError
from ...process.ranks import process_count
from ..memory import available_memory, memory_text, require_memory
from .column_parts import ends, pieces
from .factor import DefiniteFactor, Factor, SingularError, Solve, solve_real_parts
from .half import inverse_root
from .petsc import MumpsOptions, MumpsReport, petsc
from .processes import give_up, local_count, new_handle, together
from .refinement import contraction, refined
from .scratch import scratch_folder
from .spread_matrix import SpreadMatrix, in_rows

_NO_ROOM = {-8, -9, -11, -13, -14, -17, -18, -19, -20, -22}  # MUMPS' errors of workspace that is too small
_NO_WORKSPACE = {-8, -9, -17, -20}  # those of them that more of it than the analysis expects would mend
_WORKSPACE = 50, 200  # percent beyond what the analysis expects, after MUMPS' own 20 to 35
_SINGULAR = {-6, -10}
_NO_DISK = -90  # what it says of a file that it cannot write
_ROUGH = 0.1  # of an error: if a step of refinement leaves more, low-rank factors are too rough
PLAIN = MumpsOptions()
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

    def __init__(
        self, A: sp.csr_array, symmetric: bool, definite: bool = False, options: MumpsOptions = PLAIN
    ) -> None:
        self._complex = np.iscomplexobj(A)
        self._n = A.shape[0]
        self._symmetric, self._asked, self._options = symmetric, options, options
        real = _real_form(A) if self._complex else _sorted(A)
        self._rows = 2 if self._complex and isinstance(real, SpreadMatrix) else 1  # of each unknown on its process
        self._size = self._rows * real.shape[0]
        self._order = _order_of_rows(real, self._rows) if isinstance(real, SpreadMatrix) else None
        if options.out_of_core:
            self._options = options = replace(options, folder=_files(options.folder))
        if self._size >= _FORECAST:
            told = told_of(real, symmetric and not self._complex, definite, options)
            require_memory(_here(told, options), self._n)
            self._require_disk(told)
        self._handle = new_handle()
        told = _with_room(real, self._handle, symmetric and not self._complex, definite, options)
        self._raise(told)
        self._told = told
        counts = symmetric and not self._complex
        self.negative_pivots: int | None = told.negative if counts else None
        self._rho = 0.0
        if options.low_rank:
            # The signs of the pivots are those of A's eigenvalues, too, if refinement converges.
            self._matrix, self._rho = A, contraction(A, partial(self._apply, transposed=False))
            if not self._rho <= _ROUGH:
                raise NotConvergedError(
                    f"MUMPS: with solve.mumps.low_rank = {options.low_rank:g} the factors of {self._n} unknowns are too"
                    f" rough: a step of refinement leaves {self._rho:.2g} of an error, {_ROUGH:g} is allowed; expected"
                    f" a smaller number"
                )

    def _require_disk(self, told: MumpsReport) -> None:
        """Refuse files that cannot fit on this machine's disk, as far as these are known not to be compressed."""
        if not self._options.out_of_core or self._options.low_rank:
            return
        needed = told.files * local_count() // process_count()
        if needed > (free := shutil.disk_usage(self._options.folder).free):
            raise TooLargeError(
                f"solve.mumps.folder: the factors of {self._n} unknowns need {memory_text(needed)} of disk, and"
                f" {memory_text(free)} are free in {self._options.folder}"
            )

    def _raise(self, told: MumpsReport) -> None:
        if told.error in _NO_ROOM:
            raise TooLargeError(
                f"MUMPS: the factors of {self._n} unknowns need about {memory_text(_here(told, self._options))} of"
                f" memory, and {memory_text(available_memory())} are free on this machine"
            )
        if told.error == _NO_DISK:
            folder = self._options.folder
            raise TooLargeError(
                f"solve.mumps.folder: MUMPS could not write the factors of {self._n} unknowns into {folder}:"
                f" {memory_text(told.files)} are needed in all, {memory_text(shutil.disk_usage(folder).free)} are free;"
                f" is the disk full, or the size of a file limited?"
            )
        if told.error in _SINGULAR or (told.error >= 0 and told.zero):
            raise SingularError("MUMPS: the matrix is singular to working precision")
        if told.error < 0:
            raise NotConvergedError(f"MUMPS failed with error {told.error}")

    def _raise_from_solve(self, error: int) -> None:
        """Raise what an error of the solve phase means for who runs the program."""
        if error == _NO_DISK:
            raise TooLargeError(
                f"solve.mumps.folder: MUMPS could not read the factors of {self._n} unknowns in {self._options.folder};"
                f" were files removed there while the program ran, or is that disk gone?"
            )
        self._raise(replace(self._told, error=error))

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b.

        Raises
        ------
        TooLargeError
            There is no memory for the solve, or factors on disk cannot be read.
        NotConvergedError
            MUMPS fails otherwise.
        """
        solve = partial(self._apply, transposed=False)
        return refined(self._matrix, solve, b, self._rho) if self._rho else solve(b)

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""
        return self.solve_adjoint(b.conj()).conj() if self._complex else self.solve_adjoint(b)

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b; of the real form of a complex matrix it is the transposed one."""
        if self._symmetric and not self._complex:
            return self.solve(b)
        solve = partial(self._apply, transposed=True)
        return refined(in_rows(self._matrix.conj().T), solve, b, self._rho) if self._rho else solve(b)

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
        parts, order = [], self._order  # the factors have the unknowns in the order of the processes
        for begin, end in pieces(*columns.shape):
            some = columns[:, begin:end]
            part, error = together("solve", some if order is None else some[order], handle=self._handle, n=self._size,
                                   columns=end - begin, transposed=transposed, rows=self._rows)  # fmt: skip
            if error < 0:
                self._raise_from_solve(error)
            if not np.isfinite(part).all():
                raise SingularError("MUMPS: the matrix is singular to working precision")
            if order is not None:
                placed = np.empty_like(part)
                placed[order] = part
            parts.append(part if order is None else placed)
        x: np.ndarray = parts[0] if len(parts) == 1 else np.hstack(parts)
        return x.reshape(b.shape)

    def __del__(self) -> None:
        if getattr(self, "_handle", None) is not None:
            give_up(self._handle)


class MumpsDefinite(MumpsFactor):
    """Factors of a real symmetric positive definite matrix."""

    def __init__(self, A: sp.csr_array, options: MumpsOptions = PLAIN) -> None:
        super().__init__(A, symmetric=True, options=options)  # with pivoting, which tells what is not definite
        if self.negative_pivots:
            raise NotConvergedError(f"the matrix is not positive definite: {self.negative_pivots} pivots are negative")
        self._matrix = A

    def half_solve(self, b: np.ndarray) -> np.ndarray:
        """Return Z b with ZZᵀ = A⁻¹ to two per cent: PETSc gives no solves with L alone."""
        # It is not kept: it refers to this object, which is to be freed as soon as nothing else does.
        return inverse_root(self._matrix, self.solve, self._definite_solve)(b)

    def _definite_solve(self, A: sp.csr_array) -> Solve:
        return MumpsFactor(A, symmetric=True, definite=True, options=self._asked).solve


def _sorted(A: sp.csr_array) -> sp.csr_array:
    if isinstance(A, SpreadMatrix):
        return A
    A = sp.csr_array(A, dtype=float, copy=True)
    A.sum_duplicates()
    return A


def _real_form(A: sp.csr_array) -> sp.csr_array:
    """Return [[Re A, −Im A], [Im A, Re A]]; a matrix on all processes as it is: there it is made of the rows."""
    if isinstance(A, SpreadMatrix):
        return A
    return _sorted(sp.block_array([[A.real, -A.imag], [A.imag, A.real]], format="csr"))


def _order_of_rows(A: SpreadMatrix, rows: int) -> np.ndarray:
    """Return the unknowns (n,) in the order of the processes, or (2n,) where each has the imaginary parts behind."""
    order, n = A.partition.order, A.shape[0]
    if rows == 1:
        return order
    at = ends(n, process_count())
    return np.concatenate([own + k * n for own in np.split(order, at[1:-1]) for k in range(rows)])


def told_of(A: sp.csr_array, symmetric: bool, definite: bool, options: MumpsOptions = PLAIN) -> MumpsReport:
    """Return what the analysis of a real matrix tells, without its factors."""
    return _factorized(A, new_handle(), symmetric, definite, options, analyse_only=True)


def _with_room(
    A: sp.csr_array, handle: int, symmetric: bool, definite: bool, options: MumpsOptions
) -> MumpsReport:  # fmt: skip
    """Factorise a real matrix, once more with more workspace where pivoting takes more than the analysis expects.

    Options that say how much workspace there is are kept to.
    """
    for percent in (options.memory_relaxation, *(_WORKSPACE if options.memory_relaxation is None else ())):
        given = replace(options, memory_relaxation=percent)
        told = _factorized(A, handle, symmetric, definite, given, analyse_only=False)
        if told.error not in _NO_WORKSPACE:
            break
    return told


def _factorized(
    A: sp.csr_array, handle: int, symmetric: bool, definite: bool, options: MumpsOptions, analyse_only: bool
) -> MumpsReport:  # fmt: skip
    """Factorise a real matrix on all processes, or analyse it alone; its rows may be there already."""
    where: dict[str, Any] = {}
    here: sp.csr_array | None = A
    if isinstance(A, SpreadMatrix):
        where, here = A.where(), A.rest
    n = A.shape[0] * (2 if np.iscomplexobj(A) else 1)
    told: MumpsReport = together(
        "factorize", here, handle=handle, n=n, symmetric=symmetric, definite=definite, options=options,
        analyse_only=analyse_only, **where,
    )  # fmt: skip
    return told


def _here(told: MumpsReport, options: MumpsOptions = PLAIN) -> int:
    """Return the bytes of memory that the processes of this machine take at most."""
    return (told.largest_on_disk if options.out_of_core else told.largest) * local_count()


def _files(parent: str) -> str:
    """Return the folder for this run's files of factors.

    Raises
    ------
    SceneError
        It cannot be made.
    """
    try:
        return str(scratch_folder(parent))
    except OSError as error:
        raise SceneError(
            f'solve.mumps.folder: given "{parent}", where no files can be written ({error.strerror or error});'
            f" expected a folder for the files of factors"
        ) from error


@dataclass(frozen=True)
class Mumps:
    """MUMPS as a `LinearSolver`; only where `has_mumps()`.

    Attributes
    ----------
    options : MumpsOptions
    """

    options: MumpsOptions = PLAIN

    @property
    def name(self) -> str:
        """With the number of processes, where there are several."""
        count, options = process_count(), self.options
        parts = ["MUMPS (PETSc)", *([f"{count} processes"] if count > 1 else [])]
        parts += ["out of core"] if options.out_of_core else []
        parts += [f"low rank to {options.low_rank:g}"] if options.low_rank else []
        return ", ".join(parts)

    def factorize(self, A: sp.csr_array, symmetric: bool) -> Factor:
        """Return LU or LDLᵀ factors; those of a real symmetric matrix know its inertia."""
        return MumpsFactor(A, symmetric, options=self.options)

    def factorize_definite(self, A: sp.csr_array) -> DefiniteFactor:
        """Return factors of a definite matrix."""
        return MumpsDefinite(A, self.options)

    def told(self, A: sp.csr_array, symmetric: bool, definite: bool = False) -> MumpsReport:
        """Return what the analysis of a matrix (n, n), real or complex, tells, without its factors."""
        real = _real_form(A) if np.iscomplexobj(A) else _sorted(A)
        return told_of(real, symmetric and not np.iscomplexobj(A), definite, self.options)

    def memory(self, A: sp.csr_array, symmetric: bool, definite: bool = False) -> int:
        """Return the bytes that MUMPS' analysis expects of the processes on this machine."""
        return _here(self.told(A, symmetric, definite), self.options)


MUMPS = Mumps()
