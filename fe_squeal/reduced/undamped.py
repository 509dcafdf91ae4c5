"""The problem without damping and friction, from which a reduced model starts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import scipy.sparse as sp

from ..eigen.linear.choice import factorize_with_care
from ..eigen.linear.factor import DefiniteFactor, LinearSolver
from ..eigen.linear.spread_matrix import in_rows
from ..eigen.pencil import Pencil
from ..eigen.shift import shift_below
from ..errors import NotConvergedError
from ..problem.problem import Problem
from ..problem.terms import sum_matrices


def _stiffnesses(problem: Problem) -> list[list[float]]:
    """Return coefficients of the terms in K without damping and friction; two choices at most, the better one first.

    Friction, which is not symmetric, is left out. If K is not positive semidefinite without it, its symmetric part is
    added. (Added at once, it would make K indefinite where contacts are penalties.) Where most of K comes in a matrix
    that is not symmetric, as in scenes of matrices, leaving it out is not tried.
    """
    at = problem.parameters
    kept = [t.coefficient(at) if t.slot == "K" and not t.imaginary else 0.0 for t in problem.terms]
    without = [c if t.symmetric else 0.0 for c, t in zip(kept, problem.terms, strict=True)]
    if kept == without:
        return [kept]
    size = [abs(c) * float(np.abs(t.matrix.diagonal()).sum()) for c, t in zip(kept, problem.terms, strict=True)]
    friction = sum(s for s, c in zip(size, without, strict=True) if not c)
    return [without, kept] if friction < sum(size) / 2 else [kept]


def _metric(problem: Problem, stiffness: Sequence[float], sigma: float) -> list[float]:
    """Return the coefficients of all terms in P = K − σM from those in K without damping and friction."""
    return [
        -sigma * t.coefficient(problem.parameters) if t.slot == "M" else c
        for c, t in zip(stiffness, problem.terms, strict=True)
    ]


def metric_as(problem: Problem, other: Problem, of_other: Sequence[float], sigma: float) -> list[float]:
    """Return the coefficients of a problem's terms in P, chosen as for another problem of the same unknowns.

    Parameters
    ----------
    problem : Problem
        At the parameters at which P is formed.
    other : Problem
    of_other : (terms,) float
        The coefficients of the terms of `other`, see `factorize_undamped`.
    sigma : float, rad²/s²
    """
    friction = [t.slot == "K" and not t.symmetric and bool(c) for t, c in zip(other.terms, of_other, strict=True)]
    return _metric(problem, _stiffnesses(problem)[-1 if any(friction) else 0], sigma)


def weighted(problem: Problem, coefficients: Sequence[float]) -> sp.csr_array:
    """Return a weighted sum (n, n) of the terms' matrices; of a matrix that is not symmetric its symmetric part."""
    used = [(t, c) for t, c in zip(problem.terms, coefficients, strict=True) if c]
    total = sum_matrices((t.matrix, c) for t, c in used if t.symmetric)
    for t, c in used:
        if not t.symmetric:  # one after the other: each has a copy
            part = in_rows(t.matrix + t.matrix.T) * (c / 2)
            total = part if total is None else total + part
    return sp.csr_array((problem.unknowns, problem.unknowns)) if total is None else in_rows(total)


def factorize_undamped(
    problem: Problem, band: float | None, linear_solver: LinearSolver | str
) -> tuple[Pencil, float, list[float], DefiniteFactor]:
    """Return a problem without damping and friction, a shift σ below its modes, and P = K − σM of it.

    P is close to Q(λ) on everything beyond the modes of this problem, and has fewer and faster factors than any Q(λ).

    Parameters
    ----------
    problem : Problem
        Its terms collected by powers of the parameter.
    band : float, rad/s, optional
        Frequency up to which modes are asked for.
    linear_solver : LinearSolver or str

    Returns
    -------
    pencil : Pencil
    sigma : float, rad²/s²
    metric : list of float
        Coefficients of the terms in P.
    factor : DefiniteFactor
        Factors of P.

    Raises
    ------
    NotConvergedError
        If P is not positive definite.
    """
    M, failure = problem.mass, None
    for stiffness in _stiffnesses(problem):
        pencil = Pencil(M, weighted(problem, stiffness), symmetric=True)
        sigma = shift_below(pencil, band)
        metric = _metric(problem, stiffness, sigma)
        try:
            factor = factorize_with_care(partial(weighted, problem, metric), linear_solver)
            return pencil, sigma, metric, factor
        except NotConvergedError as error:
            failure = error
    raise NotConvergedError(f"the problem without damping and friction is not positive semidefinite: {failure}")
