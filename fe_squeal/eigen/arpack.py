"""Modes nearest a shift by ARPACK on the shift-inverted operator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse.linalg import ArpackError, ArpackNoConvergence, LinearOperator, eigs, eigsh

from ..errors import NotConvergedError
from .linear_solvers import Factor, solver_name
from .pencil import Modes, Pencil
from .quality import in_upper_half, modes_from_lambda, modes_from_theta
from .threads import one_openblas_thread

_SEED = 20240607
# Relative accuracy asked of 1/(θ−σ): the residuals of the modes then lie at rounding level, and a little looser saves
# little, because the last digits come with the last restart.
_TOLERANCE = 1e-13


def symmetric_modes(pencil: Pencil, factor: Factor, sigma: float, count: int) -> Modes:
    """Return the `count` modes of K φ = θ M φ nearest sigma, K symmetric, by Lanczos.

    Parameters
    ----------
    factor : Factor
        Of K − sigma M.
    """
    operator = LinearOperator((pencil.n, pencil.n), matvec=factor.solve, dtype=float)
    theta, phi = _run(
        lambda: eigsh(
            pencil.K, count, M=pencil.M, sigma=sigma, OPinv=operator, tol=_TOLERANCE, v0=_start(pencil.n),
            ncv=_basis_size(count, pencil.n),
        ),
        count,
    )  # fmt: skip
    return modes_from_theta(pencil, theta, phi, phi, _method())


def nonsymmetric_modes(pencil: Pencil, factor: Factor, sigma: float, count: int) -> Modes:
    """Return the `count` modes of K φ = θ M φ nearest sigma, right and left, by Arnoldi in the arithmetic of K.

    Parameters
    ----------
    factor : Factor
        Of K − sigma M; its adjoint solves give the left modes, unless K = Kᵀ is complex: these are φ* then.
    """
    theta, right = _arnoldi(pencil, factor.solve, sigma, count)
    if pencil.is_complex and pencil.symmetric:
        theta_left, left = theta.conj(), right.conj()
    else:
        theta_left, left = _arnoldi(pencil, factor.solve_adjoint, sigma, count)
    inner, inner_left = _common(theta, theta_left, sigma)
    theta, right = theta[inner], right[:, inner]
    _, partner = linear_sum_assignment(np.abs(theta[:, None] - theta_left[None, inner_left].conj()))
    left = left[:, inner_left[partner]]
    return modes_from_theta(pencil, theta, right, left, _method())


def _common(theta: np.ndarray, theta_left: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of right and left eigenvalues inside the widest clear ring around sigma.

    Inside, both sets are the same; at the rim a conjugate pair or a multiple eigenvalue may be cut by one of them.

    Raises
    ------
    NotConvergedError
    """
    radius, radius_left = np.abs(theta - sigma), np.abs(theta_left - sigma)
    order = np.sort(radius)
    for m in range(len(order) - 1, 0, -1):
        if order[m] - order[m - 1] > 1e-6 * order[m]:
            middle = (order[m] + order[m - 1]) / 2
            inner, inner_left = np.flatnonzero(radius < middle), np.flatnonzero(radius_left < middle)
            if len(inner) == len(inner_left):
                return inner, inner_left
    raise NotConvergedError(f"the {len(theta)} right and {len(theta_left)} left modes nearest the shift do not pair")


def quadratic_modes(pencil: Pencil, factor: Factor, sigma: float, count: int) -> Modes:
    """Return the modes of (λ²M + λC + K) φ = 0 among the 2·count eigenvalues nearest a real sigma, rad/s.

    The linearisation in (u, λu) is inverted with the n×n factors of Q(σ) alone: (u, v) of (A − σ)(u, v) = (a, b) is
    u = −Q(σ)⁻¹(Mb + (C + σM)a), v = σu + a. The second half is scaled by |σ|, so that both weigh alike.

    Parameters
    ----------
    factor : Factor
        Of Q(σ) = σ²M + σC + K.
    """
    lam, right = _linearised(pencil, factor.solve, sigma, count)
    lam_left, left = _linearised(pencil.transposed(), factor.solve_adjoint, sigma, count)
    inner, inner_left = _common(lam, lam_left, sigma)
    lam, right = lam[inner], right[:, inner]
    # The left mode of λ is the transposed problem's mode of λ*: ψᴴQ(λ) = 0 is Q(λ)ᴴψ = 0.
    _, partner = linear_sum_assignment(np.abs(lam[:, None] - lam_left[None, inner_left].conj()))
    left, upper = left[:, inner_left[partner]], in_upper_half(pencil, lam)
    return modes_from_lambda(pencil, lam[upper], right[:, upper], left[:, upper], _method())


def _linearised(
    pencil: Pencil, solve: Callable[[np.ndarray], np.ndarray], sigma: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (λ, u) of the 2n×2n linearisation nearest sigma."""
    M, C, n = pencil.M, pencil.C, pencil.n
    assert C is not None

    def apply(z: np.ndarray) -> np.ndarray:
        a, b = z[:n], z[n:] * sigma
        u = -solve(M @ (b + sigma * a) + C @ a)
        return np.concatenate([u, u + a / sigma])

    operator = LinearOperator((2 * n, 2 * n), matvec=apply, dtype=pencil.K.dtype)
    k = 2 * count
    v0 = _start(2 * n).astype(pencil.K.dtype)
    nu, z = _run(lambda: eigs(operator, k, which="LM", tol=_TOLERANCE, v0=v0, ncv=_basis_size(k, 2 * n)), k)
    return sigma + 1 / nu, z[:n]


def _arnoldi(
    pencil: Pencil, solve: Callable[[np.ndarray], np.ndarray], sigma: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (θ, vectors) of the standard problem (K − σM)⁻¹M φ = ν φ, θ = σ + 1/ν."""
    operator = LinearOperator((pencil.n, pencil.n), matvec=lambda x: solve(pencil.M @ x), dtype=pencil.K.dtype)
    v0, basis = _start(pencil.n).astype(pencil.K.dtype), _basis_size(count, pencil.n)
    nu, vectors = _run(lambda: eigs(operator, count, which="LM", tol=_TOLERANCE, v0=v0, ncv=basis), count)
    return sigma + 1 / nu, vectors


def _run(call: Callable[[], tuple[np.ndarray, np.ndarray]], count: int) -> tuple[np.ndarray, np.ndarray]:
    try:
        with one_openblas_thread():
            return call()
    except ArpackNoConvergence as error:
        raise NotConvergedError(
            f"ARPACK: {len(error.eigenvalues)} of {count} modes converged", partial=error.eigenvalues
        ) from error
    except ArpackError as error:
        raise NotConvergedError(f"ARPACK: {error}") from error


def _basis_size(count: int, n: int) -> int:
    return min(n, max(2 * count + 1, 20))


def _start(n: int) -> np.ndarray:
    return np.random.default_rng(_SEED).standard_normal(n)


def _method() -> str:
    return f"shift-invert ARPACK, {solver_name()}"
