"""MP, MPDATA and TB,FRIC of Ansys archives: one number for each property of a material, and what else they say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...errors import MeshError
from ...mesh.readers.ansys_forms import is_release
from ..draft import Draft
from .content import Line

_USED = {"EX", "EY", "EZ", "PRXY", "NUXY", "DENS", "MU", "ALPD", "BETD"}
_MODULI, _SHEAR, _RATIOS = ("EY", "EZ"), ("GXY", "GYZ", "GXZ"), ("PRYZ", "PRXZ", "NUYZ", "NUXZ")
_ALIKE = 1e-3  # of constants that an isotropic material gives in full, rounded
_ONE_VALUE = ("", "ISO")  # options of TB,FRIC with one coefficient


def read_materials(lines: Sequence[Line], source: str, draft: Draft) -> dict[int, dict[str, float]]:
    """Return the values of MP, MPDATA and TB,FRIC by number and label, such as {1: {"EX": 2.1e5}}.

    The last one of a label counts; of tables by temperature and other fields the first value, which is told. TB,FRIC
    counts before MU.

    Raises
    ------
    MeshError
        A value is no number.
    """
    found: dict[int, dict[str, float]] = {}
    frictions: dict[int, float] = {}
    table, option = 0, ""  # material of the TB,FRIC that is read, and its option
    for fields, where in lines:
        try:
            if fields[0] == "TB":
                is_friction = fields[1:2] == ["FRIC"] and "".join(fields[2:3]).isdigit()
                table, option = (int(fields[2]), "".join(fields[5:6])) if is_friction else (0, "")
                frictions.pop(table, None)
                if option == "USER":
                    draft.find("TB,FRIC", where, "is a law of the user: give friction in [[contacts]]", "missing")
            elif fields[0] in ("TBDATA", "TBDAT") and table and len(fields) > 2 and int(fields[1]) == 1:
                values = [float(text) for text in fields[2:] if text]
                first = frictions.setdefault(table, values[0])
                several = values[:1] if option in _ONE_VALUE else values[:2]
                _tell(draft, "TB,FRIC", where, first, several, "direction, temperature, slip rate or pressure")
            elif fields[0] == "MPDATA":
                # Archives have the release, or UNBL, and a count in front: MPDATA,R5.0,1,EX,2,1,2.1E5 is
                # MPDATA,EX,2,1,2.1E5.
                given = fields[3:] if is_release(fields[1]) else fields[1:]
                label, number, place = _named(given[0]), int(given[1]), int(given[2] or 1)
                values, own = [float(text) for text in given[3:] if text], found.setdefault(number, {})
                if place == 1 and values:
                    own[label] = values[0]
                if label in _USED and values:
                    _tell(draft, f"MPDATA,{label}", where, own.get(label, values[0]), values, "temperature")
            elif fields[0] == "MP" and len(fields) > 3:
                label, values = _named(fields[1]), [float(text or 0.0) for text in fields[3:]]
                found.setdefault(int(fields[2]), {})[label] = values[0]
                if label in _USED and any(values[1:]):
                    _tell(draft, f"MP,{label}", where, values[0], values[1:], "temperature")
        except (ValueError, IndexError):
            raise MeshError(f'{source}: {where}: "{",".join(fields)[:60]}" is no material value') from None
    for number, mu in frictions.items():
        found.setdefault(number, {})["MU"] = mu
    return found


def _named(label: str) -> str:
    return "BETD" if label == "DAMP" else label  # the older name


def is_isotropic(values: Mapping[str, float]) -> bool:
    """Return whether the constants of a material that are given are those of an isotropic one."""
    modulus, ratio = values.get("EX", 0.0), values.get("PRXY", values.get("NUXY", 0.0))
    expected = dict.fromkeys(_MODULI, modulus) | dict.fromkeys(_RATIOS, ratio)
    expected |= dict.fromkeys(_SHEAR, modulus / (2 * (1 + ratio)) if ratio > -1 else 0.0)
    return all(abs(values[key] - x) <= _ALIKE * abs(x) for key, x in expected.items() if key in values)


def _tell(draft: Draft, what: str, where: str, first: float, values: Sequence[float], field: str) -> None:
    """Tell that a value that depends on something is taken as it is first."""
    if any(value != first for value in values):
        draft.find(what, where, f"depends on {field}; {first:g}, the first value, is taken")
