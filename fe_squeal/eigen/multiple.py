"""Multiple eigenvalues: bases of their modes, and what rounding makes of them."""

from __future__ import annotations

import numpy as np

from .blocks import lift
from .pencil import Pencil

# Entries of assembled matrices are sums of some tens of rounded products.
ROUNDING = 8 * np.finfo(float).eps
_EQUAL = 1e-9  # relative distance below which eigenvalues count as one multiple eigenvalue
_COPY = 1e-6  # of |λ|: two that are closer may be those of equal parts of a brake
_ONE_SHAPE = 64 * ROUNDING  # squared sine of the angle between two modes below which they are one shape
_SPANNING = 32  # of the modes near another one, those most alike: as many are looked at together, at little cost
_NEARLY_REAL = 1e-6  # Im λ over |λ| up to which a complex pair may be two equal real eigenvalues, split by rounding
# Share of the squared lengths of vectors above which a direction is one of its own, and above which it may be one:
# LAPACK's vectors of several equal eigenvalues may be nearly parallel.
_APART, _PERHAPS = 1e-6, 1e-12
_MARGIN = 64  # times the rounding of a single sum: what counts as rounding of several
_EXACT = 1e-11  # backward error below which a single vector is a mode by itself


def have_copies(lam: np.ndarray) -> np.ndarray:
    """Return (k,) bool, which λ (k,) are equal to others: as of equal pads, where one mode is as good as another.

    Examples
    --------
    >>> have_copies(np.array([1j, 2j, 2.0000001j, 3j])).tolist()
    [False, True, True, False]
    """
    apart = np.abs(lam[:, None] - lam)
    np.fill_diagonal(apart, np.inf)
    return np.asarray(apart.min(axis=1, initial=np.inf) <= _COPY * np.abs(lam))


def unit_mass(pencil: Pencil, right: np.ndarray) -> np.ndarray:
    """Return modes (n, k) scaled so that φᴴMφ = 1; modes without mass, which exist with damping, are not scaled."""
    mass = np.abs(np.einsum("ij,ij->j", right.conj(), lift(pencil.M, right)))
    return np.asarray(right / np.sqrt(np.where(mass > 0, mass, 1.0)))


def rounding_of_zero(
    pencil: Pencil, lam: np.ndarray, right: np.ndarray, second_order: bool = False
) -> np.ndarray:  # fmt: skip
    """Return (k,) float, rad/s, how far rounding may move the λ = 0 of a rigid mode of a damped pencil.

    It is the root λ of λ²φᴴMφ + λ|φᴴCφ| = δ, where δ is the rounding of φᴴKφ. For a creeping motion, which damping
    holds more than mass, it is δ/|φᴴCφ|; for a free body it is √δ, which is far more.

    Parameters
    ----------
    pencil : Pencil
    lam : (k,) complex, rad/s
    right : (n, k) float or complex
        The modes.
    second_order : bool
        Whether residuals move eigenvalues by their square alone.
    """
    dissipation = np.abs(np.einsum("ij,ij->j", right.conj(), lift(pencil.C, right)))
    stiffness = ROUNDING * pencil.magnitude(np.zeros(len(lam)), right)
    if not second_order:
        stiffness += np.abs(pencil.apply(lam, right))
    delta = np.einsum("ij,ij->j", np.abs(right), stiffness)
    mass = np.abs(np.einsum("ij,ij->j", right.conj(), lift(pencil.M, right)))
    # Of a motion without any force the residual is λ²Mφ, and its root |λ|: rounding must not decide which is less.
    root = dissipation + np.sqrt(dissipation**2 + 4 * mass * delta)
    return np.asarray((1 + _EQUAL) * 2 * delta / np.maximum(root, np.finfo(float).tiny))


def separated(
    pencil: Pencil, lam: np.ndarray, right: np.ndarray, left: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the eigenpairs of a real damped pencil with equal real eigenvalues told apart.

    Rounding makes pairs a ± iδ of two equal real eigenvalues, of which the upper half plane holds one, and pairs ±δ or
    ±iδ of the one zero of a free body. The modes are spanned by the real and imaginary parts of the vectors, and there
    are as many as these have independent directions. Only what these do not solve as well stays as it is: a defective
    pair, whose parts are no modes.

    Parameters
    ----------
    lam : (k,) complex, Im λ ≥ 0
    right, left : (n, k)
    """
    if pencil.is_complex:
        return lam, right, left
    # Exact zeros are those of free motions, which are told apart already.
    zero = (lam != 0) & (np.abs(lam) <= rounding_of_zero(pencil, lam, right))
    groups = [np.flatnonzero(zero)] if zero.any() else []
    groups += [np.array([i]) for i in np.flatnonzero(~zero & (lam.imag > 0) & (lam.imag <= _NEARLY_REAL * np.abs(lam)))]
    gone, found = [], []
    for group in groups:
        at_rest = bool(zero[group[0]])
        apart = _PERHAPS if at_rest else _APART
        Z, W = real_span(pencil, right[:, group], apart), real_span(pencil, left[:, group], apart)
        count = min(Z.shape[1], W.shape[1])
        values = np.repeat(0.0 if at_rest else lam[group].real, count).astype(complex)
        Z, W = Z[:, :count], W[:, :count]
        least = max(_EXACT, _error(pencil, lam[group], right[:, group], left[:, group]) if at_rest else 0.0)
        if count and (count == 2 or at_rest) and _error(pencil, values, Z, W) <= least:
            gone.append(group)
            found.append((values, Z, W))
    if not found:
        return lam, right, left
    rest = np.delete(np.arange(len(lam)), np.concatenate(gone))
    lam, right, left = (
        np.concatenate([a[..., rest], *new], axis=-1)
        for a, new in zip((lam, right, left), zip(*found, strict=True), strict=True)
    )
    return lam, right, left


def separated_divergences(
    pencil: Pencil, theta: np.ndarray, right: np.ndarray, left: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the eigenpairs of a real undamped pencil with equal θ < 0 told apart.

    Rounding makes pairs −a ± iδ of two equal θ = −a. The square roots of such a pair would be two modes ±√a, but there
    are two of each. As in `separated`, a defective pair stays as it is.

    Parameters
    ----------
    theta : (k,) float or complex, rad²/s²
    right, left : (n, k)
    """
    split = (theta.real < 0) & (theta.imag > 0) & (theta.imag <= _NEARLY_REAL * np.abs(theta))
    if pencil.is_complex or not split.any():
        return theta, right, left
    theta, right, left = theta.copy(), right.copy(), left.copy()
    for i in np.flatnonzero(split):
        pair = np.array([i, np.abs(theta - theta[i].conj()).argmin()])
        Z, W = real_span(pencil, right[:, [i]]), real_span(pencil, left[:, [i]])
        same = theta[pair[1]].imag < 0 and np.abs(theta[pair[1]].conj() - theta[i]) <= _EQUAL * np.abs(theta[i])
        lam = np.sqrt(np.full(2, -theta[i].real))
        if same and Z.shape[1] == W.shape[1] == 2 and _error(pencil, lam, Z, W) <= _EXACT:
            theta[pair], right[:, pair], left[:, pair] = theta[i].real, Z, W
    return theta, right, left


def _error(pencil: Pencil, lam: np.ndarray, right: np.ndarray, left: np.ndarray) -> float:
    """Return the backward error of modes, as of one matrix of vectors, from the right or from the left."""
    sides = (pencil, lam, right), (pencil.transposed(), lam.conj(), left)
    return max(float(np.linalg.norm(p.apply(v, x)) / (np.linalg.norm(p.magnitude(v, x)) or 1.0)) for p, v, x in sides)


def real_span(pencil: Pencil, x: np.ndarray, apart: float = _APART) -> np.ndarray:
    """Return real (n, m), orthonormal by mass, that span complex x (n, k); those that carry most of them come first.

    Directions with a smaller share of the squared lengths than `apart` count as rounding.
    """
    x = unit_mass(pencil, x)
    parts = np.hstack([x.real, x.imag])
    w, v = np.linalg.eigh(parts.T @ (pencil.M @ parts))
    keep = np.flatnonzero(w > apart * w.max())[::-1] if w.max() > 0 else np.zeros(0, int)
    return np.asarray(parts @ (v[:, keep] / np.sqrt(w[keep])))


def defective_error(
    pencil: Pencil, values: np.ndarray, right: np.ndarray, left: np.ndarray, magnitude: np.ndarray
) -> np.ndarray:
    """Return the error of multiple eigenvalues whose k modes are one shape, for which no first order exists; else 0.

    The eigenvalues of a 2×2 Jordan block with J above the diagonal move by (δJ)^½ if the entry below it is δ instead of
    0, and those of a k×k block by (δJᵏ⁻¹)^(1/k). δ is rounding, ε|ψ|ᵀmagnitude with ψ of unit mass. J is at most the
    size of the sums that cancel in the mode, |ψ|ᵀmagnitude.

    Parameters
    ----------
    right, left : (n, k)
        The right ones of unit mass.
    """
    error = np.zeros(len(values))
    cluster, size = _clusters(values)
    for c in np.flatnonzero(size > 1):
        i = np.flatnonzero(cluster == c)
        x = right[:, i]
        cosine = np.minimum(np.abs(x.conj().T @ (pencil.M @ x)), 1.0)
        alike = np.maximum((1 - cosine**2 <= _ONE_SHAPE).sum(axis=1), 1)
        size_of = np.einsum("ij,ij->j", np.abs(unit_mass(pencil, left[:, i])), magnitude[:, i])
        error[i] = np.where(alike > 1, size_of * ROUNDING ** (1 / alike), 0.0)
    return error


def near_coalescence(
    first_order: np.ndarray, least: np.ndarray, values: np.ndarray, products: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Bound the error of eigenvalues close to another one by the square-root law of a double eigenvalue.

    With 2h the distance to the other eigenvalue, u the first-order error (which grows as 1/h) and δ the error of an
    eigenvalue whose mode had no part in those near, h² is uncertain by e = 2hu + δ². So h may become √(h² − e), which
    is h − u to first order, or for e > h² the eigenvalues may meet and part at a right angle: each is then uncertain by
    √e. A multiple eigenvalue with a full set of modes has h = 0 and keeps the error δ. The other eigenvalue is the
    nearest one, or of several within 4u, as far as two that may meet are apart, the one whose shape is most alike.

    At an angle α to the span of the modes near it a mode has a condition number of 1/sin α within that span, so that
    δ = u sin α: where these are of another shape, as a copy of it elsewhere, all of u has other causes.

    Parameters
    ----------
    first_order, least, values : (k,)
        The least is the error of a well-conditioned eigenvalue.
    products : (k, k) float or complex
        φ_iᴴMφ_j of modes of unit mass.
    """
    if len(values) < 2:
        return first_order
    alike, least = np.abs(products), least.copy()
    distance = np.abs(values[:, None] - values[None, :])
    np.fill_diagonal(distance, np.inf)
    nearest = distance.min(axis=1)
    near = (distance <= np.fmax(4 * first_order, nearest)[:, None]) & np.isfinite(distance)
    other = np.where(near, alike, -1.0).argmax(axis=1)
    for i in np.flatnonzero((nearest <= 4 * first_order) & (least < first_order) & np.isfinite(first_order)):
        others = np.flatnonzero(near[i])
        others = others[np.argsort(-alike[i, others], kind="stable")[:_SPANNING]]
        least[i] = max(least[i], first_order[i] * _sine(products[others, i], products[np.ix_(others, others)]))
    h = distance[np.arange(len(values)), other] / 2
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        e = 2 * h * first_order + least**2
        bound = np.where(e > h**2, np.sqrt(e), e / (h + np.sqrt(h**2 - e)))
    return np.fmax(least, np.where(np.isnan(bound), first_order, bound))


def _sine(part: np.ndarray, gram: np.ndarray) -> float:
    """Return the sine of the angle between a mode and the span of others, zero where it is rounding.

    Parameters
    ----------
    part, gram : (m,), (m, m)
        Products of the others with the mode and with each other.
    """
    squared = 1 - np.vdot(part, np.linalg.pinv(gram, ROUNDING, hermitian=True) @ part).real
    return float(np.sqrt(squared)) if squared > _ONE_SHAPE else 0.0


def _clusters(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for each eigenvalue the number of its group of equal ones, and the size of each group."""
    near = np.abs(values[:, None] - values[None, :]) <= _EQUAL * np.maximum(np.abs(values)[:, None], np.abs(values))
    first = np.arange(len(values))  # of those connected to each; sparse graphs of SciPy cost more than small modes do
    while len(first) and (lower := np.where(near, first, len(first)).min(axis=1)).tolist() != first.tolist():
        first = lower
    _, cluster, size = np.unique(first, return_inverse=True, return_counts=True)
    return cluster, size


def biorthogonal(
    left: np.ndarray, gram: np.ndarray, values: np.ndarray, rounding: np.ndarray | None = None
) -> np.ndarray:
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
    rounding : (k,), optional
        What rounding leaves of ψᴴ(weight)φ, where an eigenvalue is exactly known and may be defective: its left vectors
        are then zero.
    """
    rounding = np.zeros(len(values)) if rounding is None else _MARGIN * rounding
    left = left.astype(np.result_type(left, gram))
    cluster, size = _clusters(values)
    alone = np.flatnonzero(size[cluster] == 1)
    own = gram.diagonal()[alone]
    left[:, alone] *= np.divide(1.0, own, out=np.zeros_like(own), where=np.abs(own) > rounding[alone]).conj()
    for c in np.flatnonzero(size > 1):
        i = np.flatnonzero(cluster == c)
        block = gram[np.ix_(i, i)]
        unit = np.abs(block).max() or 1.0
        least = max(np.finfo(float).eps, min(rounding[i].max() / unit, 1.0))
        left[:, i] = left[:, i] @ (np.linalg.pinv(block / unit, rcond=least) / unit).conj().T
    return left
