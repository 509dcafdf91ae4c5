"""A problem whose matrices a parameter changes, as a quadratic polynomial through three values of the parameter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial.polynomial import polyfromroots

from ..eigen.kernel import null_columns
from ..eigen.linear.spread_matrix import in_rows
from ..eigen.pencil import FreeMotions
from .parameters import paths_of
from .problem import Problem
from .tabulated import Tabulated, kind_of
from .terms import Term, sum_matrices
from .unheld import ROUNDING_OF_FORCES


def interpolate(problem: Problem, parameter: str, low: float, high: float) -> Problem:
    """Return a problem whose matrices are quadratic in a parameter and agree at both ends and the middle.

    Itself where the parameter changes coefficients alone. It knows no other parameter.
    """
    return problem if problem.is_affine(parameter) else interpolate_beside(problem, parameter, low, high, 0.0)


def interpolate_beside(problem: Problem, parameter: str, low: float, high: float, origin: float) -> Problem:
    """Return a problem as `interpolate` does, over the distance of the parameter from an origin instead of itself.

    In an interval that is short beside the values themselves, powers of these would cancel each other.

    With A the matrix at `low` and D_1, D_2 what the matrices in the middle and at `high` differ by, the polynomial is
    A + ℓ_1(p) D_1 + ℓ_2(p) D_2, where ℓ_i are Lagrange's. The differences have few entries where the parameter changes
    few elements and contact points.
    """
    at = np.array([low, (low + high) / 2, high])
    table = Tabulated.of(problem, parameter, low)
    path = paths_of(parameter)[0]
    terms, differences = list(table.terms), dict[object, list[tuple[np.ndarray, Term]]]()
    for i in (1, 2):
        before = len(table.terms)
        table = table.with_value(float(at[i]))
        polynomial = _lagrange(at - origin, i)
        for t in table.terms[before:]:
            differences.setdefault(kind_of(t), []).append((polynomial, t))
    for parts in differences.values():
        like, skew = parts[0][1], all(t.skew for _, t in parts)
        for power in range(3):
            A = sum_matrices((t.matrix, polynomial[power]) for polynomial, t in parts if polynomial[power])
            if A is not None:
                name = f"{like.slot}{power} of the difference"
                powers = {path: power} if power else {}
                terms.append(replace(like, name=name, matrix=in_rows(A), skew=skew, powers=powers, only=None))
    always = _common(list(table.known.values()))
    return Problem(tuple(terms), dict.fromkeys(paths_of(parameter), low - origin), free=lambda _: always)


def _lagrange(nodes: np.ndarray, i: int) -> np.ndarray:
    """Return the coefficients (m,) of the polynomial that is 1 at node i and 0 at the others, from power 0 on.

    Examples
    --------
    >>> _lagrange(np.array([0.0, 1.0, 2.0]), 2)
    array([ 0. , -0.5,  0.5])
    """
    others = np.delete(nodes, i)
    return np.asarray(polyfromroots(others) / np.prod(nodes[i] - others))


def _common(found: list[FreeMotions]) -> FreeMotions:
    """Return the motions that are free in all of several cases."""
    Z = found[0].motions
    for other in found[1:]:
        Q = np.linalg.qr(other.motions)[0]
        Z = Z @ null_columns(Z - Q @ (Q.T @ Z), ROUNDING_OF_FORCES * float(np.linalg.norm(Z)))
    return FreeMotions(Z)
