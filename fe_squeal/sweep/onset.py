"""An onset of instability, as a sweep reports it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

_VAGUE = 0.5  # of the step between values: an onset that is less certain may be between others
_EQUAL = 1e-8  # of values and of frequencies: onsets of equal parts of a brake differ by less


@dataclass(frozen=True)
class Onset:
    """A critical value of the sweep parameter.

    Attributes
    ----------
    parameter : str
        Name of the parameter p.
    value : float
        The critical value p_c.
    frequency_hz : float, Hz
        Frequency of the mode there; 0 for divergence.
    kind : "flutter" or "divergence"
    direction : "into" or "out of"
        Whether a mode becomes unstable or stable for a rising parameter.
    crossing_speed : float
        c in what `law` says, 1/s over the unit of p or over its root. NaN for two modes of equal frequency that couple
        as soon as the parameter leaves the first value: there is no threshold then.
    branch_a, branch_b : int or None
        The branches that take part; `branch_b` is None where one mode crosses by itself.
    uncertainty : float
        Uncertainty of `value`, from rounding and residuals.
    two_mode_value : float
        What the modes of the two branches at the first value, without all other modes, predict for `value`; NaN if they
        never meet, or K is not linear in the parameter.
    discretisation : float
        Error of `value` by the mesh; NaN where it is not estimated.
    extrapolated : float
        The likely value for an infinitely fine mesh; NaN where it is not estimated.
    extrapolated_discretisation : float
        Error of `extrapolated`.
    law : "root", "linear", "parting" or ""
        How growth begins at a small distance d = |p − p_c|: Re λ = c √d where two eigenvalues meet, or λ and −λ at zero
        without dampers; Re λ = c d where one crosses the imaginary axis. At a "parting" a pair λ, λ* that grows already
        becomes two real λ ± c √d, or the reverse. "" where it is not known.
    exact : (float, float, float, float) or None
        While a sweep on a reduced model runs: `value`, `uncertainty`, `frequency_hz` and `crossing_speed` of the
        problem itself. Those above are of the reduced model, whose modes are followed, and have to agree with these.
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
    extrapolated_discretisation: float = np.nan
    law: str = ""
    exact: tuple[float, float, float, float] | None = None

    @property
    def has_root(self) -> bool:
        """Whether Re λ changes like a square root beside it; where its law is not known, whether two branches meet."""
        return self.law in ("root", "parting") if self.law else self.branch_b is not None

    def growth_within(self, distance: float) -> float:
        """Return the growth rate, 1/s, at a distance by its law; not finite where it has no threshold."""
        return float(abs(self.crossing_speed) * (np.sqrt(distance) if self.has_root else distance))

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """Its value, uncertainty, frequency and speed, as `exact` has them."""
        return self.value, self.uncertainty, self.frequency_hz, self.crossing_speed

    def certified(self) -> Onset:
        """Return the onset of the problem itself."""
        if self.exact is None:
            return self
        value, uncertainty, frequency_hz, speed = self.exact
        return replace(
            self, value=value, uncertainty=uncertainty, frequency_hz=frequency_hz, crossing_speed=speed, exact=None
        )

    def is_copy_of(self, other: Onset) -> bool:
        """Return whether another onset is the same of an equal part of the brake, or this one itself."""
        unsure = self.uncertainty + other.uncertainty + _EQUAL * abs(self.value)
        alike = (self.kind, self.direction) == (other.kind, other.direction)
        near = abs(self.frequency_hz - other.frequency_hz) <= _EQUAL * self.frequency_hz
        return alike and near and abs(self.value - other.value) <= unsure


def certified(
    onsets: Iterable[Onset], parameter: str, values: Sequence[float], ends: tuple[float, float]
) -> tuple[tuple[Onset, ...], list[str], list[str]]:  # fmt: skip
    """Return the onsets of the problem itself, ascending, and sentences: about those left out, and about vague ones.

    Parameters
    ----------
    onsets : iterable of Onset
        Those of the reduced model that is followed, or of the problem.
    parameter : str
        Its name.
    values : sequence of float
        The values of the sweep, ascending.
    ends : (float, float)
        Between these, onsets are listed: one of the reduced model just inside may be outside on the problem itself.
    """
    pairs = sorted(((o.certified(), o.exact is not None) for o in onsets), key=lambda pair: pair[0].value)
    found = [o for o, _ in pairs]
    inside = [o for o in found if ends[0] <= o.value + o.uncertainty and o.value - o.uncertainty <= ends[1]]
    outside = [
        f"an onset near {o.frequency_hz:.5g} Hz is at {parameter} = {o.value:.8g} and not listed: it lies outside of"
        " the sweep, within which a reduced model had it"
        for o in found if o not in inside
    ]
    vague = [
        f"the onset at {parameter} = {o.value:.5g} is uncertain by {o.uncertainty:.2g}, more than half the distance of"
        " the values around it: its reduced model may be off by so much"
        for o, is_reduced in pairs if is_reduced and o in inside and o.uncertainty > _VAGUE * _step(values, o.value) > 0
    ]
    return tuple(inside), outside, vague


def _step(values: Sequence[float], value: float) -> float:
    """Return the distance of the two of some values that are on both sides of a value; 0 where there is one alone."""
    if len(values) < 2:
        return 0.0
    behind = int(np.clip(np.searchsorted(values, value), 1, len(values) - 1))
    return float(values[behind] - values[behind - 1])
