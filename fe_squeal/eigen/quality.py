"""Backward errors, condition numbers and the uncertainty of growth rates."""

from __future__ import annotations

import numpy as np

from .blocks import lift
from .multiple import (
    ROUNDING,
    biorthogonal,
    defective_error,
    near_coalescence,
    rounding_of_zero,
    separated,
    separated_divergences,
    unit_mass,
)
from .pencil import Modes, Pencil

__all__ = ["ROUNDING", "backward_errors", "in_upper_half", "modes_from_lambda", "modes_from_theta"]

_ONE_FREQUENCY = 1e-9  # of a frequency: modes whose frequencies are closer than this are put in order by growth rate
_ENOUGH = 0.5  # of |Im λ|: what losses change less does not swing by them alone
_MIRRORED = 4  # times what losses change of it: so near to λ* is the other one of a pair


def modes_from_theta(
    pencil: Pencil, theta: np.ndarray, right: np.ndarray, left: np.ndarray, method: str, second_order: bool = False
) -> Modes:  # fmt: skip
    """Return the modes of an undamped pencil from K φ = θ M φ, θ = −λ².

    A complex pair θ, θ* gives the two modes λ and −λ*; θ < 0 gives the two real λ = ±√−θ; a θ that is zero within its
    uncertainty gives one mode λ = 0 whose re_uncertainty is the square root of that. Of a complex K each θ gives one
    mode, that of Im λ ≥ 0.

    Parameters
    ----------
    theta : (k,) real or complex, rad²/s²
    right, left : (n, k)
        Left vectors in the order of the right ones, any basis where eigenvalues are multiple; they are scaled here.
    second_order : bool
        Whether left vectors are so exact that a residual moves an eigenvalue only as far as they see it.
    """
    theta, right, left = separated_divergences(pencil, theta, unit_mass(pencil, right), left)
    lefts, Mright = left, lift(pencil.M, right)
    left = biorthogonal(left, left.conj().T @ Mright, theta)
    lam = 1j * np.sqrt(theta.astype(complex))
    residual = pencil.apply(lam, right, Mright)
    magnitude = pencil.magnitude(lam, right)
    backward = _relative(pencil, residual, magnitude)
    first_order, amplification = _perturbation(left, residual, magnitude, theta)
    seen = 0.0 if second_order else np.abs(residual)
    least = np.einsum("ij,ij->j", np.abs(right), seen + ROUNDING * magnitude)
    u_theta = near_coalescence(first_order, least, theta, right.conj().T @ Mright)
    u_theta = np.maximum(u_theta, defective_error(pencil, theta, right, lefts, magnitude))

    # A rigid mode: θ is zero within what rounding leaves.
    rigid = np.abs(theta) <= u_theta
    lam = np.where(rigid, 0.0, lam)
    # |√(θ+δ) − √θ| is at most δ/2√θ to first order, and at most √δ always. A real λ moves by up to this for θ < 0.
    nearest = np.sqrt(np.maximum(np.abs(theta) - u_theta, 0.0))
    diverges = (theta.imag == 0) & (theta.real < 0)
    u_re = np.where(diverges, _over(u_theta, np.abs(lam) + nearest), _over(u_theta, 2 * np.abs(lam)))
    u_re = np.minimum(u_re, np.sqrt(u_theta))
    condition = _over(amplification, 2 * np.abs(theta))
    if pencil.is_complex:
        divergent = np.zeros(0, dtype=int)
        u_re = _outside_the_law(pencil, lam, right, left, u_re, 2 * np.abs(lam))
    else:
        real = (np.abs(lam.imag) <= u_re) & (np.abs(lam.real) > u_re) & (theta.imag == 0)
        divergent = np.flatnonzero(~rigid & real)
    lam[divergent] = lam[divergent].real
    index = np.concatenate([np.arange(len(lam)), divergent])
    lam = np.concatenate([lam, -lam[divergent]]) + 0.0  # turns −0 into 0
    order = _by_frequency(lam, u_re[index])
    index, lam = index[order], lam[order]
    return Modes(lam, right[:, index], left[:, index], backward[index], u_re[index], condition[index], method)


def modes_from_lambda(
    pencil: Pencil, lam: np.ndarray, right: np.ndarray, left: np.ndarray, method: str, second_order: bool = False,
    known: np.ndarray | None = None,
) -> Modes:  # fmt: skip
    """Return the modes of a pencil with C from its eigenpairs that are `in_upper_half`.

    Of those that `grow_below` the axis only the largest Re λ is kept, as `Modes.beyond`, where losses alone let them
    swing, or no mode above the axis is their partner. What is real but for its uncertainty is not below it.

    Parameters
    ----------
    lam : (k,) complex, rad/s
    right, left : (n, k) complex
        Left vectors in the order of the right ones, any basis where eigenvalues are multiple.
    second_order : bool
        As of `modes_from_theta`.
    known : (m,) complex, rad/s, optional
        Modes of the pencil that are known besides, which may be partners.
    """
    lam, right, left = separated(pencil, lam, unit_mass(pencil, right), left)
    # ψ_iᴴ((λ_i + λ_j)M + C)φ_j vanishes for λ_i ≠ λ_j, and is ψᴴ(2λM + C)φ on the diagonal.
    lefts, Mright = left, lift(pencil.M, right)
    mass = left.conj().T @ Mright
    gram = (lam[:, None] + lam[None, :]) * mass + left.conj().T @ lift(pencil.C, right)
    left = biorthogonal(left, gram, lam, _rounding_at_rest(pencil, lam, right, left))
    residual = pencil.apply(lam, right, Mright)
    magnitude = pencil.magnitude(lam, right)
    backward = _relative(pencil, residual, magnitude)
    first_order, amplification = _perturbation(left, residual, magnitude, lam)
    dissipation = np.abs(np.einsum("ij,ij->j", right.conj(), lift(pencil.C, right)))
    seen = 0.0 if second_order else np.abs(residual)
    least = np.einsum("ij,ij->j", np.abs(right), seen + ROUNDING * magnitude)
    with np.errstate(over="ignore"):  # for λ = 0 without damping the derivative of λ is infinite
        least = least / np.maximum(2 * np.abs(lam) + dissipation, np.finfo(float).tiny)
    u = near_coalescence(first_order, least, lam, right.conj().T @ Mright)
    slope = np.where(lam == 0, np.inf, 2 * np.abs(lam))
    u = np.maximum(u, defective_error(pencil, lam, right, lefts, magnitude / slope))
    rounding = rounding_of_zero(pencil, lam, right, second_order)
    rigid = np.abs(lam) <= rounding
    lam, u = np.where(rigid, 0.0, lam), np.where(rigid, rounding, u)
    if pencil.is_complex:
        # Losses that hardly touch a real λ leave an imaginary part of rounding, of either sign.
        lam = np.where(_is_real(lam, pencil.n) | ((np.abs(lam.imag) <= u) & (np.abs(lam.real) > u)), lam.real, lam)
        u = _outside_the_law(pencil, lam, right, left, u, np.ones(len(lam)))
    order, below = _by_frequency(lam, u), grow_below(pencil, lam)
    upper = np.append(lam[lam.imag > 0], [] if known is None else known)
    below &= (u >= np.abs(lam)) | (np.abs(upper - lam.conj()[:, None]) > _MIRRORED * u[:, None]).all(axis=1)
    if pencil.is_complex:
        order = order[lam[order].imag >= 0]
    condition, beyond = _over(amplification, np.abs(lam)), float(lam.real[below].max(initial=0.0))
    return Modes(lam, right, left, backward, u, condition, method, beyond=beyond).select(order)


def together(modes: Modes, others: Modes) -> Modes:
    """Return modes of one pencil and others of it as one set, by the method of the others."""
    assert modes.left is not None and others.left is not None
    u = np.append(modes.re_uncertainty, others.re_uncertainty)
    every = Modes(
        np.append(modes.lam, others.lam), np.hstack([modes.right, others.right]), np.hstack([modes.left, others.left]),
        np.append(modes.backward_error, others.backward_error), u, np.append(modes.condition, others.condition),
        others.method, beyond=max(modes.beyond, others.beyond), unsearched=modes.unsearched.joined(others.unsearched),
    )  # fmt: skip
    return every.select(_by_frequency(every.lam, u))


def _by_frequency(lam: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the order (k,) of λ (k,) by rising frequency, and by falling growth rate where frequencies are equal.

    The two modes of a coupled pair have one frequency, and rounding must not decide which of them comes first. Growth
    rates within their uncertainties u (k,) of zero count as zero.
    """
    order = np.lexsort((-lam.real, lam.imag))
    frequency = lam.imag[order]
    group = np.concatenate([[0], np.cumsum(np.diff(frequency) > _ONE_FREQUENCY * np.abs(frequency[1:]))])[: len(lam)]
    growth = np.where(np.abs(lam.real) <= u, 0.0, lam.real)[order]
    return np.asarray(order[np.lexsort((frequency, -growth, group))])


def _rounding_at_rest(pencil: Pencil, lam: np.ndarray, right: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Return for each mode what rounding leaves at most of ψᴴCφ, for any φ, where λ is known to be zero; 0 for others.

    Where a motion has no force on itself, as a gyroscopic one, ψᴴCφ may be less for its own φ than for another one.
    """
    found, known = np.zeros(len(lam)), np.flatnonzero(lam == 0)
    if len(known) and pencil.C is not None:
        sizes = np.abs(left[:, known]).T @ (abs(pencil.C) @ np.abs(right[:, known]))
        found[known] = ROUNDING * sizes.max(axis=1)
    return found


def in_upper_half(pencil: Pencil, lam: np.ndarray) -> np.ndarray:
    """Return (k,) bool, which eigenvalues lam (k,) of a pencil with C to keep: those with Im λ ≥ 0, up to rounding.

    The others of a real pencil are conjugates of these. With a complex K, rounding may put the λ = 0 of a rigid body
    that a dashpot holds on either side of the real axis. The λ = 0 of a free body is double, and rounding splits it
    into ±δ, of which one is kept. If Im λ is all rounding, as with strong dashpots, its sign means nothing, and λ is
    kept too.
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


def grow_below(pencil: Pencil, lam: np.ndarray) -> np.ndarray:
    """Return (k,) bool, which eigenvalues lam (k,) are below the real axis with a complex K and grow as fast as swing.

    Losses move a real λ > 0 there where they do not act on what makes it grow, as on a negative stiffness of a contact.
    """
    return np.asarray(pencil.is_complex & (lam.imag < 0) & (lam.real >= -lam.imag))


def _is_real(lam: np.ndarray, n: int) -> np.ndarray:
    return np.asarray(np.abs(lam.imag) <= n * np.finfo(float).eps * np.abs(lam))


def _outside_the_law(
    pencil: Pencil, lam: np.ndarray, right: np.ndarray, left: np.ndarray, u: np.ndarray, slope: np.ndarray
) -> np.ndarray:
    """Return re_uncertainty of a complex K: more than `u` where |Re λ| ≥ |Im λ|, of which its law says nothing.

    K(1 + iη) holds for Im λ > 0 and its conjugate for Im λ < 0; of motion that does not oscillate it says nothing.
    There λ is uncertain by all that the losses change of it, |ψᴴ(Im K)φ|/slope. Where that is no less than about
    |Im λ|, as of a θ near the negative real axis, the sign of Im θ, however small, decides whether the root in the
    upper half plane grows or decays: that follows from where the law is cut off, not from the brake, and λ is uncertain
    by |λ|.

    Parameters
    ----------
    lam, u, slope : (k,)
        The slope is ψᴴ(∂(λ²M + λC + K)/∂λ)φ.
    right, left : (n, k)
    """
    beyond = np.flatnonzero(np.abs(lam.real) >= np.abs(lam.imag))
    if len(beyond):
        size, u = np.abs(lam[beyond]), u.copy()
        effect = np.abs(np.einsum("ij,ij->j", left[:, beyond].conj(), lift(pencil.K.imag, right[:, beyond])))
        effect = _over(effect, slope[beyond])
        u[beyond] = np.fmax(u[beyond], np.where(effect < _ENOUGH * np.abs(lam.imag[beyond]), effect, size))
    return u


def _perturbation(
    left: np.ndarray, residual: np.ndarray, magnitude: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the first-order error of each eigenvalue, and its amplification: the error per relative error of entries.

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


def eigenvalue_errors(pencil: Pencil, lam: np.ndarray, right: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Return how far residuals and rounding may move eigenvalues (k,) of a pencil with C, to first order, rad/s.

    Near a defective eigenvalue it is about what rounding makes of it, however often it is defective: a distance δ grows
    from an error ε with ε/δᵏ⁻¹, which is δ itself for δᵏ = ε.

    Parameters
    ----------
    lam : (k,) complex, rad/s
    right, left : (n, k)
        Left vectors in the order of the right ones.
    """
    right = unit_mass(pencil, right)
    gram = (lam[:, None] + lam) * (left.conj().T @ lift(pencil.M, right)) + left.conj().T @ lift(pencil.C, right)
    left = biorthogonal(left, gram, lam)
    residual, magnitude = np.abs(pencil.apply(lam, right)), pencil.magnitude(lam, right)
    return np.asarray(np.einsum("ij,ij->j", np.abs(left), residual + ROUNDING * magnitude))


def backward_errors(pencil: Pencil, lam: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the backward errors (k,) of pairs λ (k,), u (n, k), see `Modes`."""
    return _relative(pencil, pencil.apply(lam, u), pencil.magnitude(lam, u))


def _relative(pencil: Pencil, residual: np.ndarray, magnitude: np.ndarray) -> np.ndarray:
    d = pencil.units[0][:, None]
    left, size = _column_norms(d * residual), _column_norms(d * magnitude)
    return np.divide(left, size, out=np.zeros(len(left)), where=left > 0)  # 0/0 where nothing acts on an unknown


def _over(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a / b, infinite where b is zero."""
    return np.divide(a, b, out=np.full(len(b), np.inf), where=b != 0)


def _column_norms(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(x, axis=0))
