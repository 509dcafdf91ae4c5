"""Accuracy of small eigenproblems (A0 + v A1 + v² A2) x = 0: scaling before, polishing of single pairs after."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from .blocks import lift

ACCURATE = 1e-12  # backward error, some thousand roundings: a pair with a larger one is polished
# So is one that a Rayleigh quotient moves by more than _MOVED of its value, if more than rounding is wrong with it:
# LAPACK's error is that of the largest eigenvalue, to which the stiffest and lightest unknowns raise it.
_ROUNDING, _MOVED = 1e-15, 1e-8
_STEPS = 3
# Eigenvalues that are equal up to _EQUAL, or up to their errors, are polished together where one alone has no room. The
# steps are made beside them, at these parts of their size or, if that is less, of the room to others: no pivot is all
# rounding there, and what a step leaves wrong in vectors, by the square of its part, comes to rounding.
_EQUAL, _ASIDE = 1e-6, (1e-4, 1e-6, 1e-8)


def equilibrate(M: sp.csr_array, C: sp.csr_array | None, K: sp.csr_array) -> tuple[np.ndarray, float]:
    """Return d (n,) and ω0 such that the entries of ω0²DMD, ω0DCD and DKD are of order one, D = diag(d).

    ω0 is the median frequency of a single unknown, √(K_ii/M_ii): norms would be those of the stiffest few. Both are
    powers of two, so that scaling adds no rounding. An unknown without any diagonal entry, a Lagrange multiplier, has
    the unit that makes its largest entry in K one.
    """
    m, k = np.abs(M.diagonal()), np.abs(K.diagonal())
    both = (m > 0) & (k > 0)
    omega0 = float(_power_of_two(np.sqrt(np.median(k[both] / m[both])))) if both.any() else 1.0
    size = k + omega0**2 * m
    if C is not None:
        size = size + omega0 * np.abs(C.diagonal())
    empty = size == 0
    size[empty] = 1.0
    d = _power_of_two(1 / np.sqrt(size))
    if empty.any() and not empty.all():
        entries = sp.coo_array(abs(K) + abs(K.T))
        i, j = entries.coords
        largest = np.zeros(len(d))
        np.maximum.at(largest, j, np.where(empty[i], 0.0, d[i] * entries.data))
        d[empty] = _power_of_two(1 / np.where(largest > 0, largest, 1.0))[empty]
    return d, omega0


def pair_errors(A: Sequence[np.ndarray], v: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return (k,) the larger of the backward errors of the right and the left vector of each eigenpair.

    Parameters
    ----------
    A : sequence of (n, n) float or complex
        The matrices, as in this module's other functions.
    v : (k,) float or complex
        Eigenvalues.
    x, y : (n, k) float or complex
        Right and left vectors.
    """
    return judged_pairs(A, v, x, y)[0]


def judged_pairs(
    A: Sequence[np.ndarray], v: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (k,) the `pair_errors` of eigenpairs, and which of these are not as exact as they could be.

    Beside those with a large backward error it is those whose Rayleigh quotient v − yᴴQ(v)x / yᴴQ'(v)x is another v.
    """
    sizes = [np.abs(Aj) for Aj in A]
    right, products = _backward_errors(A, sizes, v, x)
    left, _ = _backward_errors([Aj.T.conj() for Aj in A], [size.T for size in sizes], v.conj(), y)
    error = np.maximum(right, left)
    by = np.array([np.einsum("ij,ij->j", y.conj(), Ajx) for Ajx in products])  # yᴴA_jx
    powers = v ** np.arange(len(A))[:, None]
    residual, slope = np.abs((powers * by).sum(axis=0)), np.abs((np.arange(len(A))[:, None] * powers * by).sum(axis=0))
    return error, np.asarray(~(error <= ACCURATE) | (error > _ROUNDING) & (residual > _MOVED * slope))


def polish_pairs(
    A: Sequence[np.ndarray], v: np.ndarray, x: np.ndarray, y: np.ndarray, error: np.ndarray, wrong: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pairs with the inaccurate ones improved by inverse iteration with the Rayleigh quotient of both sides.

    A result counts only where it lies within a quarter of the distance to the next eigenvalue, so that no two pairs
    run into one. That leaves a multiple eigenvalue no room: all its vectors are improved together.

    Parameters
    ----------
    A : coefficients (n, n) by rising power of v
    v : (k,)
    x, y : (n, k)
        Right and left vectors, Q(v)x = 0 and yᴴQ(v) = 0.
    error, wrong : (k,)
        Their `judged_pairs`: backward errors, and whether they are inaccurate.
    """
    start, error = v, error.copy()
    v, x, y = v.copy(), x.copy(), y.copy()
    is_real = not any(np.iscomplexobj(Aj) for Aj in A)
    for i in np.flatnonzero(wrong):
        pair = start[i], x[:, i], y[:, i]
        if is_real and start[i].imag == 0:
            pair = start[i].real, x[:, i].real, y[:, i].real
        room = np.abs(np.delete(start, i) - start[i]).min(initial=np.inf) / 4
        for _ in range(_STEPS):
            pair = _step(A, *pair)
            now = pair_errors(A, np.array([pair[0]]), pair[1][:, None], pair[2][:, None])[0]
            if not now < max(error[i], _ROUNDING) or abs(pair[0] - start[i]) > room:
                break
            v[i], x[:, i], y[:, i], error[i] = *pair, now
            if now <= ACCURATE / 10:
                break
    for i in np.flatnonzero(~(error <= ACCURATE)):
        equal = max(_EQUAL * np.abs(start[i]), min(error[i], _EQUAL))  # entries are of order one
        group = np.flatnonzero(np.abs(start - start[i]) <= equal)
        if len(group) > 1 and not error[i] <= ACCURATE:  # not improved together with another one before
            better = _polished_together(A, start, group, x[:, group], y[:, group])
            if better is not None and better[3].max() < error[group].max():
                v[group], x[:, group], y[:, group], error[group] = better
    return v, x, y


def _step(
    A: Sequence[np.ndarray], v: complex, x: np.ndarray, y: np.ndarray
) -> tuple[complex, np.ndarray, np.ndarray]:
    x, y = _iterated(A, v, x[:, None], y[:, None])
    Q, slope = _matrices(A, v)
    with np.errstate(all="ignore"):
        x, y = (z[:, 0] / np.linalg.norm(z) for z in (x, y))
        return v - np.vdot(y, Q @ x) / np.vdot(y, slope @ x), x, y


def _polished_together(
    A: Sequence[np.ndarray], start: np.ndarray, group: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """Return the m nearly equal eigenvalues `group`, vectors (n, m) and errors (m,); None without success.

    The vectors are iterated from beside the mean v of the eigenvalues. In the spaces X, Y that they span these are
    v + δ with (YᴴQ(v)X + δ YᴴQ'(v)X) a = 0, but for δ². Where all δ are one but for rounding, any basis of X and of Y
    is one of vectors.
    """
    middle, room = start[group].mean(), np.abs(np.delete(start, group)[:, None] - start[group]).min(initial=np.inf) / 4
    is_real = not start[group].imag.any() and not any(np.iscomplexobj(Aj) for Aj in A)
    if is_real:
        middle, x, y = middle.real, x.real, y.real
    best = None
    for part in _ASIDE:
        x, y = _iterated(A, middle + part * min(room, abs(middle) or 1.0), x, y)
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            break
        x, y = (la.qr(z, mode="economic")[0] for z in (x, y))
        Q, slope = _matrices(A, middle)
        delta, b, a = la.eig(-y.conj().T @ Q @ x, y.conj().T @ slope @ x, left=True, right=True)
        if not np.abs(delta).max() <= room:  # a defective eigenvalue has infinite ones
            break
        ways = [(np.full(len(group), delta.mean().real if is_real else delta.mean()), x, y)]
        if not (is_real and delta.imag.any()):
            ways.append((delta.real, x @ a.real, y @ b.real) if is_real else (delta, x @ a, y @ b))
        for moved, right, left in ways:
            found = middle + moved, right, left
            errors = pair_errors(A, *found)
            if best is None or errors.max() < best[3].max():
                best = *found, errors
            if errors.max() <= _ROUNDING:
                return best
        middle = middle + ways[0][0][0]
    return best


def _iterated(A: Sequence[np.ndarray], v: complex, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Q(v)⁻¹Q'(v)x and its adjoint of y, for columns (n, m)."""
    Q, slope = _matrices(A, v)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", la.LinAlgWarning)
        lu = la.lu_factor(Q, check_finite=False)
        # A pivot of exactly zero belongs to an exact eigenvalue: any small one gives its vectors.
        pivots = lu[0].diagonal().copy()
        np.fill_diagonal(lu[0], np.where(pivots == 0, np.finfo(float).eps * np.abs(Q).max(), pivots))
        x = la.lu_solve(lu, slope @ x, check_finite=False)
        y = la.lu_solve(lu, slope.conj().T @ y, trans=2, check_finite=False)
        return x, y


def _matrices(A: Sequence[np.ndarray], v: complex) -> tuple[np.ndarray, np.ndarray]:
    """Return Q(v) and Q'(v)."""
    Q, slope = A[0], np.zeros_like(A[0])
    for j, Aj in enumerate(A[1:], 1):
        Q, slope = Q + Aj * v**j, slope + j * Aj * v ** (j - 1)
    return Q, slope


def _backward_errors(
    A: Sequence[np.ndarray], sizes: Sequence[np.ndarray], v: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return ‖Q(v)x‖ / ‖Σ|v|ʲ|A_j||x|‖ for each column of x, and the products A_jx; the sizes are |A_j|."""
    a, products = np.abs(x), [lift(Aj, x) for Aj in A]
    residual, magnitude = products[0], sizes[0] @ a
    for j, (Ajx, size) in enumerate(zip(products[1:], sizes[1:], strict=True), 1):
        residual, magnitude = residual + Ajx * v**j, magnitude + (size @ a) * np.abs(v) ** j
    with np.errstate(invalid="ignore"):
        return np.asarray(np.linalg.norm(residual, axis=0) / np.linalg.norm(magnitude, axis=0)), products


def _power_of_two(x: np.ndarray) -> np.ndarray:
    return np.asarray(2.0 ** np.round(np.log2(x)))
