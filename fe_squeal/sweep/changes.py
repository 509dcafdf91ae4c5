"""A change of stability inside a step of a sweep, and how finely a step is searched for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FINEST = 1e-6  # of a step: two changes of stability nearer to each other than this are not told apart
SETTLED = 1e-5  # of a step: values are added until no window wider than this can hide in the error of the group matrix


@dataclass(frozen=True)
class Change:
    """A change of stability of the step model between two near values.

    Attributes
    ----------
    kind : str
        "meeting": two eigenvalues θ become a complex pair, or a pair becomes two. "zero": an undamped θ passes zero.
        "crossing": λ crosses the imaginary axis. "parting": a growing pair λ, λ* becomes two real λ, or these a pair.
    gains : int
        How many unstable modes are gained for a rising parameter; negative where some are lost.
    low, high : float
        Values between which the change lies.
    limits : (float, float)
        The wider interval around it in which nothing else changes in the group.
    v : complex
        The eigenvalue there, θ without dampers or λ with them.
    right, left : (r,) complex
        Its vectors on the step model, approximately.
    group : (r, ·) complex
        Right vectors of all modes of the group, at both ends of the interval.
    at_start : bool
        Whether the interval begins at the first value of the step.
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
    """Raised where stability cannot be told without the modes at one more value.

    Attributes
    ----------
    t : float
        That value, 0 … 1 between the ends of the interval.
    """

    def __init__(self, t: float) -> None:
        super().__init__()
        self.t = t
