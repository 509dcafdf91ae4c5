"""Which consistent units a deck is in: by density and wave speed of its materials, and the size of its mesh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Units:
    """Consistent units by what one of each is in SI.

    Attributes
    ----------
    name : str
    length, mass, time : float
        m, kg and s.
    """

    name: str
    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    @property
    def pressure(self) -> float:
        """Pa."""
        return self.mass / (self.length * self.time**2)

    @property
    def density(self) -> float:
        """kg/m^3."""
        return self.mass / self.length**3

    @property
    def stiffness(self) -> float:
        """N/m."""
        return self.mass / self.time**2

    @property
    def damping(self) -> float:
        """N s/m."""
        return self.mass / self.time

    @property
    def force(self) -> float:
        """N."""
        return self.mass * self.length / self.time**2

    @property
    def speed(self) -> float:
        """m/s."""
        return self.length / self.time

    @property
    def length_unit(self) -> str:
        """What the scene says of the mesh file."""
        return "mm" if self.length == 1e-3 else "m"


SI = Units("m, kg, s")
SYSTEMS = (
    SI, Units("mm, t, s (N, MPa)", 1e-3, 1e3, 1.0), Units("mm, kg, ms (kN, GPa)", 1e-3, 1.0, 1e-3),
    Units("mm, kg, s (mN, kPa)", 1e-3, 1.0, 1.0), Units("mm, g, ms (N, MPa)", 1e-3, 1e-3, 1e-3),
)  # fmt: skip
# Linings, magnesium and composites have 1500, tungsten 19 300 kg/m^3; sound in linings 1000 to 2000, in steel and
# aluminium 5100 m/s, in rubber 100. Brakes and their parts are between a millimetre and a few metres.
_DENSITY, _SPEED, _SIZE = (400.0, 25_000.0), (50.0, 20_000.0), (1e-3, 5.0)
_MIDDLE = (5000.0, 4000.0)  # kg/m^3 and m/s: between what brakes are made of
_MODULUS = (1e6, 1e12)  # Pa, from rubber to diamond


def recognise(materials: Sequence[tuple[float, float]], size: float) -> tuple[Units | None, list[Units]]:
    """Return the units of a deck, and the others that its numbers could be in.

    Parameters
    ----------
    materials : sequence of (Young's modulus, density)
    size : float
        Size of the mesh.

    Returns
    -------
    units
        None if no system makes sense of the numbers.
    others

    Examples
    --------
    >>> recognise([(2.1e5, 7.8e-9)], 250.0)[0].name
    'mm, t, s (N, MPa)'
    >>> recognise([(1.0, 1.0)], 1.0)
    (None, [])
    """
    found = []
    for units in SYSTEMS:
        distance = 0.0
        fits = _SIZE[0] <= size * units.length <= _SIZE[1] and bool(materials)
        for modulus, density in materials:
            rho, c = density * units.density, math.sqrt(modulus / density) * units.speed
            fits = fits and _DENSITY[0] <= rho <= _DENSITY[1] and _SPEED[0] <= c <= _SPEED[1]
            distance += abs(math.log(rho / _MIDDLE[0])) + abs(math.log(c / _MIDDLE[1]))
        if fits:
            found.append((distance, units))
    found.sort(key=lambda pair: pair[0])
    return (found[0][1], [units for _, units in found[1:]]) if found else (None, [])


def likely(moduli: Sequence[float], size: float) -> Units:
    """Return the first system in which Young's moduli, and the size of a mesh, are those of a brake; SI if none is.

    For decks without densities, where suggestions need units but nothing may be converted: 2.1e5 is steel in MPa both
    with tonnes and seconds and with grams and milliseconds.

    Examples
    --------
    >>> likely([2.1e5], 250.0).name, likely([2.1e11], 0.25).name
    ('mm, t, s (N, MPa)', 'm, kg, s')
    """
    for units in SYSTEMS:
        usual = all(_MODULUS[0] <= modulus * units.pressure <= _MODULUS[1] for modulus in moduli)
        if usual and _SIZE[0] <= size * units.length <= _SIZE[1]:
            return units
    return SI
