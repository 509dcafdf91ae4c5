"""Backward errors, condition numbers and the uncertainty of growth rates."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from .pencil import Modes, Pencil

# Entries of assembled matrices are sums of some tens of rounded products.
ROUNDING = 8 * np.finfo(float).eps
_ONE_SHAPE = 64 * ROUNDING  # of the squared sine between two modes: below it they are one shape
_EQUAL = 1e-9  # relative distance below which eigenvalues count as one multiple eigenvalue


def modes_from_theta(pencil: Pencil, theta: np.ndarray, right: np.ndarray, left: np.ndarray, method: str) -> Modes:
    """Return the modes of an undamped pencil from K φ = θ M φ, θ = −λ².

    A complex pair θ, θ* gives the two modes λ and −λ*; θ < 0 gives the two real λ = ±√−θ; a θ that is zero within its
    uncertainty gives one mode λ = 0 whose re_uncertainty is the square root of that. Of a complex K each θ gives one
    mode, that of Im λ ≥ 0.

    Parameters
    ----------
    theta : (k,) real or complex, rad²/s²
    right, left : (n, k)
        Left vectors in the order of the right ones, any basis where eigenvalues are multiple; they are scaled here.
    """
    right = _unit_mass(pencil, right)
    lefts = _unit_mass(pencil, left)
    left = _biorthogonal(left, left.conj().T @ (pencil.M @ right), theta)
    lam = 1j * np.sqrt(theta.astype(complex))
    residual = pencil.apply(lam, right)
    magnitude = pencil.magnitude(lam, right)
    backward = _backward_errors(pencil, residual, magnitude)
    first_order, amplification = _perturbation(left, residual, magnitude, theta)
    least = np.einsum("ij,ij->j", np.abs(right), np.abs(residual) + ROUNDING * magnitude)
    u_theta = _near_coalescence(first_order, least, theta)
    u_theta = np.maximum(u_theta, _defective(pencil, theta, right, lefts, magnitude))

    # A rigid mode: θ is zero within what rounding leaves.
    rigid = np.abs(theta) <= u_theta
    lam = np.where(rigid, 0.0, lam)
    # |√(θ+δ) − √θ| is at most δ/2√θ to first order, and at most √δ always.
    with np.errstate(divide="ignore"):
        u_re = np.minimum(u_theta / (2 * np.abs(lam)), np.sqrt(u_theta))
        condition = amplification / (2 * np.abs(theta))
    if pencil.is_complex:
        divergent = np.zeros(0, dtype=int)
        u_re = _outside_the_law(lam, u_re)
    else:
        real = (np.abs(lam.imag) <= u_re) & (np.abs(lam.real) > u_re) & (theta.imag == 0)
        divergent = np.flatnonzero(~rigid & real)
    lam[divergent] = lam[divergent].real
    index = np.concatenate([np.arange(len(lam)), divergent])
    lam = np.concatenate([lam, -lam[divergent]]) + 0.0  # turns −0 into 0
    order = np.lexsort((-lam.real, lam.imag))
    index, lam = index[order], lam[order]
    return Modes(lam, right[:, index], left[:, index], backward[index], u_re[index], condition[index], method)


def modes_from_lambda(pencil: Pencil, lam: np.ndarray, right: np.ndarray, left: np.ndarray, method: str) -> Modes:
    """Return the modes of a pencil with C from its eigenpairs that are `in_upper_half`.

    Parameters
    ----------
    lam : (k,) complex, rad/s
    right, left : (n, k) complex
        Left vectors in the order of the right ones, any basis where eigenvalues are multiple.
    """
    right = _unit_mass(pencil, right)
    # ψ_iᴴ((λ_i + λ_j)M + C)φ_j vanishes for λ_i ≠ λ_j, and is ψᴴ(2λM + C)φ on the diagonal.
    lefts = _unit_mass(pencil, left)
    mass = left.conj().T @ (pencil.M @ right)
    left = _biorthogonal(left, (lam[:, None] + lam[None, :]) * mass + left.conj().T @ (pencil.C @ right), lam)
    residual = pencil.apply(lam, right)
    magnitude = pencil.magnitude(lam, right)
    backward = _backward_errors(pencil, residual, magnitude)
    first_order, amplification = _perturbation(left, residual, magnitude, lam)
    dissipation = np.abs(np.einsum("ij,ij->j", right.conj(), pencil.C @ right))
    least = np.einsum("ij,ij->j", np.abs(right), np.abs(residual) + ROUNDING * magnitude)
    least = least / np.maximum(2 * np.abs(lam) + dissipation, np.finfo(float).tiny)
    u = _near_coalescence(first_order, least, lam)
    u = np.maximum(u, _defective(pencil, lam, right, lefts, magnitude / np.maximum(2 * np.abs(lam), 1e-300)))
    # A rigid mode: λ is zero within what rounding δ of φᴴKφ leaves, the root of λ²φᴴMφ + λ|φᴴCφ| = δ. Where damping
    # holds more than mass, as in creeping, that is δ/|φᴴCφ|, far below the √δ of a free body.
    stiffness = np.abs(residual) + ROUNDING * pencil.magnitude(np.zeros(len(lam)), right)
    delta = np.einsum("ij,ij->j", np.abs(right), stiffness)
    mass = np.abs(np.einsum("ij,ij->j", right.conj(), pencil.M @ right))
    rounding = 2 * delta / np.maximum(dissipation + np.sqrt(dissipation**2 + 4 * mass * delta), np.finfo(float).tiny)
    rigid = np.abs(lam) <= rounding
    lam, u = np.where(rigid, 0.0, lam), np.where(rigid, rounding, u)
    if pencil.is_complex:
        lam = np.where(_is_real(lam, pencil.n), lam.real, lam)
        u = _outside_the_law(lam, u)
    order = np.lexsort((-lam.real, lam.imag))
    if pencil.is_complex:
        order = order[lam[order].imag >= 0]
    with np.errstate(divide="ignore"):
        condition = amplification / np.abs(lam)
    return Modes(lam, right, left, backward, u, condition, method).select(order)


def in_upper_half(pencil: Pencil, lam: np.ndarray) -> np.ndarray:
    """Return which eigenvalues of a pencil with C to keep: Im λ ≥ 0, and rigid ones that rounding put below.

    The others of a real pencil are conjugates of these. With a complex K, λ = 0 of a rigid body that a dashpot holds
    may come out on either side; that of a free body is double and splits into ±δ, of which one is enough. Where
    dashpots leave no more than rounding of Im λ, its sign says nothing either.
    """
    upper = lam.imag >= 0
    if pencil.is_complex:
        upper |= _is_real(lam, pencil.n)
    mass = pencil.M.diagonal()
    if not pencil.is_complex or not (mass > 0).any():
        return np.asarray(upper)
    largest = np.max(np.abs(pencil.K.diagonal())[mass > 0] / mass[mass > 0])
    tiny = np.abs(lam) <= np.sqrt(ROUNDING * largest)
    for i in np.flatnonzero(tiny & ~upper):
        upper[i] = not (np.abs(lam[tiny & (lam.imag >= 0)] + lam[i]) <= 0.1 * np.abs(lam[i])).any()
    return np.asarray(upper)


def _is_real(lam: np.ndarray, n: int) -> np.ndarray:
    return np.asarray(np.abs(lam.imag) <= n * np.finfo(float).eps * np.abs(lam))


def _outside_the_law(lam: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return re_uncertainty of a complex K: at least |λ| where |Re λ| ≥ |Im λ|, so that such a mode is marginal.

    K(1 + iη) holds for Im λ > 0 and its conjugate for Im λ < 0, so motion that does not oscillate has no law: for θ
    near the negative real axis, Im θ of either sign and however small decides whether the root in the upper half plane
    is a growing or a decaying one. That is a choice of the model and says nothing about stability.
    """
    return np.where(np.abs(lam.real) >= np.abs(lam.imag), np.maximum(u, np.abs(lam)), u)


def _unit_mass(pencil: Pencil, right: np.ndarray) -> np.ndarray:
    """Return the columns with φᴴMφ = 1; those without any mass, which damping makes possible, as they are."""
    mass = np.abs(np.einsum("ij,ij->j", right.conj(), pencil.M @ right))
    return np.asarray(right / np.sqrt(np.where(mass > 0, mass, 1.0)))


def _perturbation(
    left: np.ndarray, residual: np.ndarray, magnitude: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the error of each eigenvalue by perturbation theory, and how much of it one rounding would be.

    With T_ij = |ψ_iᴴ r_j| + ε|ψ_i|ᵀ(magnitude)_j, eigenvalue i moves by T_ii and through its neighbours by
    T_ij T_ji / |θ_i − θ_j|, or √(T_ij T_ji) where that is smaller: the modes of a doublet are free to turn.

    Returns
    -------
    first_order, amplification : (k,)
    """
    amplification = np.abs(left).T @ magnitude
    T = np.abs(left.conj().T @ residual) + ROUNDING * amplification
    both = T * T.T
    gap = np.abs(values[:, None] - values[None, :])
    with np.errstate(divide="ignore", invalid="ignore"):
        through = np.fmin(np.sqrt(both), both / gap)
    np.fill_diagonal(through, T.diagonal())
    return through.sum(axis=1), amplification.diagonal()


def _near_coalescence(first_order: np.ndarray, least: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Bound the error of eigenvalues close to another one by the square-root law of a double eigenvalue.

    With Δ the distance to the nearest other eigenvalue and u the first-order error (which grows as 1/Δ), the squared
    half distance is uncertain by Δu, so each eigenvalue by at most √(Δu); far from coalescence u itself is smaller. A
    multiple eigenvalue with a full set of modes has Δ = 0 and keeps the error of a well-conditioned one, `least`.
    """
    if len(values) < 2:
        return first_order
    distance = np.abs(values[:, None] - values[None, :])
    np.fill_diagonal(distance, np.inf)
    gap = distance.min(axis=1)
    with np.errstate(invalid="ignore"):
        return np.fmax(least, np.fmin(first_order, np.sqrt(gap * first_order)))


def _defective(
    pencil: Pencil, values: np.ndarray, right: np.ndarray, left: np.ndarray, magnitude: np.ndarray
) -> np.ndarray:
    """Return the error of multiple eigenvalues whose k modes are one shape, for which no first order exists; else 0.

    A block with J above the diagonal moves by (δJ)^½ where δ below it is rounding, ε|ψ|ᵀmagnitude with ψ of unit mass,
    and so does one of k by (δJᵏ⁻¹)^(1/k). J is at most what cancels in the mode, |ψ|ᵀmagnitude.

    Parameters
    ----------
    right, left : (n, k)
        Of unit mass.
    """
    error = np.zeros(len(values))
    cluster, size = _clusters(values)
    for c in np.flatnonzero(size > 1):
        i = np.flatnonzero(cluster == c)
        x = right[:, i]
        cosine = np.minimum(np.abs(x.conj().T @ (pencil.M @ x)), 1.0)
        alike = (1 - cosine**2 <= _ONE_SHAPE).sum(axis=1)
        size_of = np.einsum("ij,ij->j", np.abs(left[:, i]), magnitude[:, i])
        error[i] = np.where(alike > 1, size_of * ROUNDING ** (1 / alike), 0.0)
    return error


def _clusters(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for each eigenvalue the number of its group of equal ones, and the size of each group."""
    near = np.abs(values[:, None] - values[None, :]) <= _EQUAL * np.maximum(np.abs(values)[:, None], np.abs(values))
    groups = connected_components(sp.csr_array(near), directed=False)[1]
    _, cluster, size = np.unique(groups, return_inverse=True, return_counts=True)
    return cluster, size


def _biorthogonal(left: np.ndarray, gram: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return left modes ψ with ψᴴ(weight)φ = 1 for their own φ and 0 within a multiple eigenvalue.

    Each pair is scaled by itself, so that a small ψᴴφ shows as the large condition number it is; only within a cluster
    of equal eigenvalues is the basis of the left space free, and changed. At a defective eigenvalue no such basis
    exists: the pseudo-inverse keeps it finite, and the condition number says so.

    Parameters
    ----------
    gram : (k, k)
        ψ_iᴴ(weight)φ_j of the given left vectors.
    values : (k,)
        Eigenvalues, in the order of both.
    """
    left = left.astype(np.result_type(left, gram))
    cluster, size = _clusters(values)
    alone = np.flatnonzero(size[cluster] == 1)
    own = gram.diagonal()[alone]
    left[:, alone] *= np.divide(1.0, own, out=np.zeros_like(own), where=own != 0).conj()
    for c in np.flatnonzero(size > 1):
        i = np.flatnonzero(cluster == c)
        block = gram[np.ix_(i, i)]
        unit = np.abs(block).max() or 1.0
        left[:, i] = left[:, i] @ (np.linalg.pinv(block / unit, rcond=np.finfo(float).eps) / unit).conj().T
    return left


def _backward_errors(pencil: Pencil, residual: np.ndarray, magnitude: np.ndarray) -> np.ndarray:
    d = pencil.units[0][:, None]
    return _column_norms(d * residual) / _column_norms(d * magnitude)


def _column_norms(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(x, axis=0))
