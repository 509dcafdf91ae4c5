"""A change of stability inside a step of a sweep, and how finely a step is searched for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FINEST = 1e-6  # of a step: two changes of stability that are closer together than this are not distinguished
SETTLED = 1e-5  # of a step: values are added until no window of instability wider than this can be hidden by errors


@dataclass(frozen=True)
class Change:
    """A change of stability of the step model between two near values.

    Attributes
    ----------
    kind : str
        "meeting": two real eigenvalues θ become a complex pair, or the reverse. "zero": a real θ passes zero.
        "crossing": λ crosses the imaginary axis. "parting": a growing pair λ, λ* becomes two real λ, or the reverse.
    gains : int
        Number of unstable modes more above the change than below it; negative if there are fewer.
    low, high : float
        Values of the parameter between which the change is.
    limits : (float, float)
        A wider interval around it in which the stability of the group does not change otherwise.
    v : complex
        The eigenvalue that changes: θ without dampers, rad²/s², or λ with dampers, rad/s.
    right, left : (r,) complex
        Its right and left vector in the coordinates of the step model, approximately.
    group : (r, 2m) complex
        Right vectors of all m modes of the group at both ends of the group's interval.
    at_start : bool
        Whether the change may be at the first value of the step itself: two modes of equal frequency may couple there.
    copies : int
        How many eigenvalues equal to v change in the same way at once, as those of equal parts do; a change for each.
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
    copies: int = 1


class Asked(Exception):
    """Raised where the modes at one more value are needed to decide whether stability changes.

    Attributes
    ----------
    t : float
        Where this value is in the interval of the group: 0 at its beginning, 1 at its end.
    """

    def __init__(self, t: float) -> None:
        super().__init__()
        self.t = t
