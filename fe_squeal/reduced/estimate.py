"""How far the modes of a projection may be off, and whether that meets the tolerance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..eigen.pencil import Modes
from ..eigen.request import Request, select_wanted
from ..problem.parameters import Place
from .basis import ReducedBasis

_BESIDE = 1.1  # times the highest frequency asked for: modes up to there are neighbours of the modes asked for
SLIGHT = 0.1  # times the tolerance: errors below this need not be known better
GUARDED = 1.2  # times the highest frequency of the basis: modes up to there are known
_SAFETY = 0.5  # times the tolerance: estimated errors of eigenvalues are driven below this
_ILL = 10.0  # relative condition from which a mode is near a double eigenvalue

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
    relative = error / np.maximum(np.abs(modes.lam), 1e-3 * highest)
    known = relative / np.maximum(condition / _ILL, 1.0) + np.finfo(float).eps
    off = known / (_SAFETY * request.tolerance)
    modes = replace(
        modes, re_uncertainty=modes.re_uncertainty + error + rounding,
        backward_error=np.fmax(modes.backward_error, backward),
        method=f"reduced model of {len(basis)} vectors", exhaustive=False,
    )  # fmt: skip
    return modes, off, relative


def neighbours(every: Modes, request: Request) -> Modes:
    """Return the modes asked for with those next above them."""
    wanted = select_wanted(every, request, np.inf)
    assert wanted is not None
    limit = _BESIDE * float(np.abs(wanted.lam).max(initial=0.0))
    return every.select(np.flatnonzero(np.abs(every.lam) <= limit))


@dataclass(frozen=True)
class Condensed:
    """A smaller basis inside that of a reduced model, for the modes asked for alone.

    Attributes
    ----------
    basis : ReducedBasis
    scale : float
        Factor of its estimated errors, which are bounds; how much too large they are is known from the whole basis,
        whose modes are more exact.
    """

    basis: ReducedBasis
    scale: float = 1.0

    def modes(self, place: Place, request: Request, highest: float) -> Estimate:
        """Return modes with their errors, see `estimated`."""
        every = self.basis.modes(place, GUARDED * highest)
        return estimated(self.basis, place, every, request, highest, self.scale)


@dataclass(frozen=True)
class OnlineModel:
    """What a reduced model needs to give modes with their errors: nothing in it is as long as the problem's vectors.

    Attributes
    ----------
    basis : ReducedBasis
        Without its vectors, see `ReducedBasis.without_vectors`.
    request : Request
    highest : float, rad/s
    condensed : Condensed or None
        Its modes are returned if their errors meet the tolerance, otherwise those of the whole basis.
    """

    basis: ReducedBasis
    request: Request
    highest: float
    condensed: Condensed | None = None

    def modes(self, place: Place) -> Estimate:
        """Return the modes at a place with their errors, see `estimated`; vectors are in coordinates of a basis."""
        if self.condensed is not None:
            found = self.condensed.modes(place, self.request, self.highest)
            if found[1].max(initial=0.0) <= 1:
                return found
        every = self.basis.modes(place, GUARDED * self.highest)
        return estimated(self.basis, place, every, self.request, self.highest)
