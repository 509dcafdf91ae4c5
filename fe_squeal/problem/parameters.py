"""Names of parameters: the path of a number of the scene, "mu" for short the friction coefficient."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Real

from ..errors import SceneError, suggest

MU = "mu"
_LONG = "effects.friction.mu"
Place = float | tuple[float, ...]  # the value of one parameter, or the values of several
_SHOWN = 80  # characters of a wrong value that a message shows


def paths_of(parameter: str) -> list[str]:
    """Return the paths in the scene that one parameter changes together, each by the one name that it is known by.

    That is "mu" for effects.friction.mu, "NAME" for parameters.NAME of a scene of matrices, and else the path itself.

    Raises
    ------
    SceneError
        The name is not a text, or has one path twice.

    Examples
    --------
    >>> paths_of("effects.friction.mu, springs.right.damping")
    ['mu', 'springs.right.damping']
    """
    if not isinstance(parameter, str):
        raise SceneError(f'given {_short(parameter)} as the name of a parameter; expected a text, as "{MU}"')
    paths = [_known(path.strip()) for path in parameter.split(",")]
    if twice := [path for i, path in enumerate(paths) if path in paths[:i]]:
        raise SceneError(f'given "{twice[0]}" twice; expected every path once')
    return paths


def parameter_name(parameter: str) -> str:
    """Return the one name that a parameter is known by; raises what `paths_of` does.

    Examples
    --------
    >>> parameter_name("effects.friction.mu,springs.right.damping")
    'mu, springs.right.damping'
    """
    return ", ".join(paths_of(parameter))


def _known(path: str) -> str:
    return MU if path == _LONG else path.removeprefix("parameters.")


def values_at(parameter: str | tuple[str, ...], place: Place) -> dict[str, float]:
    """Return the values of one parameter, or of several, at a place.

    Examples
    --------
    >>> values_at("mu", 0.3)
    {'mu': 0.3}
    >>> values_at(("mu", "springs.left.damping"), (0.3, 2.0))
    {'mu': 0.3, 'springs.left.damping': 2.0}
    """
    if isinstance(parameter, str):
        assert not isinstance(place, tuple)
        return {parameter: place}
    assert isinstance(place, tuple)
    return dict(zip(parameter, place, strict=True))


def product_of_powers(powers: Mapping[str, int], values: Mapping[str, float]) -> float:
    """Return Π value**exponent over parameters with their exponents.

    Raises
    ------
    SceneError
        A parameter has no value, or the product is no finite number.

    Examples
    --------
    >>> product_of_powers({"mu": 1, "omega": -2}, {"mu": 0.5, "omega": 10.0})
    0.005
    >>> product_of_powers({"omega": 20}, {"omega": 1e17})
    Traceback (most recent call last):
    fe_squeal.errors.SceneError: omega^20 at omega = 1e+17 is no finite number; expected one up to 1.8e308
    """
    try:
        product = math.prod((float(values[name]) ** e for name, e in powers.items()), start=1.0)
    except KeyError as error:
        name = error.args[0]
        raise SceneError(f'a power of "{name}", which has no value{suggest(name, values)}') from None
    except ArithmeticError:  # a power of floats that overflows, or a negative one of 0
        product = math.inf
    if not math.isfinite(product):
        shown = " · ".join(f"{name}^{e}" for name, e in powers.items())
        at = ", ".join(f"{name} = {values[name]:g}" for name in powers)
        raise SceneError(f"{shown} at {at} is no finite number; expected one up to 1.8e308")
    return product


def values_by_path(
    given: object, more: Sequence[object] = (), named: Mapping[str, object] | None = None,
    call: str = "problem.at(", example: str = MU,
) -> dict[str, float]:  # fmt: skip
    """Return what a caller gave as a mapping of parameters to numbers, for each path on its own.

    Parameters
    ----------
    given : object
        Expected to be a mapping of parameters to numbers, or None; a parameter may be several paths, "a, b".
    more : sequence of object
        What stands behind it in the call; expected to be nothing.
    named : mapping of str to object, optional
        Parameters that were given as keywords.
    call, example : str
        How messages show the call to begin, and a parameter that they give there.

    Raises
    ------
    SceneError
        If it is no such mapping, or has two values for one path. The message shows how to write it.

    Examples
    --------
    >>> values_by_path({"springs.left.damping, springs.right.damping": 2})
    {'springs.left.damping': 2.0, 'springs.right.damping': 2.0}
    >>> values_by_path("springs.left.damping", [2])
    Traceback (most recent call last):
    fe_squeal.errors.SceneError: given 'springs.left.damping', 2; expected parameters with their values, \
as in problem.at({"springs.left.damping": 2})
    """
    name, number = example, "0.3"
    if isinstance(given, str) and len(more) == 1 and _is_number(more[0]):
        name, number = given, str(more[0])  # what was meant
    shown = f'as in {call}{{"{name}": {number}}})'
    if more or not (given is None or isinstance(given, Mapping)):
        said = ", ".join(_short(value) for value in (given, *more))
        raise SceneError(f"given {said}; expected parameters with their values, {shown}")
    found: dict[str, float] = {}
    for name, value in (*(given or {}).items(), *(named or {}).items()):
        if not isinstance(name, str):
            raise SceneError(f"given {_short(name)} as the name of a parameter; expected a text, {shown}")
        if not _is_number(value):
            raise SceneError(f"{name}: given {_short(value)}; expected a finite number, {shown}")
        rounded = float(value)  # as which fractions and long integers are rounded
        for path in paths_of(name):
            if found.setdefault(path, rounded) != rounded:
                raise SceneError(f"{path}: given {found[path]:g} and {rounded:g}; expected one value")
    return found


def _is_number(value: object) -> bool:
    try:
        return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:  # an integer or a fraction beyond all that are floats
        return False


def _short(value: object) -> str:
    """Return a value as Python shows it, on one line and cut."""
    text = " ".join(repr(value).split())
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
