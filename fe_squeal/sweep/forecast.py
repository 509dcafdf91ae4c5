"""Predict how much memory a sweep will take, before anything is solved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import psutil
import scipy.sparse as sp

from ..eigen.dense import DENSE_LIMIT
from ..eigen.linear.choice import factor_memory
from ..eigen.linear.factor import LinearSolver
from ..eigen.linear.superlu import superlu_memory
from ..eigen.memory import available_memory, memory_text
from ..eigen.pencil import Pencil
from ..eigen.shift import shift_below, symmetric_part
from ..errors import NotConvergedError
from ..problem.problem import Problem

VALUES, UNKNOWNS = 5, 2000  # values of the sweep and unknowns from which a reduced model is faster than direct solves
# Vectors of length n for each mode asked for: in a reduced basis while it grows, and in Arnoldi iterations for right
# and left modes.
_REDUCED_VECTORS, _DIRECT_VECTORS = 24, 12
_REDUCED_COPIES, _DIRECT_COPIES = 4, 2  # copies of the matrices: sums of terms, and what the solver keeps


def is_reduced(problem: Problem, parameter: str, values: int, method: str) -> bool:
    """Return whether a sweep uses a reduced model: if `method` asks for it, and with "auto" where that is faster."""
    # Without friction and damping a few values cost least by Lanczos iterations. In all other problems left modes are
    # needed and modes are counted, and both take less time with a reduced model, even at one value.
    plain = all(t.symmetric and t.slot != "C" and not t.imaginary for t in problem.terms)
    enough = values >= VALUES or not plain
    pays = enough and problem.unknowns >= UNKNOWNS and problem.is_affine(parameter)
    return method in ("reduced", "modal") or (method == "auto" and pays)


@dataclass(frozen=True)
class MemoryPrediction:
    """The memory that a sweep is predicted to take at its peak.

    Attributes
    ----------
    total : int, bytes
        Memory of the whole process, with everything that is loaded now.
    factors : int, bytes
        Memory of the sparse factors, as part of the total.
    free : int, bytes
        What the process may still take now.
    reduced : bool
        Whether the sweep uses a reduced model.
    """

    total: int
    factors: int
    free: int
    reduced: bool

    @property
    def fits(self) -> bool:
        """Whether so much memory is free."""
        return self.total - psutil.Process().memory_info().rss <= self.free

    def __str__(self) -> str:
        way = "reduced sweep" if self.reduced else "a direct solve per value"
        text = f"{memory_text(self.total)}, {memory_text(self.factors)} of it factors ({way})"
        return text if self.fits else f"{text}; {memory_text(self.free)} are free: it does not fit"


def predict_memory(
    problem: Problem, parameter: str, values: int, modes: int, method: str, linear_solver: LinearSolver | str = "auto"
) -> MemoryPrediction:
    """Predict the memory of a sweep from a symbolic analysis of the matrices, to about a third.

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
    loaded = int(psutil.Process().memory_info().rss)
    reduced = is_reduced(problem, parameter, values, method)
    if problem.unknowns <= DENSE_LIMIT:
        return MemoryPrediction(loaded, 0, available_memory(), reduced)
    pencil = problem.solved_with(linear_solver).pencil()
    entries = sum(A.nnz for A in (pencil.M, pencil.C, pencil.K) if A is not None)
    number = 16 if pencil.is_complex else 8
    definite = symmetric_part(pencil)
    sigma = shift_below(definite, None)
    if reduced:
        A, symmetric = sp.csr_array(definite.K - sigma * definite.M), True
    else:
        A, symmetric = _shifted(pencil, sigma), pencil.symmetric and pencil.C is None
    factors = _factors(A, symmetric, linear_solver, definite=reduced)
    copies, vectors = (_REDUCED_COPIES, _REDUCED_VECTORS) if reduced else (_DIRECT_COPIES, _DIRECT_VECTORS)
    extra = copies * entries * (number + 4) + vectors * modes * problem.unknowns * 8
    return MemoryPrediction(loaded + extra + factors, factors, available_memory(), reduced)


def _shifted(pencil: Pencil, sigma: float) -> sp.csr_array:
    """Return a matrix with the same pattern as the one that a direct solve factorises; only the pattern is analysed."""
    A = pencil.K - sigma * pencil.M
    return sp.csr_array(A if pencil.C is None else A + np.sqrt(-sigma) * pencil.C)


def _factors(A: sp.csr_array, symmetric: bool, linear_solver: LinearSolver | str, *, definite: bool) -> int:
    try:
        return factor_memory(A, symmetric, definite, linear_solver)
    except NotConvergedError:  # the analysis fails, and so will the solve, which reports why
        return 0
    except MemoryError:  # the analysis itself did not fit
        return superlu_memory(A, symmetric)
