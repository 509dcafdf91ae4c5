"""The minimal model: one mass on a belt, two inclined springs, one contact spring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..model import LumpedModel
from ..parameters import parameter, reading
from ..springs import Floats, add_spring, direction, friction_coupling, inclined

_ROUNDING = 8 * np.finfo(float).eps


@dataclass(frozen=True)
class Minimal(LumpedModel):
    """One mass with two degrees of freedom, q = (x along the belt, y normal).

    Spring and damper i act along (sin θi, −cos θi), k3 and c3 along y. The defaults are degenerate: the two inclined
    springs cancel in b, and a = d, so that both frequencies are √15 rad/s for every μ and no threshold exists.

    Examples
    --------
    >>> Minimal().critical_mu(), [round(mu, 12) for mu in Minimal(k2=20).critical_mu()]
    ([], [0.329914439537])
    """

    name: ClassVar[str] = "minimal"
    coordinates: ClassVar[tuple[str, ...]] = ("x", "y")

    m: float = parameter(1.0, "kg", "mass", "positive")
    k1: float = parameter(10.0, "N/m", "first inclined spring")
    k2: float = parameter(10.0, "N/m", "second inclined spring")
    k3: float = parameter(10.0, "N/m", "contact spring, normal to the belt")
    theta1: float = parameter(120.0, "°", "angle of the first spring", "any")
    theta2: float = parameter(60.0, "°", "angle of the second spring", "any")
    c1: float = parameter(0.0, "N s/m", "damper beside k1")
    c2: float = parameter(0.0, "N s/m", "damper beside k2")
    c3: float = parameter(0.0, "N s/m", "damper beside k3")
    friction: str = reading("printed")

    @property
    def M(self) -> Floats:
        """Mass matrix."""
        return self.m * np.eye(2)

    @property
    def C(self) -> Floats:
        """Damping matrix; friction does not follow the damper forces, as in the source."""
        return self._two_inclined_and_normal(self.c1, self.c2, self.c3)

    @property
    def K0(self) -> Floats:
        """Stiffness matrix without friction, [[a, b], [b, d]]."""
        return self._two_inclined_and_normal(self.k1, self.k2, self.k3)

    @property
    def friction_matrix(self) -> Floats:
        """F in K(μ) = K0 + μ F."""
        return friction_coupling(self.K0, 0, 1, self.k3, self.friction)

    def critical_mu(self) -> list[float]:
        """Return the μ > 0 at which flutter begins: without damping by the closed form, else the Hopf points."""
        if self.C.any():
            return super().critical_mu()
        springs = (self.k1, self.k2, self.k3, self.theta1, self.theta2)
        mu = float(critical_friction(*springs, friction=self.friction))
        return [mu] if 0 < mu < np.inf else []

    def _two_inclined_and_normal(self, first: float, second: float, normal: float) -> Floats:
        K = add_spring(np.zeros((2, 2)), first, inclined(self.theta1, 0, 1))
        return add_spring(add_spring(K, second, inclined(self.theta2, 0, 1)), normal, {1: 1.0})


def critical_friction(
    k1: ArrayLike, k2: ArrayLike, k3: ArrayLike, theta1: ArrayLike, theta2: ArrayLike, friction: str = "printed"
) -> Floats:
    """Return the μ at which flutter begins in the undamped minimal model, in closed form, for arrays of parameters.

    With K0 = [[a, b], [b, d]] the double root is at
    `printed`: μ_c = −((a−d)² + 4b²) / (4 b d); `contact`: k3 instead of the last d;
    `full`: μ_c = −(a + d − 2 √(ad − b²)) / b.

    Parameters
    ----------
    k1, k2, k3 : array_like, N/m
    theta1, theta2 : array_like, degrees
    friction : {"printed", "contact", "full"}

    Returns
    -------
    array
        Negative where only the reversed belt gives flutter, infinite where none does: where b is zero to rounding, and
        in `contact` also where k3 = 0.

    Examples
    --------
    >>> critical_friction(10, [5, 10, 20], 10, 120, 60).round(6).tolist()
    [-0.209946, inf, 0.329914]
    """
    (s1, c1), (s2, c2) = direction(theta1), direction(theta2)
    p1, p2, p3 = (np.asarray(k, dtype=float) for k in (k1, k2, k3))
    a = p1 * s1**2 + p2 * s2**2
    d = p3 + p1 * c1**2 + p2 * c2**2
    first, second = p1 * s1 * c1, p2 * s2 * c2
    b = first + second
    with np.errstate(divide="ignore", invalid="ignore"):
        if friction == "full":
            # a + d − 2√(ad−b²) without the cancellation
            mu = -((a - d) ** 2 + 4 * b**2) / (a + d + 2 * np.sqrt(a * d - b**2)) / b
        else:
            mu = -((a - d) ** 2 + 4 * b**2) / (4 * b * (d if friction == "printed" else p3))
    uncoupled = np.abs(b) <= _ROUNDING * (np.abs(first) + np.abs(second))
    return np.asarray(np.where(uncoupled | ~np.isfinite(mu), np.inf, mu))
