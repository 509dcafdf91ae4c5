"""How much memory a sweep will take, before anything is solved."""

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

VALUES, UNKNOWNS = 5, 2000  # from which a reduced model pays
# Vectors of length n per mode asked for: of a reduced basis while it grows, and of Arnoldi iterations for both sides.
_REDUCED_VECTORS, _DIRECT_VECTORS = 24, 12
_REDUCED_COPIES, _DIRECT_COPIES = 4, 2  # of the matrices: sums of terms and what the solver keeps


def is_reduced(problem: Problem, parameter: str, values: int, method: str) -> bool:
    """Whether a sweep works on a reduced model of the problem: where that is asked for, or pays."""
    # A few values without friction and damping cost least by Lanczos iteration. In all other problems left modes are
    # needed and modes are counted, which costs less by a reduced model, even at one value.
    plain = all(t.symmetric and t.slot != "C" and not t.imaginary for t in problem.terms)
    enough = values >= VALUES or not plain
    pays = enough and problem.unknowns >= UNKNOWNS and problem.is_affine(parameter)
    return method in ("reduced", "modal") or (method == "auto" and pays)


@dataclass(frozen=True)
class MemoryPrediction:
    """What a sweep takes at its peak.

    Attributes
    ----------
    total, factors : int, bytes
        Of this process with everything loaded, and of the sparse factors among it.
    free : int, bytes
        What the process may still take now.
    reduced : bool
    """

    total: int
    factors: int
    free: int
    reduced: bool

    @property
    def fits(self) -> bool:
        """Whether as much is free."""
        return self.total - psutil.Process().memory_info().rss <= self.free

    def __str__(self) -> str:
        way = "reduced sweep" if self.reduced else "a direct solve per value"
        text = f"{memory_text(self.total)}, {memory_text(self.factors)} of it factors ({way})"
        return text if self.fits else f"{text}; {memory_text(self.free)} are free: it does not fit"


def predict_memory(
    problem: Problem, parameter: str, values: int, modes: int, method: str, linear_solver: LinearSolver | str = "auto"
) -> MemoryPrediction:
    """Predict the memory of a sweep from an analysis of the matrices; about a third is uncertain.

    Parameters
    ----------
    problem : Problem
        Assembled: what it takes by itself is measured.
    values, modes : int
        How many of each are asked for.
    linear_solver : LinearSolver or str
        Whose factors they are.
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
        factors = _factors(sp.csr_array(definite.K - sigma * definite.M), True, True, linear_solver)
    else:
        factors = _factors(_shifted(pencil, sigma), pencil.symmetric and pencil.C is None, False, linear_solver)
    copies, vectors = (_REDUCED_COPIES, _REDUCED_VECTORS) if reduced else (_DIRECT_COPIES, _DIRECT_VECTORS)
    extra = copies * entries * (number + 4) + vectors * modes * problem.unknowns * 8
    return MemoryPrediction(loaded + extra + factors, factors, available_memory(), reduced)


def _shifted(pencil: Pencil, sigma: float) -> sp.csr_array:
    """Return a matrix with the entries of the one that a direct solve factorises; its values do not matter."""
    A = pencil.K - sigma * pencil.M
    return sp.csr_array(A if pencil.C is None else A + np.sqrt(-sigma) * pencil.C)


def _factors(A: sp.csr_array, symmetric: bool, definite: bool, linear_solver: LinearSolver | str) -> int:
    try:
        return factor_memory(A, symmetric, definite, linear_solver)
    except NotConvergedError:  # an analysis that fails: the solve says why
        return 0
    except MemoryError:  # the analysis itself did not fit
        return superlu_memory(A, symmetric)
