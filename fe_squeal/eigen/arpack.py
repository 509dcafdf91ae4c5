"""Modes nearest a shift by ARPACK on the shift-inverted operator."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from scipy.sparse.linalg import ArpackError, ArpackNoConvergence, LinearOperator, eigs, eigsh
from threadpoolctl import ThreadpoolController

from ..errors import NotConvergedError
from .linear_solvers import Factor, solver_name
from .pencil import Modes, Pencil
from .quality import modes_from_lambda, modes_from_theta

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
    """Return the `count` modes of K φ = θ M φ nearest sigma, right and left, by Arnoldi in real arithmetic.

    Parameters
    ----------
    factor : Factor
        Of K − sigma M; its transposed solves give the left modes.
    """
    theta, right = _arnoldi(pencil, factor.solve, sigma, count)
    theta_left, left = _arnoldi(pencil, factor.solve_transposed, sigma, count)
    # A conjugate pair at the rim may be in one of the two sets only: keep what both have.
    agree = np.abs(theta[:, None] - theta_left[None, :].conj()) <= 1e-6 * (np.abs(theta[:, None]) + np.abs(sigma))
    theta, right, left = theta[agree.any(axis=1)], right[:, agree.any(axis=1)], left[:, agree.any(axis=0)]
    if right.shape[1] != left.shape[1]:
        raise NotConvergedError(
            f"left and right modes near {np.sqrt(abs(sigma)) / (2 * np.pi):.6g} Hz do not pair:"
            f" {right.shape[1]} right, {left.shape[1]} left"
        )
    return modes_from_theta(pencil, theta, right, left, _method())


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
    lam_left, left = _linearised(pencil.transposed(), factor.solve_transposed, sigma, count)
    index = np.argmin(np.abs(lam[:, None] - lam_left[None, :].conj()), axis=1)
    agree = np.abs(lam - lam_left[index].conj()) <= 1e-6 * (np.abs(lam) + sigma)
    # The left mode of λ* belongs to the conjugate row: ψᴴQ(λ) = 0 is Q(λ*)ᵀψ = 0.
    upper = agree & (lam.imag >= 0)
    if len(set(index[upper])) < upper.sum():
        raise NotConvergedError("left and right damped modes do not pair: eigenvalues closer than 1e-6 of their size")
    return modes_from_lambda(pencil, lam[upper], right[:, upper], left[:, index[upper]], _method())


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

    operator = LinearOperator((2 * n, 2 * n), matvec=apply, dtype=float)
    k = 2 * count
    nu, z = _run(
        lambda: eigs(operator, k, which="LM", tol=_TOLERANCE, v0=_start(2 * n), ncv=_basis_size(k, 2 * n)), k
    )
    return sigma + 1 / nu, z[:n]


def _arnoldi(
    pencil: Pencil, solve: Callable[[np.ndarray], np.ndarray], sigma: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (θ, vectors) of the standard problem (K − σM)⁻¹M φ = ν φ, θ = σ + 1/ν."""
    operator = LinearOperator((pencil.n, pencil.n), matvec=lambda x: solve(pencil.M @ x), dtype=float)
    nu, vectors = _run(
        lambda: eigs(
            operator, count, which="LM", tol=_TOLERANCE, v0=_start(pencil.n), ncv=_basis_size(count, pencil.n)
        ),
        count,
    )
    return sigma + 1 / nu, vectors


def _run(call: Callable[[], tuple[np.ndarray, np.ndarray]], count: int) -> tuple[np.ndarray, np.ndarray]:
    # OpenBLAS's threads and those of MKL under PARDISO wait for each other in turn; the small products of ARPACK are
    # several times faster on one.
    try:
        with _openblas().limit(limits=1):
            return call()
    except ArpackNoConvergence as error:
        raise NotConvergedError(
            f"ARPACK: {len(error.eigenvalues)} of {count} modes converged", partial=error.eigenvalues
        ) from error
    except ArpackError as error:
        raise NotConvergedError(f"ARPACK: {error}") from error


@functools.cache
def _openblas() -> ThreadpoolController:
    return ThreadpoolController().select(internal_api="openblas")


def _basis_size(count: int, n: int) -> int:
    return min(n, max(2 * count + 1, 20))


def _start(n: int) -> np.ndarray:
    return np.random.default_rng(_SEED).standard_normal(n)


def _method() -> str:
    return f"shift-invert ARPACK, {solver_name()}"
