"""An onset of instability, as a sweep reports it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Onset:
    """A critical value of the sweep parameter.

    Attributes
    ----------
    parameter, value : str, float
    frequency_hz : float
    kind : "flutter" or "divergence"
    direction : "into" or "out of" instability, for a rising parameter
    crossing_speed : float
        dRe λ/dp; where two eigenvalues meet, the factor of √|p − p_c| in Re λ. NaN for two modes of equal frequency
        that couple as soon as the parameter leaves the first value: there is no threshold then.
    branch_a, branch_b : int or None
        The branches that take part; one of them alone where an eigenvalue crosses by itself.
    uncertainty : float
        Of `value`.
    two_mode_value : float
        What the two branches' modes at the start of the sweep alone would predict; NaN if they never meet.
    discretisation : float
        Error of `value` by the mesh; NaN where it is not estimated.
    extrapolated : float
        The value that meshes finer and finer are likely to tend to; NaN where it is not estimated.
    """

    parameter: str
    value: float
    frequency_hz: float
    kind: str
    direction: str
    crossing_speed: float
    branch_a: int
    branch_b: int | None
    uncertainty: float
    two_mode_value: float = np.nan
    discretisation: float = np.nan
    extrapolated: float = np.nan
