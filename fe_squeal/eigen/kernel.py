"""The kernel of a stiffness matrix that nothing else is known of."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..errors import NotConvergedError
from .linear.choice import factorize
from .linear.factor import LinearSolver
from .multiple import ROUNDING
from .pencil import Pencil

_CANCELLED = 8 * ROUNDING  # of what cancels in Kz: a force that is zero but for rounding
_LEAST = 1e-3  # of the largest entry of a motion: what the others count at least when the size of a sum is measured
_DENSE = 400  # unknowns up to which a singular value decomposition is cheapest
_SHIFT = 1e-9  # of the largest ratio of stiffness to mass: nearer to zero than any elastic mode
_SEED, _BLOCK, _STEPS = 20251122, 8, 12
_GAIN = 0.5  # of a residual: what a further step has to leave of it at most, or it has come to its end


def null_columns(B: np.ndarray, least: float) -> np.ndarray:
    """Return orthonormal V (k, m) with ‖B V‖ ≤ least, for B (n, k)."""
    if not B.shape[1]:
        return np.zeros((0, 0))
    _, s, Vh = la.svd(B, full_matrices=len(B) < B.shape[1])
    s = np.append(s, np.zeros(B.shape[1] - len(s)))
    return np.asarray(Vh[s <= least].conj().T)


def amplitudes(Z: np.ndarray, d: np.ndarray | None = None) -> np.ndarray:
    """Return the sizes of the entries of Z (n, k), at least a share of the largest of their column.

    An entry that is zero by itself holds rounding of the larger ones, which is not what it cancels with.

    Parameters
    ----------
    d : (n,), optional
        Units of the unknowns, in which entries are compared.
    """
    units = np.ones((len(Z), 1)) if d is None else d[:, None]
    size = np.abs(Z / units)
    return np.asarray(units * (size + _LEAST * size.max(axis=0, initial=0.0)))


def unforced(A: sp.csr_array, Z: np.ndarray, rounding: float) -> np.ndarray:
    """Return orthonormal V (k, m) such that A moves nothing along Z V: the forces are `rounding` of what cancels."""
    if not Z.shape[1]:
        return np.zeros((0, 0))
    V = la.svd(A @ Z, full_matrices=False)[2].conj().T
    forces, sizes = (np.linalg.norm(x, axis=0) for x in (A @ (Z @ V), abs(A) @ amplitudes(Z @ V)))
    return np.asarray(V[:, forces <= rounding * sizes])


def kernel_within(pencil: Pencil, motions: np.ndarray) -> np.ndarray:
    """Return the motions (n, k) in the span of some, (n, m), that K leaves free to rounding."""
    d = pencil.units[0][:, None]
    return np.asarray(d * _in_kernel(_scaled_parts(pencil), la.qr(motions / d, mode="economic")[0]))


def _scaled_parts(pencil: Pencil) -> list[sp.csr_array]:
    """Return the real and, where there is one, the imaginary part of K in the pencil's own units."""
    D = sp.diags_array(pencil.units[0])
    return [sp.csr_array(D @ A @ D) for A in ((pencil.K.real, pencil.K.imag) if pencil.is_complex else (pencil.K,))]


def find_kernel(pencil: Pencil, linear_solver: LinearSolver | str = "auto") -> np.ndarray:
    """Return real Z (n, k) with K Z = 0 to rounding, by inverse iteration with a block.

    The iteration starts at random, and its block grows until it holds vectors that are not in the kernel. Where K
    cannot be factorised even beside zero, nothing is found.
    """
    d = pencil.units[0]
    n, scaled = pencil.n, _scaled_parts(pencil)
    if n <= _DENSE:
        stacked = np.vstack([A.toarray() for A in scaled])
        s = la.svdvals(stacked)
        if s[-1] > np.sqrt(_CANCELLED) * s[0]:  # regular, which is usual
            return np.zeros((n, 0))
        X = la.svd(stacked, full_matrices=False)[2][s <= np.sqrt(_CANCELLED) * s[0]].T
        return d[:, None] * _in_kernel(scaled, X)
    mass, stiffness = pencil.M.diagonal() * d**2, np.abs(scaled[0].diagonal())
    if not (mass > 0).any():
        return np.zeros((n, 0))
    M = sp.csr_array(sp.diags_array(d) @ pencil.M @ sp.diags_array(d))
    shift = _SHIFT * stiffness.max() / mass.max()
    try:
        factor = factorize(sp.csr_array(scaled[0] + shift * M), pencil.symmetric, linear_solver)
    except NotConvergedError:
        return np.zeros((n, 0))
    rng, block = np.random.default_rng(_SEED), _BLOCK
    while True:
        block = min(block, n)
        X, before = la.qr(factor.solve(rng.standard_normal((n, block))), mode="economic")[0], np.inf
        for _ in range(_STEPS):
            X = la.qr(factor.solve(M @ X), mode="economic")[0]
            least = float(la.svdvals(scaled[0] @ X)[-1])
            if least > _GAIN * before:
                break
            before = least
        Z = _in_kernel(scaled, X)
        if Z.shape[1] < block or block == n:
            return d[:, None] * Z
        block *= 2


def _in_kernel(parts: list[sp.csr_array], X: np.ndarray) -> np.ndarray:
    """Return the part of the span of orthonormal columns on which all forces are rounding of what cancels."""
    for A in parts:
        X = X @ unforced(A, X, _CANCELLED)
    return X
