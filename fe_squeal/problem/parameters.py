"""Names of parameters: the path of a number of the scene, "mu" for short the friction coefficient."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real

from ..errors import SceneError

MU = "mu"
_LONG = "effects.friction.mu"


def canonical(path: str) -> str:
    """Return the name under which a path is known: "mu" for effects.friction.mu, else itself."""
    return MU if path == _LONG else path.removeprefix("parameters.")


def paths_of(parameter: str) -> list[str]:
    """Return the paths that one sweep parameter moves together.

    Examples
    --------
    >>> paths_of("springs.left.damping, springs.right.damping")
    ['springs.left.damping', 'springs.right.damping']
    """
    return [p.strip() for p in parameter.split(",")]


def values_by_path(given: object, example: str = MU) -> dict[str, float]:
    """Return what a caller gave as a mapping of parameters to numbers, for each path on its own.

    Parameters
    ----------
    given : object
        Expected to be a mapping of parameters to numbers; a parameter may be several paths, "a, b".
    example : str
        A parameter that messages show how to give.

    Raises
    ------
    SceneError
        If it is no such mapping.

    Examples
    --------
    >>> values_by_path({"springs.left.damping, springs.right.damping": 2})
    {'springs.left.damping': 2.0, 'springs.right.damping': 2.0}
    >>> values_by_path(0.3)
    Traceback (most recent call last):
    fe_squeal.errors.SceneError: given 0.3; expected parameters with their values, as in problem.at({"mu": 0.3})
    """
    shown = f'as in problem.at({{"{example}": 0.3}})'
    if not isinstance(given, Mapping):
        raise SceneError(f"given {given!r}; expected parameters with their values, {shown}")
    found: dict[str, float] = {}
    for name, value in given.items():
        if not isinstance(name, str):
            raise SceneError(f"given {name!r} as the name of a parameter; expected a text, {shown}")
        if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
            raise SceneError(f"{name}: given {value!r}; expected a finite number, {shown}")
        found |= dict.fromkeys(paths_of(name), float(value))
    return found
