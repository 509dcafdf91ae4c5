"""What a factorised matrix can do, whichever solver made it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from ...errors import NotConvergedError

Solve = Callable[[np.ndarray], np.ndarray]


class SingularError(NotConvergedError):
    """A matrix is singular to working precision; versions of PARDISO tell it at a solve only."""


class Factor(Protocol):
    """A factorised real or complex matrix A."""

    negative_pivots: int | None
    """Number of negative eigenvalues of a real symmetric A (Sylvester's law of inertia); None where not known."""

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b for b (n,) or (n, k), real or complex."""

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b."""

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b."""


def by_parts(solve: Solve, b: np.ndarray) -> np.ndarray:
    """Solve for real and imaginary parts as columns of one real right-hand side."""
    if not np.iscomplexobj(b):
        return np.asarray(solve(b))
    columns = b.reshape(len(b), -1)
    x = solve(np.hstack([columns.real, columns.imag]))
    k = columns.shape[1]
    return np.asarray(x[:, :k] + 1j * x[:, k:]).reshape(b.shape)
