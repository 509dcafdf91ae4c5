"""The coordinate along which a sweep divides its steps and interpolates: p itself, or ln p over decades."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

_DECADE = 10.0  # ratio of the last to the first value from which a sweep is taken to be logarithmic
_EVEN = 0.1  # of the mean step: steps that differ by less than this count as equal


@dataclass(frozen=True)
class Scale:
    """The coordinate x of a parameter p in which steps are divided and matrices interpolated.

    Attributes
    ----------
    logarithmic : bool
        Whether x = ln p, with dA/dx = p dA/dp. Otherwise x = p.
    """

    logarithmic: bool = False

    @classmethod
    def of(cls, values: np.ndarray) -> Scale:
        """Return the scale of a sweep: logarithmic for positive values that are geometric or span more than a decade.

        Examples
        --------
        >>> [Scale.of(np.array(v)).logarithmic for v in ([1.0, 2.0, 4.0], [1.0, 2.0, 3.0], [0.0, 10.0], [0.2, 5.0])]
        [True, False, False, True]
        """
        values = np.asarray(values, float)
        if len(values) < 2 or values[0] <= 0:
            return cls()
        ratios = np.diff(np.log(values))
        geometric = len(values) > 2 and _is_even(ratios) and not _is_even(np.diff(values))
        return cls(geometric or bool(values[-1] > _DECADE * values[0]))

    def x(self, p: float) -> float:
        """Return the coordinate of a parameter."""
        return float(np.log(p)) if self.logarithmic else p

    def p(self, x: float) -> float:
        """Return the parameter at a coordinate."""
        return float(np.exp(x)) if self.logarithmic else x

    def slope(self, p: float) -> float:
        """Return dp/dx."""
        return p if self.logarithmic else 1.0

    def filled(self, values: np.ndarray, steps: int) -> np.ndarray:
        """Return values with others added between them, so that no step in x is longer than 1/steps of their range.

        Examples
        --------
        >>> Scale().filled(np.array([0.0, 0.5, 2.0]), 4).tolist()
        [0.0, 0.5, 1.0, 1.5, 2.0]
        """
        if len(values) < 2:
            return values
        x = np.array([self.x(float(p)) for p in values])
        widest = (x[-1] - x[0]) / steps * (1 + 1e-9)
        between = [
            self.p(float(c))
            for a, b in itertools.pairwise(x)
            for c in np.linspace(a, b, int(np.ceil((b - a) / widest)) + 1)[1:-1]
        ]
        return np.sort(np.concatenate([values, between]))

    def middle(self, a: float, b: float) -> float:
        """Return the parameter half way between two values, in x."""
        return float(np.sqrt(a) * np.sqrt(b)) if self.logarithmic else (a + b) / 2


LINEAR = Scale()


def _is_even(steps: np.ndarray) -> bool:
    return bool(np.ptp(steps) <= _EVEN * steps.mean())
