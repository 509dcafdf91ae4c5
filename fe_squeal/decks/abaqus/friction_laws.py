"""Friction coefficients over the sliding speed: exponential decay, and tables of slip rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class ExponentialDecay:
    """μ = μ_k + (μ_s − μ_k) exp(−d v) (Abaqus Analysis Guide, frictional behavior).

    Attributes
    ----------
    static, kinetic : float
    decay : float
        In the deck's unit of time over length.
    """

    static: float
    kinetic: float
    decay: float

    def at(self, speed: float) -> tuple[float, float]:
        """Return μ and dμ/dv at a sliding speed, in the deck's units."""
        left = (self.static - self.kinetic) * float(np.exp(-self.decay * speed))
        return self.kinetic + left, -self.decay * left


@dataclass(frozen=True)
class SlipRates:
    """Coefficients (r,) at ascending slip rates (r,), linear between them and constant outside."""

    coefficients: tuple[float, ...]
    rates: tuple[float, ...]

    def at(self, speed: float) -> tuple[float, float]:
        """Return μ and dμ/dv at a sliding speed, in the deck's units; at a corner dμ/dv is that of faster sliding."""
        mu, rates = np.array(self.coefficients), np.array(self.rates)
        i = int(np.searchsorted(rates, speed, side="right"))
        inside = 0 < i < len(rates)
        slope = (mu[i] - mu[i - 1]) / (rates[i] - rates[i - 1]) if inside else 0.0
        return float(np.interp(speed, rates, mu)), float(slope)


FrictionLaw = ExponentialDecay | SlipRates


def law_of(parameters: set[str], rows: Sequence[Sequence[float | None]]) -> FrictionLaw | None:
    """Return how the coefficient depends on the sliding speed; None if it is constant, or depends on something else.

    Parameters
    ----------
    parameters : set of str
        Names of the parameters of *Friction.
    rows : sequence of sequences of float
        Its data lines: μ_s, μ_k and d of the decay, or μ, slip rate and what else it depends on, None where blank.
    """
    if "USER" in parameters or not rows:
        return None
    numbers = [[float(value or 0.0) for value in _without_blank_end(row)] for row in rows]
    if "EXPONENTIAL DECAY" in parameters:
        whole = len(numbers) == 1 and len(numbers[0]) == 3 and "TEST DATA" not in parameters
        return ExponentialDecay(*numbers[0]) if whole and numbers[0][2] >= 0 else None
    if len(numbers) == 1 or any(len(row) < 2 for row in numbers) or "ANISOTROPIC" in parameters:
        return None
    mu, rates, others = zip(*((row[0], row[1], tuple(v for v in row[2:])) for row in numbers), strict=True)
    ascending = all(b > a for a, b in pairwise(rates))
    return SlipRates(tuple(mu), tuple(rates)) if ascending and len(set(others)) == 1 else None


def _without_blank_end(row: Sequence[float | None]) -> list[float | None]:
    """Return the row of a data line without what stands behind a comma at its end."""
    given = list(row)
    while given and given[-1] is None:
        given.pop()
    return given
