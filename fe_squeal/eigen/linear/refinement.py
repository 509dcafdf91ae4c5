"""Solves to full accuracy with factors that are not quite those of the matrix."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .factor import Solve

_SEED, _COLUMNS, _STEPS = 20261123, 4, 4  # of random right-hand sides, and how many steps measure the contraction
_ROUNDING = 1e-16  # relative: an error below this is rounding
_GAIN = 0.5  # times the last residual: if a step leaves more than this, only rounding is left
RANGE = 1e20  # a matrix whose largest entry is beyond this or its inverse is not brought to single precision
_TINY = np.finfo(float).tiny


def contraction(A: sp.csr_array, solve: Solve, steps: int = _STEPS) -> float:
    """Return about the spectral radius ρ of 1 − AB⁻¹, where B⁻¹ is what `solve` applies, for a matrix A (n, n).

    A step x + B⁻¹(b − Ax) leaves ρ of an error. If ρ < 1 then B + t(A − B) is singular for no t from 0 to 1, so that A
    has as many negative eigenvalues as B where both are symmetric.
    """
    unit, largest = _units(A), 0.0
    rest = np.random.default_rng(_SEED).standard_normal((A.shape[0], _COLUMNS)) / unit[:, None]
    for _ in range(steps):
        rest = rest / np.maximum(_sizes(rest, unit), _TINY)
        rest = rest - _product(A, solve(rest))
        largest = max(largest, float(_sizes(rest, unit).max()))
    return largest


def refined(A: sp.csr_array, solve: Solve, b: np.ndarray, rho: float) -> np.ndarray:
    """Return A⁻¹ b for b (n,) or (n, k), by as many steps of iterative refinement as a contraction ρ < 1 asks for."""
    columns = b.reshape(len(b), -1)
    x, unit, before = solve(columns), _units(A), np.full(columns.shape[1], np.inf)
    for _ in range(int(np.ceil(np.log(_ROUNDING) / np.log(np.clip(rho, _ROUNDING, _GAIN))))):
        rest = columns - A @ x
        size = _sizes(rest, unit)
        better = np.flatnonzero(size < _GAIN * before)
        if not len(better):
            break
        before[better] = size[better]
        x[:, better] += solve(rest[:, better])
    return np.asarray(x.reshape(b.shape))


def residual_of_products(A: sp.csr_array, solve: Solve) -> float:
    """Return the relative residual ‖b − AB⁻¹b‖/‖b‖ of b = Ax, where B⁻¹ is what `solve` applies, for random x (n,).

    The largest of a few. Rows are weighed by the diagonal of A (n, n), as in `contraction`; unlike there, b has no part
    that a singular A cannot give, so that it tells good factors from poor ones where both are of nearly singular ones.
    """
    unit = _units(A)
    b = _product(A, np.random.default_rng(_SEED).standard_normal((A.shape[0], _COLUMNS)) * unit[:, None])
    rest = _sizes(b - _product(A, solve(b)), unit)
    return float((rest / np.maximum(_sizes(b, unit), _TINY)).max())


def in_single(A: sp.csr_array) -> sp.csr_array:
    """Return a matrix in single precision, which shares its indices; itself where numbers are too large or too small.

    Examples
    --------
    >>> [in_single(sp.csr_array([[a]])).dtype.name for a in (2.0, 2e30, 2j)]
    ['float32', 'float64', 'complex64']
    """
    if not 1 / RANGE < largest_part(A) < RANGE:
        return A
    kind = np.complex64 if np.iscomplexobj(A) else np.float32
    return sp.csr_array((A.data.astype(kind), A.indices, A.indptr), shape=A.shape)


def largest_part(A: sp.csr_array) -> float:
    """Return the size of the largest real or imaginary part among the entries of a matrix, without a copy of them.

    Examples
    --------
    >>> largest_part(sp.csr_array([[1 - 3j]]))
    3.0
    """
    parts = A.data.view(A.data.real.dtype)
    return float(max(parts.max(initial=0.0), -parts.min(initial=0.0)))


def _product(A: sp.csr_array, x: np.ndarray) -> np.ndarray:
    """Return Ax, without a copy of A in double precision if it is in single."""
    single = A.dtype in (np.float32, np.complex64)
    return np.asarray(A @ (x.astype(np.complex64 if np.iscomplexobj(x) else np.float32) if single else x))


def _units(A: sp.csr_array) -> np.ndarray:
    """Return (n,) what rows are multiplied with before their residuals are compared."""
    diagonal = np.abs(A.diagonal())
    size = diagonal if diagonal.all() else np.where(diagonal > 0, diagonal, abs(A).max(axis=1).toarray().ravel())
    return np.asarray(1 / np.sqrt(np.where(size > 0, size, 1.0)))


def _sizes(rest: np.ndarray, unit: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(unit[:, None] * rest, axis=0))
