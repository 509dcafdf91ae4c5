"""Two masses behind each other, the second on the belt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..model import LumpedModel
from ..parameters import parameter, reading
from ..springs import Floats, add_spring, friction_coupling, inclined


@dataclass(frozen=True)
class TwoMass(LumpedModel):
    """Two masses with three degrees of freedom, q = (x1, x2 along the belt, y2 normal).

    k1x ‖ c1x ties m1 to the wall, k2x ‖ c2x and the inclined spring k (angle θ1) tie m2 to m1, ky ‖ cy holds m2
    on the belt. Friction acts on m2. The source prints no matrices; this layout has its names and its trends. Its
    angle is counted from the belt: k acts along (cos θ1, −sin θ1).

    Examples
    --------
    >>> [round(mu, 12) for mu in TwoMass().critical_mu()]
    [0.20149364613]
    """

    name: ClassVar[str] = "two-mass"
    coordinates: ClassVar[tuple[str, ...]] = ("x1", "x2", "y2")
    default_mu: ClassVar[float] = 0.4

    m1: float = parameter(1.0, "kg", "mass at the wall", "positive")
    m2: float = parameter(2.0, "kg", "mass on the belt", "positive")
    k1x: float = parameter(10.0, "N/m", "spring from the wall to m1")
    k2x: float = parameter(10.0, "N/m", "spring from m1 to m2 along the belt")
    ky: float = parameter(50.0, "N/m", "contact spring, normal to the belt")
    k: float = parameter(5.0, "N/m", "inclined spring from m1 to m2")
    theta1: float = parameter(45.0, "°", "angle of the inclined spring from the belt", "any")
    c1x: float = parameter(0.0, "N s/m", "damper beside k1x")
    c2x: float = parameter(0.0, "N s/m", "damper beside k2x")
    cy: float = parameter(0.0, "N s/m", "damper beside ky")
    friction: str = reading("printed")

    @property
    def M(self) -> Floats:
        """Mass matrix."""
        return np.diag([self.m1, self.m2, self.m2])

    @property
    def C(self) -> Floats:
        """Damping matrix."""
        return self._chain(self.c1x, self.c2x, self.cy)

    @property
    def K0(self) -> Floats:
        """Stiffness matrix without friction."""
        from_normal = 90.0 - self.theta1
        return add_spring(self._chain(self.k1x, self.k2x, self.ky), self.k, inclined(from_normal, 1, 2, x_other=0))

    @property
    def friction_matrix(self) -> Floats:
        """F in K(μ) = K0 + μ F."""
        return friction_coupling(self.K0, 1, 2, self.ky, self.friction)

    def _chain(self, wall: float, between: float, normal: float) -> Floats:
        K = add_spring(np.zeros((3, 3)), wall, {0: 1.0})
        return add_spring(add_spring(K, between, {1: 1.0, 0: -1.0}), normal, {2: 1.0})
