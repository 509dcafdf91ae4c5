"""*PARAMETER of Abaqus decks: numbers, and arithmetic with them. Nothing else is accepted, and no Python is run."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping, Sequence

from fe_squeal.errors import MeshError

_MOST_CHARACTERS = 200
_EXACT = 2**53  # whole numbers below this are floating-point numbers as well
_TWO: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: lambda a, b: a + b, ast.Sub: lambda a, b: a - b, ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: _quotient(a, b), ast.Pow: lambda a, b: _power(a, b),
}  # fmt: skip
_FUNCTIONS: dict[str, Callable[[float], float]] = {
    "sqrt": math.sqrt, "sin": math.sin, "cos": math.cos, "tan": math.tan, "abs": abs, "exp": math.exp, "log": math.log,
}  # fmt: skip


def evaluate_parameters(lines: Sequence[str], known: Mapping[str, float], where: str) -> dict[str, float]:
    """Return the known values, and those that the lines `name = expression` define, by names in lower case.

    Whole numbers stay whole, as in Python.

    Raises
    ------
    MeshError
        A line is not arithmetic with numbers and names that are defined before, or divides whole numbers whose quotient
        is none: it is rounded down by releases of Abaqus with Python 2, and not by later ones.

    Examples
    --------
    >>> evaluate_parameters(["mu = 0.3", "twice = 2 * mu  # for later"], {}, "a.inp")
    {'mu': 0.3, 'twice': 0.6}
    """
    values = dict(known)
    for line in lines:
        text = line.partition("#")[0].strip()
        if not text:
            continue
        name, equals, expression = (part.strip() for part in text.partition("="))
        try:
            if not equals or not name.isidentifier() or len(expression) > _MOST_CHARACTERS:
                raise ValueError
            value = _value(ast.parse(expression, mode="eval").body, values)
            if not math.isfinite(value):
                raise ValueError
        except _Rounded as error:
            raise MeshError(f'{where}: "{text[:60]}" divides {error}; expected a point, as in 1./2') from None
        except (ValueError, ArithmeticError, SyntaxError, RecursionError, MemoryError, KeyError):
            raise MeshError(
                f'{where}: "{text[:60]}" is no parameter that is understood; expected name = a number, or sums,'
                " products, quotients and powers of numbers and names defined before"
            ) from None
        values[name.lower()] = value
    return values


class _Rounded(Exception):
    """Whole numbers are divided, and their quotient is not whole."""


def _quotient(a: float, b: float) -> float:
    if not (isinstance(a, int) and isinstance(b, int)):
        return a / b
    if a % b:
        raise _Rounded(f"whole numbers, of which some releases of Abaqus take {a // b} and others {a / b:g}")
    return a // b


def _power(a: float, b: float) -> float:
    power = math.pow(a, b)
    return int(power) if isinstance(a, int) and isinstance(b, int) and abs(power) < _EXACT and b >= 0 else power


def _value(node: ast.expr, values: Mapping[str, float]) -> float:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return node.value
    if isinstance(node, ast.Name):
        return values[node.id.lower()]
    if isinstance(node, ast.BinOp) and type(node.op) in _TWO:
        return _TWO[type(node.op)](_value(node.left, values), _value(node.right, values))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        value = _value(node.operand, values)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and len(node.args) == 1 and not node.keywords:
        return float(_FUNCTIONS[node.func.id.lower()](_value(node.args[0], values)))
    raise ValueError
