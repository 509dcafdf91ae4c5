"""Motions that grow and of which loss factors say nothing: they are told, since they count as marginal."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from ..eigen.growth import may_grow_dense
from ..eigen.pencil import Modes, Pencil

_SMALL = 800  # unknowns up to which real eigenvalues are looked for without losses
_REAL = 1e-9  # of |λ|: an imaginary part that is smaller is rounding
_RATE = 1e-6  # of the largest |λ|: growth that is slower is rounding


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
            found = _fastest(M, K.real) if C is None else _largest_real(M, C, K.real, least)
    return found if found > least else 0.0


def _fastest(M: np.ndarray, K: np.ndarray) -> float:
    """Return the largest real λ of λ²M + K, 0 where there is none."""
    theta = la.eigvals(K, M)
    real = theta.real[np.isfinite(theta) & (np.abs(theta.imag) <= _REAL * np.abs(theta)) & (theta.real < 0)]
    return float(np.sqrt(-real).max(initial=0.0))


def _largest_real(M: np.ndarray, C: np.ndarray, K: np.ndarray, least: float) -> float:
    """Return the largest real λ of λ²M + λC + K, 0 where none is above `least`, or M is singular."""
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
    lam = la.eigvals(A, la.block_diag(np.eye(n), M))
    real = lam.real[np.isfinite(lam) & (np.abs(lam.imag) <= _REAL * np.abs(lam)) & (lam.real > least)]
    return float(real.max(initial=0.0))
