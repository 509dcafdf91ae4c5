"""A change of stability inside a step of a sweep, and how closely such changes are looked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FINEST = 1e-6  # of a step: nearer to each other two changes of stability are not told apart
SETTLED = 1e-5  # of a step: windows that may be hidden below the error of a group are narrower than this


@dataclass(frozen=True)
class Change:
    """A change of stability between two near values.

    Attributes
    ----------
    kind : "meeting" of two eigenvalues θ, "zero" of an undamped eigenvalue θ, "crossing" of the imaginary axis, or
        "parting" of a growing pair λ, λ* into two real ones, or of these into a pair
    gains : int
        By how many the unstable modes become more, for a rising parameter.
    low, high : float
        Values before and behind.
    limits : (float, float)
        Values up to which nothing else changes in the group; the change itself is between them.
    v : complex
        The eigenvalue there, θ or λ.
    right, left : (r,) complex
        On the small problem, approximately.
    group : (r, ·) complex
        Right vectors of the whole group, at both ends of the interval.
    at_start : bool
        Whether the change begins at the first value of the step.
    """

    kind: str
    gains: int
    low: float
    high: float
    limits: tuple[float, float]
    v: complex
    right: np.ndarray
    left: np.ndarray
    group: np.ndarray
    at_start: bool = False


class Asked(Exception):
    """A value at which modes are needed to tell more, as t of the cluster."""

    def __init__(self, t: float) -> None:
        super().__init__()
        self.t = t
