"""Modes nearest a shift by Krylov methods on the shift-inverted operator: ARPACK, or blocks."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..errors import NotConvergedError
from .free_modes import FreeModes
from .pencil import Modes, Pencil
from .quality import grow_below, in_upper_half, modes_from_lambda, modes_from_theta
from .shift_invert import Pairs, ShiftInverted


class UnpairedError(NotConvergedError):
    """The right and the left modes nearest a shift are not the same: with more of them sought these may be."""


def symmetric_modes(
    pencil: Pencil, operator: ShiftInverted, count: int, free: FreeModes | None = None
) -> tuple[Modes, float]:
    """Return the `count` modes of K φ = θ M φ nearest the shift, K symmetric, and the distance within which all are.

    The eigenpairs of motions that nothing holds are added to these, here and in the functions below; the operator is
    expected to have them projected out. They may lie far from the shift, beyond eigenvalues that were not found, so
    they do not count for the distance. Copies of multiple eigenvalues may be missing, and divergences (θ < 0) that lie
    far below the shift; see `counted_modes`.

    Returns
    -------
    modes : Modes
    reach : float
        That distance from the shift: of θ, rad²/s²; with C of λ, rad/s. Infinite if these are all modes.
    """
    theta, x = operator.largest_symmetric(count, "LM")
    every = count == operator.size or (len(theta) < count and operator.takes_all(count))
    reach = np.inf if every else _farthest(theta[theta > operator.sigma], operator.sigma)
    if free is not None:
        theta, x, _ = free.beside(theta, x, x)
    return modes_from_theta(pencil, theta, x, x, method_of(operator)), reach


def nonsymmetric_modes(
    pencil: Pencil, operator: ShiftInverted, count: int, free: FreeModes | None = None
) -> tuple[Modes, float]:
    """Return the `count` modes of K φ = θ M φ nearest the shift, right and left, and the distance within which all are.

    The left modes of a complex K = Kᵀ are φ*.
    """
    theta, right = operator.largest(count)
    every = len(theta) < count or count == operator.size
    if pencil.is_complex and pencil.symmetric:
        theta_left, left = theta.conj(), right.conj()
    else:
        theta_left, left = operator.largest(count, adjoint=True)
    inner, inner_left = _common(operator, (theta, right), theta_left, every)
    theta, right = theta[inner], right[:, inner]
    _, partner = linear_sum_assignment(np.abs(theta[:, None] - theta_left[None, inner_left].conj()))
    left = left[:, inner_left[partner]]
    reach = np.inf if every else _farthest(theta, operator.sigma)
    if free is not None:
        theta, right, left = free.beside(theta, right, left)
    return modes_from_theta(pencil, theta, right, left, method_of(operator)), reach


def quadratic_modes(
    pencil: Pencil, operator: ShiftInverted, count: int, free: FreeModes | None = None
) -> tuple[Modes, float]:
    """Return the modes of (λ²M + λC + K) φ = 0 among the 2·count eigenvalues nearest the shift, and the distance."""
    count = min(2 * count, operator.size)
    lam, right = operator.largest(count)
    every = len(lam) < count or count == operator.size
    lam_left, left = operator.largest(count, adjoint=True)
    inner, inner_left = _common(operator, (lam, right), lam_left.conj(), every)
    lam, right = lam[inner], right[:, inner]
    # The left mode of λ is the transposed problem's mode of λ*: ψᴴQ(λ) = 0 is Q(λ)ᴴψ = 0.
    _, partner = linear_sum_assignment(np.abs(lam[:, None] - lam_left[None, inner_left].conj()))
    left = left[:, inner_left[partner]]
    upper = in_upper_half(pencil, lam) | grow_below(pencil, lam)
    lam, right, left = lam[upper], right[:, upper], left[:, upper]
    reach = np.inf if every else _farthest(lam, operator.sigma)
    if free is not None:
        lam, right, left = free.beside(lam, right, left)
    return modes_from_lambda(pencil, lam, right, left, method_of(operator)), reach


def _farthest(values: np.ndarray, sigma: complex) -> float:
    """Return the distance from the shift of the farthest of eigenvalues (k,); 0 without any."""
    return float(np.abs(values - sigma).max(initial=0.0))


def _common(
    operator: ShiftInverted, pairs: Pairs, theta_left: np.ndarray, every: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of right and left eigenvalues inside the widest clear ring around the shift.

    Inside, both sets are the same; at the rim a conjugate pair or a multiple eigenvalue may be cut by one of them.

    Raises
    ------
    UnpairedError
        `partial` has the right ones, as of `ShiftInverted.largest`.
    """
    theta, sigma = pairs[0], operator.sigma
    if every and len(theta) == len(theta_left):
        return np.arange(len(theta)), np.arange(len(theta))
    radius, radius_left = np.abs(theta - sigma), np.abs(theta_left - sigma)
    order = np.sort(radius)
    for m in range(len(order) - 1, 0, -1):
        if order[m] - order[m - 1] > 1e-6 * order[m]:
            middle = (order[m] + order[m - 1]) / 2
            inner, inner_left = np.flatnonzero(radius < middle), np.flatnonzero(radius_left < middle)
            if len(inner) == len(inner_left):
                return inner, inner_left
    raise UnpairedError(
        f"the {len(theta)} right and {len(theta_left)} left modes nearest the shift do not pair",
        operator.eigenpairs(*pairs),
    )


def method_of(operator: ShiftInverted) -> str:
    """Return the name of the method with that of the linear solver."""
    blocks = operator.in_blocks and operator.pencil.problem_class != "symmetric"
    way = "block Krylov-Schur" if blocks else "ARPACK"
    return f"shift-invert {way}, {operator.linear_solver.name}"
