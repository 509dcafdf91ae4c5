"""The ways to ask LAPACK for all eigenpairs of small matrices, the cheapest first: none is accurate for all of them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from .polish import judged_pairs, pair_errors

Pairs = tuple[np.ndarray, np.ndarray, np.ndarray]  # eigenvalues (k,), right and left vectors (n, k)
APART = 1.001  # at least this ratio of two eigenvalues is between those that are taken from one list and another
_BLURRED = 1e-11  # of the largest eigenvalue asked for: a method with such a rounding is not tried
SOLVES = 1e-8  # backward error above which an eigenvalue that may be infinite is what rounding makes of one
_SINGULAR = 16.0  # times n ε: part of the largest eigenvalue of a mass matrix that its eigenvalues may be wrong by
_SHIFT = 0.1  # times the largest eigenvalue asked for: the shift, about as far from that as from much smaller ones


def symmetric_methods(M: np.ndarray, K: np.ndarray) -> list[Callable[[], Pairs]]:
    """Return methods for K x = θ M x with symmetric M, K (n, n), the cheapest first."""

    def direct() -> Pairs:
        theta, phi = la.eigh(K, M)
        return theta, phi, phi

    def graded() -> Pairs:
        """Low modes from M φ = ν K φ, ν = 1/θ, where some unknowns are much lighter or stiffer than others."""
        nu, phi = la.eigh(M, K)
        return _together([K, -M], _inverse(nu, phi, phi), direct())

    def inverted() -> Pairs:
        """1/(θ + 1) of M against K + M, where M is singular or nearly so and K has no strong divergence."""
        nu, phi = la.eigh(M, K + M)
        finite = nu > len(M) * np.finfo(float).eps
        return 1 / nu[finite] - 1, phi[:, finite], phi[:, finite]

    def constrained() -> Pairs:
        """Unknowns without mass, eliminated from K φ = θ M φ: QZ would split equal eigenvalues into complex pairs.

        Their own stiffness K00 makes some follow the others statically. Its null vectors are Lagrange multipliers:
        their rows are constraints Bu = 0, on whose null space the others move.
        """
        rest, light = (np.flatnonzero(f) for f in (M.diagonal() > 0, M.diagonal() == 0))
        if not len(light):
            raise la.LinAlgError("every unknown has mass")
        w, v = la.eigh(K[np.ix_(light, light)])
        stiff = np.abs(w) > len(w) * np.finfo(float).eps * max(np.abs(w).max(), 1.0)  # of entries of order one
        across = v.T @ K[np.ix_(light, rest)]
        follow = -across[stiff] / w[stiff, None]
        S = K[np.ix_(rest, rest)] + across[stiff].T @ follow
        B = across[~stiff]
        free = la.null_space(B) if len(B) else np.eye(len(rest))
        if free.shape[1] != len(rest) - len(B):
            raise la.LinAlgError("the constraints depend on each other")
        mass = M[np.ix_(rest, rest)]
        theta, y = la.eigh(free.T @ S @ free, free.T @ mass @ free)
        phi = np.zeros((len(M), len(theta)))
        phi[rest] = free @ y
        phi[light] = v[:, stiff] @ (follow @ phi[rest])
        if len(B):  # the forces that hold the constraints
            forces = la.lstsq(B.T, (mass @ phi[rest]) * theta - S @ phi[rest])[0]
            phi[light] += v[:, ~stiff] @ forces
        return theta, phi, phi

    return [direct, graded, inverted, constrained, lambda: _qz(K, M)]


def undamped_methods(M: np.ndarray, K: np.ndarray, highest: float) -> list[Callable[[], Pairs]]:
    """Return methods for K x = θ M x with M, K (n, n); pairs beyond |θ| = highest may be left out."""

    def standard() -> Pairs:
        """With M = LLᵀ the standard problem L⁻¹KL⁻ᵀ is several times cheaper than QZ."""
        L = la.cholesky(M, lower=True)
        theta, left, right = la.eig(_congruent(L, K), left=True, right=True)
        keep = np.abs(theta) <= highest
        return theta[keep], _back(L, right[:, keep]), _back(L, left[:, keep])

    def graded() -> Pairs:
        """Low modes from K⁻¹M φ = ν φ, ν = 1/θ, where some unknowns are much lighter or stiffer than others."""
        nu, left, right = la.eig(np.linalg.solve(K, M), left=True, right=True)
        return _together([K, -M], _inverse(nu, right, np.linalg.solve(K.conj().T, left)), standard())

    return [standard, graded, lambda: _qz(K, M)]


def _inverse(nu: np.ndarray, x: np.ndarray, y: np.ndarray) -> Pairs:
    """Return the pairs with 1/ν instead of ν, without those that rounding does not tell from infinity."""
    finite = np.abs(nu) > len(nu) * np.finfo(float).eps * np.abs(nu).max()
    return 1 / nu[finite], x[:, finite], y[:, finite]


def _together(A: Sequence[np.ndarray], low: Pairs, high: Pairs) -> Pairs:
    """Return the smallest pairs of one list and the largest of another one, all of which both lists have.

    LAPACK's error is a rounding of the largest eigenvalue it is asked for. That of 1/θ is the smallest θ. So what is
    much smaller than the largest θ is right in one list, and what is much larger than the smallest θ in the other one.
    """
    parts = []
    for v, x, y in (low, high):
        order = np.argsort(np.abs(v), kind="stable")
        parts.append((v[order], x[:, order], y[:, order]))
    wrong = [judged_pairs(A, *pairs)[1] for pairs in parts]
    sizes = [np.abs(v) for v, _, _ in parts]
    m = min(map(len, sizes))
    if m < 2:
        raise la.LinAlgError("too few eigenvalues to be parted")
    # Parted before the s-th eigenvalue of both lists, where all others are smaller: not within a pair.
    gap = np.minimum.reduce([s[1:m] for s in sizes]) / np.maximum.reduce([s[: m - 1] for s in sizes])
    faults = np.cumsum(wrong[0])[: m - 1] + np.cumsum(wrong[1][::-1])[::-1][1:m]
    s = 1 + int(np.argmin(np.where(gap > APART, faults, np.iinfo(int).max)))
    v, x, y = (np.concatenate([a[..., :s], b[..., s:]], axis=-1) for a, b in zip(*parts, strict=True))
    return v, x, y


def damped_methods(
    M: np.ndarray, C: np.ndarray, K: np.ndarray, highest: float, upper: bool
) -> list[Callable[[], Pairs]]:  # fmt: skip
    """Return methods for (λ²M + λC + K) x = 0 with M, C, K (n, n).

    They linearise [[0, I], [−K, −C]] z = λ [[I, 0], [0, M]] z, z = (u, λu); the lower half of a left z is a left mode.

    Pairs beyond |λ| = highest, and with `upper` those with Im λ < 0, may be left out.
    """
    n = len(M)
    zero, identity = np.zeros((n, n)), np.eye(n)

    def standard() -> Pairs:
        """With M = LLᵀ a standard problem in Lᵀu, several times cheaper than QZ."""
        L = la.cholesky(M, lower=True)
        damping = _congruent(L, C)
        if np.finfo(float).eps * la.norm(damping, 1) > _BLURRED * highest:
            raise la.LinAlgError("a rounding of the fastest eigenvalue hides those asked for")
        A = np.block([[zero, identity], [-_congruent(L, K), -damping]])
        lam, left, right = la.eig(A, left=True, right=True)
        keep = (np.abs(lam) <= highest) & ((lam.imag >= 0) | (not upper))
        return lam[keep], _back(L, right[:n, keep]), _back(L, left[n:, keep])

    def shifted() -> Pairs:
        """1/(ν − 1) of λ = νs: what C makes fast comes to 0, and what creeps to −1. Divergence may be near ν = 1."""
        if not np.isfinite(highest):
            raise la.LinAlgError("all eigenvalues are asked for")
        shift = _SHIFT * highest
        S, Q = inverse_of_companion(M, C, K, shift)
        mu, left, right = la.eig(S, left=True, right=True)
        keep = np.abs(mu) > np.finfo(float).eps * np.abs(mu).max()
        lam = np.full(len(mu), np.inf, complex)
        lam[keep] = shift * (1 + 1 / mu[keep])
        keep &= (np.abs(lam) <= highest) & ((lam.imag >= 0) | (not upper))
        return lam[keep], right[:n, keep], la.lu_solve(Q, left[:n, keep] + left[n:, keep], trans=2)

    def general(unit: float = 1.0) -> Pairs:
        """QZ with λ in multiples of a unit: a linearisation is accurate for λ near it where C is large."""
        size = max(np.abs(K).max(), unit * np.abs(C).max(), unit**2 * np.abs(M).max()) or 1.0
        A = np.block([[zero, identity], [-K / size, -unit / size * C]])
        lam, right, left = _qz(A, la.block_diag(identity, unit**2 / size * M))
        return unit * lam, right[:n], left[n:]

    def by_ranges() -> Pairs:
        """Creeping modes around K/C, ordinary ones around 1 and fast ones around C/M, each with its own unit."""
        k, c, m = (np.abs(A.diagonal()) for A in (K, C, M))
        if not ((c > 0) & (k > 0)).any() or not ((c > 0) & (m > 0)).any():
            raise la.LinAlgError("no unknown is damped")
        slow = float(np.median((k / np.where(c > 0, c, 1.0))[(c > 0) & (k > 0)]))
        fast = float(np.median((c / np.where(m > 0, m, 1.0))[(c > 0) & (m > 0)]))
        borders = [0.0, np.sqrt(min(slow, 1.0)), np.sqrt(max(fast, 1.0)), np.inf]
        parts = []
        for unit, low, high in zip((slow, 1.0, fast), borders[:-1], borders[1:], strict=True):
            lam, right, left = general(unit)
            inside = (low <= np.abs(lam)) & (np.abs(lam) < high)
            parts.append((lam[inside], right[:, inside], left[:, inside]))
        lam, right, left = (np.concatenate(p, axis=-1) for p in zip(*parts, strict=True))
        return lam, right, left

    return [standard, shifted, general, by_ranges]


def inverse_of_companion(
    M: np.ndarray, C: np.ndarray, K: np.ndarray, shift: float
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:  # fmt: skip
    """Return S (2n, 2n) whose eigenvalues are 1/(λ/s − 1) for those of (λ²M + λC + K) x = 0, and factors of Q(s).

    S = (A − B)⁻¹B of the linearisation A z = ν B z with ν = λ/s, by Q(s) = K + sC + s²M alone, for M, C, K (n, n).

    Raises
    ------
    LinAlgError
        The shift s > 0 is an eigenvalue.
    """
    C1, M1 = shift * C, shift**2 * M
    Q = regular_lu(K + C1 + M1)
    first, second = (la.lu_solve(Q, part) for part in (C1 + M1, M1))
    return np.block([[-first, -second], [np.eye(len(M)) - first, -second]]), Q


def _qz(A: np.ndarray, B: np.ndarray) -> Pairs:
    (alpha, beta), left, right = la.eig(A, B, left=True, right=True, homogeneous_eigvals=True)
    finite = beta != 0
    v, right, left = alpha[finite] / beta[finite], right[:, finite], left[:, finite]
    # What rounding makes of infinite eigenvalues solves nothing; a fast one may have as small a β, and solves it.
    keep = np.abs(beta[finite]) > len(A) * np.finfo(float).eps * la.norm(B, 1)
    small = ~keep & np.isfinite(v)
    keep[small] = pair_errors([A, -B], v[small], right[:, small], left[:, small]) <= SOLVES
    return v[keep], right[:, keep], left[:, keep]


def finite_number(A: Sequence[np.ndarray]) -> int:
    """Return how many finite eigenvalues v of (A0 + v A1 + v² A2) x = 0 there are, A2 left out without damping.

    Unknowns whose rows of mass are empty have fewer: those without inertia have no θ, and of two λ they keep one for
    each rank of their own damping. Motions among them that nothing else holds are Lagrange multipliers, which take
    that of another unknown, too: of one with mass, or where they tie it to a damped one without, the only λ of that.
    Where their forces act on more damped unknowns than they hold, or on fewer, it may be too large.

    Parameters
    ----------
    A : sequence of (n, n) float or complex
        The last one is that of mass, or of its negative, and entries are of order one.
    """
    order, light = len(A) - 1, np.asarray(~A[-1].any(axis=1))
    own = [part[np.ix_(light, light)] for part in A[:order]]
    damped, limits = 0, [_rounding(part) for part in own]
    if order == 2:
        left, c, right = np.linalg.svd(own[1])
        damped = int(np.count_nonzero(c > limits[1]))
        own[0] = left.conj().T @ own[0] @ right.conj().T
    left, k, right = np.linalg.svd(own[0][damped:, damped:])
    held = int(np.count_nonzero(k > limits[0]))
    across = left[:, held:].conj().T @ own[0][damped:, :damped], own[0][:damped, damped:] @ right[held:].conj().T
    tied = max(int(np.count_nonzero(np.linalg.svd(part, compute_uv=False) > limits[0])) for part in across)
    return order * int(len(light) - light.sum() - (len(k) - held)) + damped + tied


def _rounding(A: np.ndarray) -> float:
    """Return up to where singular values of a matrix (k, k), turned or not, or of a part of it, may be rounding."""
    return _SINGULAR * len(A) * np.finfo(float).eps * max(np.abs(A).max(initial=0.0), 1.0)


def massless_apart(A: list[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray | None]:
    """Return the matrices of other unknowns, where a mass matrix is singular and few of its rows or none are empty.

    Each row of the mass of nodes that move one lump by their mean has entries, and rounding makes large numbers of the
    θ that are infinite. With M = T W Tᵀ the unknowns T of zero W are those without mass, whose rows are empty.

    Parameters
    ----------
    A : list of (n, n) float or complex
        The last one is that of mass, or of its negative: real and symmetric, with a diagonal of order one.

    Returns
    -------
    A : those given, or TᵀAT
    T : (n, n) float or None
        Orthogonal. It mixes only unknowns that mass couples. None where M has full rank but for empty rows.
    """
    M, T = A[-1], None
    if np.count_nonzero(M) == M.size and _is_definite(M):  # as of most projections
        return A, None
    labels = connected_components(sp.csr_array(M), directed=False)[1]
    light = []
    for label in np.flatnonzero(np.bincount(labels) > 1):
        own = np.flatnonzero(labels == label)
        block, limit = M[np.ix_(own, own)], _SINGULAR * len(own) * np.finfo(float).eps
        if _is_definite(block):
            continue
        w, v = la.eigh(block)
        T = np.eye(len(M)) if T is None else T
        T[np.ix_(own, own)] = v
        light.append(own[np.abs(w) <= limit * np.abs(w).max()])
    if T is None:
        return A, None
    turned = [T.T @ part @ T for part in A]
    for rows in light:
        turned[-1][rows] = turned[-1][:, rows] = 0.0
    return turned, T


def _is_definite(M: np.ndarray) -> bool:
    """Return whether a symmetric matrix (k, k), or its negative, is positive definite beyond rounding."""
    factor, failed = la.lapack.dpotrf(np.sign(np.trace(M)) * M)
    return not failed and bool(la.lapack.dpocon(factor, la.norm(M, 1))[0] > _SINGULAR * len(M) * np.finfo(float).eps)


def regular_lu(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the factors and pivots of a finite matrix (n, n) that is not singular, for `scipy.linalg.lu_solve`.

    Raises
    ------
    LinAlgError
        It is.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", la.LinAlgWarning)
        try:
            lu, pivots = la.lu_factor(A, check_finite=False)
        except la.LinAlgWarning as error:
            raise la.LinAlgError(str(error)) from error
    return lu, pivots


def _congruent(L: np.ndarray, A: np.ndarray) -> np.ndarray:
    """Return L⁻¹AL⁻ᵀ."""
    return np.asarray(la.solve_triangular(L, la.solve_triangular(L, A, lower=True).T, lower=True).T)


def _back(L: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.asarray(la.solve_triangular(L, x, lower=True, trans="T"))
