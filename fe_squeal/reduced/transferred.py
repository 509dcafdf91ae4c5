"""The modes of a problem near that of a reduced model, by a projection on the basis of this model."""

from __future__ import annotations

import numpy as np

from ..eigen.linear.choice import factorize_definite_roughly
from ..eigen.pencil import Modes
from ..eigen.request import is_needed
from ..errors import NotConvergedError
from ..problem.forms import collect_powers
from ..problem.problem import Problem
from .basis import ReducedBasis
from .model import ReducedModel
from .places import ModesAtPlaces
from .undamped import metric_as, weighted


class TransferredModel(ModesAtPlaces):
    """A projection of another problem on the basis of a reduced model, without any vector more.

    A basis that holds right and left modes of one problem holds those of a near one up to the distance of the two, and
    λ up to the product of what right and left modes lack. `error` tells how far λ may be off.

    Parameters
    ----------
    model : ReducedModel
    problem : Problem
        Of the same unknowns, affine in the parameter of the model.
    start : float
        Value of the parameter at which P = K − σM is formed.

    Attributes
    ----------
    basis : ReducedBasis
    highest : float, rad/s
        Frequency up to which the basis holds the modes of the problem without damping and friction.
    linear_solver : LinearSolver
    definite : DefiniteFactor
        Factors of P.

    Raises
    ------
    NotConvergedError
        P of the other problem is not positive definite, or none of its modes is in the range.
    """

    def __init__(self, model: ReducedModel, problem: Problem, start: float) -> None:
        parameter, own = model.parameter, model.basis
        assert isinstance(parameter, str)
        self.linear_solver, self.request, self.highest = model.linear_solver, model.request, model.highest
        collected = collect_powers(problem, parameter).at({parameter: start})
        self._know_nothing(collected, along=False)
        metric = metric_as(collected, own.problem, own.metric, own.sigma)
        self.definite = factorize_definite_roughly(lambda: weighted(collected, metric), self.linear_solver)
        half_solve = self.definite.half_solve
        self.basis = ReducedBasis(collected, parameter, metric, own.sigma, half_solve, self.linear_solver)
        unheld = collected.free_motions().motions
        if unheld.shape[1]:
            self.basis.append(unheld)  # first, so that the basis has them exactly
        self.basis.append(np.asarray(own.V))
        if own.has_slow:
            self.basis.expect_slow_motions()
        first = self.modes(start)
        if not len(first):
            raise NotConvergedError("the basis of another problem has no modes in the range that was asked for")
        self.basis.calibrate(start, first)

    def modes(self, value: float) -> Modes:
        """Return the modes asked for at one value, with vectors of length r and the errors of the projection."""
        return self._estimated(value)[0]

    def error(self, value: float) -> float:
        """Return the largest estimated error of λ at a value, relative to |λ|, of modes that swing or grow."""
        modes, _, relative = self._estimated(value)
        return float(relative[is_needed(modes)].max(initial=0.0))
