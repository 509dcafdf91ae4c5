"""Shapes of a reduced model made as exact as those of a direct solve, for what is written or looked at."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment

from ..eigen.blocks import combine, cross, lift
from ..eigen.dense import solve_dense
from ..eigen.linear.factor import Factor
from ..eigen.pencil import Modes, Pencil
from ..eigen.quality import backward_errors
from .vectors import real_columns

_ROUNDS = 8
_FINE = 1e-8  # part of a unit vector: directions in which columns of length 1 differ by less are left out


def corrected_shapes(
    pencil: Pencil, modes: Modes, wanted: np.ndarray, factorize: Callable[[], Factor], tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return shapes whose backward error meets a tolerance, and these errors.

    The error of λ of a two-sided reduced model is the product of the errors of right and left modes; the error of the
    shape is that of the right mode alone, and larger. Residuals Q(λ)φ, solved for with the factors of a matrix near
    Q(λ), span what is missing; on the modes and these corrections the eigenproblem is solved again (block Davidson:
    Sleijpen and van der Vorst, SIAM Rev. 42, 2000).

    Parameters
    ----------
    pencil : Pencil
        Pencil of the problem, n unknowns.
    modes : Modes
        Right vectors (n, m) of the reduced model, those wanted and their neighbours.
    wanted : (k,) int
        Positions among them.
    factorize : callable
        Returns factors of Q(λ) for a λ somewhere in the range of these modes, or of a matrix near it; called if a shape
        misses the tolerance.
    tolerance : float

    Returns
    -------
    shapes : (n, k) complex
    errors : (k,)
        Above the tolerance where the corrections did not get that far.
    """
    lam = modes.lam[wanted]
    basis = _beside(np.zeros((len(modes.right), 0)), real_columns(modes.right))
    best = modes.right[:, wanted].astype(complex)
    errors = backward_errors(pencil, lam, best)
    factor = None
    for _ in range(_ROUNDS):
        bad = np.flatnonzero(errors > tolerance)
        if not len(bad):
            break
        rest = pencil.apply(lam[bad], best[:, bad])
        factor = factor or factorize()
        steps = factor.solve(rest)
        basis = np.hstack([basis, _beside(basis, real_columns(steps))])
        found = solve_dense(_projected(pencil, basis))
        _, at = linear_sum_assignment(np.abs(lam[:, None] - found.lam[None, :]))
        shapes = lift(basis, found.right[:, at].astype(complex))
        now = backward_errors(pencil, lam, shapes)
        better = now < errors
        best[:, better], errors[better] = shapes[:, better], now[better]
    return best, errors


def _beside(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the parts of columns that lie outside an orthonormal basis."""
    for _ in range(2):  # the second time removes what rounding left
        columns = columns - combine(basis, cross(basis, columns))
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    Q, R, _ = la.qr(columns, mode="economic", pivoting=True)
    size = np.abs(R.diagonal())
    Q = Q[:, size > _FINE * size.max(initial=0.0)]
    return np.asarray(la.qr(Q - combine(basis, cross(basis, Q)), mode="economic")[0])


def _projected(pencil: Pencil, basis: np.ndarray) -> Pencil:
    M, C, K = (
        None if A is None else sp.csr_array(cross(basis, A @ basis)) for A in (pencil.M, pencil.C, pencil.K)
    )
    assert M is not None and K is not None
    return Pencil(M, K, C, pencil.symmetric)
