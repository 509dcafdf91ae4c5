"""The choice of a sparse direct solver, and what is done before any of them is called.

A solver is handed in as `linear_solver`: one of the words of `[solve] linear_solver`, or an object that has the methods
of `LinearSolver`. Another solver is a file beside `superlu.py`, an entry in `_available` and a word in `SolverName`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeVar

import scipy.sparse as sp

from ...errors import NotConvergedError, SceneError
from ...process.ranks import process_count
from ..memory import release_freed
from .dense import DenseFactor
from .factor import DefiniteFactor, Factor, LinearSolver, Solve
from .mumps import MUMPS, PLAIN, Mumps, MumpsOptions, has_mumps
from .pardiso import PARDISO, has_pardiso
from .refinement import contraction, in_single
from .superlu import SUPERLU

_Solving = TypeVar("_Solving", Factor, DefiniteFactor)
SolverName = Literal["auto", "pardiso", "superlu", "mumps"]
_MISSING = {
    "pardiso": "MKL's PARDISO cannot be loaded on this machine (package pypardiso)",
    "mumps": "MUMPS cannot be loaded on this machine (petsc4py with MUMPS and real numbers; see docs/cluster.md)",
}
_LARGE = 3000  # unknowns from which on freed memory is given back before a factorisation, which takes far longer
_MANY = 3e7  # entries from which on memory counts most: those of a solid of 200 000 unknowns
_ROUGH = 0.05  # of a residual: what a correction with rough factors may leave
# The same where memory counts most. What is left of a residual is left of its part along the lowest modes, and these
# are in the basis that the factors serve; of other parts they leave less (at 940 074 unknowns 0.11 and 0.002).
_ROUGHER = 0.3
_CHECKED = 2  # corrections by which that is seen
_FULL = 1000  # unknowns up to which a full matrix goes to LAPACK


def choose(linear_solver: LinearSolver | str = "auto", mumps: MumpsOptions = PLAIN) -> LinearSolver:
    """Return the solver that a word stands for; if it is MUMPS, with these options.

    "auto" is MUMPS where mpiexec has started several processes; else PARDISO where it can be loaded, else SuperLU.

    Raises
    ------
    SceneError
        If the word is unknown, or stands for a solver that is not there.

    Examples
    --------
    >>> choose("superlu").name
    'SuperLU (SciPy)'
    """
    if not isinstance(linear_solver, str):
        return linear_solver
    if process_count() > 1 and not has_mumps():
        raise SceneError(
            f"solve.linear_solver: {process_count()} processes take part by MUMPS alone, and {_MISSING['mumps']};"
            " expected one process, or that package"
        )
    solvers = _available(linear_solver)
    if "mumps" in solvers and mumps != PLAIN:
        solvers["mumps"] = Mumps(mumps)
    if linear_solver == "auto":
        return next(iter(solvers.values()))
    if linear_solver in solvers:
        return solvers[linear_solver]
    *others, last = (f'"{word}"' for word in ("auto", *solvers))
    why = f", and {_MISSING[linear_solver]}" if linear_solver in _MISSING else ""
    raise SceneError(
        f'solve.linear_solver: given "{linear_solver}"{why}; expected {", ".join(others)} or {last}'
    )


def found_solvers() -> dict[str, bool]:
    """Return by its word in a scene whether each solver can be loaded on this machine; PETSc is loaded for that."""
    return {"pardiso": has_pardiso(), "superlu": True, "mumps": has_mumps()}


def _available(word: str) -> dict[str, LinearSolver]:
    """Return the solvers that can be loaded on this machine, the one that "auto" takes first."""
    found: dict[str, LinearSolver] = {"superlu": SUPERLU}
    found = {"pardiso": PARDISO, **found} if has_pardiso() else found
    if process_count() > 1:
        return {"mumps": MUMPS, **found}
    # PETSc starts MPI, so that it is not loaded unless it is asked for.
    return {**found, "mumps": MUMPS} if word == "mumps" and has_mumps() else found


def factorize(A: sp.csr_array, symmetric: bool, linear_solver: LinearSolver | str = "auto") -> Factor:
    """Factorise a matrix: a small one that is full by LAPACK, any other by the sparse solver.

    Parameters
    ----------
    A : (n, n) sparse, real or complex
    symmetric : bool
        Whether A = Aᵀ, also where it is complex.

    Raises
    ------
    NotConvergedError, TooLargeError
        As `LinearSolver.factorize`.
    """
    if A.shape[0] <= _FULL and A.nnz > A.shape[0] ** 2 / 2 and not symmetric:
        return DenseFactor(A)
    _make_room(A)
    return choose(linear_solver).factorize(A, symmetric)


def factorize_definite(A: sp.csr_array, linear_solver: LinearSolver | str = "auto") -> DefiniteFactor:
    """Factorise a real symmetric positive definite matrix.

    Raises
    ------
    NotConvergedError
        If it is not positive definite.
    """
    if not (A.diagonal() > 0).all():  # solvers take it for granted, and PARDISO may crash
        raise NotConvergedError("the matrix is not positive definite: its diagonal is not")
    _make_room(A)
    return choose(linear_solver).factorize_definite(A)


def is_large(entries: int, linear_solver: LinearSolver | str = "auto") -> bool:
    """Whether a matrix has so many entries that it is factorised roughly, if the solver can do that."""
    return entries >= _MANY and _rough(linear_solver) is not None


def factorize_with_care(
    make: Callable[[], sp.csr_array], linear_solver: LinearSolver | str = "auto"
) -> DefiniteFactor:  # fmt: skip
    """Factorise as `factorize_definite`, but roughly where the matrix has so many entries that memory counts most.

    Parameters
    ----------
    make : callable
        Returns the matrix (n, n) anew, so that it takes no memory beside rough factors but in single precision.

    Raises
    ------
    NotConvergedError
        If the matrix is not positive definite.
    """
    A = make()
    if not is_large(A.nnz, linear_solver):
        return factorize_definite(A, linear_solver)
    del A
    return factorize_definite_roughly(make, linear_solver)


def negative_eigenvalues(A: sp.csr_array, linear_solver: LinearSolver | str = "auto") -> int | None:
    """Return the number of negative eigenvalues of a real symmetric matrix, or None where the factors do not tell.

    A matrix of many entries is factorised roughly: `contraction` shows whether it has as many as its factors.

    Raises
    ------
    NotConvergedError
        If the matrix cannot be factorised.
    """
    rough = _rough(linear_solver)
    counted = None if rough is None or A.nnz < _MANY else _counted_roughly(A, rough)
    return factorize(A, True, linear_solver).negative_pivots if counted is None else counted


def _counted_roughly(A: sp.csr_array, rough: LinearSolver) -> int | None:
    try:
        factor = factorize(A, True, rough)
        sure = factor.negative_pivots is not None and contraction(A, factor.solve) <= _ROUGHER
    except NotConvergedError:  # single precision may take a pivot for zero
        return None
    return factor.negative_pivots if sure else None


def factorize_roughly(
    make: Callable[[], sp.csr_array], symmetric: bool, linear_solver: LinearSolver | str = "auto"
) -> Factor:  # fmt: skip
    """Factorise as `factorize`, for corrections alone: solves whose residuals are computed and solved for again.

    Factors of the solver's `rough`, such as those in single precision, are smaller. Where one correction by them leaves
    more than `_ROUGH` of a residual, or of a large matrix `_ROUGHER`, the others are computed instead.

    Parameters
    ----------
    make : callable
        As of `factorize_with_care`.
    """
    return _good_enough(make, lambda A, solver: factorize(A, symmetric, solver), linear_solver)


def factorize_definite_roughly(
    make: Callable[[], sp.csr_array], linear_solver: LinearSolver | str = "auto"
) -> DefiniteFactor:  # fmt: skip
    """Factorise as `factorize_definite`, for what `factorize_roughly` is for.

    Raises
    ------
    NotConvergedError
        If the matrix is not positive definite.
    """
    return _good_enough(make, factorize_definite, linear_solver)


def _good_enough(
    make: Callable[[], sp.csr_array], factors: Callable[[sp.csr_array, LinearSolver | str], _Solving],
    linear_solver: LinearSolver | str,
) -> _Solving:  # fmt: skip
    """Return factors by the rough solver if these are good enough for corrections, else those by the solver itself."""
    rough = _rough(linear_solver)
    factor = None if rough is None else _rough_factors(make, factors, rough)
    return factors(make(), linear_solver) if factor is None else factor


def _rough_factors(
    make: Callable[[], sp.csr_array], factors: Callable[[sp.csr_array, LinearSolver | str], _Solving],
    rough: LinearSolver,
) -> _Solving | None:  # fmt: skip
    A, most = make(), _ROUGH
    if A.nnz >= _MANY:  # then the matrix in double precision takes no memory beside the factors
        A, most = in_single(A), _ROUGHER
    try:
        factor = factors(A, rough)
        return factor if contraction(A, factor.solve, _CHECKED) <= most else None
    except NotConvergedError:  # single precision may take a pivot for zero or negative
        return None


def _rough(linear_solver: LinearSolver | str) -> LinearSolver | None:
    return getattr(choose(linear_solver), "rough", None)


def _make_room(A: sp.csr_array) -> None:
    """Give freed memory back before large factors: of models of 5 000 unknowns it is a tenth of all at the peak."""
    if A.shape[0] >= _LARGE:
        release_freed()


def factor_memory(
    A: sp.csr_array, symmetric: bool, definite: bool = False, linear_solver: LinearSolver | str = "auto",
    roughly: bool = False,
) -> int:  # fmt: skip
    """Return the bytes that the factors of a matrix will take, maybe rough ones, without computing them."""
    solver = (_rough(linear_solver) if roughly else None) or choose(linear_solver)
    return solver.memory(A, symmetric, definite)


def solver_name(linear_solver: LinearSolver | str = "auto") -> str:
    """Return the name of a sparse solver."""
    return choose(linear_solver).name


def factorize_complex(A: sp.csr_array, linear_solver: LinearSolver | str = "auto") -> tuple[Solve, Solve]:
    """Return functions that apply A⁻¹ and A⁻ᴴ of a complex matrix."""
    factor = factorize(sp.csr_array(A, dtype=complex), False, linear_solver)
    return factor.solve, factor.solve_adjoint
