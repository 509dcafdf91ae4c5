"""The numbers that a study keeps of the modes at one place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..eigen.pencil import Modes
from ..eigen.request import Request

COLUMNS = (
    "unstable", "worst_re", "worst_frequency_hz", "worst_damping_ratio", "worst_re_uncertainty", "error", "direct",
    "known_hz", "unsearched",
)  # fmt: skip
MODE_COLUMNS = ("frequency_hz", "re", "re_uncertainty", "damping_ratio")


@dataclass(frozen=True)
class Outcome:
    """What is kept of the modes at one place, as numbers that can be sent and stored.

    Attributes
    ----------
    row : (9,) float
        The columns `COLUMNS`: 1 if a mode is unstable beyond the uncertainty of its growth rate, else 0; growth rate
        (1/s), frequency (Hz), damping ratio and uncertainty of the growth rate (1/s) of the mode that grows most (of
        several with equal growth the most uncertain one); the largest estimated |Δλ/λ| of a mode; 1 if the place was
        solved directly, else 0; up to which frequency (Hz) all modes are known, infinite where they are all there are;
        1 if the solve has not looked for some modes that may grow, see `Modes.unsearched`, else 0.
    modes : (k, 4) float
        The columns `MODE_COLUMNS` of the k unstable modes.
    """

    row: np.ndarray
    modes: np.ndarray

    @property
    def unstable(self) -> bool:
        """Whether any mode is unstable at the place."""
        return bool(self.row[0])


def outcome_of(modes: Modes, request: Request, error: float, direct: bool) -> Outcome:
    """Return what is kept of the modes at one place.

    Parameters
    ----------
    modes : Modes
    request : Request
        Which modes were asked for.
    error : float
        The largest estimated |Δλ/λ|.
    direct : bool
        Whether the modes come from a direct solve.
    """
    lam, u = modes.lam, modes.re_uncertainty
    size = np.where(lam == 0, 1.0, np.abs(lam))
    ratio = -lam.real / size + 0.0
    grows = modes.stability == "unstable"
    kept = np.stack([modes.frequency_hz[grows], lam.real[grows], u[grows], ratio[grows]], axis=1)
    known = request.max_frequency_hz or np.inf
    if request.count is not None and request.count <= len(lam) and modes.eigenvalue_count < 2 * len(modes.right):
        known = float(modes.frequency_hz.max())
    left_out = modes.unsearched.may_grow
    if not len(lam):
        return Outcome(np.array([0.0, np.nan, np.nan, np.nan, np.nan, error, direct, known, left_out], float), kept)
    worst = max(range(len(lam)), key=lambda i: (lam.real[i], u[i]))
    row = [grows.any(), lam.real[worst], modes.frequency_hz[worst], ratio[worst], u[worst]]
    return Outcome(np.array([*row, error, direct, known, left_out], float), kept)
