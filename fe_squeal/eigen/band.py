"""Modes of a pencil with C: those that oscillate in a band of frequencies, and real ones that grow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import NotConvergedError
from .found_pairs import FoundPairs
from .free_modes import FreeModes, split_off
from .growth import with_damping
from .inertia import count_below
from .known_band import KnownBand, is_light
from .linear.factor import LinearSolver
from .multiple import rounding_of_zero
from .pencil import Modes, Pencil
from .quality import eigenvalue_errors, grow_below, modes_from_lambda, modes_from_theta, together
from .request import Request, is_beside, is_needed, select_wanted
from .shift import LIGHT, symmetric_part

_BEYOND = 1e-4  # of a highest frequency: so far beyond it modes are looked for, and those below are all known then
# Doublings of the band, one after the other, in which no mode is found, and how many times farther up no mode may be
# without damping and friction either: there are no more then.
_BARREN, _FAR = 6, 1e3
# Times the error of an eigenvalue, and part of it: so small a Re λ is rounding, and eigenvalues so near are one.
_BLUR, _ROUNDING = 4, 1e-12
_SAME = 1e-7  # of |λ|: eigenvalues that are closer are copies of one
_EMPTY = 0.1  # of a band: its lower part, to which its modes are looked for where the rest has none
_AT_ZERO = 1e-8  # of a band: the square root of the rounding of its λ², below which a frequency may be zero
_WIDE = 3.0  # times the highest frequency found: up to there one disc looks for what grows up to the end of the range
_ONE_DISC = 36  # modes expected at most where a step before found none: one disc covers the next step then


def band_modes(
    pencil: Pencil, request: Request, band: float, free: FreeModes | None, linear_solver: LinearSolver | str,
    expected: int | None = None,
) -> Modes:  # fmt: skip
    """Return the wanted modes of a real pencil with C: oscillating ones, and real ones that do not decay.

    Heavily damped modes, and real decaying ones, are found only if they happen to lie in a disc.

    Parameters
    ----------
    band : float, rad/s
        Approximate frequency at which the wanted modes end.
    expected : int, optional
        As of `solve_modes`.

    Raises
    ------
    NotConvergedError
        If the range is not covered; `partial` has the modes found.
    """
    known, count, limit = KnownBand(FoundPairs(pencil), free, linear_solver), request.count, np.inf
    if request.max_frequency_hz is not None:
        band = limit = 2 * np.pi * request.max_frequency_hz * (1 + _BEYOND)
    expected = count or expected or count_below(symmetric_part(pencil), band, linear_solver)
    known.cover(0.0, band, expected or 20)
    found = np.count_nonzero(known.found.lam.imag <= band) + (0 if free is None else np.count_nonzero(free.lam == 0))
    if count is None and expected and found < expected:  # overdamped ones, or far below the highest frequency
        full = _occupied(pencil, band, linear_solver)
        if full < band:
            known = KnownBand(FoundPairs(pencil), free, linear_solver)
            known.cover(0.0, full, expected)
        while full < band:  # where gyroscopic terms or friction may have taken some of them
            full, start = min(full / _EMPTY, band), full
            known.cover(start, full, 1)
    barren = 0
    while True:
        modes, top = known.modes(), max(known.top, band)
        # Where none swings farther up, all others are overdamped: there are fewer modes than were asked for.
        reach = np.inf if barren >= _BARREN and _is_highest(pencil, top, linear_solver) else top
        wanted = select_wanted(modes, request, reach)
        if wanted is not None:
            break
        inside = np.sort(modes.lam.imag[(modes.lam.imag <= top) & ~is_beside(modes)])
        missing = max((count or 0) - len(inside), 1)
        # The number of modes is taken to rise as the square of the frequency, as a membrane's does: the upper half
        # of the band has three quarters of them then. Where it rises more slowly, another step follows.
        below = 4 / 3 * max(int(np.count_nonzero(inside > 0.5 * top)), 1)
        step = top * float(np.clip(np.sqrt(1 + 1.3 * (missing + 2) / below) - 1, 0.05, 1.0))
        # How dense modes are says nothing any more where a step has found none.
        band, expected = (2 * top, min(missing, _ONE_DISC)) if barren else (top + step, missing)
        before = len(known.found)
        known.cover(top, band, expected + 4)
        barren = barren + 1 if len(known.found) == before else 0
    end = float(wanted.lam.imag.max(initial=0.0)) or top
    known.add_copies(end * (1 + _BEYOND))
    if end < limit <= _WIDE * end:
        end = limit
    known.add_rest(end)
    if end < limit < np.inf:  # no mode is there, unless it grows or decays too fast for the discs
        if known.add_beside(limit):
            known.add_end(limit)
        else:
            known.add_aslant(limit)
    modes = known.modes()
    wanted = select_wanted(modes, request, reach)
    if wanted is None:
        raise NotConvergedError("beside real eigenvalues that grow the others are too uncertain to be told", modes)
    # Which ones of a crowd were found is chance, and another value would have others.
    return wanted.select(np.flatnonzero(is_needed(wanted))) if known.crowded else wanted


def _occupied(pencil: Pencil, band: float, linear_solver: LinearSolver | str) -> float:
    """Return the part of a band of frequencies, rad/s, that has all its modes without damping and friction.

    Where a highest frequency is far above all modes, these would be within what discs do not reach at zero. The whole
    band is returned if all are at zero, or unstable since a stiffness is negative, because that does not tell at which
    frequencies gyroscopic terms let them swing. It is returned too where modes cannot be counted.
    """
    undamped, lowest, part = symmetric_part(pencil), _AT_ZERO * band, _EMPTY * band
    whole = count_below(undamped, band, linear_solver)

    def has_all(top: float) -> bool:
        return whole is not None and count_below(undamped, top, linear_solver) == whole

    if not has_all(part) or has_all(lowest):
        return band
    while part > lowest and has_all(_EMPTY * part):
        part *= _EMPTY
    return part


def _is_highest(pencil: Pencil, top: float, linear_solver: LinearSolver | str) -> bool:
    """Return whether no mode without damping and friction is between a frequency, rad/s, and one far above it.

    True where these cannot be counted.
    """
    below, far = (count_below(symmetric_part(pencil), omega, linear_solver) for omega in (top, _FAR * top))
    return below is None or far is None or far <= below


def with_far_growth(
    pencil: Pencil, modes: Modes, limit: float, free: FreeModes | None, linear_solver: LinearSolver | str,
    whole: bool = False,
) -> Modes:  # fmt: skip
    """Return modes with those beside them that swing below a frequency, rad/s, and grow fast.

    The modes nearest a shift reach as far in growth as in frequency alone. Flutter of strong friction, and divergence
    of a brake whose friction is not symmetric, may be faster.

    Parameters
    ----------
    modes : Modes
        With right and left ones. Of a pencil without C all with |λ| up to the limit, apart from copies.
    limit : float, rad/s
        Above zero.
    whole : bool
        Whether they are all those in a circle around a real shift `BEHIND` the limit, through i times the limit, with
        every copy of a multiple eigenvalue.
    """
    damped = with_damping(pencil)
    if free is not None:  # of which λ = 0 has velocities, too
        free = split_off(damped, linear_solver)
    pairs = FoundPairs(damped, modes.lam, modes.right, modes.left)
    known = KnownBand(pairs, free, linear_solver, method=modes.method)
    if not whole and not known.add_beside(limit):
        known.add_aslant(limit)
    if pencil.is_complex and pencil.C is not None:
        known.add_end(limit)
    known.add_far(limit)
    assert pairs.right is not None and pairs.left is not None
    far = np.flatnonzero((np.arange(len(pairs)) >= len(modes)) & (pairs.lam.imag <= limit * (1 + _BEYOND)))
    # Copies of multiple eigenvalues that one start vector has not shown are among them, however they grow or decay.
    far = far[is_light(pairs.lam[far]) | grow_below(pencil, pairs.lam[far]) | _are_copies(pairs.lam[far], modes.lam)]
    far = far[~_known_zeros(damped, modes, free, pairs.lam[far], pairs.right[:, far])]
    modes = replace(modes, unsearched=modes.unsearched.joined(known.unsearched))
    if not len(far):
        return modes
    lam, right, left = pairs.lam[far], pairs.right[:, far], pairs.left[:, far]
    if pencil.C is not None:
        return together(modes, modes_from_lambda(pencil, lam, right, left, known.method, known=modes.lam))
    theta = -(lam**2)
    if not pencil.is_complex:
        theta, columns, mirrored = _paired(lam, eigenvalue_errors(damped, lam, right, left))
        right, left = (np.where(mirrored, x[:, columns].conj(), x[:, columns]) for x in (right, left))
    found = modes_from_theta(pencil, theta, right, left, known.method)
    # What grows below the axis stands for a θ whose mode decays: beside flutter it is but the other one of a pair.
    unsure = found.re_uncertainty >= np.abs(found.lam)
    kept = is_light(found.lam) | unsure | _are_copies(found.lam, modes.lam)
    return together(modes, found.select(np.flatnonzero(kept | (not pencil.is_complex))))


def _are_copies(lam: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return (k,) bool, which λ (k,) that swing are equal to some of those known, (m,)."""
    return np.asarray((lam.imag > 0) & (np.abs(lam[:, None] - known) <= _SAME * np.abs(lam)[:, None]).any(axis=1))


def _known_zeros(
    pencil: Pencil, modes: Modes, free: FreeModes | None, lam: np.ndarray, right: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Return (k,) bool, which λ (k,) are those λ = 0 of the modes given that no free motion accounts for.

    These are known and were not taken out of the search, since as states they are defective.
    """
    count = np.count_nonzero(modes.lam == 0) - (0 if free is None else np.count_nonzero(free.lam == 0))
    zero = np.abs(lam) <= rounding_of_zero(pencil, lam, right)
    return np.asarray(zero & (np.cumsum(zero) <= max(count, 0)))


def _paired(lam: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the θ that eigenvalues of a real pencil without damping stand for, from the half plane Im λ ≥ 0.

    λ and −λ* are one pair θ, θ*, found as one or as two. What swings but for its errors is one real θ.

    Parameters
    ----------
    lam : (k,) complex, rad/s
    errors : (k,) float, rad/s

    Returns
    -------
    theta, columns, mirrored : (m,) complex, int, bool
        Each θ, which of the vectors belongs to it, and whether that is conjugated.
    """
    blurred = np.maximum(_BLUR * errors, _ROUNDING * np.abs(lam))
    theta, columns, mirrored, done = list[complex](), list[int](), list[bool](), np.zeros(len(lam), bool)
    for i in np.argsort(-lam.real):
        if done[i]:
            continue
        done[i] = True
        square = -complex(lam[i]) ** 2
        if abs(lam[i].real) <= blurred[i]:
            theta, columns, mirrored = [*theta, square.real], [*columns, i], [*mirrored, False]
            continue
        apart = np.where(done, np.inf, np.abs(lam + lam[i].conjugate()))
        j = int(apart.argmin())
        if apart[j] <= max(blurred[i], blurred[j]):
            done[j] = True
        both = lam[i].imag > 0  # of a real λ, θ < 0 stands for ±λ
        theta += [square, square.conjugate()] if both else [square.real]
        columns += [i, i] if both else [i]
        mirrored += [False, True] if both else [False]
    return np.array(theta), np.array(columns), np.array(mirrored)


def count_beside(
    pencil: Pencil, modes: Modes, top: float, free: FreeModes | None, linear_solver: LinearSolver | str
) -> int | None:
    """Return how many modes of a real pencil with C there are beside those given; None where that is not sure.

    They are searched for around another shift, with the given ones taken out. Modes count that grow, or swing below a
    frequency with light damping.

    Parameters
    ----------
    modes : Modes
        Right and left modes, among them those of free motions.
    top : float, rad/s
        The frequency; no mode is near it.
    """
    known = KnownBand(FoundPairs(pencil, modes.lam, modes.right, modes.left), free, linear_solver)
    try:
        if not known.add_beside(top):
            return None
    except NotConvergedError:
        return None
    assert known.found.right is not None
    lam, right = known.found.lam[len(modes) :], known.found.right[:, len(modes) :]
    light = (lam.imag > 0) & (lam.imag <= top) & (lam.real > -LIGHT * lam.imag)
    return int(np.count_nonzero(light | ((lam.imag == 0) & (lam.real > rounding_of_zero(pencil, lam, right)))))
