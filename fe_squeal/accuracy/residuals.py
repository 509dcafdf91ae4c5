"""Residuals on the refined mesh of modes of the mesh itself, at several values of the parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import combine, lift, times
from ..eigen.pencil import Modes
from ..problem.terms import Term
from ..reduced.vectors import thin_svd, unit_columns
from .refined import Refined

_SPARSE = 0.3  # of all rows: a term that acts in fewer is multiplied in these rows alone
_SAME = 1e-8  # part of a mode outside the span of others, relative to it, that is left out: it is rounding

_Product: TypeAlias = tuple[np.ndarray | slice, np.ndarray]


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
        U, size, _ = thin_svd(np.hstack([unit_columns(*_both(m)) for m in modes]))
        self._span = U[:, size > _SAME * size.max(initial=0.0)]
        X = times(refined.prolongation, combine(refined.model.basis.V, self._span))
        self._right = [_product(term.matrix, X) for term in self._problem.terms]
        self._left = [
            _transposed(AX, term, X)
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

    def _combined(self, products: list[_Product], shapes: np.ndarray, factors: list[np.ndarray]) -> np.ndarray:
        own = self._span.T @ shapes
        total = np.zeros((self._problem.unknowns, shapes.shape[1]), np.result_type(own, *factors))
        for (rows, B), c in zip(products, factors, strict=True):
            total[rows] += lift(B, own * c)
        return total


def _product(A: sp.csr_array, X: np.ndarray) -> _Product:
    """Return the rows in which A has entries and these rows of AX: friction acts in few."""
    rows = np.flatnonzero(np.diff(A.indptr))
    if len(rows) >= _SPARSE * A.shape[0]:
        return slice(None), times(A, X)
    return rows, times(sp.csr_array(A[rows]), X)


def _transposed(product: _Product, term: Term, X: np.ndarray) -> _Product:
    """Return the product of a term's transposed matrix with X from that of the matrix itself, where they differ."""
    if term.symmetric:
        return product
    if term.skew:
        return product[0], -product[1]
    return _product(term.matrix.T.tocsr(), X)


def _both(modes: Modes) -> tuple[np.ndarray, np.ndarray]:
    assert modes.left is not None
    return modes.right, modes.left
