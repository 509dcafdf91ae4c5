"""The lowest modes of a projected problem, from those at a place nearby, with a proof that none is missing.

LAPACK finds all modes of a projection, ten times as many as a study asks for, and does little of that in blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as la

from ..eigen.blocks import lift
from ..eigen.dense import solve_dense
from ..eigen.lapack import regular_lu
from ..eigen.pencil import FreeMotions, Modes, Pencil
from ..eigen.request import Request, select_wanted
from ..problem.parameters import Place
from .projection import Projection
from .vectors import real_columns

_STEPS = 3  # of inverse iteration; each takes a digit or so off the angle between a mode and the span of the block
_SHIFT = 0.5  # of the square of the highest frequency asked for: the shift of the iteration
_SMALL = 0.5  # of the size of the projection: with more columns than that LAPACK on all of it costs no more
_BEYOND = 1.01  # times that square: no other mode may be below
_KNOWN = 1.4  # times that square: modes up to there are moved upwards if they are exact enough
# Of that square: the largest residual of such a mode. Chosen: modes come out of the iteration with less, and rough
# images of modes below, which would hide these, with far more.
_EXACT = 1e-3
_MOVED = 1e3  # times the largest entry of the matrix: by how much


@dataclass(frozen=True)
class Blocks:
    """Where a search for modes starts.

    Attributes
    ----------
    right, left : (r, ·) float
        Columns that span right and left modes; fewer rows where the basis has grown since.
    square : float, rad²/s²
        Of the highest frequency asked for.
    """

    right: np.ndarray
    left: np.ndarray
    square: float

    @classmethod
    def of(cls, modes: Modes, request: Request) -> Blocks:
        """Return the blocks of modes, among them those asked for."""
        wanted = select_wanted(modes, request, np.inf)
        assert wanted is not None and modes.left is not None
        one = np.flatnonzero(modes.lam.real >= 0)  # λ and −λ* have the same shapes
        right, left = real_columns(modes.right[:, one]), real_columns(modes.left[:, one])
        return cls(right, left, _square_of(wanted, request))

    def on(self, W: np.ndarray) -> Blocks:
        """Return the blocks in the coordinates of a smaller basis, whose columns are W (r, s) in theirs."""
        return replace(self, right=W[: len(self.right)].T @ self.right, left=W[: len(self.left)].T @ self.left)


@dataclass(frozen=True)
class KnownModes:
    """The blocks at some places of a box, and its widths (d,)."""

    widths: np.ndarray
    blocks: dict[Place, Blocks] = field(default_factory=dict, repr=False)

    def nearest(self, place: Place) -> Blocks | None:
        """Return those at the nearest place; None where there are none at all."""
        if place not in self.blocks and self.blocks:
            away = (np.array(list(self.blocks)) - np.array(place)) / self.widths
            place = list(self.blocks)[int(np.argmin(np.linalg.norm(away, axis=1)))]
        return self.blocks.get(place)

    def first(self, count: int) -> KnownModes:
        """Return those at the first places."""
        return KnownModes(self.widths, dict(list(self.blocks.items())[:count]))

    def on(self, W: np.ndarray) -> KnownModes:
        """Return those in the coordinates of a smaller basis, whose columns are W (r, s) in theirs."""
        return KnownModes(self.widths, {p: b.on(W) for p, b in self.blocks.items()})


def lowest_modes(
    basis: Projection, place: Place, request: Request, highest: float, near: Blocks
) -> Modes | None:  # fmt: skip
    """Return modes of an undamped projection, among them all that are asked for; None where that is not sure.

    A block of right modes and one of left modes come nearer to those of the place by inverse iteration with one shift.
    The result is the projection on both together, in which an eigenvalue is off by the product of the two angles that
    remain; the residuals of its modes show that as they show what the basis lacks.

    No mode is missing by this: a mode x that the left ones y_i do not belong to has y_iᴴMx = 0, and Re θ =
    xᴴK_s x / xᴴMx with the symmetric part K_s of K. So where K_s − cM + τ Σ (My_i)(My_i)ᴴ with any τ > 0 is positive
    definite, no other mode has Re θ ≤ c. (Bendixson, Acta Math. 25, 1902.)

    Parameters
    ----------
    highest : float, rad/s
        Up to there modes are returned. Those beyond the frequencies asked for are rough.
    near : Blocks
        Where the iteration starts.
    """
    M, C, K, symmetric = basis.matrices(place)
    if C is not None or np.iscomplexobj(K) or basis.has_slow or basis.free_motions(place).motions.shape[1]:
        return None
    if near.right.shape[1] + near.left.shape[1] > _SMALL * len(M):
        return None
    W = _invariant(M, K, near)
    if W is None:
        return None
    small = Pencil(W.T @ M @ W, W.T @ K @ W, None, symmetric, None, FreeMotions.none(W.shape[1]))
    modes = solve_dense(small, highest)
    assert modes.left is not None
    modes = replace(modes, right=lift(W, modes.right), left=lift(W, modes.left))
    wanted = select_wanted(modes, request, np.inf)
    assert wanted is not None
    if len(wanted) < (request.count or 0):
        return None
    return modes if _complete(M, K, modes, _square_of(wanted, request)) else None


def _square_of(wanted: Modes, request: Request) -> float:
    """Return the square of the highest frequency asked for, rad²/s²."""
    if request.max_frequency_hz is not None:
        return float(2 * np.pi * request.max_frequency_hz) ** 2
    return float(wanted.lam.imag.max(initial=0.0)) ** 2


def _invariant(M: np.ndarray, K: np.ndarray, near: Blocks) -> np.ndarray | None:
    """Return an orthonormal basis of both blocks after some steps of inverse iteration; None where the shift is a θ."""
    try:
        lu, pivots = regular_lu(K - _SHIFT * near.square * M)
    except la.LinAlgError:
        return None
    blocks = []
    for block, transposed in ((near.right, 0), (near.left, 1)):
        X = np.zeros((len(M), block.shape[1]))
        X[: len(block)] = block
        for _ in range(_STEPS):
            X = la.lu_solve((lu, pivots), M @ X, trans=transposed, check_finite=False)
            X = la.qr(X, mode="economic", check_finite=False)[0]
        blocks.append(X)
    return np.asarray(la.qr(np.hstack(blocks), mode="economic", check_finite=False)[0])


def _complete(M: np.ndarray, K: np.ndarray, modes: Modes, square: float) -> bool:
    """Return whether all other modes have a Re θ above the square of a frequency."""
    assert modes.left is not None
    theta = -(modes.lam**2)
    known = np.flatnonzero((theta.real <= _KNOWN * square) & (modes.lam.real >= 0))
    left, My = modes.left[:, known], M @ modes.left[:, known]
    rest = np.linalg.norm(K.T @ left - My * theta[known].conj(), axis=0)
    exact = rest <= _EXACT * square * np.linalg.norm(My, axis=0)
    N = la.qr(M @ real_columns(left[:, exact]), mode="economic", check_finite=False)[0]
    S = (K + K.T) / 2 - _BEYOND * square * M
    S += _MOVED * np.abs(S).max() * (N @ N.T)
    return int(la.lapack.dpotrf(S, clean=False, overwrite_a=True)[1]) == 0
