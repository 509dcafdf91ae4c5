"""All modes of small problems by LAPACK."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import scipy.linalg as la

from ..errors import NotConvergedError
from .free_modes import FreeModes, split_off
from .lapack import (
    APART,
    SOLVES,
    Pairs,
    damped_methods,
    finite_number,
    massless_apart,
    symmetric_methods,
    undamped_methods,
)
from .linear.factor import LinearSolver
from .pencil import Modes, Pencil
from .polish import judged_pairs, pair_errors, polish_pairs
from .quality import grow_below, in_upper_half, modes_from_lambda, modes_from_theta
from .threads import one_openblas_thread

DENSE_LIMIT = 400  # unknowns up to which all modes come from LAPACK: seconds, tens of them where QZ is needed

# Up to so many inaccurate pairs are polished one by one, instead of trying another method: as parts of all eigenvalues
# of the matrices, and of those that are asked for.
_FEW, _FEW_OF_ASKED = 0.1, 0.3
# Eigenvalues larger than _HUGE, in units of ω0, with a backward error above SOLVES are what rounding makes of infinite
# ones, or of several equal penalties; they are dropped.
_HUGE = 1e4
_AT_REST, _DOUBTFUL = 1e-6, 1e-10  # of ω0: slower modes may be free motions; backward error of one that is no mode

# As `Pairs`, with their errors (k,), and whether they are inaccurate (k,).
_Pairs: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@one_openblas_thread()
def solve_dense(
    pencil: Pencil, highest: float = np.inf, linear_solver: LinearSolver | str = "auto", growing: float | None = None
) -> Modes:  # fmt: skip
    """Return all finite modes of a small pencil, or those up to |λ| = highest, rad/s.

    They are exhaustive unless fewer were found than there are, so far apart are the fastest and the others.

    Parameters
    ----------
    linear_solver : LinearSolver or str
        Used where motions that nothing holds have to be looked for.
    growing : float, rad/s, optional
        With damping: only modes with Re λ > 0 and Im λ up to this are asked for. Others may be left out.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> K = sp.csr_array(np.array([[2.0, -1.0], [-1.0, 2.0]]))
    >>> solve_dense(Pencil(sp.eye_array(2, format="csr"), K, symmetric=True)).lam.imag**2
    array([1., 3.])
    """
    modes = _solved(pencil, highest, linear_solver, growing)
    slow = np.abs(modes.lam) <= _AT_REST * pencil.units[1]
    if pencil.free is not None and (modes.backward_error[slow] > _DOUBTFUL).any():
        # Stiffnesses may cancel at just these values of the parameters, and leave free what they hold at others.
        return _solved(replace(pencil, free=None), highest, linear_solver, growing)
    return modes


def _solved(pencil: Pencil, highest: float, linear_solver: LinearSolver | str, growing: float | None) -> Modes:
    """Return the modes as `solve_dense`, beside the free motions that are known."""
    d, omega0 = pencil.units
    free = split_off(pencil, linear_solver)
    pencil = pencil.dense()
    M, K = omega0**2 * d[:, None] * pencil.M * d, d[:, None] * pencil.K * d
    if pencil.C is None:
        (v, right, left), every = _undamped_pairs(pencil, M, K, (highest / omega0) ** 2, free)
        if not pencil.is_complex and not v.imag.any():
            v, right, left = v.real, right.real, left.real
    else:
        C = omega0 * d[:, None] * pencil.C * d
        limit = None if growing is None else growing / omega0
        (v, right, left), every = _damped_pairs(pencil, M, C, K, highest / omega0, free, limit)
    v, right, left = (omega0 if pencil.C is not None else omega0**2) * v, d[:, None] * right, d[:, None] * left
    if free is not None:
        v, right, left = free.beside(v, right, left)
    modes_from = modes_from_theta if pencil.C is None else modes_from_lambda
    return replace(modes_from(pencil, v, right, left, "dense (LAPACK)"), exhaustive=every)


def _undamped_pairs(
    pencil: Pencil, M: np.ndarray, K: np.ndarray, highest: float, free: FreeModes | None
) -> tuple[Pairs, bool]:
    """Return the eigenpairs K x = θ M x of scaled matrices, without those of free motions, and whether none is lost."""
    d, A, X = pencil.units[0][:, None], [K, -M], None
    if free is not None:
        X = complement(M @ (free.right / d))
        A = [X.T @ part @ X for part in A]
    if not len(A[0]):
        return (np.zeros(0), np.zeros((len(K), 0)), np.zeros((len(K), 0))), True
    A, T = massless_apart(A)
    real_symmetric = pencil.symmetric and not pencil.is_complex
    methods = symmetric_methods(-A[1], A[0]) if real_symmetric else undamped_methods(-A[1], A[0], highest)
    theta, right, left = _finite(A, polish_pairs(A, *_best(A, methods, highest)), _HUGE**2)
    every = bool(np.isfinite(highest) or len(theta) >= finite_number(A))
    right, left = (right, left) if T is None else (T @ right, T @ left)
    if X is None or free is None:
        return (theta, right, left), every
    right, left, Z, MW = X @ right, X @ left, free.right / d, M @ (free.left / d)
    return (theta, right - Z @ (np.linalg.pinv(MW.conj().T @ Z) @ (MW.conj().T @ right)), left), every


def complement(MZ: np.ndarray) -> np.ndarray:
    """Return orthonormal X (n, n − k) with XᵀMZ = 0, whose columns are single unknowns where MZ has no row.

    With K Z = 0 the left modes of other eigenvalues lie in the span of X, and XᵀKX, XᵀMX have these eigenvalues alone.
    """
    order = np.argsort(~MZ.any(axis=1), kind="stable")  # reflections then leave the rows without mass alone
    X = np.empty((len(MZ), len(MZ) - MZ.shape[1]))
    X[order] = la.qr(MZ[order], mode="full")[0][:, MZ.shape[1] :]
    return X


def _damped_pairs(
    pencil: Pencil, M: np.ndarray, C: np.ndarray, K: np.ndarray, highest: float, free: FreeModes | None,
    growing: float | None,
) -> tuple[Pairs, bool]:  # fmt: skip
    """Return the eigenpairs of scaled matrices in the upper half plane without those of free motions, and whether all.

    Up to |λ| = highest none is known to be lost.
    """
    d, omega0 = pencil.units
    A, X, Z = [K, C, M], None, None
    if free is not None and free.closed.shape[1]:
        Z = free.closed / d[:, None]
        X = complement(M @ Z)
        A = [X.T @ part @ X for part in A]
    if not len(A[0]):
        return (np.zeros(0, complex), np.zeros((len(K), 0)), np.zeros((len(K), 0))), True
    A, T = massless_apart(A)
    # Eigenvalues of real matrices come in conjugate pairs. Those of free motions may be pairs by rounding alone.
    upper = free is None and not pencil.is_complex
    pairs = _best(A, damped_methods(A[2], A[1], A[0], highest, upper), highest, upper)
    lam = pairs[0]
    every = bool(np.isfinite(highest) or _number(lam, upper) >= finite_number(A))
    keep = in_upper_half(pencil, omega0 * lam) | grow_below(pencil, lam)
    if free is not None:  # how many eigenvalues are zero is known: they are the nearest to zero, and are added exactly
        keep[np.argsort(np.abs(lam), kind="stable")[: free.zeros]] = False
    if growing is not None:
        keep &= (lam.real > 0) & (lam.imag <= growing)
    lam, right, left = _finite(A, polish_pairs(A, *(part[..., keep] for part in pairs)), _HUGE)
    every = every and bool(np.isfinite(highest) or len(lam) == np.count_nonzero(keep))
    right, left = (right, left) if T is None else (T @ right, T @ left)
    if X is None or Z is None:
        return (lam, right, left), every
    # With C Z = M Z D and XᵀMZ = 0 the motions Z exert no force on the others, which were solved for by themselves.
    # These do move Z: by the c that makes the rows of Z in Q(λ)(Xa + Zc) = 0 hold.
    right, left = X @ right, X @ left
    inertia = lam[:, None, None] ** 2 * (Z.T @ M @ Z) + lam[:, None, None] * (Z.T @ C @ Z)
    forces = (Z.T @ C @ right) * lam + Z.T @ K @ right
    moved = np.linalg.pinv(inertia) @ forces.T[:, :, None]
    return (lam, right - Z @ moved[:, :, 0].T, left), every


def _number(v: np.ndarray, upper: bool) -> int:
    """Return how many eigenvalues (k,) stand for; with `upper` those of Im < 0, conjugates of others, do not count."""
    return len(v) if not upper else int(np.count_nonzero(v.imag == 0) + 2 * np.count_nonzero(v.imag > 0))


def _best(
    A: Sequence[np.ndarray], methods: Sequence[Callable[[], Pairs]], highest: float, upper: bool = False
) -> _Pairs:
    """Return the pairs up to |v| = highest by the first method that gets nearly all right, and their errors.

    Where no method does, those of the best one. A pair that a method has lost is as wrong as one that is inaccurate.

    Parameters
    ----------
    upper : bool
        Whether of conjugate pairs the methods may give only those of Im v ≥ 0.
    """
    number = 0 if np.isfinite(highest) else finite_number(A)
    tried: list[tuple[float, _Pairs]] = []
    for method in methods:
        try:
            v, x, y = method()
        except la.LinAlgError:
            continue
        keep = np.abs(v) <= highest
        pairs = v[keep], x[:, keep], y[:, keep]
        errors, wrong = judged_pairs(A, *pairs)
        lost = max(number - _number(pairs[0], upper), 0)
        faults = np.count_nonzero(wrong) + lost
        tried.append((faults / max(len(wrong) + lost, 1), (*pairs, errors, wrong)))
        if tried[-1][0] <= _FEW_OF_ASKED and lost == 0 and faults <= _FEW * len(A[0]) * (len(A) - 1):
            break
    if not tried:
        raise NotConvergedError("LAPACK finds no eigenvalues of these matrices")
    best = min(tried, key=lambda t: t[0])[1]
    wrong = best[4]
    lost = number - _number(best[0][~wrong], upper)
    if number <= _number(best[0], upper):
        return best
    rest = [found for _, pairs in tried if (found := _fastest(pairs, lost, best[0][~wrong], upper)) is not None]
    if not rest:
        return best
    fast = min(rest, key=lambda pairs: float(pairs[3].max()))
    v, x, y, errors, wrong = (np.concatenate([p[..., ~wrong], q], axis=-1) for p, q in zip(best, fast, strict=True))
    return v, x, y, errors, wrong


def _fastest(pairs: _Pairs, number: int, others: np.ndarray, upper: bool) -> _Pairs | None:
    """Return those of the pairs that are so many eigenvalues larger than others (k,); None where these are not as many.

    The accurate list of the slow ones may have lost the fastest, which a list that blurs the slow ones still has.
    """
    order = np.argsort(-np.abs(pairs[0]), kind="stable")
    standing = np.cumsum([_number(pairs[0][[i]], upper) for i in order])
    count = int(np.searchsorted(standing, number)) + 1
    if count > len(order) or standing[count - 1] != number:
        return None
    chosen = order[:count]
    if np.abs(pairs[0][chosen]).min() <= APART * np.abs(others).max(initial=0.0):
        return None
    v, x, y, errors, wrong = (part[..., chosen] for part in pairs)
    return v, x, y, errors, wrong


def _finite(A: Sequence[np.ndarray], pairs: Pairs, huge: float) -> Pairs:
    v, right, left = pairs
    keep = np.abs(v) <= huge
    if not keep.all():
        keep |= pair_errors(A, *pairs) <= SOLVES
    return v[keep], right[:, keep], left[:, keep]
