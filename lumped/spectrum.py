"""Eigenvalues of (λ² M + λ C + K) u = 0 for single matrices and stacks, and how far to trust their real parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .springs import Floats

Complexes = NDArray[np.complex128]

# The entries are sums of a few products and LAPACK's backward error is a few units in the last place of the norm.
_PERTURBATION = 8 * np.finfo(float).eps
_SAMPLES = 8
_SAFETY = 2.0


@dataclass(frozen=True)
class Spectrum:
    """Eigenvalues and their uncertainty.

    Attributes
    ----------
    lam : (..., 2n) complex, rad/s
        Ascending by Im λ, then by Re λ.
    uncertainty : (..., 2n) float, rad/s
        How far rounding may have moved each λ.
    """

    lam: Complexes
    uncertainty: Floats

    @property
    def growth(self) -> Floats:
        """Largest Re λ, rad/s."""
        return np.asarray(self.lam.real.max(-1))

    @property
    def unstable(self) -> NDArray[np.bool_]:
        """Which systems have an eigenvalue whose real part is positive beyond its uncertainty."""
        return np.asarray((self.lam.real > self.uncertainty).any(-1))

    @property
    def stability(self) -> str:
        """`unstable`, `marginal` or `stable` (decaying), for a single system.

        Examples
        --------
        >>> from lumped import Minimal
        >>> [model.spectrum(0.5).stability for model in (Minimal(), Minimal(k2=20), Minimal(c1=1, c2=1, c3=1))]
        ['marginal', 'unstable', 'stable']
        """
        if self.lam.ndim != 1:
            raise ValueError(f"one system expected, got a stack of shape {self.lam.shape[:-1]}")
        if self.unstable:
            return "unstable"
        return "stable" if (self.lam.real < -self.uncertainty).all() else "marginal"


def solve_spectrum(M: Floats, C: Floats, K: Floats) -> Spectrum:
    """Solve (λ² M + λ C + K) u = 0 and estimate the rounding error of each λ.

    The error is the largest change of λ, twice over, among eight seeded perturbations of the entries of the state
    matrix by eight units in the last place of its largest one. Near a double eigenvalue λ moves by the square root of
    a perturbation: 1e-15 in the entries is 1e-8 in λ, and a growth rate of 1e-9 there says nothing. No formula for
    simple eigenvalues sees that, the perturbed matrices do.

    Parameters
    ----------
    M : (n, n) array, kg
        Diagonal.
    C : (..., n, n) array, N s/m
    K : (..., n, n) array, N/m

    Examples
    --------
    >>> import numpy as np
    >>> s = solve_spectrum(np.eye(2), np.zeros((2, 2)), np.array([[15.0, 7.5], [-1.8e-15, 15.0]]))
    >>> bool(s.growth > 1e-9), bool(s.unstable)
    (True, False)
    """
    A, undamped = _reduced(M, C, K)
    lam = _eigenvalues(A, undamped)
    rng = np.random.default_rng(20)
    scale = _PERTURBATION * np.abs(A).max((-2, -1), keepdims=True)
    noise = rng.uniform(-1, 1, (_SAMPLES, *A.shape[-2:]))
    moved = _eigenvalues(A[..., None, :, :] + scale[..., None, :, :] * noise, undamped)
    nearest = np.abs(lam[..., None, :, None] - moved[..., None, :]).min(-1)
    return Spectrum(lam, _SAFETY * nearest.max(-2))


def solve_eigenvalues(M: Floats, C: Floats, K: Floats) -> Complexes:
    """Solve (λ² M + λ C + K) u = 0 for all 2n eigenvalues of each matrix of a stack.

    Without damping λ = ±√(−θ) with θ of M^(−1/2) K M^(−1/2), so that λ → −λ holds to the last bit and a stable system
    has Re λ = 0; otherwise the state matrix is solved.

    Parameters
    ----------
    M : (n, n) array, kg
        Diagonal.
    C : (..., n, n) array, N s/m
    K : (..., n, n) array, N/m

    Returns
    -------
    (..., 2n) complex, rad/s
        Ascending by Im λ, then by Re λ.

    Examples
    --------
    >>> import numpy as np
    >>> solve_eigenvalues(np.eye(1), np.zeros((1, 1)), np.array([[[4.0]], [[9.0]]])).imag
    array([[-2.,  2.],
           [-3.,  3.]])
    """
    return _eigenvalues(*_reduced(M, C, K))


def mass_normalized(M: Floats, K: Floats) -> Floats:
    """Return M^(−1/2) K M^(−1/2) for a diagonal M and a stack of K."""
    w = 1 / np.sqrt(np.diagonal(M))
    return np.asarray(K * w[:, None] * w)


def state_matrix(M: Floats, C: Floats, K: Floats) -> Floats:
    """Return A of d/dt (q, q̇) = A (q, q̇), (..., 2n, 2n), for a diagonal M.

    Examples
    --------
    >>> import numpy as np
    >>> state_matrix(2 * np.eye(1), np.eye(1), 4 * np.eye(1))
    array([[ 0. ,  1. ],
           [-2. , -0.5]])
    """
    n = len(M)
    inverse = 1 / np.diagonal(M)[:, None]
    A = np.zeros((*np.broadcast_shapes(C.shape[:-2], K.shape[:-2]), 2 * n, 2 * n))
    A[..., :n, n:] = np.eye(n)
    A[..., n:, :n] = -inverse * K
    A[..., n:, n:] = -inverse * C
    return A


def _reduced(M: Floats, C: Floats, K: Floats) -> tuple[Floats, bool]:
    if C.any():
        return _balanced(state_matrix(M, C, K)), False
    shape = np.broadcast_shapes(C.shape, K.shape)
    return np.broadcast_to(mass_normalized(M, K), shape), True


def _balanced(A: Floats) -> Floats:
    """Return state matrices of (Ω q, q̇), so that their entries, and rounding in them, do not depend on units."""
    n = A.shape[-1] // 2
    stiffness, damping = (np.abs(X).max((-2, -1), keepdims=True) for X in (A[..., n:, :n], A[..., n:, n:]))
    rate = np.where(stiffness > 0, np.sqrt(stiffness), np.where(damping > 0, damping, 1.0))
    omega = 2.0 ** np.round(np.log2(rate))  # a power of two, by which scaling is exact
    A[..., :n, n:] *= omega
    A[..., n:, :n] /= omega
    return A


def _eigenvalues(A: Floats, undamped: bool) -> Complexes:
    values = np.linalg.eigvals(A).astype(complex)
    if undamped:
        root = np.sqrt(-values)
        values = np.concatenate([root, -root], axis=-1) + 0.0  # turns -0.0 into 0.0
    return np.take_along_axis(values, np.lexsort((values.real, values.imag)), -1)
