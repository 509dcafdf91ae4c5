"""Two pads on a disc without a spring that ties tangential motion to normal motion, and the counter-example to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..model import LumpedModel
from ..parameters import parameter, reading
from ..springs import Floats, add_spring

_N1, _N2, _ND, _T1, _T2, _TD = range(6)


@dataclass(frozen=True)
class UncoupledDisc(LumpedModel):
    """Two pads and a disc, q = (n1, n2, nd normal, t1, t2, td tangential).

    K = [[K_nn, 0], [μ kc F, K_tt]]: friction drives the tangential motion, and nothing comes back from it. K is block
    triangular and its spectrum does not depend on μ. The pads press on opposite faces: pad 1 opens by n1 − nd, pad 2
    by nd − n2. A reconstruction of the kind of model that the source describes; it gives no matrices and no values.

    Examples
    --------
    >>> disc = UncoupledDisc()
    >>> bool(np.ptp(disc.eigenvalues([0.0, 1.0, 5.0]), axis=0).max() < 1e-12), disc.critical_mu()
    (True, [])
    """

    name: ClassVar[str] = "uncoupled-disc"
    coordinates: ClassVar[tuple[str, ...]] = ("n1", "n2", "nd", "t1", "t2", "td")

    mp: float = parameter(1.0, "kg", "mass of each pad", "positive")
    md: float = parameter(2.0, "kg", "mass of the disc", "positive")
    kpn: float = parameter(10.0, "N/m", "normal spring of each pad")
    kpt: float = parameter(10.0, "N/m", "tangential spring of each pad")
    kdn: float = parameter(20.0, "N/m", "normal spring of the disc")
    kdt: float = parameter(20.0, "N/m", "tangential spring of the disc")
    kc: float = parameter(50.0, "N/m", "contact spring between each pad and the disc")
    cpn: float = parameter(0.0, "N s/m", "damper beside kpn")
    cpt: float = parameter(0.0, "N s/m", "damper beside kpt")
    cdn: float = parameter(0.0, "N s/m", "damper beside kdn")
    cdt: float = parameter(0.0, "N s/m", "damper beside kdt")
    cc: float = parameter(0.0, "N s/m", "damper beside kc")
    friction: str = reading("contact", ("contact",))

    @property
    def M(self) -> Floats:
        """Mass matrix."""
        return np.diag([self.mp, self.mp, self.md, self.mp, self.mp, self.md])

    @property
    def C(self) -> Floats:
        """Damping matrix."""
        return _layout(self.cpn, self.cdn, self.cpt, self.cdt, self.cc)

    @property
    def K0(self) -> Floats:
        """Stiffness matrix without friction."""
        return _layout(self.kpn, self.kdn, self.kpt, self.kdt, self.kc)

    @property
    def friction_matrix(self) -> Floats:
        """F in K(μ) = K0 + μ F."""
        F = np.zeros((6, 6))
        for t, opening in ((_T1, {_N1: 1.0, _ND: -1.0}), (_T2, {_ND: 1.0, _N2: -1.0})):
            for i, value in opening.items():
                F[t, i] += self.kc * value
                F[_TD, i] -= self.kc * value
        return F


def _layout(pad_normal: float, disc_normal: float, pad_along: float, disc_along: float, contact: float) -> Floats:
    K = np.diag([pad_normal, pad_normal, disc_normal, pad_along, pad_along, disc_along])
    for pad in (_N1, _N2):
        K = add_spring(K, contact, {pad: 1.0, _ND: -1.0})
    return K


@dataclass(frozen=True)
class RigidPad(LumpedModel):
    """A rigid pad that moves along the normal and rotates, q = (y, φ): flutter without any inclined spring.

    Contact springs ka at the lever −1 and kb at +1, a rotational spring kr, friction at the height h below the centre:
    with the defaults K = [[3, 1], [1 − 3μ, 4 − μ]], and flutter begins at μ = 7 − 2√11.

    Examples
    --------
    >>> RigidPad().K(1.0)
    array([[ 3.,  1.],
           [-2.,  3.]])
    """

    name: ClassVar[str] = "rigid-pad"
    coordinates: ClassVar[tuple[str, ...]] = ("y", "phi")

    m: float = parameter(1.0, "kg", "mass", "positive")
    j: float = parameter(1.0, "kg m²", "inertia", "positive")
    ka: float = parameter(1.0, "N/m", "contact spring at the lever -1 m")
    kb: float = parameter(2.0, "N/m", "contact spring at the lever +1 m")
    kr: float = parameter(1.0, "N m", "rotational spring")
    h: float = parameter(1.0, "m", "height of the centre above the contact")

    @property
    def M(self) -> Floats:
        """Mass matrix."""
        return np.diag([self.m, self.j])

    @property
    def K0(self) -> Floats:
        """Stiffness matrix without friction."""
        K = add_spring(np.diag([0.0, self.kr]), self.ka, {0: 1.0, 1: -1.0})
        return add_spring(K, self.kb, {0: 1.0, 1: 1.0})

    @property
    def friction_matrix(self) -> Floats:
        """F in K(μ) = K0 + μ F: the moment −μ N h of the friction force."""
        F = np.zeros((2, 2))
        F[1] = -self.h * np.array([self.ka + self.kb, self.kb - self.ka])
        return F
