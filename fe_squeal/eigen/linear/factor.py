"""What a sparse direct solver gives, whichever it is: the protocol of solvers and of their factors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from ...errors import NotConvergedError

Solve = Callable[[np.ndarray], np.ndarray]


class SingularError(NotConvergedError):
    """A matrix is singular to working precision; versions of PARDISO tell it at a solve only."""


class Factor(Protocol):
    """A factorised real or complex matrix A."""

    @property
    def negative_pivots(self) -> int | None:
        """Number of negative eigenvalues of a real symmetric A (Sylvester's law of inertia); None where not known."""

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b for b (n,) or (n, k), real or complex."""

    def solve_transposed(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᵀ b for b (n,) or (n, k)."""

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻ᴴ b for b (n,) or (n, k)."""


class DefiniteFactor(Protocol):
    """Factors A = LLᵀ of a real symmetric positive definite matrix, up to the order of rows."""

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b for b (n,) or (n, k) real."""

    def solve_adjoint(self, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹ b for b (n,) or (n, k), since A is real and symmetric."""

    def half_solve(self, b: np.ndarray) -> np.ndarray:
        """Return L⁻ᵀ b for b (n,) or (n, k), with A = LLᵀ: for random b of unit covariance that of L⁻ᵀ b is A⁻¹."""


class LinearSolver(Protocol):
    """A sparse direct solver.

    It may have an attribute `rough`: a solver whose factors are smaller and less exact, such as those in single
    precision, for solves that are corrected anyway. That one is also given matrices in single precision (float32,
    complex64), with right-hand sides in double precision.
    """

    @property
    def name(self) -> str:
        """As run.json gives it."""

    def factorize(self, A: sp.csr_array, symmetric: bool) -> Factor:
        """Factorise a matrix (n, n), real or complex.

        Parameters
        ----------
        symmetric : bool
            Whether A = Aᵀ, also where it is complex.

        Raises
        ------
        SingularError
            If a pivot is zero. A solver may perturb what rounding leaves of a singular matrix instead, which backward
            errors then show.
        TooLargeError
            If the factors do not fit into memory.
        """

    def factorize_definite(self, A: sp.csr_array) -> DefiniteFactor:
        """Factorise a real symmetric positive definite matrix (n, n) with a positive diagonal.

        Raises
        ------
        NotConvergedError
            If it is not positive definite.
        TooLargeError
        """

    def memory(self, A: sp.csr_array, symmetric: bool, definite: bool = False) -> int:
        """Return about how many bytes the factors of a matrix will take, without computing them."""


def solve_real_parts(solve: Solve, b: np.ndarray) -> np.ndarray:
    """Return A⁻¹ b for complex b (n,) or (n, k), by solving for its real and imaginary parts as real columns."""
    if not np.iscomplexobj(b):
        return np.asarray(solve(b))
    columns = b.reshape(len(b), -1)
    x = solve(np.hstack([columns.real, columns.imag]))
    k = columns.shape[1]
    return np.asarray(x[:, :k] + 1j * x[:, k:]).reshape(b.shape)
