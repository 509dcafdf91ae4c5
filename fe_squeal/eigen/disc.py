"""The eigenvalues of an operator outside a circle around zero, by block Krylov–Schur iteration.

Of a shift-inverted operator these are the eigenvalues in a disc around the shift. ARPACK converges a number of
eigenvalues, however many others are as large. Here the radius is given, so that what lies at the rim does not have to
converge: strong dampers crowd hundreds of real eigenvalues there. Blocks find multiple eigenvalues, and solves with
several right-hand sides at once read the factors from memory once for all of them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la

from .blocks import combine, cross
from .linear.factor import Solve
from .memory import require_vectors

BLOCK = 4  # vectors that are multiplied at once
_TOLERANCE = 1e-13  # of |ν|: residual of an eigenpair, which is at the level of rounding then
_NEGLIGIBLE = 0.01  # of the largest |ν|: smaller eigenvalues have residuals relative to this
_LOOK, _RARELY = 24, 0.2  # new vectors, or part of those before, after which eigenvalues are computed again
_ROOM = 3  # times the largest number of eigenvalues: vectors of a full space, in addition to those of _MORE
_MORE = 60
_KEPT = 1.5  # times the eigenvalues outside the circle: vectors kept of a full space, in addition to those of _BESIDE
_BESIDE = 20
# Of the largest product: what orthogonalisation leaves of another one is nothing but rounding if it is smaller than the
# first of these. If it is smaller than the second, rounding is some 1e-10 of it or more.
_NOTHING, _FAINT = 1e-14, 1e-6
_PATIENT, _SHOWN = 12, 1e-2  # restarts for eigenvalues that are needed; of |ν|: the residual of one that shows
_SEED = 20261125


def largest_within(
    apply: Solve, size: int, radius: float, most: int, restarts: int = 12, draw: int = 0,
    needed: Callable[[np.ndarray], np.ndarray] | None = None, block: int = BLOCK, least: int = 0,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """Return eigenvalues ν (k,) with |ν| > 1/radius, their vectors (size, k), and a radius for which these are all.

    The radius returned is smaller than the one given where there are more than `most` such eigenvalues, or where not
    all of them converge. Those that did converge beyond it are returned too, up to `most` of them all.

    Parameters
    ----------
    apply : callable
        The operator on columns (size, b): a real one of real columns, whose eigenvalues come in conjugate pairs then.
    size : int
        At least `most`, two blocks and some more.
    radius : float
        1/|ν| of the circle; infinite for the `most` largest eigenvalues.
    most : int
        Largest number of eigenvalues to look for.
    restarts : int
        How often a full space is cut back, at most.
    draw : int
        Which random vectors to start from. These decide which copies of a multiple eigenvalue are found: as many as a
        block has vectors. Others start where those are taken out, for the same ones would have nothing left of it.
    needed : callable, optional
        Which of ν (k,) are worth up to `_PATIENT` restarts more, where they begin to show in a full space.
    block : int
        Vectors that are multiplied at once.
    least : int
        With fewer vectors the search does not end, unless a full space has no more. The eigenvalues found so far do not
        tell of one that hardly shows yet, since it is not much larger than a crowd of others.

    References
    ----------
    Stewart, SIAM J. Matrix Anal. Appl. 23, 2001 (Krylov–Schur iteration); Zhou and Saad, Numer. Algorithms 47, 2008
    (with blocks).

    Examples
    --------
    >>> lam = np.append([1.0, 2.0, 2.0], np.linspace(5.0, 6.0, 497))
    >>> nu, _, known = largest_within(lambda z: z / lam[:, None], 500, 3.0, 10)
    >>> np.round(np.sort(1 / nu.real), 9), known
    (array([1., 2., 2.]), 3.0)
    """
    room = min(room_for(most, block), (size - block) // block * block)
    require_vectors(size, room + block, 16)
    start = la.qr(np.random.default_rng(_SEED + draw).standard_normal((size, block)), mode="economic")[0]
    dtype = np.result_type(apply(start[:, :1]))
    V = np.zeros((size, room + block), dtype, order="F")
    S = np.zeros((room + block, room), dtype)  # A V_m = V_(m + b) S
    V[:, :block] = start
    m, looked, cut = 0, 0, 0
    while True:
        _extend(apply, V, S, m, block)
        m += block
        full = m + block > room
        if m - looked < max(_LOOK, _RARELY * looked) and not full:
            continue
        looked = m
        nu, y = la.eig(S[:m, :m])
        order = np.argsort(-np.abs(nu), kind="stable")
        nu, y = nu[order], y[:, order]
        residual = np.linalg.norm(S[m : m + block, :m] @ y, axis=0)
        count, known = _sure(np.abs(nu), residual, radius, most)
        open_ = nu[(np.abs(nu) > 1 / radius) & (residual <= _SHOWN * np.abs(nu)) & ~_converged(np.abs(nu), residual)]
        patient = needed is not None and cut < _PATIENT and needed(open_).any()
        if (known >= radius and (m >= least or full)) or count >= most or (full and cut >= restarts and not patient):
            converged = np.flatnonzero(_converged(np.abs(nu), residual) & (np.abs(nu) > 1 / radius))
            chosen = np.union1d(np.arange(count), converged[: max(most, count)])[: max(most, count)]
            return nu[chosen], combine(V[:, :m], y[:, chosen]), known
        if full:
            wanted = int(np.count_nonzero(np.abs(nu) > 1 / radius))
            m = looked = _cut_back(V, S, m, min(int(_KEPT * min(wanted, most)) + _BESIDE, m - 4 * block), block)
            cut += 1


def room_for(most: int, block: int = BLOCK) -> int:
    """Return how many vectors a search for `most` eigenvalues holds."""
    return (_ROOM * most + _MORE) // block * block


def _extend(apply: Solve, V: np.ndarray, S: np.ndarray, m: int, block: int) -> None:
    """Multiply the last block, make it orthogonal to all vectors, and put it behind them."""
    known = V[:, : m + block]
    W = apply(known[:, m:])
    size = np.linalg.norm(W, axis=0).max()
    W, inside = _orthogonal(known, W)
    S[: m + block, m : m + block] += inside
    Q, R = la.qr(W, mode="economic", check_finite=False)
    if np.abs(R.diagonal()).min() <= _FAINT * size:
        # At unit length the rounding in a column that was so small counts. It lies along the known vectors, too.
        Q, inside = _orthogonal(known, Q)
        S[: m + block, m : m + block] += inside @ R
        Q, again = la.qr(Q, mode="economic", check_finite=False)
        R = again @ R
    if (lost := np.flatnonzero(np.abs(R.diagonal()) <= _NOTHING * size)).size:
        # The space holds all that the operator makes of it. Other directions continue it, which are not coupled to it.
        R[lost] = 0.0
        rest = np.hstack([known, np.delete(Q, lost, axis=1)])
        Q[:, lost] = la.qr(
            _orthogonal(rest, np.random.default_rng(m).standard_normal((len(V), len(lost))).astype(V.dtype))[0],
            mode="economic",
        )[0]
    V[:, m + block : m + 2 * block] = Q
    S[m + block : m + 2 * block, m : m + block] = R


def _orthogonal(known: np.ndarray, W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what columns W (size, b) have outside the span of orthonormal ones, and their coordinates inside."""
    coordinates = np.zeros((known.shape[1], W.shape[1]), W.dtype)
    for _ in range(2):  # once more, since the first time leaves rounding of what was taken out
        inside = cross(known, W.conj()).conj() if np.iscomplexobj(W) else cross(known, W)
        W = W - combine(known, inside)
        coordinates += inside
    return W, coordinates


def _sure(size: np.ndarray, residual: np.ndarray, radius: float, most: int) -> tuple[int, float]:
    """Return how many of the leading eigenvalues are known, and a radius for which these are all.

    An eigenvalue that has not converged may be as large as |ν| and its residual.

    Parameters
    ----------
    size, residual : (m,) float
        |ν| of the projection, falling, and the residuals.
    """
    open_ = np.flatnonzero(~_converged(size, residual))
    first = int(open_[0]) if len(open_) else len(size)
    known = min(radius, 1 / (size[first] + residual[first])) if len(open_) else radius
    count = int(np.count_nonzero(size[:first] > 1 / known))
    if count > most:
        count, known = most, min(known, 2 / (size[most - 1] + size[most]))
    return count, known


def _converged(size: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Return (m,) bool, which eigenvalues of the projection are exact to rounding; the arguments are those above."""
    return np.asarray(residual <= _TOLERANCE * np.maximum(size, _NEGLIGIBLE * size[0]))


def _cut_back(V: np.ndarray, S: np.ndarray, m: int, keep: int, block: int) -> int:
    """Keep about so many Schur vectors of the largest eigenvalues and the block behind; return how many are kept."""
    least = np.sort(np.abs(la.eigvals(S[:m, :m])))[-keep]
    T, Z, keep = la.schur(
        S[:m, :m], output="real" if np.isrealobj(S) else "complex",
        sort=lambda nu, imag=0.0: abs(nu + 1j * imag) >= least * (1 - 1e-12),
    )  # fmt: skip
    V[:, :keep] = combine(V[:, :m], Z[:, :keep])
    V[:, keep : keep + block] = V[:, m : m + block]
    coupling = S[m : m + block, :m] @ Z[:, :keep]
    S[:] = 0
    S[:keep, :keep], S[keep : keep + block, :keep] = T[:keep, :keep], coupling
    return int(keep)
