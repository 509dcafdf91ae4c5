"""How far the modes of a projection may be off, and whether that meets the tolerance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..eigen.growth import sizes
from ..eigen.pencil import Modes
from ..eigen.request import Request, is_beside, is_needed, select_wanted
from ..problem.parameters import Place
from .basis import ReducedBasis
from .lowest import Blocks, KnownModes, lowest_modes

_BESIDE = 1.1  # times the highest frequency asked for: modes up to there are neighbours of the modes asked for
SLIGHT = 0.1  # times the tolerance: errors below this need not be known better
GUARDED = 1.2  # times the highest frequency of the basis: modes up to there are known
_SAFETY = 0.9  # of the tolerance: what the estimated errors of eigenvalues are driven below
_FALLS = 0.7  # times the largest error before: one that falls less is not that of the search
ILL = 10.0  # relative condition from which a mode is near a double eigenvalue

Estimate = tuple[Modes, np.ndarray, np.ndarray]  # modes asked for, how far each misses the tolerance, and |Δλ/λ|


def estimated(
    basis: ReducedBasis, value: Place, every: Modes, request: Request, highest: float, scale: float = 1.0
) -> Estimate:  # fmt: skip
    """Return the modes asked for among those of a projection, for each how far it misses the tolerance, and |Δλ/λ|.

    Parameters
    ----------
    every : Modes
        All modes of the projected problem up to `GUARDED` times `highest`.
    highest : float, rad/s
        Frequency up to which the basis holds the modes of the problem without damping and friction.
    scale : float
        Factor of the estimated errors, below 1 where it is known how much too large they are.

    Returns
    -------
    modes : Modes
    off : (k,) float
        How far each misses the tolerance: its error by the one allowed, 1 where the tolerance is just met.
    relative : (k,) float
    """
    modes = select_wanted(every, request, np.inf)
    assert modes is not None
    error, backward, condition, rounding = basis.errors(value, modes, highest)
    # How much too large the estimates are was measured on errors above the slight ones only, so that the scale does not
    # make an estimate smaller than a slight error.
    error = np.minimum(error, np.maximum(scale * error, SLIGHT * request.tolerance * np.abs(modes.lam)))
    # The tolerance is meant for well-conditioned modes: next to a double eigenvalue no solver finds λ so closely.
    relative = error / error_scale(modes, highest)
    known = relative / np.maximum(condition / ILL, 1.0) + np.finfo(float).eps
    # What decays without swinging need not be found: its errors are told, and the basis does not grow for it.
    off = np.where(is_needed(modes), known / (_SAFETY * request.tolerance), 0.0)
    modes = replace(
        modes, re_uncertainty=modes.re_uncertainty + error + rounding,
        backward_error=np.fmax(modes.backward_error, backward),
        method=method_of(basis), exhaustive=False,
    )  # fmt: skip
    return modes, off, relative


def error_scale(modes: Modes, highest: float) -> np.ndarray:
    """Return what errors of λ (k,), rad/s, are relative to: |λ|, but of slow modes a part of `highest`, rad/s."""
    return np.maximum(np.abs(modes.lam), 1e-3 * highest)


def method_of(basis: ReducedBasis) -> str:
    """Return what the results say of how modes of a basis were found."""
    return f"reduced model of {len(basis)} vectors"


def neighbours(every: Modes, request: Request) -> Modes:
    """Return the modes asked for with those next above them."""
    wanted = select_wanted(every, request, np.inf)
    assert wanted is not None
    limit = _BESIDE * float(sizes(wanted.lam).max(initial=0.0))
    return every.select(np.flatnonzero(sizes(every.lam) <= limit))


def swinging_sizes(modes: Modes) -> np.ndarray:
    """Return the sizes (k,) of λ, rad/s, rising, of modes that count towards the number asked for."""
    return np.sort(sizes(modes.lam)[~is_beside(modes)])


@dataclass(frozen=True)
class CertifiedBasis:
    """A basis that gives modes with their errors.

    Attributes
    ----------
    basis : ReducedBasis
    request : Request
    highest : float, rad/s
        Frequency up to which the basis holds the modes of the problem without damping and friction.
    known : KnownModes
        Where the search for modes starts.
    scale : float
        Of the estimated errors, which are bounds; of a smaller basis it is known how much too large they are.
    """

    basis: ReducedBasis
    request: Request
    highest: float
    known: KnownModes
    scale: float = 1.0

    def modes(self, place: Place) -> Estimate:
        """Return the modes asked for at a place, see `estimated`; vectors are in coordinates of the basis."""
        return self.found(place)[0]

    def found(self, place: Place, enough: float = 1.0) -> tuple[Estimate, Modes]:
        """Return the same, and all modes that were found.

        These are the lowest ones, whose search goes on for as long as that makes errors smaller of which one is above
        `enough` times the allowed one, or all of the basis by LAPACK where it is not sure that no mode is missing.
        """
        near, before = self.known.nearest(place), np.inf
        while near is not None:
            modes = lowest_modes(self.basis, place, self.request, GUARDED * self.highest, near)
            if modes is None:
                break
            estimate = self._estimated(place, modes)
            off = float(estimate[1].max(initial=0.0))
            if off <= enough or off > _FALLS * before:
                return estimate, modes
            near, before = Blocks.of(modes, self.request), off
        modes = self.basis.modes(place, GUARDED * self.highest)
        return self._estimated(place, modes), modes

    def _estimated(self, place: Place, modes: Modes) -> Estimate:
        return estimated(self.basis, place, modes, self.request, self.highest, self.scale)

    def without_vectors(self) -> CertifiedBasis:
        """Return the same with no vector of the problem's length, see `ReducedBasis.without_vectors`."""
        return replace(self, basis=self.basis.without_vectors())


def is_short(modes: Modes, least: int, highest: float, number: int | None) -> bool:
    """Return whether modes at a place are fewer than are needed, and than there are.

    Those above the highest frequency do not count: there others may be missing, which nothing looks for.

    Parameters
    ----------
    modes : Modes
    least : int
        How many are needed that swing.
    highest : float, rad/s
        Frequency up to which the basis holds the modes of the problem without damping and friction.
    number : int or None
        How many modes there are of any frequency, two eigenvalues each, if the basis has them all.
    """
    known = swinging_sizes(modes)
    if number is not None:
        return len(known) < least and modes.eigenvalue_count < 2 * number
    return bool(np.count_nonzero(known <= highest) < least)


@dataclass(frozen=True)
class OnlineModel:
    """What a reduced model needs to give modes with their errors: nothing in it is as long as the problem's vectors.

    Attributes
    ----------
    whole : CertifiedBasis
    condensed : CertifiedBasis or None
        A smaller one inside it, for the modes asked for alone. Where its errors meet the tolerance its modes are
        returned, else those of the whole basis.
    number : int or None
        How many modes there are of any frequency, if the basis has them all.
    """

    whole: CertifiedBasis
    condensed: CertifiedBasis | None = None
    number: int | None = None

    def modes(self, place: Place) -> Estimate:
        """Return the modes at a place with their errors, see `estimated`; vectors are in coordinates of a basis."""
        if self.condensed is not None:
            found = self.condensed.modes(place)
            if found[1].max(initial=0.0) <= 1:
                return found
        return self.whole.modes(place)

    def is_short(self, modes: Modes) -> bool:
        """Return whether modes at a place are fewer than were asked for, see `is_short`."""
        return is_short(modes, self.whole.request.count or 0, self.whole.highest, self.number)
