"""Count the modes of problems with damping or friction, where the inertia of a matrix does not give the number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..eigen.band import count_beside
from ..eigen.free_modes import split_off
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Modes
from ..eigen.request import Request, is_beside
from ..eigen.shift import LIGHT
from ..errors import NotConvergedError
from ..problem.problem import Problem
from ..reduced import ReducedModel

_CLEAR = 1e-5  # of a frequency: a count ends in a gap between two frequencies that is at least so wide
_SAME = 1e-5  # of |λ|: two eigenvalues that are closer together belong to the same mode
_VALUE = "value"  # name of a parameter that nothing depends on, for a reduced model at a single value


def count_apart(
    problem: Problem, modes: Modes, request: Request, linear_solver: LinearSolver | str = "auto"
) -> int | None:
    """Count the modes up to the highest of those found, by another method than the one that found them.

    With dampers others are searched for around another shift, with those found taken out.

    Without dampers the modes without friction are counted by the inertia of K − σM (Sylvester's law). They make a first
    reduced model. It is extended until every residual of the modes with damping and friction meets the tolerance and a
    search from random vectors finds no other mode. The count is the number of its modes up to a clear gap between two
    frequencies.

    Parameters
    ----------
    problem : Problem
        The problem, at those values of its parameters at which the modes were found.
    modes : Modes
        The modes found.
    request : Request
        What was asked for when they were solved for.
    linear_solver : LinearSolver or str
        As for `sweep`.

    Returns
    -------
    int or None
        None if there is no clear gap, the solver does not give the inertia, the reduced model does not converge, or
        overdamped modes are so many that a search does not part them.
    """
    swinging = np.sort(modes.lam.imag[(modes.lam.imag > 0) & ~is_beside(modes)])
    gaps = np.flatnonzero(np.diff(swinging) > _CLEAR * swinging[1:])
    if not len(gaps):
        return None
    end = float(swinging[gaps[-1]] + swinging[gaps[-1] + 1]) / 2
    pencil = problem.pencil()
    if pencil.C is not None and not pencil.is_complex:
        others = count_beside(pencil, modes, end, split_off(pencil, linear_solver), linear_solver)
        return None if others is None else len(modes) + others
    frozen = replace(problem, parameters={**problem.parameters, _VALUE: 0.0}, coupled=frozenset())
    try:
        model = ReducedModel(frozen, _VALUE, [0.0], request, linear_solver=linear_solver)
        if not model.counted():
            return None
        counted = model.modes(0.0)
    except NotConvergedError:
        return None
    # With structural damping every mode is counted.
    every = any(t.imaginary for t in problem.terms)
    lam, found = (
        m.lam[(m.lam.imag > 0) & (m.lam.imag < end) & (every | (m.lam.real > -LIGHT * m.lam.imag)) & ~is_beside(m)]
        for m in (counted, modes)
    )
    alike = np.abs(lam[:, None] - modes.lam[None, :]) <= _SAME * np.abs(lam)[:, None]
    i, j = linear_sum_assignment(alike, maximize=True)  # each mode found is identified with a mode of the model
    matched = int(np.count_nonzero(alike[i, j]))
    return None if matched < len(found) and len(lam) < len(found) else len(modes) + len(lam) - matched
