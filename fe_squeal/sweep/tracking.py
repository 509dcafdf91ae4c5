"""Following modes from one parameter value to the next, by shape and eigenvalue together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment

from ..eigen.pencil import Modes

_FREQUENCY_SCALE = 0.02  # relative change of an eigenvalue that costs half of what a wholly different shape costs
_NO_MATCH = 1.5  # cost from which a mode counts as new
_DOUBT = 0.4  # change of shape, 1 − MAC, from which a mode is followed in smaller steps
_EQUAL = 1e-3  # relative distance below which shapes may have mixed


def modal_assurance(a: np.ndarray, b: np.ndarray, M: sp.csr_array) -> np.ndarray:
    """Return |a_iᴴ M b_j|² / (a_iᴴ M a_i · b_jᴴ M b_j), the MAC weighted by mass.

    Parameters
    ----------
    a : (n, k), b : (n, l)

    Returns
    -------
    (k, l) float in [0, 1]
    """
    Ma, Mb = M @ a, M @ b
    size = np.sqrt(np.outer(_energy(a, Ma), _energy(b, Mb)))
    cross = np.abs(a.conj().T @ Mb)
    return np.divide(cross, size, out=np.zeros_like(cross), where=size > 0) ** 2


@dataclass(frozen=True)
class Match:
    """How the modes of one value continue those of the value before.

    Attributes
    ----------
    origin : (k,) int
        For each current mode the position of the previous one that it continues, or −1 for a new one.
    doubtful : (k,) bool
        Whether the shape has changed so much that a value in between is needed to tell which mode continues.
    """

    origin: np.ndarray
    doubtful: np.ndarray


def match_modes(previous: Modes, current: Modes, M: sp.csr_array) -> Match:
    """Find for each mode the one that it continues.

    The assignment minimises the sum of 1 − MAC and x/(1 + x), x the relative change of λ in units of 2 %. In a
    coupled pair λ, −λ* both shapes resemble both predecessors alike; there the growing mode continues the growing one,
    and where two uncoupled modes have merged, the lower of them. Where a pair couples or comes apart shapes change
    abruptly, and within a multiple eigenvalue they are arbitrary; such modes are not doubtful.
    """
    origin = np.full(len(current), -1)
    if not len(previous) or not len(current):
        return Match(origin, np.zeros(len(current), bool))
    distance = np.abs(previous.lam[:, None] - current.lam[None, :])
    size = _FREQUENCY_SCALE * np.maximum(np.abs(previous.lam)[:, None], np.abs(current.lam)[None, :])
    moved = np.divide(distance, size + distance, out=np.zeros_like(distance), where=distance > 0)
    assurance = modal_assurance(previous.right, current.right, M)
    cost = 1 - assurance + moved
    # Among modes of equal frequency a growing one continues a growing one: growth begins and ends at onsets alone.
    changed = np.abs(_sign(previous)[:, None] - _sign(current)[None, :]) / 2
    rows, columns = linear_sum_assignment(cost + changed)
    taken = np.full(len(current), np.inf)
    taken[columns] = cost[rows, columns]
    accepted = cost[rows, columns] < _NO_MATCH
    origin[columns[accepted]] = rows[accepted]
    before, now = mirror_partners(previous), mirror_partners(current)
    _order_pairs(origin, previous.lam, current.lam, before, now)
    coupling = (now >= 0) | ((origin >= 0) & (before[origin] >= 0))
    # Shapes of equal frequency may be any combination of each other: what counts is how much of a mode lies in all of
    # them together.
    near = np.abs(previous.lam[:, None] - previous.lam[None, :]) <= _EQUAL * np.abs(previous.lam)[:, None]
    group = near.astype(float) @ assurance
    kept = np.where(origin >= 0, group[origin, np.arange(len(current))], 0.0)
    doubtful = ~coupling & (1 - kept > _DOUBT) | (origin < 0) & (current.lam.imag > 0)
    return Match(origin, doubtful)


def mirror_partners(modes: Modes) -> np.ndarray:
    """Return for each mode the position of its mirror image −λ*, or −1.

    Only an undamped spectrum has them: a coupled pair is one growing and one decaying mode of the same frequency.
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
    """Let modes of equal rank continue each other where a pair couples, stays coupled or comes apart (see match_modes).

    Coupled modes rank by growth, others by falling frequency.

    Parameters
    ----------
    before, now : (k,) int
        Mirror partners, or −1.
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
                origin[i], origin[j] = q, p  # of the two predecessors only one is known: the growing mode continues it
            continue
        rank_now = lam_now[[i, j]].real if now[i] == j else -lam_now[[i, j]].imag
        rank_before = lam_before[[p, q]].real if before[p] == q else -lam_before[[p, q]].imag
        if (rank_now[0] - rank_now[1]) * (rank_before[0] - rank_before[1]) < 0:
            origin[i], origin[j] = q, p


def _sign(modes: Modes) -> np.ndarray:
    return np.where(np.abs(modes.lam.real) > modes.re_uncertainty, np.sign(modes.lam.real), 0.0)


def _energy(u: np.ndarray, Mu: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("ij,ij->j", u.conj(), Mu).real)
