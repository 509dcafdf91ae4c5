"""Three pad masses on a rigid belt that moves in its plane: a reconstruction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..model import LumpedModel
from ..parameters import parameter, reading
from ..springs import Floats, add_spring, inclined

_X1, _Y1, _X2, _Y2, _X3, _Y3, _XB, _YB, _PHI = range(9)
_LEVER = 2.0  # m; the contacts and the belt's normal springs sit at −2 and +2


@dataclass(frozen=True)
class NineDof(LumpedModel):
    """Nine degrees of freedom, q = (x1, y1, x2, y2, x3, y3, xb, yb, φ).

    A reconstruction: the source prints neither matrices nor dimensions. About a thousand of 1.9 million topologies
    have its bifurcations near 0.9 and 2.7; this is the most regular one that also fits its claims on stiffness.
    Friction follows the two contact springs, with its reaction on the belt, so `contact` is the only reading.

    Examples
    --------
    >>> [round(o.mu, 9) for o in NineDof().critical_points(0, 4) if o.into]
    [0.858154205, 2.738331047, 3.658885653]
    """

    name: ClassVar[str] = "nine-dof"
    coordinates: ClassVar[tuple[str, ...]] = ("x1", "y1", "x2", "y2", "x3", "y3", "xb", "yb", "phi")

    m1: float = parameter(1.0, "kg", "first pad mass", "positive")
    m2: float = parameter(1.0, "kg", "second pad mass", "positive")
    m3: float = parameter(1.0, "kg", "third pad mass", "positive")
    mb: float = parameter(1.0, "kg", "mass of the belt", "positive")
    jb: float = parameter(1.0, "kg m²", "inertia of the belt", "positive")
    k1: float = parameter(1.0, "N/m", "horizontal spring, ground to m1")
    k2: float = parameter(1.0, "N/m", "horizontal spring, ground to m2")
    k3: float = parameter(1.0, "N/m", "horizontal spring, m1 to m2")
    k4: float = parameter(1.0, "N/m", "horizontal spring, m1 to m3")
    k5: float = parameter(1.0, "N/m", "vertical spring, ground to m1")
    k6: float = parameter(1.0, "N/m", "vertical spring, ground to m2")
    k7: float = parameter(1.0, "N/m", "vertical spring, ground to m3")
    k8: float = parameter(1.0, "N/m", "inclined spring, ground to m1")
    k9: float = parameter(1.0, "N/m", "inclined spring, ground to m2")
    k10: float = parameter(1.0, "N/m", "inclined spring, ground to m3")
    k11: float = parameter(1.0, "N/m", "horizontal spring of the belt")
    k12: float = parameter(1.0, "N/m", "vertical spring of the belt at the lever -2 m")
    k13: float = parameter(1.0, "N/m", "vertical spring of the belt at the lever +2 m")
    kc1: float = parameter(1.0, "N/m", "contact spring of m1, at the lever -2 m")
    kc2: float = parameter(1.0, "N/m", "contact spring of m2, at the lever +2 m")
    theta1: float = parameter(45.0, "°", "angle of k8", "any")
    theta2: float = parameter(45.0, "°", "angle of k9", "any")
    theta3: float = parameter(45.0, "°", "angle of k10", "any")
    c1: float = parameter(0.0, "N s/m", "damper, ground to x1")
    c2: float = parameter(0.0, "N s/m", "damper, ground to y1")
    c3: float = parameter(0.0, "N s/m", "damper, ground to x2")
    c4: float = parameter(0.0, "N s/m", "damper, ground to y2")
    c5: float = parameter(0.0, "N s/m", "damper, ground to x3")
    c6: float = parameter(0.0, "N s/m", "damper, ground to y3")
    c7: float = parameter(0.0, "N s/m", "damper, ground to xb")
    c8: float = parameter(0.0, "N s/m", "damper, ground to yb")
    c9: float = parameter(0.0, "N m s", "damper, ground to φ")
    friction: str = reading("contact", ("contact",))

    @property
    def M(self) -> Floats:
        """Mass matrix."""
        return np.diag([self.m1, self.m1, self.m2, self.m2, self.m3, self.m3, self.mb, self.mb, self.jb])

    @property
    def C(self) -> Floats:
        """Damping matrix, diagonal."""
        return np.diag([self.c1, self.c2, self.c3, self.c4, self.c5, self.c6, self.c7, self.c8, self.c9])

    @property
    def K0(self) -> Floats:
        """Stiffness matrix without friction."""
        springs = [
            (self.k1, {_X1: 1.0}), (self.k2, {_X2: 1.0}), (self.k3, {_X2: 1.0, _X1: -1.0}),
            (self.k4, {_X3: 1.0, _X1: -1.0}), (self.k5, {_Y1: 1.0}), (self.k6, {_Y2: 1.0}), (self.k7, {_Y3: 1.0}),
            (self.k8, inclined(self.theta1, _X1, _Y1)), (self.k9, inclined(self.theta2, _X2, _Y2)),
            (self.k10, inclined(self.theta3, _X3, _Y3)), (self.k11, {_XB: 1.0}),
            (self.k12, {_YB: 1.0, _PHI: -_LEVER}), (self.k13, {_YB: 1.0, _PHI: _LEVER}),
            *((kc, opening) for kc, _, opening in self._contacts()),
        ]  # fmt: skip
        K = np.zeros((9, 9))
        for stiffness, elongation in springs:
            K = add_spring(K, stiffness, elongation)
        return K

    @property
    def friction_matrix(self) -> Floats:
        """F in K(μ) = K0 + μ F: along x of each pad in contact, the reaction on the belt."""
        F = np.zeros((9, 9))
        for stiffness, x, opening in self._contacts():
            for i, value in opening.items():
                F[x, i] += stiffness * value
                F[_XB, i] -= stiffness * value
        return F

    def _contacts(self) -> list[tuple[float, int, dict[int, float]]]:
        """Stiffness, tangential coordinate and opening of each contact."""
        return [
            (self.kc1, _X1, {_Y1: 1.0, _YB: -1.0, _PHI: _LEVER}),
            (self.kc2, _X2, {_Y2: 1.0, _YB: -1.0, _PHI: -_LEVER}),
        ]
