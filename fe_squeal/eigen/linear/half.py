"""A⁻¹ᐟ² of a definite matrix, from solves with shifted ones alone: for solvers that have no solves with triangles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.special import ellipj, ellipk

from .factor import Solve
from .spread_matrix import in_rows, sizes_times

_LOST = 2e-2  # relative error of A⁻¹ᐟ² b that is accepted: norms of random samples are uncertain by 15 % anyway
_STEPS = 12  # number of steps of the power method for the smallest eigenvalue
_BELOW = 0.5  # times what the power method finds, which is too large: taken for the smallest eigenvalue
_SEED = 20251124


def inverse_root(
    A: sp.csr_array, solve: Solve, factorize: Callable[[sp.csr_array], Solve], lost: float = _LOST
) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function b ↦ Z b with Z Zᵀ = A⁻¹, for a real symmetric positive definite A (n, n).

    With D the diagonal of A and B = D⁻¹ᐟ²AD⁻¹ᐟ², whose eigenvalues lie in [m, M],

        Z = D⁻¹ᐟ² B⁻¹ᐟ²,   B⁻¹ᐟ² ≈ Σ c_j (B + s_j)⁻¹,   s_j > 0,

    the trapezoidal rule for the integral of z⁻¹ᐟ²(z − B)⁻¹ in elliptic coordinates, with N terms wrong by
    e^(−π²N/(ln(M/m) + 3)) (Hale, Higham, Trefethen, SIAM J. Numer. Anal. 46, 2008, method 3).

    Parameters
    ----------
    solve : callable
        A⁻¹ b.
    factorize : callable
        Returns the solves with a matrix that is positive definite, too; its factors are given up after one block.
    lost : float
        Relative error of Z.
    """
    scale = 1 / np.sqrt(A.diagonal())
    largest = float((scale * sizes_times(A, scale)).max())  # at least the largest sum of a row of |B|
    x = np.random.default_rng(_SEED).standard_normal(A.shape[0])
    smallest = largest
    for _ in range(_STEPS):  # B⁻¹ = D^½ A⁻¹ D^½
        x /= np.linalg.norm(x)
        x = solve(x / scale) / scale
        smallest = 1 / float(np.linalg.norm(x))
    shifts, weights = _nodes(_BELOW * smallest, largest, lost)

    def apply(b: np.ndarray) -> np.ndarray:
        total = np.zeros_like(b, dtype=float)
        for s, c in zip(shifts, weights, strict=True):
            # (B + s)⁻¹ b = D^½ (A + sD)⁻¹ D^½ b, and Z takes D⁻¹ᐟ² of it
            inner = factorize(in_rows(A + sp.diags_array(s / scale**2)))
            total += c * inner((b.T / scale).T)
        return total

    return apply


def _nodes(smallest: float, largest: float, lost: float) -> tuple[np.ndarray, np.ndarray]:
    """Return shifts and weights of A⁻¹ᐟ² for spectra between two numbers."""
    ratio = smallest / largest
    count = int(np.ceil((np.log(1 / ratio) + 3) * np.log(1 / lost) / np.pi**2)) + 1
    quarter = ellipk(1 - ratio)
    sn, cn, dn, _ = ellipj((np.arange(count) + 0.5) * quarter / count, 1 - ratio)
    return smallest * (sn / cn) ** 2, 2 * quarter * np.sqrt(smallest) / (np.pi * count) * dn / cn**2
