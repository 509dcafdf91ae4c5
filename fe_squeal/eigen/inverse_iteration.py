"""Modes that miss the tolerance, improved one by one by inverse iteration beside their eigenvalues.

Where one part of a structure is far softer than the rest, a search from a shift amid its modes leaves rounding of the
search space in the stiff part, whose forces are then large beside all others. A solve beside the eigenvalue takes that
out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..errors import NotConvergedError
from .linear.choice import factorize
from .linear.factor import LinearSolver
from .linear.spread_matrix import in_rows
from .pencil import Modes, Pencil
from .quality import backward_errors, modes_from_lambda, modes_from_theta

_STEPS = 3
_ASIDE = 1e-5  # relative distance from an eigenvalue at which a step gains five digits, and pivots are not perturbed
_WELL = 0.1  # of the tolerance: what an improved mode meets
_ROOM = 0.25  # of the distance to the next eigenvalue: one that moves farther may have become that one


def improved(
    pencil: Pencil, modes: Modes, inexact: np.ndarray, tolerance: float, linear_solver: LinearSolver | str
) -> Modes:
    """Return modes with the inexact ones improved; as they are where one of these does not come to meet the tolerance.

    Multiple eigenvalues are left as they are, since their modes might become one.

    Parameters
    ----------
    modes : Modes
        With left ones.
    inexact : (k,) bool
        Those whose backward errors are too large.
    tolerance : float
        Largest backward error accepted.
    """
    assert modes.left is not None
    # Without damping there is one θ = −λ² of the two ±λ of a divergence.
    once = np.ones(len(modes), bool)
    if pencil.C is None and not pencil.is_complex:
        once = (modes.lam.imag != 0) | (modes.lam.real <= 0)
    lam, right, left = modes.lam[once], modes.right[:, once], modes.left[:, once]
    values = lam.copy() if pencil.C is not None else -(lam**2)
    right, left = (x.astype(complex) for x in (right, left))
    for i in np.flatnonzero(inexact[once]):
        room = _ROOM * np.abs(np.delete(values, i) - values[i]).min(initial=np.inf)
        pair = _iterated(pencil, values[i], right[:, i], left[:, i], tolerance, linear_solver)
        if pair is None or abs(pair[0] - values[i]) > room:
            return modes
        values[i], right[:, i], left[:, i] = pair
    if not values.imag.any() and pencil.C is None and not pencil.is_complex:
        values, right, left = values.real, right.real, left.real
    modes_from = modes_from_theta if pencil.C is None else modes_from_lambda
    better = modes_from(pencil, values, right, left, modes.method)
    return replace(better, exhaustive=modes.exhaustive, beyond=modes.beyond, unsearched=modes.unsearched)


def _iterated(
    pencil: Pencil, value: complex, x: np.ndarray, y: np.ndarray, tolerance: float, linear_solver: LinearSolver | str
) -> tuple[complex, np.ndarray, np.ndarray] | None:
    """Return θ, or λ with C, and its vectors (n,) after the steps that meet the tolerance; None if none does."""
    d = pencil.units[0]
    D = sp.diags_array(d)
    for _ in range(_STEPS):
        near = value * (1 + _ASIDE)
        A = sp.csr_array(D @ _matrix(pencil, near if near.imag else near.real) @ D)
        try:
            factor = factorize(A, pencil.symmetric and pencil.C is None, linear_solver)
        except NotConvergedError:
            return None
        slope = _slope(pencil, value)
        x, y = d * factor.solve(d * (slope @ x)), d * factor.solve_adjoint(d * (slope.conj().T @ y))
        x, y = x / np.linalg.norm(x / d), y / np.linalg.norm(y / d)
        weight = np.vdot(y, slope @ x)
        if not np.isfinite(weight) or not weight:
            return None
        value = value - complex(np.vdot(y, _matrix(pencil, value) @ x) / weight)
        lam = np.array([value]) if pencil.C is not None else 1j * np.sqrt(np.array([value]))
        if backward_errors(pencil, lam, x[:, None])[0] <= _WELL * tolerance:
            return value, x, y
    return None


def _matrix(pencil: Pencil, value: complex) -> sp.csr_array:
    """Return K − θM, or λ²M + λC + K."""
    if pencil.C is None:
        return in_rows(pencil.K - value * pencil.M)
    return in_rows(value**2 * pencil.M + value * pencil.C + pencil.K)


def _slope(pencil: Pencil, value: complex) -> sp.csr_array:
    """Return the derivative of that matrix."""
    return in_rows(-pencil.M if pencil.C is None else 2 * value * pencil.M + pencil.C)
