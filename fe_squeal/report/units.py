"""Units beside numbers: those of SI, or none where a scene has a consistent set of its own (`units = "any"`)."""

from __future__ import annotations

ANY = "any"  # what a scene without SI units says


def with_unit(number: str, unit: str, units: str) -> str:
    """Return a number with its unit; without one where units are not known.

    Examples
    --------
    >>> with_unit("2.5", "N m", "SI"), with_unit("2.5", "N m", "any")
    ('2.5 N m', '2.5')
    """
    return number if units == ANY else f"{number} {unit}"


def in_brackets(name: str, unit: str, units: str) -> str:
    """Return the label of an axis with its unit, as `x (mm)`."""
    return name if units == ANY else f"{name} ({unit})"


def behind_comma(name: str, unit: str, units: str) -> str:
    """Return the head of a column with its unit, as `area, m²`."""
    return name if units == ANY else f"{name}, {unit}"


def drawn_length(units: str) -> float:
    """Return what a length of the model is multiplied by in pictures: they are in mm, or in the scene's own unit."""
    return 1.0 if units == ANY else 1e3


def pressure_unit(peak: float, units: str = "SI") -> tuple[str, float]:
    """Return the unit in which a pressure is best read, "" if it is not known, and what it is in the model's unit.

    Examples
    --------
    >>> pressure_unit(2.7e6), pressure_unit(3e4), pressure_unit(0.0), pressure_unit(2.7, "any")
    (('MPa', 1000000.0), ('kPa', 1000.0), ('Pa', 1.0), ('', 1.0))
    """
    if units == ANY:
        return "", 1.0
    for unit, size in (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3)):
        if peak >= 0.1 * size:
            return unit, size
    return "Pa", 1.0


def force_text(force: float, units: str) -> str:
    """Return a force in words.

    Examples
    --------
    >>> force_text(1316.0, "SI"), force_text(1316.0, "any")
    ('1.316 kN', '1316')
    """
    large = units != ANY and abs(force) >= 1000
    return with_unit(f"{force / 1000 if large else force:.4g}", "kN" if large else "N", units)
