"""Parameters of the lumped models: units and bounds beside each field, checks, and `name=value` settings."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

FRICTION_READINGS = ("printed", "contact", "full")
# As in a scene: squares and products of numbers beyond would overflow or vanish.
_TINY, _HUGE = 1e-50, 1e50
_BOUNDS = {"positive": "a positive number", "non-negative": "zero or a positive number", "any": "a finite number"}


def parameter(default: float, unit: str, meaning: str, bound: str = "non-negative") -> Any:
    """Return a dataclass field that carries its unit, its meaning and its bound.

    Parameters
    ----------
    default : float
    unit : str
        For example `N/m`; shown in figures and messages.
    meaning : str
        What the parameter is, in a few words.
    bound : {"positive", "non-negative", "any"}

    Examples
    --------
    >>> @dataclasses.dataclass(frozen=True)
    ... class Mass:
    ...     m: float = parameter(1.0, "kg", "mass", "positive")
    >>> dataclasses.fields(Mass)[0].metadata["unit"]
    'kg'
    """
    return dataclasses.field(default=default, metadata={"unit": unit, "meaning": meaning, "bound": bound})


def reading(default: str, allowed: Sequence[str] = FRICTION_READINGS) -> Any:
    """Return a dataclass field for the reading of the friction force.

    Examples
    --------
    >>> @dataclasses.dataclass(frozen=True)
    ... class Sled:
    ...     friction: str = reading("printed")
    >>> check_parameters("sled", Sled(friction="contakt"))
    Traceback (most recent call last):
        ...
    ValueError: sled: friction = "contakt"; did you mean "contact"?
    """
    meaning = "which normal force friction follows"
    return dataclasses.field(default=default, metadata={"unit": "", "meaning": meaning, "allowed": tuple(allowed)})


def suggest(name: str, valid: Iterable[str]) -> str:
    """Return the tail of a message about an unknown name: the nearest valid one, or all of them.

    Examples
    --------
    >>> suggest("k2z", ["k2x", "ky"])
    '; did you mean "k2x"?'
    """
    names = list(valid)
    close = difflib.get_close_matches(name, names, n=1)
    return f'; did you mean "{close[0]}"?' if close else f"; valid: {', '.join(names)}"


def check_parameters(owner: str, model: Any) -> None:
    """Check every field of a model against its bound.

    Raises
    ------
    ValueError
        A number is not finite, breaks its bound, or is 1e50 or more in size, or 1e-50 or less where it has to be
        positive; or the reading of the friction force is unknown.
    """
    for f in dataclasses.fields(model):
        value = getattr(model, f.name)
        allowed = f.metadata.get("allowed")
        if allowed is not None:
            if value not in allowed:
                raise ValueError(f'{owner}: {f.name} = "{value}"{suggest(str(value), allowed)}')
            continue
        bound = f.metadata["bound"]
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < math.inf:
            raise ValueError(f"{owner}: {f.name} = {value!r}; expected {_BOUNDS[bound]} ({f.metadata['unit']})")
        _check_size(owner, f.name, value, _TINY if bound == "positive" else 0.0)  # what may be zero may be near it
        if (bound == "positive" and value <= 0) or (bound == "non-negative" and value < 0):
            text = f"{f.name} = {value:g} {f.metadata['unit']} ({f.metadata['meaning']})"
            raise ValueError(f"{owner}: {text}; expected {_BOUNDS[bound]}")


def _check_size(owner: str, name: str, value: float, least: float = _TINY) -> None:
    """Raise ValueError for a number whose squares and products would overflow or vanish."""
    if value and not least < abs(value) < _HUGE:
        raise ValueError(
            f"{owner}: {name} = {value!r}; expected a number between {_TINY:g} and {_HUGE:g} in size, or 0"
        )


def parse_settings(texts: Iterable[str]) -> dict[str, str]:
    """Split settings of the form `name=value`.

    Raises
    ------
    ValueError
        A setting has no `=`, or a name is given twice.

    Examples
    --------
    >>> parse_settings(["k2=20", "friction=contact"])
    {'k2': '20', 'friction': 'contact'}
    """
    settings: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name or not value:
            raise ValueError(f'"{text}" is no setting; expected name=value, for example k2=20')
        if name in settings:
            raise ValueError(f"{name} is set twice, to {settings[name]} and to {value}")
        settings[name] = value
    return settings


def read_settings(
    owner: str, model_class: type, settings: Mapping[str, str], mu: float
) -> tuple[dict[str, Any], float]:
    """Turn settings into the model's keyword arguments and the friction coefficient.

    Parameters
    ----------
    owner : str
        The model's name, for messages.
    model_class : dataclass
    settings : mapping of str to str
        Names of fields, and `mu`.
    mu : float
        Taken where the settings have none.

    Raises
    ------
    ValueError
        A name is unknown (the nearest one is suggested), a value is no number, or one that is neither zero nor between
        1e-50 and 1e50 in size, or `mu` is not finite.

    Examples
    --------
    >>> from lumped import Minimal
    >>> read_settings("minimal", Minimal, {"k2": "20", "mu": "0.4"}, mu=0.5)
    ({'k2': 20.0}, 0.4)
    """
    fields = {f.name: f for f in dataclasses.fields(model_class)}
    values: dict[str, Any] = {}
    for name, text in settings.items():
        if name != "mu" and name not in fields:
            raise ValueError(f'{owner}: no parameter "{name}"{suggest(name, [*fields, "mu"])}')
        if name != "mu" and "allowed" in fields[name].metadata:
            values[name] = text
            continue
        try:
            values[name] = float(text)
        except ValueError:
            unit = "" if name == "mu" else f" ({fields[name].metadata['unit']})"
            raise ValueError(f'{owner}: {name} = "{text}"; expected a number{unit}') from None
        if math.isfinite(values[name]):  # others are told with what the parameter may be
            _check_size(owner, name, values[name])
    friction = values.pop("mu", mu)
    if not math.isfinite(friction):
        raise ValueError(f"{owner}: mu = {friction}; expected a finite number (negative: the belt runs backwards)")
    return values, friction
