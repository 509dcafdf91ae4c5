"""Whether modes can grow faster than some rate: the symmetric parts of the matrices bound it, by their inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from .inertia import count_beneath, negative_at_infinity
from .linear.factor import LinearSolver
from .linear.spread_matrix import in_rows, largest, sizes_times
from .pencil import Pencil
from .shift import symmetric_part, turned_stiffness

# Times a rate: how far below zero θ may be, as a frequency, and how much damping may be negative, so that no real λ is
# larger than 0.6 times the rate: λ² − 0.1λ − ¼ > 0 there.
_STIFFNESS, _DAMPING = 0.5, 0.1
_SLOW = 0.25  # of a rate: gyroscopic terms up to this leave what it bounds nearly as it is
_EQUAL = 1e-12  # of the largest entry: what differs by less is symmetric
_ROUGHLY, _SURE = 1e-2, 1.2  # tolerance of Lanczos iteration for a bound, and the factor by which it is made safe
_SMALLEST, _SEED = 50, 20261126  # unknowns from which Lanczos iteration serves; of its random start
_LITTLE = 1e-13  # of the largest entry of a matrix: changes nothing but whether a pivot is zero
_MIRROR = 1e-6  # of |λ|: so near to −λ* another is its mirror


def may_grow(pencil: Pencil, rate: float, linear_solver: LinearSolver | str = "auto") -> bool | None:
    """Return whether a real λ may be larger than about a rate, rad/s; None where the solver gives no inertia.

    The mode u of a real λ > 0 is real, so that λ²uᵀMu + λuᵀCu + uᵀKu = 0 has the symmetric parts of C and K alone.
    Where those of K + ¼r²M and C + 0.1rM have no negative eigenvalue, the sum is positive for every λ > 0.6 r. A
    symmetric C, or none, then also bounds how fast flutter grows: (Re λ)² − 0.1 r Re λ < (Im λ)² + ¼r².

    Constraints by Lagrange multipliers are no such negative eigenvalues, and do no work. With friction their forces do,
    and no sum bounds it: something may always grow then.

    It costs one real symmetric factorisation, with a C that is not zero a second one.

    Parameters
    ----------
    pencil : Pencil
        Of a complex K the real part counts.
    rate : float, rad/s
    linear_solver : LinearSolver or str
    """
    undamped, theta = symmetric_part(pencil), -((_STIFFNESS * rate) ** 2)
    if pencil.C is None or not largest(pencil.C):
        below = count_beneath(undamped, theta, linear_solver)
        return None if below is None else below > 0 or _multipliers_work(pencil, undamped, linear_solver)
    mass, damping = (sizes_times(A, np.ones(pencil.n)) for A in (pencil.M, pencil.C))
    light = (mass == 0) & (damping > 0)
    undamped = _with_mass(undamped, light, theta)
    below = count_beneath(undamped, theta, linear_solver)
    if below or (below == 0 and _multipliers_work(pencil, undamped, linear_solver)):
        return True
    # Unknowns with neither mass nor damping would make C + rM singular.
    rows, theta = np.flatnonzero((mass > 0) | light), -_DAMPING * rate
    M, C = (sp.csr_array(A[rows][:, rows]) for A in (pencil.M, pencil.C))
    dampers = Pencil(M, sp.csr_array((C + C.T) / 2), symmetric=True)
    negative = count_beneath(_with_mass(dampers, light[rows], theta), theta, linear_solver)
    return None if negative is None or below is None else negative > 0


def _multipliers_work(pencil: Pencil, undamped: Pencil, linear_solver: LinearSolver | str) -> bool:
    """Return whether there are constraints whose forces are not across the motions that they allow, as with friction.

    They act along the columns of K of unknowns without mass, and allow motions across its rows.
    """
    light = undamped.M.diagonal() == 0
    if pencil.symmetric or not light.any():
        return False
    K = turned_stiffness(pencil)
    rows, columns = K[light], sp.csr_array(K.T)[light]
    works = abs(rows - columns).max() > _EQUAL * abs(rows).max()
    return bool(works and negative_at_infinity(undamped, linear_solver))


def _with_mass(pencil: Pencil, light: np.ndarray, theta: float) -> Pencil:
    """Return a pencil with so little mass at some unknowns that K − θM, θ < 0, changes there by rounding alone.

    Unknowns with a damper and without mass are no constraints, as `count_beneath` takes those without mass: a negative
    stiffness at the damper makes a real λ grow.
    """
    small = _LITTLE * largest(pencil.K) / -theta
    return replace(pencil, M=in_rows(pencil.M + sp.diags_array(small * light)))


def may_grow_dense(M: np.ndarray, C: np.ndarray | None, K: np.ndarray, rate: float) -> bool:
    """Return whether a real λ may be larger than a rate, rad/s, for full matrices, (r, r) each, C None without damping.

    λ²M + λC + K has a positive symmetric part for all λ above the rate if it has one there, and so has 2λM + C. That
    costs two Cholesky factorisations, without damping one.
    """
    if np.isinf(rate):
        return False
    value = rate**2 * M + (K + K.T).real / 2
    if C is None:
        return not _is_positive(value)
    damping = (C + C.T) / 2
    return not (_is_positive(value + rate * damping) and _is_positive(2 * rate * M + damping))


def _is_positive(A: np.ndarray) -> bool:
    return bool(la.lapack.dpotrf(A, clean=False)[1] == 0)


def sizes(lam: np.ndarray) -> np.ndarray:
    """Return the sizes (k,) of λ (k,), rad/s, by which a band is cut off: |λ|, or Im λ of what grows.

    A mode that grows fast, and its mirror −λ*, may lie far beyond the band that it belongs to by its frequency.
    """
    size, grows = np.abs(lam), lam.real > 0
    mirror = (np.abs(lam[:, None] + lam[grows].conj()) <= _MIRROR * size[:, None]).any(axis=1)
    return np.asarray(np.where(grows | mirror, lam.imag, size))


def whirls(pencil: Pencil, rate: float) -> bool:
    """Return whether the skew part of C may let flutter grow faster than a rate, rad/s, where `may_grow` excludes it.

    With the bound g of `gyroscopic_rate` (Re λ)² < (Im λ)² + g Im λ + ¼r²: up to `_SLOW` r it adds little.
    """
    if pencil.C is None:
        return False
    skew = in_rows((pencil.C - pencil.C.T) / 2)
    if largest(skew) <= _EQUAL * largest(pencil.C):
        return False
    return gyroscopic_rate(pencil.M, skew) > _SLOW * rate


def gyroscopic_rate(M: sp.csr_array, G: sp.csr_array) -> float:
    """Return a bound g, rad/s, of |uᴴGu| / uᴴMu for a skew G; infinite where it is not known.

    It bounds how far modes come down, too: the Hermitian matrix K − ω²M + iωG is at least K − (ω² + gω)M, so that no
    more modes swing below ω than there are θ < ω² + gω without G. (Derived here, no source.)

    Parameters
    ----------
    M, G : (n, n) sparse, kg and N s/m
        With unknowns that have no mass, or a complex G, it is infinite.
    """
    d = M.diagonal()
    if np.iscomplexobj(G) or d.min() <= 0 or len(d) < _SMALLEST:
        return np.inf
    D = sp.diags_array(1 / np.sqrt(d))
    start = np.random.default_rng(_SEED).standard_normal(len(d))
    scaled, mass = sp.csr_array(D @ G @ D), sp.csr_array(D @ M @ D)
    square = LinearOperator(G.shape, matvec=lambda x: scaled.T @ (scaled @ x), dtype=float)
    try:
        largest = eigsh(square, 1, tol=_ROUGHLY, v0=start, return_eigenvectors=False)[0]
        least = eigsh(mass, 1, which="SA", tol=_ROUGHLY, v0=start, return_eigenvectors=False)[0]
    except ArpackError:
        return np.inf
    return float(np.sqrt(_SURE * largest) / (least / _SURE)) if least > 0 else np.inf


def with_damping(pencil: Pencil) -> Pencil:
    """Return the pencil with C = 0 where it has none: of λ instead of θ."""
    return pencil if pencil.C is not None else replace(pencil, C=sp.csr_array(pencil.M.shape))
