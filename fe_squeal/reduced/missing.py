"""Modes that a basis does not hold, by a count or by a search: residuals of the modes that it has cannot tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..eigen.blocks import lift, times
from ..eigen.growth import sizes
from ..eigen.inertia import count_below
from ..eigen.linear.factor import DefiniteFactor, LinearSolver
from ..eigen.pencil import Modes, Pencil
from ..eigen.request import Request, select_wanted
from ..problem.parameters import Place
from .basis import ReducedBasis
from .vectors import real_columns

_SEED, _BLOCK, _STEPS = 20251107, 8, 5
# Times the end of the range: a mode below that which only the extended basis has was missing. It is rough, and so lies
# too high, if anything; the basis has modes beyond the range.
_BEYOND = 1.05
_CLEAR = 1e-5  # of the next θ, or of a frequency: a gap that is wider than this is a clear one
SEARCH_SOLVES = _STEPS * _BLOCK  # right-hand sides that a search solves for


def search_vectors(basis: ReducedBasis, factor: DefiniteFactor) -> np.ndarray:
    """Return vectors (n, ·) that span the lowest modes outside a basis, roughly.

    They are those of a few steps of block Krylov iteration with P⁻¹M, from random vectors.

    Parameters
    ----------
    basis : ReducedBasis
    factor : DefiniteFactor
        Factors of P.
    """
    trial = basis.copy()
    block = np.random.default_rng(_SEED).standard_normal((basis.problem.unknowns, _BLOCK))
    M = basis.problem.mass
    for _ in range(_STEPS):
        block = factor.solve(times(M, block))
        size = len(trial)
        if not trial.append(block):
            break
        block = np.asarray(trial.V[:, size:])
    return np.array(trial.V[:, len(basis) :], order="C")


def missing_modes(
    basis: ReducedBasis, values: Sequence[Place], before: Sequence[Modes], request: Request, highest: float,
    outside: np.ndarray,
) -> list[np.ndarray]:  # fmt: skip
    """Return vectors (n, ·) of modes in the range that was asked for, which the basis lacks.

    A copy of the basis is extended by what may lie outside: a mode in the range that only the copy has was missing. The
    copy may have it roughly, and so may the basis if it got it from a copy: too high, and perhaps beyond the range.

    Parameters
    ----------
    values : sequence of float, or of tuples of them
        Values of the parameter at which modes are compared.
    before : sequence of Modes
        Modes of the basis at these values, at least up to `highest`.
    request : Request
    highest : float, rad/s
        Frequency up to which the basis holds the modes of the problem without damping and friction.
    outside : (n, ·) float
        As of `search_vectors`, for this basis or for one that its vectors begin with.
    """
    trial = basis.copy()
    trial.append(outside)
    found = []
    for p, known in zip(values, before, strict=True):
        every = trial.modes(p, highest)
        end = end_of_range(known, request, highest)
        both = np.append(sizes(every.lam), sizes(known.lam))
        for limit in clear_places(both, end, max(min(_BEYOND * end, highest), end)):
            now, then = _inside(every, limit), _inside(known, limit)
            if len(now) > len(then):
                # The new modes are those farthest from any that was known.
                far = np.abs(every.lam[now, None] - known.lam[then]).min(axis=1, initial=np.inf)
                new = now[np.argsort(far)[len(then) - len(now) :]]
                found.append(real_columns(lift(trial.V, every.right[:, new])))
                break
    return found


def end_of_range(modes: Modes, request: Request, highest: float) -> float:
    """Return where the range that was asked for ends, rad/s, at most the frequency `highest`.

    Parameters
    ----------
    modes : Modes
        Those that are known, by which it ends where a number of modes is asked for. Others that were missing may lie
        anywhere below.
    request : Request
    highest : float, rad/s
    """
    if request.max_frequency_hz is not None:
        return min(2 * np.pi * request.max_frequency_hz, highest)
    wanted = select_wanted(modes, request, np.inf)
    assert wanted is not None
    return min(float(sizes(wanted.lam).max(initial=0.0)) or highest, highest)


def clear_places(values: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """Return the middles of the first clear gap between two numbers, low ≤ high, and of the widest one.

    In a gap none of some values (k,) lies. Counts below the first one are those of a range that ends at `low`: a mode
    that the basis has only roughly, and so just beyond the range, is not among its own. Counts below the widest one
    hold also a mode that even the extended basis has just beyond.

    Examples
    --------
    >>> np.round(clear_places(np.array([0.5, 1.0 + 1e-9, 1.02, 1.2]), 1.0, 1.1), 6).tolist()
    [1.01, 1.06]
    """
    edges = np.sort(np.append(values[(values > low) & (values < high)], [low, high]))
    gaps, middles = np.diff(edges), (edges[:-1] + edges[1:]) / 2
    widest, clear = int(gaps.argmax()), np.flatnonzero(gaps > _CLEAR * low)
    return float(middles[clear[0] if len(clear) else widest]), float(middles[widest])


def holds_all(
    theta: np.ndarray, highest: float, pencil: Pencil, linear_solver: LinearSolver | str
) -> bool | None:  # fmt: skip
    """Return whether a basis holds all modes up to a frequency of a problem without damping and friction.

    They are counted by the inertia in the highest clear gap: beyond it the basis has values that are not those of
    modes.

    Parameters
    ----------
    theta : (r,) float, rad²/s²
        Values of the projection on the basis, ascending.
    highest : float, rad/s
        The frequency.
    pencil : Pencil
        The problem without damping and friction.
    linear_solver : LinearSolver or str

    Returns
    -------
    bool or None
        None where there is no clear gap, or the linear solver does not give the inertia.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> one, K = (sp.diags_array(d).tocsr() for d in (np.ones(5), np.array([1, 1.5, 3, 4, 5])))
    >>> pencil = Pencil(one, K, symmetric=True)
    >>> [holds_all(np.array(t), 3.0**0.5, pencil, "auto") for t in ([1, 1.5, 3, 9], [1, 3, 9])]
    [True, False]
    """
    above = np.minimum(theta[1:], highest**2)
    gaps = np.flatnonzero(above - theta[:-1] > _CLEAR * above)
    if not len(gaps):
        return None
    last = int(gaps[-1])
    counted = count_below(pencil, float(np.sqrt((theta[last] + above[last]) / 2)), linear_solver)
    return None if counted is None else counted == last + 1


def _inside(modes: Modes, limit: float) -> np.ndarray:
    """Return the positions of modes below a limit, without overdamped ones, of which there may be any number."""
    lam = modes.lam
    return np.flatnonzero((sizes(lam) < limit) & (lam.real >= -lam.imag))
