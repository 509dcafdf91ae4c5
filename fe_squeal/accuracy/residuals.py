"""Residuals on the refined mesh of modes of the mesh itself, at several values of the parameter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la

from ..eigen.blocks import combine, lift, times
from ..eigen.pencil import Modes
from ..reduced.vectors import unit_columns
from .refined import Refined

_SAME = 1e-8  # part of a mode outside the span of others, relative to it, that is left out: it is rounding


class Residuals:
    """The residuals r = Q(λ)φ and ρ = Q(λ)ᴴψ on the refined mesh of right and left modes of the mesh itself.

    Modes at different values of the parameter span nearly the same space. So the terms of the problem are multiplied
    once with what spans them all, and a residual is a combination of these products.

    Parameters
    ----------
    refined : Refined
    modes : sequence of Modes
        Of the model of the mesh itself, with left ones: all whose residuals will be asked for.
    """

    def __init__(self, refined: Refined, modes: Sequence[Modes]) -> None:
        self._problem, self._parameter = refined.problem, refined.parameter
        U, size, _ = la.svd(np.hstack([unit_columns(*_both(m)) for m in modes]), full_matrices=False)
        self._span = U[:, size > _SAME * size.max(initial=0.0)]
        X = times(refined.prolongation, combine(refined.model.basis.V, self._span))
        self._right = [times(term.matrix, X) for term in self._problem.terms]
        self._left = [
            AX if term.symmetric else times(term.matrix.T.tocsr(), X)
            for AX, term in zip(self._right, self._problem.terms, strict=True)
        ]

    def right(self, value: float, modes: Modes) -> np.ndarray:
        """Return r (n_fine, k) of modes at a value of the parameter."""
        return self._combined(self._right, modes.right, self._factors(value, modes))

    def left(self, value: float, modes: Modes) -> np.ndarray:
        """Return ρ (n_fine, k) of modes at a value of the parameter."""
        return self._combined(self._left, _both(modes)[1], [c.conj() for c in self._factors(value, modes)])

    def _factors(self, value: float, modes: Modes) -> list[np.ndarray]:
        at = self._problem.at({self._parameter: value})
        return [np.broadcast_to(t.factor(modes.lam, at.parameters), len(modes)) for t in at.terms]

    def _combined(self, products: list[np.ndarray], shapes: np.ndarray, factors: list[np.ndarray]) -> np.ndarray:
        own = self._span.T @ shapes
        return np.asarray(sum(lift(B, own * c) for B, c in zip(products, factors, strict=True)))


def _both(modes: Modes) -> tuple[np.ndarray, np.ndarray]:
    assert modes.left is not None
    return modes.right, modes.left
