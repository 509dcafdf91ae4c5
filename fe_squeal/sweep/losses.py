"""Motions that grow and of which loss factors say nothing: they are told, since they count as marginal."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from ..eigen.growth import may_grow_dense
from ..eigen.lapack import inverse_of_companion, regular_lu
from ..eigen.pencil import Modes, Pencil

_SMALL = 800  # unknowns up to which real eigenvalues are looked for without losses
_REAL = 1e-9  # of |λ|: an imaginary part that is smaller is rounding
_RATE = 1e-6  # of the largest |λ|: growth that is slower is rounding
_TIMES, _TRIED = 4.0, 4  # from one shift that is tried to the next, and how many


def growth_beyond(pencil: Pencil, modes: Modes) -> float:
    """Return the largest growth rate, 1/s, of motions that swing, if at all, by their losses alone; 0 for none.

    K(1 + iη) is a law of oscillations, so that such modes count as marginal, see `quality`. Without dampers one that
    decays so has a partner that grows. With dampers it may be overdamped: what grows is in no list, see `Modes.beyond`.
    Losses may also turn slow growth into what seems to swing, so that it is looked for among the real eigenvalues of
    small matrices without their imaginary part.

    Parameters
    ----------
    pencil : Pencil
        With complex K (n, n).
    modes : Modes
    """
    lam = modes.lam
    least = _RATE * float(np.abs(lam).max(initial=0.0))
    unsure = modes.re_uncertainty >= np.abs(lam.real)
    beyond = lam[unsure & (np.abs(lam.real) >= np.abs(lam.imag)) & (np.abs(lam) > least)]
    found = float((np.abs(beyond.real) if pencil.C is None else beyond.real).max(initial=modes.beyond))
    if found <= least and pencil.n <= _SMALL:
        full = pencil.dense()
        M, K = np.asarray(full.M).real, np.asarray(full.K)
        C = None if full.C is None else np.asarray(full.C).real
        # Where the symmetric part of K is positive nothing diverges, and every θ has a positive real part.
        if may_grow_dense(M, C, K.real, max(least, np.finfo(float).tiny)):
            found = _largest_real(M, C, K.real, least, float(np.abs(lam).max(initial=0.0)) or 1.0)
    return found if found > least else 0.0


def _largest_real(M: np.ndarray, C: np.ndarray | None, K: np.ndarray, least: float, highest: float) -> float:
    """Return the largest real λ of λ²M + λC + K with real matrices (n, n), 0 where none is above `least`.

    Eigenvalues alone are asked of 1/(λ − s), or of 1/(λ² − s²) without C: a standard problem, several times cheaper
    than QZ. The symmetric parts show that no real λ is larger than the shift s, whose matrix is regular therefore.

    Parameters
    ----------
    highest : float, rad/s
        The smallest shift that is tried.
    """
    shift = next((s for s in highest * _TIMES ** np.arange(_TRIED) if not may_grow_dense(M, C, K, s)), None)
    least = max(least, _RATE * (shift or 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        if shift is None:
            lam = _by_qz(M, C, K)
        elif C is None:
            nu = la.eigvals(la.lu_solve(regular_lu(K + shift**2 * M), M))
            lam = np.sqrt((shift**2 - 1 / nu).astype(complex))  # θ + s² = 1/ν and λ² = −θ
        else:
            lam = shift * (1 + 1 / la.eigvals(inverse_of_companion(M, C, K, shift)[0]))
    real = lam.real[np.isfinite(lam) & (np.abs(lam.imag) <= _REAL * np.abs(lam)) & (lam.real > least)]
    return float(real.max(initial=0.0))


def _by_qz(M: np.ndarray, C: np.ndarray | None, K: np.ndarray) -> np.ndarray:
    if C is None:
        return np.asarray(np.sqrt(-la.eigvals(K, M).astype(complex)))
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
    return np.asarray(la.eigvals(A, la.block_diag(np.eye(n), M)))
