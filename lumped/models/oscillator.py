"""The friction oscillator of the section on the mode-coupling mechanism (after Schroth)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..model import LumpedModel
from ..parameters import parameter, reading
from ..springs import Floats, add_spring, friction_coupling, inclined


@dataclass(frozen=True)
class Oscillator(LumpedModel):
    """One mass on a belt, on springs along x and y and one spring between the two directions.

    q = (x along the belt, y normal). At θ = 45° and `printed`:
    K = [[kx + k/2, −k/2 + μ (ky + k/2)], [−k/2, ky + k/2]]. Flutter begins at μ_c = 0.362.

    Examples
    --------
    >>> [round(mu, 12) for mu in Oscillator().critical_mu()]
    [0.362]
    """

    name: ClassVar[str] = "oscillator"
    coordinates: ClassVar[tuple[str, ...]] = ("x", "y")

    m: float = parameter(1.0, "kg", "mass", "positive")
    kx: float = parameter(11.0, "N/m", "spring along the belt")
    ky: float = parameter(20.0, "N/m", "normal spring, the contact")
    k: float = parameter(10.0, "N/m", "inclined spring")
    theta: float = parameter(45.0, "°", "angle of the inclined spring", "any")
    cx: float = parameter(0.0, "N s/m", "damper along the belt")
    cy: float = parameter(0.0, "N s/m", "normal damper")
    friction: str = reading("printed")

    @property
    def M(self) -> Floats:
        """Mass matrix."""
        return self.m * np.eye(2)

    @property
    def C(self) -> Floats:
        """Damping matrix."""
        return np.diag([self.cx, self.cy])

    @property
    def K0(self) -> Floats:
        """Stiffness matrix without friction."""
        return add_spring(np.diag([self.kx, self.ky]), self.k, inclined(self.theta, 0, 1))

    @property
    def friction_matrix(self) -> Floats:
        """F in K(μ) = K0 + μ F."""
        return friction_coupling(self.K0, 0, 1, self.ky, self.friction)
