"""Follow modes from one value of the parameter to the next, by shape and eigenvalue together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment

from ..eigen.blocks import lift
from ..eigen.pencil import Modes
from ..eigen.request import is_needed

_FREQUENCY_SCALE = 0.02  # of |λ|: a change of λ by this costs 1/2, as much as a change of shape to MAC = 1/2
_CHOICE = 0.04  # of |λ|: modes whose frequencies differ by more are no pair that may have coupled
_NO_MATCH = 1.5  # cost from which on a mode counts as new
_DOUBT = 0.4  # 1 − MAC: a mode whose shape changes by more than this is followed in smaller steps
_EQUAL = 1e-3  # of |λ|: the shapes of modes whose eigenvalues are closer than this may have mixed


def modal_assurance(a: np.ndarray, b: np.ndarray, M: sp.csr_array) -> np.ndarray:
    """Return the modal assurance criterion (MAC) weighted by mass: |a_iᴴ M b_j|² / (a_iᴴ M a_i · b_jᴴ M b_j).

    Parameters
    ----------
    a, b : (n, k) and (n, l) float or complex
        Shapes; their lengths do not matter.
    M : (n, n) sparse or dense
        Mass matrix.

    Returns
    -------
    (k, l) float
        From 0 to 1.
    """
    Ma, Mb = lift(M, a), lift(M, b)
    size = np.sqrt(np.outer(_energy(a, Ma), _energy(b, Mb)))
    cross = np.abs(a.conj().T @ Mb)
    return np.divide(cross, size, out=np.zeros_like(cross), where=size > 0) ** 2


@dataclass(frozen=True)
class Match:
    """How the modes at one value continue those at the value before.

    Attributes
    ----------
    origin : (k,) int
        For each current mode the position of the previous mode that it continues; −1 for a new mode.
    doubtful : (k,) bool
        Whether the shape has changed so much that modes at a value in between are needed to follow it.
    """

    origin: np.ndarray
    doubtful: np.ndarray


def match_modes(previous: Modes, current: Modes, M: sp.csr_array) -> Match:
    """Find for each mode the mode at the value before that it continues.

    The assignment minimises the sum of the costs 1 − MAC and x/(1 + x), where x is the relative change of λ in units of
    2 %. In a coupled pair λ, −λ* both shapes resemble both modes before. Then the growing mode continues the growing
    one (as it does wherever two frequencies are nearly equal, since those of damped pairs are), or the one of lower
    frequency if the two modes were not coupled before. Where a pair couples or comes apart shapes change abruptly, and
    within a multiple eigenvalue they are arbitrary: such modes are not doubtful. Nor are those that decay without
    swinging: the many of a heavily damped problem mix from value to value.

    Parameters
    ----------
    previous, current : Modes
        With shapes of n unknowns.
    M : (n, n) sparse or dense
        Mass matrix, for the MAC.
    """
    origin = np.full(len(current), -1)
    if not len(previous) or not len(current):
        return Match(origin, np.zeros(len(current), bool))
    distance = np.abs(previous.lam[:, None] - current.lam[None, :])
    size = _FREQUENCY_SCALE * np.maximum(np.abs(previous.lam)[:, None], np.abs(current.lam)[None, :])
    moved = np.divide(distance, size + distance, out=np.zeros_like(distance), where=distance > 0)
    assurance = modal_assurance(previous.right, current.right, M)
    cost = 1 - assurance + moved
    # A mode that grows continues one that grows, if there is a choice: growth begins and ends only at onsets.
    changed = np.abs(_sign(previous)[:, None] - _sign(current)[None, :]) / 2
    rows, columns = linear_sum_assignment(cost + changed * _has_neighbour(current.lam))
    taken = np.full(len(current), np.inf)
    taken[columns] = cost[rows, columns]
    accepted = cost[rows, columns] < _NO_MATCH
    origin[columns[accepted]] = rows[accepted]
    before, now = mirror_partners(previous), mirror_partners(current)
    _order_pairs(origin, previous.lam, current.lam, before, now)
    coupling = (now >= 0) | ((origin >= 0) & (before[origin] >= 0))
    # Shapes of equal frequency may be any linear combination of each other. So a mode is compared with the span of all
    # shapes of nearly equal frequency before.
    near = np.abs(previous.lam[:, None] - previous.lam[None, :]) <= _EQUAL * np.abs(previous.lam)[:, None]
    group = near.astype(float) @ assurance
    kept = np.where(origin >= 0, group[origin, np.arange(len(current))], 0.0)
    doubtful = ~coupling & (1 - kept > _DOUBT) | (origin < 0) & (current.lam.imag > 0)
    doubtful &= is_needed(current)
    return Match(origin, doubtful)


def mirror_partners(modes: Modes) -> np.ndarray:
    """Return (k,) int for each mode the position of its mirror image −λ*, or −1 if it has none.

    Mirror images exist without damping: a coupled pair is a growing and a decaying mode of the same frequency.
    """
    lam, found = modes.lam, np.full(len(modes), -1)
    for i in np.flatnonzero(_sign(modes) > 0):
        gap = np.where(found < 0, np.abs(lam + lam[i].conjugate()), np.inf)
        gap[i] = np.inf
        j = int(np.argmin(gap))
        if gap[j] <= 4 * modes.re_uncertainty[i] + 1e-9 * abs(lam[i]):
            found[i], found[j] = j, i
    return found


def _order_pairs(
    origin: np.ndarray, lam_before: np.ndarray, lam_now: np.ndarray, before: np.ndarray, now: np.ndarray
) -> None:
    """Change `origin` where a pair couples, stays coupled or comes apart: modes of equal rank continue each other.

    Coupled modes rank by growth, others by falling frequency, as `match_modes` says.

    Parameters
    ----------
    origin : (k,) int
        As in `Match`; changed in place.
    lam_before, lam_now : (l,) and (k,) complex, rad/s
        Eigenvalues at the value before and at this one.
    before, now : (l,) and (k,) int
        Positions of their mirror images, or −1.
    """
    coupled = [(i, j) for i, j in enumerate(now) if i < j]
    parted = [
        (i, j)
        for i in range(len(origin))
        for j in range(i + 1, len(origin))
        if now[i] < 0 and now[j] < 0 and origin[i] >= 0 and before[origin[i]] == origin[j] >= 0
    ]
    for i, j in coupled + parted:
        p, q = origin[i], origin[j]
        if p < 0 or q < 0:
            if now[i] == j and (lam_now[i].real > lam_now[j].real) == (p < 0):
                origin[i], origin[j] = q, p  # only one of the two modes before is known: the growing mode continues it
            continue
        rank_now = lam_now[[i, j]].real if now[i] == j else -lam_now[[i, j]].imag
        rank_before = lam_before[[p, q]].real if before[p] == q else -lam_before[[p, q]].imag
        if (rank_now[0] - rank_now[1]) * (rank_before[0] - rank_before[1]) < 0:
            origin[i], origin[j] = q, p


def _sign(modes: Modes) -> np.ndarray:
    return np.where(np.abs(modes.lam.real) > modes.re_uncertainty, np.sign(modes.lam.real), 0.0)


def _has_neighbour(lam: np.ndarray) -> np.ndarray:
    """Return which modes, (k,) bool, have another one of nearly the same frequency."""
    near = np.abs(lam.imag[:, None] - lam.imag[None, :]) <= _CHOICE * np.abs(lam)[:, None]
    return np.asarray(near.sum(axis=1) > 1)


def _energy(u: np.ndarray, Mu: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("ij,ij->j", u.conj(), Mu).real)
