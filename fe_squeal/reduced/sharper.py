"""Critical values to more than a reduced model knows them: its basis with corrections of the critical modes."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..eigen.linear.factor import Factor
from ..eigen.pencil import Modes
from ..problem.problem import Problem
from .model import ReducedModel


class SharperModel:
    """A reduced model whose basis grows by corrections of critical modes, which leave the model itself as it is.

    The error of a critical value is the product of the residuals of its right and left mode. Both solved for with
    factors of Q at another value and frequency, they are corrections, which the projection on the larger basis
    improves further. So one factorisation serves many critical values.

    Parameters
    ----------
    model : ReducedModel
    """

    def __init__(self, model: ReducedModel) -> None:
        self._model, self._basis = model, model.basis.copy()

    @cached_property
    def problem(self) -> Problem:
        """The projected problem, its terms collected by powers of the parameter."""
        return self._basis.collected()

    def padded(self, vector: np.ndarray) -> np.ndarray:
        """Return a vector (m,) of the model, or of the basis before it grew, as one (r,) of the present basis."""
        return np.pad(vector, (0, len(self._basis) - len(vector)))

    def correct(self, value: float, lam: complex, right: np.ndarray, left: np.ndarray, factor: Factor) -> None:
        """Add the corrections of a mode to the basis.

        Parameters
        ----------
        value : float
            Of the parameter.
        lam : complex, rad/s
            The eigenvalue there.
        right, left : (r,) float or complex
            The right and left vector there, in coordinates of the present basis.
        factor : Factor
            Of Q(λ) at a value and a frequency that need not be these.
        """
        unknown = np.zeros(1)
        mode = Modes(np.array([lam]), right[:, None], left[:, None], unknown, unknown, unknown)
        self._model.correct(self._basis, value, mode, factor)
        self.__dict__.pop("problem", None)

    def root_error(
        self, value: float, lam: complex, right: np.ndarray, left: np.ndarray, here: Problem | None = None,
        crosses: bool = False,
    ) -> tuple[float, float]:  # fmt: skip
        """Return how far a critical value may be off for vectors (r,), see `ReducedModel.root_error`."""
        return self._basis.root_error(value, lam, right, left, self._model.highest, here=here, crosses=crosses)
