"""Predict how much memory a sweep will take, before anything is solved."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace

import numpy as np
import psutil
import scipy.sparse as sp

from ..eigen.columns import are_spread, part_here
from ..eigen.dense import DENSE_LIMIT
from ..eigen.linear.choice import factor_memory, is_large
from ..eigen.linear.factor import LinearSolver
from ..eigen.linear.spread_matrix import SpreadMatrix, in_rows
from ..eigen.linear.superlu import solid_memory
from ..eigen.memory import available_memory, memory_text, release_freed
from ..eigen.pencil import Pencil
from ..eigen.shift import shift_below, symmetric_part
from ..errors import NotConvergedError, SquealError
from ..problem.aside import movable_bytes
from ..problem.problem import Problem
from ..problem.tabulated import Tabulated
from ..process.ranks import process_count

# Values of the sweep from which a reduced model is faster than direct solves of a problem that LAPACK does not solve as
# a whole, and unknowns from which it is so at fewer values with friction or damping. Measured on ten models of
# benchmarks/gallery, with 747 to 6 654 unknowns; at five values it took 1.4 times as long at worst, 0.2 at best.
VALUES, UNKNOWNS = 5, 2000

# What is counted below was measured phase by phase, by the memory that each holds (benchmarks/memory.py).
_FIGURES = 62 * 2**20  # bytes of Matplotlib, pandas and what belongs to them, which a run loads
# Bytes that writing tables, page and shapes takes besides what is counted one by one. Four reduced sweeps of brakes
# with 6 558 to 12 717 unknowns took 27 to 59 MiB more than the count without it.
_WRITTEN = 45 * 2**20
_KERNELS = 25 * 2**20  # bytes of the solver's library, read from the disk when it first factorises
# Bytes that the C library keeps of what was freed, in pieces between others: those of up to 32 MiB (glibc), so that
# large models keep no more than small ones.
_KEPT = 40 * 2**20
_GUARDED = 1.3  # times the modes asked for: modes that the basis begins with
# Vectors of the basis for each of these modes, which damping and complex stiffness make complex, by problem class.
_BASIS = {"symmetric": 3.0, "nonsymmetric": 5.0, "quadratic": 8.0, "complex": 17.0}
_SAMPLES = 48  # vectors: random samples of residuals
_PROJECTED = 18  # bytes for each entry of a projected term: sparse with its indices, and half as much again beside it
_DENSE = 8  # matrices of a small eigenproblem, with the workspaces of LAPACK
_LIFTED = 10.0  # vectors for each guarded mode: shapes as vectors of the problem, complex, and a basis of them
_KRYLOV = 8.0  # vectors for each mode asked for: of the Krylov spaces, and the modes themselves
# While a reduced model is made: vectors that the search for missing modes keeps, counted from the program; corrections
# of each guarded mode that are in the basis beside all its vectors; the arrays of the vectors that are corrected at
# once, right and left ones, and the bytes of these arrays of a large problem, which corrects fewer at once. The last
# three were found on brakes of quadratic tetrahedra with 48 417 and 96 711 unknowns.
_SEARCHED, _CORRECTED, _BLOCKS, _MOST = 40, 1.0, 9.0, 9 * 2**26
# Times the factors of a large problem: what those of a matrix with friction take more, by PARDISO's analyses at 437 886
# unknowns; those of a complex matrix have twice the bytes.
_STRONG = {"symmetric": 0.0, "nonsymmetric": 1.2, "quadratic": 3.0, "complex": 3.0}
# What direct solves make of these: left ones too, complex ones, and with damping those of displacement and velocity.
_SOLVED = {"symmetric": 1, "nonsymmetric": 2, "quadratic": 8, "complex": 4}
# Of the search for strong flutter, by problem class: vectors of its Krylov space; and those of each mode asked for that
# is taken out, right and left, displacement and velocity, with copies in other units and projectors. Complex ones count
# twice. Counted from the program.
_FLUTTER = {"nonsymmetric": (368, 32), "complex": (736, 64)}
# Where a parameter changes matrices: sums of terms at other values that an assembly keeps; values of which a table has
# terms besides those of the sweep, at which steps are halved and onsets end; how far apart two values are, in parts of
# one, whose terms tell the entries of these.
_VERSIONS, _BESIDE, _APART = 3, 4, 0.1
# Copies of the matrices of direct sweeps, in those of a real K: a matrix with the indices of a solver beside it; and
# what is kept of the sizes of all entries.
_HANDED, _SIZES = 1.25, 2 / 3


def is_reduced(problem: Problem, parameter: str, values: int, method: str) -> bool:
    """Return whether a sweep uses a reduced model: if `method` asks for it, and with "auto" where that is faster."""
    # Without friction and damping a few values cost least by Lanczos iterations. In all other problems left modes are
    # needed and modes are counted, and both take less time with a reduced model, even at one value.
    plain = all(t.symmetric and t.slot != "C" and not t.imaginary for t in problem.terms)
    few = problem.unknowns >= UNKNOWNS and not plain
    pays = few or (values >= VALUES and problem.unknowns > DENSE_LIMIT)
    possible = problem.is_affine(parameter) or problem.source is not None
    return method in ("reduced", "modal") or (method == "auto" and pays and possible)


@dataclass(frozen=True)
class MemoryPrediction:
    """The memory that a sweep is predicted to take at its peak.

    Attributes
    ----------
    total : int, bytes
        Memory of the whole process, with everything that is loaded now, and under mpiexec what the other processes of
        this machine, which are loaded already, take besides: their parts of factors and vectors.
    factors : int, bytes
        Memory of the sparse factors, as part of the total.
    free : int, bytes
        What the process may still take now.
    reduced : bool
        Whether the sweep uses a reduced model.
    parts : dict of int, bytes
        What the total consists of, by name.
    strong : int, bytes
        What comes to that if friction or damping is strong: larger factors, or those that shapes are made exact with.
    taken : int, bytes
        What the process has now.
    """

    total: int
    factors: int
    free: int
    reduced: bool
    parts: dict[str, int] = field(default_factory=dict)
    strong: int = 0
    taken: int = 0

    @property
    def room(self) -> int:
        """Bytes that the whole process may take: what it has now, and what is free."""
        return self.free + self.taken

    @property
    def fits(self) -> bool:
        """Whether there is room for it."""
        return self.total <= self.room

    def __str__(self) -> str:
        way = "reduced sweep" if self.reduced else "a direct solve per value"
        parts = ", ".join(f"{name} {memory_text(size)}" for name, size in self.parts.items())
        more = f"; {memory_text(self.strong)} more if friction or damping is strong" if self.strong else ""
        text = f"{memory_text(self.total)} ({way}): {parts}{more}"
        return text if self.fits else f"{text}; {memory_text(self.free)} are free: it does not fit"


@dataclass(frozen=True)
class MemoryCount:
    """What the memory of a run is counted from, once the matrices are analysed: `at` gives it for numbers of modes.

    Attributes
    ----------
    unknowns, values, terms : int
        Of the problem, of the sweep, and of the sum that the problem is.
    problem_class : str
    reduced : bool
        Whether the sweep uses a reduced model.
    factors : int, bytes
        Those that the solver's analysis tells; 0 where small matrices go to LAPACK as a whole.
    fixed : dict of int, bytes
        Parts that modes and values do not change, by name.
    lifted : int, bytes
        Of a reduced model: sums of matrices while shapes are made of its modes.
    large : bool
        Whether the reduced model begins with rough factors, and goes on with them where friction and damping are weak.
    terms_here : int, bytes
        Of "program and model", the matrices of the terms whose rows several processes would share.
    terms_spread : int, bytes
        The same of matrices whose rows are on several processes, on all of these.
    """

    unknowns: int
    values: int
    terms: int
    problem_class: str
    reduced: bool
    factors: int
    fixed: dict[str, int]
    lifted: int = 0
    large: bool = False
    terms_here: int = 0
    terms_spread: int = 0

    def at(self, modes: int, processes: int | None = None) -> MemoryPrediction:
        """Return the prediction for a number of modes: on this machine, or of the first of some processes alone.

        Factors count as they are given: of all processes on this machine, unless `with_factors` has other ones.
        """
        parts, n, kind, with_factors = dict(self.fixed), self.unknowns, self.problem_class, 0
        here = part_here(n) if processes is None else 1 / processes if are_spread(n, processes) else 1.0
        if here < 1:
            parts["matrices"] = int(here * parts["matrices"])
            if processes is not None:
                parts["program and model"] -= int((1 - here) * self.terms_here)
        if processes is None and self.terms_spread:  # which this process has a part of: those of others on this machine
            parts["matrices"] += int((here - 1 / process_count()) * self.terms_spread)
        if n > DENSE_LIMIT and self.reduced:
            guarded, basis = self._vectors(modes)
            number = 16 if kind == "complex" else 8
            order = 2 * basis if kind == "quadratic" else basis
            blocks = min(8 * n * _BLOCKS * guarded, _MOST)
            own = here * (basis + _CORRECTED * guarded)
            parts["vectors"] = int(8 * n * (own + _SAMPLES + _SEARCHED) + blocks)
            shapes = int(here * self.lifted)
            shapes += int(8 * n * (here * basis + _SAMPLES + _LIFTED * guarded))
            # Pictures and shapes come when what the model is made with is gone; most shapes are exact without factors.
            gone = parts["matrices"] + parts["vectors"] + self.factors
            later = shapes + parts.pop("pictures", 0) + _WRITTEN
            parts["pictures and shapes"] = max(0, later - gone)
            with_factors = max(0, later + self.factors - gone) - parts["pictures and shapes"]
            parts["projections"] = int(_PROJECTED * self.terms * basis**2)
            parts["small eigenproblems"] = int(number * (_DENSE * order**2 + 2 * self.values * guarded * basis))
        elif n > DENSE_LIMIT:
            krylov, states = _FLUTTER.get(kind, (0, 0))
            parts["vectors"] = int(8 * n * max(_KRYLOV * modes * _SOLVED[kind], krylov + states * modes))
        strong = int(_STRONG[kind] * self.factors) if self.large else with_factors
        free, taken = available_memory(), int(psutil.Process().memory_info().rss)
        return MemoryPrediction(sum(parts.values()), self.factors, free, self.reduced, parts, strong, taken)

    def with_factors(self, factors: int) -> MemoryCount:
        """Return the same with factors of so many bytes."""
        return replace(self, factors=factors, fixed={**self.fixed, "factors": factors})

    def rows(self, processes: int) -> int:
        """Return the bytes of the matrices that each of several processes has the rows of."""
        if self.unknowns <= DENSE_LIMIT or not are_spread(self.unknowns, processes):
            return 0
        return int((self.terms_here + self.terms_spread + self.fixed["matrices"]) / processes)

    def share(self, modes: int, processes: int) -> int:
        """Return the bytes of the vectors that each of several processes has a part of."""
        if not self.reduced or self.unknowns <= DENSE_LIMIT or not are_spread(self.unknowns, processes):
            return 0
        guarded, basis = self._vectors(modes)
        return int(8 * self.unknowns * (basis + _CORRECTED * guarded) / processes)

    def _vectors(self, modes: int) -> tuple[float, float]:
        """Return the numbers of modes that a basis begins with, and of its vectors."""
        guarded = min(_GUARDED * modes, self.unknowns)
        return guarded, min(_BASIS[self.problem_class] * guarded, self.unknowns)


def predict_memory(
    problem: Problem, parameter: str, values: int, modes: int, method: str, linear_solver: LinearSolver | str = "auto"
) -> MemoryPrediction:
    """Predict the memory of a run at its peak: while a mode is made exact with factors of the problem at one value.

    With a reduced model it is there or later, where its shapes and the page are written; the larger one counts.
    Pictures of shapes are drawn by another process. All is counted from the numbers of unknowns, entries and modes, but
    the factors, which the solver's analysis tells, and what is loaded now, which is measured. To 15 % where the
    analysis is exact; SuperLU has none.

    Parameters
    ----------
    problem : Problem
        The assembled problem; its own memory is measured.
    parameter : str
        The parameter of the sweep.
    values, modes : int
        Number of values and of modes that are asked for.
    method : "auto", "direct", "reduced" or "modal"
        As for `sweep`.
    linear_solver : LinearSolver or str
        The solver that will factorise the matrices.
    """
    return count_memory(problem, parameter, values, method, linear_solver).at(modes)


def count_memory(
    problem: Problem, parameter: str, values: int, method: str, linear_solver: LinearSolver | str = "auto"
) -> MemoryCount:
    """Return what `predict_memory` counts from, after one symbolic analysis; parameters as there."""
    reduced = is_reduced(problem, parameter, values, method)
    n, terms = problem.unknowns, len(problem.terms)
    if n <= DENSE_LIMIT:
        return MemoryCount(n, values, terms, problem.problem_class, reduced, 0, {"program and model": _loaded()})
    if reduced:
        return _reduced(problem, parameter, values, linear_solver)
    pencil = problem.solved_with(linear_solver).pencil()
    kind, stored = pencil.problem_class, [A for A in (pencil.M, pencil.C, pencil.K) if A is not None]
    real, whole = sum(12 * A.nnz for A in stored), sum(_per_entry(A) * A.nnz for A in stored)
    A = factorised_matrix(pencil)
    # Sums of terms, at a value and of what does not move; what is factorised, and that again in the solver's hands.
    matrices = 2 * whole + (1 + _HANDED) * A.nnz * _per_entry(A)
    matrices += 0 if problem.is_affine(parameter) else _VERSIONS * real
    factors = _factors(A, pencil.symmetric and pencil.C is None, linear_solver)
    static = _static_factors(problem, parameter, values, pencil.K, linear_solver)
    del pencil, A, stored
    fixed = _loaded_parts() | static | {
        "matrices": int(matrices), "factors": factors, "errors": int(_SIZES * real), "freed, but kept": _KEPT,
    }  # fmt: skip
    return MemoryCount(n, values, terms, kind, False, factors, fixed, 0, False, *_bytes_of(problem))


def _static_factors(
    problem: Problem, parameter: str, values: int, K: sp.csr_array, linear_solver: LinearSolver | str
) -> dict[str, int]:  # fmt: skip
    """Return the bytes of the factors that static states of a sweep have in common, see `TangentSolver`, by name."""
    if not problem.state or values == 1 or problem.is_affine(parameter) or is_large(K.nnz, linear_solver):
        return {}
    return {"static states": _factors(sp.csr_array(K.real), False, linear_solver)}


def _reduced(problem: Problem, parameter: str, values: int, linear_solver: LinearSolver | str) -> MemoryCount:
    """Return what is counted of a reduced sweep while factors make modes exact.

    These are taken to be factors of Q(iω), or of a large problem those of P, without damping and friction.
    """
    pencil = problem.solved_with(linear_solver).pencil()
    kind, real = pencil.problem_class, 12 * pencil.K.nnz
    sums = sum(_per_entry(A) * A.nnz for A in (pencil.M, pencil.C, pencil.K) if A is not None)
    large = is_large(pencil.K.nnz, linear_solver)
    aside = 0
    if large:
        used = [A for A in (pencil.M, pencil.C, pencil.K) if A is not None]
        aside = movable_bytes(problem.terms, used)
        del used
        pencil = Pencil(pencil.M, sp.csr_array(pencil.K.real), symmetric=True)
    A, symmetric = factorised_matrix(pencil), pencil.symmetric and pencil.C is None
    factors = _factors(A, symmetric, linear_solver, roughly=True, definite=large)
    # PARDISO's copy of A or of its upper triangle, in single precision. A itself is gone when vectors are corrected.
    handed = A.nnz * (A.dtype.itemsize // 2 + 4) * (0.5 if symmetric else 1.0)
    static = _static_factors(problem, parameter, values, pencil.K, linear_solver)
    del pencil, A
    moved, more = _moved(problem, parameter, values)
    handed += moved + (0 if problem.is_affine(parameter) else _VERSIONS * real)
    fixed = _loaded_parts() | static | {"matrices": int(sums + handed), "factors": factors, "freed, but kept": _KEPT}
    fixed["program and model"] -= aside
    own, spread = _bytes_of(problem)
    n, terms = problem.unknowns, len(problem.terms) + more
    lifted, own = int(2 * sums + real), max(0, own - aside)
    return MemoryCount(n, values, terms, kind, True, factors, fixed, lifted, large, own, spread)


def _bytes_of(problem: Problem) -> tuple[int, int]:
    """Return the bytes of the bodies' mass and stiffness: of those of this process alone, and of those on all."""
    bodies = {id(t.matrix): t.matrix for t in problem.terms if t.name.startswith(("mass.", "elastic."))}
    own, spread = 0, 0
    for A in bodies.values():
        if isinstance(A, SpreadMatrix):
            spread += sum(12 * part.told.entries for _, part in A.parts)
        elif A.data.flags.writeable:  # others are in files
            own += 12 * A.nnz
    return own, spread


def _moved(problem: Problem, parameter: str, values: int) -> tuple[int, int]:
    """Return the bytes and the number of the terms that a table has beside those of its first value.

    None where the parameter moves coefficients alone, and none that are known where the problem cannot be made at
    another value.
    """
    if values == 1 or problem.is_affine(parameter):
        return 0, 0
    value = problem.value(parameter)
    try:
        table = Tabulated.of(problem, parameter, value)
        moved = table.with_value((1 - _APART) * value if value else _APART).terms[len(table.terms) :]
    except SquealError:  # the sweep raises the same error, or has its own values
        return 0, 0
    count = values + _BESIDE
    return count * sum(12 * t.matrix.nnz for t in moved), count * len(moved)


def _loaded_parts() -> dict[str, int]:
    """Return what the process has now, after the analysis, and the libraries that it will load."""
    figures = 0 if "matplotlib.figure" in sys.modules else _FIGURES
    return {"program and model": _loaded(), "libraries": _KERNELS, "pictures": figures}


def _per_entry(A: sp.csr_array) -> int:
    return int(A.dtype.itemsize) + 4


def _loaded() -> int:
    """Return the bytes that the process has now, without freed ones."""
    release_freed()
    return int(psutil.Process().memory_info().rss)


def factorised_matrix(pencil: Pencil) -> sp.csr_array:
    """Return a matrix of the pattern and type that is factorised where a mode is made exact."""
    sigma = shift_below(symmetric_part(pencil), None)
    A = pencil.K - sigma * pencil.M
    return in_rows(A if pencil.C is None else A + 1j * np.sqrt(-sigma) * pencil.C)


def _factors(
    A: sp.csr_array, symmetric: bool, linear_solver: LinearSolver | str, roughly: bool = False, definite: bool = False
) -> int:  # fmt: skip
    try:
        return factor_memory(A, symmetric, definite, linear_solver, roughly)
    except NotConvergedError:  # the analysis fails, and so will the solve, which reports why
        return 0
    except MemoryError:  # the analysis itself did not fit
        return solid_memory(A, symmetric)
