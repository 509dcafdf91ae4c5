"""Following modes from one parameter value to the next, by shape and eigenvalue together."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment

from .eigen.pencil import Modes, is_mirror

_FREQUENCY_SCALE = 0.02  # relative change of an eigenvalue that weighs as much as a wholly different shape
_NO_MATCH = 1.5  # cost from which a mode counts as new


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


def match_modes(previous: Modes, current: Modes, M: sp.csr_array) -> np.ndarray:
    """Return for each current mode the previous mode that it continues, or −1 for a new one.

    The assignment minimises the sum of 1 − MAC and the relative change of λ. In a coupled pair λ, −λ* both shapes
    resemble
    both predecessors alike; there the growing mode continues the growing one, and where two uncoupled modes have
    merged, the lower of them.

    Returns
    -------
    (k,) int
    """
    if not len(previous) or not len(current):
        return np.full(len(current), -1)
    distance = np.abs(previous.lam[:, None] - current.lam[None, :])
    size = _FREQUENCY_SCALE * np.maximum(np.abs(previous.lam)[:, None], np.abs(current.lam)[None, :])
    moved = np.divide(distance, size, out=np.zeros_like(distance), where=size > 0)
    cost = 1 - modal_assurance(previous.right, current.right, M) + moved
    rows, columns = linear_sum_assignment(cost)
    origin = np.full(len(current), -1)
    accepted = cost[rows, columns] < _NO_MATCH
    origin[columns[accepted]] = rows[accepted]
    _order_pairs(origin, previous.lam, current.lam)
    return origin


def mirror_partners(modes: Modes) -> np.ndarray:
    """Return for each mode the position of its mirror image −λ*, or −1.

    Only an undamped spectrum has them: a coupled pair is one growing and one decaying mode of the same frequency.
    """
    lam, found = modes.lam, np.full(len(modes), -1)
    for i in np.flatnonzero(np.abs(lam.real) > modes.re_uncertainty):
        gap = np.abs(lam + lam[i].conjugate())
        gap[i] = np.inf
        j = int(np.argmin(gap))
        if gap[j] <= 4 * modes.re_uncertainty[i] + 1e-9 * abs(lam[i]):
            found[i] = j
    return found


def _order_pairs(origin: np.ndarray, before: np.ndarray, after: np.ndarray) -> None:
    """Swap the origins of neighbouring modes where a pair couples, stays coupled or comes apart (see match_modes)."""
    for i in range(len(after) - 1):
        p, q = origin[i], origin[i + 1]
        if p < 0 or q < 0:
            continue
        coupled_now = is_mirror(after[i], after[i + 1])
        coupled_before = is_mirror(before[p], before[q])
        if not (coupled_now or coupled_before):
            continue
        # Rank both sides by growth where they are coupled, else by falling frequency, and join equal ranks.
        now = after[[i, i + 1]].real if coupled_now else -after[[i, i + 1]].imag
        then = before[[p, q]].real if coupled_before else -before[[p, q]].imag
        if (now[0] - now[1]) * (then[0] - then[1]) < 0:
            origin[i], origin[i + 1] = q, p


def _energy(u: np.ndarray, Mu: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("ij,ij->j", u.conj(), Mu).real)
