"""Corners of a box of parameters where modes are softest, or forces that bring them down are largest."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from ..problem.parameters import paths_of
from ..problem.problem import Problem
from .growing import spread

_CORNERS = 16  # places that are returned, at most, beside the softest corner: the ends of four parameters
_COMPARED = 3  # values whose matrices are compared; a reduced model needs those of both ends and the middle anyway
_HARDLY = 0.1  # of the stiffness of an unknown elsewhere: what it is stiffer by and counts as equally stiff
_SOFT = 1e-6  # of the stiffness of an unknown at other values: what is less, or negative, counts as this


def softest_corner(
    problem: Problem, parameters: Sequence[str], low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray
) -> tuple[float, ...]:
    """Return the corner of a box with the least stiffness and the most mass; the middle for other parameters.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> from fe_squeal.problem.terms import Term
    >>> one, skew = sp.csr_array(np.eye(2)), sp.csr_array(np.array([[0.0, 1.0], [0.0, 0.0]]))
    >>> terms = (Term("m", "M", one, True, {"density": 1}), Term("k", "K", one, True, {"modulus": 1}))
    >>> terms += (Term("friction", "K", skew, False, {"mu": 1}),)
    >>> problem = Problem(terms, {"density": 1.0, "modulus": 1.0, "mu": 0.3})
    >>> softest_corner(problem, ("density", "modulus", "mu"), (0.9, 0.8, 0.0), (1.1, 1.2, 0.6))
    (1.1, 0.8, 0.3)
    """
    corner = []
    for k, (least, most) in enumerate(zip(low, high, strict=True)):
        wanted = _softening(problem, parameters, low, high, k)
        corner.append(float(least if wanted == {1} else most if wanted == {-1} else (least + most) / 2))
    return tuple(corner)


def softest_value(problem: Problem, parameter: str, values: np.ndarray) -> float:
    """Return the one of some values (m,), ascending, with the least stiffness and the most mass, as far as is known.

    Errors of a reduced model are measured by the stiffness that it begins with. A motion that is softer elsewhere has
    larger ones than that. What is nearest to zero counts where values have both signs, and where none is softest for
    all motions. Where the parameter changes more than coefficients of terms, a few values are compared.

    Raises
    ------
    SceneError, NotConvergedError
        As `Problem.at`.
    """
    low, high = float(values[0]), float(values[-1])
    nearest = float(values[np.argmin(np.abs(values))])
    if not problem.is_affine(parameter):
        few = sorted({nearest, *spread(values, _COMPARED)})
        return nearest if problem.source is None else _least_stiff(problem, parameter, nearest, few)
    if low * high <= 0:
        return nearest
    corner = set(softest_corner(problem, [parameter], [low], [high]))
    return corner.pop() if corner in ({low}, {high}) else nearest


def _least_stiff(problem: Problem, parameter: str, nearest: float, few: Sequence[float]) -> float:
    """Return the one of a few values at which no unknown is much stiffer than at others of them.

    As contact points open, the stiffness of their unknowns falls, of some perhaps at one value and of others at
    another. Motions of whole parts that soften with them are among the lowest modes, which the basis has; what it lacks
    moves single points. It is `nearest` where that is hardly stiffer, as by stresses alone.
    """
    stiffness = np.array([_diagonal(problem.at({parameter: value})) for value in few])
    least, size = stiffness.min(axis=0), np.abs(stiffness).max(axis=0)
    above = (stiffness - least) / np.maximum(least, np.maximum(_SOFT * size, np.finfo(float).tiny))
    stiffer = dict(zip(few, above.max(axis=1).tolist(), strict=True))
    best = min(few, key=lambda value: stiffer[value])
    return nearest if stiffer[nearest] <= stiffer[best] + _HARDLY else best


def _diagonal(problem: Problem) -> np.ndarray:
    """Return the diagonal (n,) of the symmetric terms of K, without losses."""
    terms = [t for t in problem.terms if t.slot == "K" and t.symmetric and not t.imaginary]
    parts = (t.coefficient(problem.parameters) * t.matrix.diagonal() for t in terms)
    return sum(parts, start=np.zeros(problem.unknowns))


def has_softest_corner(
    problem: Problem, parameters: Sequence[str], low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray
) -> bool:
    """Return whether a corner of a box, low and high (d,), is softest: there no motion has more stiffness or less mass.

    There is none where the same parameter stiffens some motions and softens others, or one of them here and there.
    """
    return all(len(_softening(problem, parameters, low, high, k)) < 2 for k in range(len(parameters)))


def _softening(
    problem: Problem, parameters: Sequence[str], low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray,
    k: int,
) -> set[int]:  # fmt: skip
    """Return what raising the k-th parameter does to uᵀKu, or to −uᵀMu, of some motion u: 1 raises it, −1 lowers it."""
    found: set[int] = set()
    terms = [t for t in problem.terms if t.symmetric and not t.imaginary and t.slot in "MK"]
    for t in terms:
        slopes = set()
        for others, own in product((low, high), (low[k], high[k])):
            place = dict(zip(parameters, others, strict=True)) | {parameters[k]: own}
            at = {**problem.parameters, **{q: float(v) for p, v in place.items() for q in paths_of(p)}}
            slopes |= {int(np.sign(t.slope(q, at))) for q in paths_of(parameters[k]) if t.powers.get(q)}
        for slope in slopes - {0}:
            found |= {slope * sign * (1 if t.slot == "K" else -1) for sign in t.signs}
    return found


def are_all_corners(
    problem: Problem, parameters: Sequence[str], low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray
) -> bool:  # fmt: skip
    """Return whether `corners` has all combinations of both ends, low and high (d,), of the parameters that count."""
    start = softest_corner(problem, parameters, low, high)
    return 2 ** len(_open_ends(problem, parameters, low, high, start)) <= _CORNERS


def _open_ends(
    problem: Problem, parameters: Sequence[str], low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray,
    start: tuple[float, ...],
) -> list[int]:  # fmt: skip
    """Return the parameters, by position, on which such forces depend or that have no end where all is softest."""
    pushing = {q for t in problem.terms if not t.symmetric for q in t.powers}
    return [
        k for k, p in enumerate(parameters)
        if low[k] != high[k] and (start[k] not in (low[k], high[k]) or pushing.intersection(paths_of(p)))
    ]  # fmt: skip


def corners(
    problem: Problem, parameters: Sequence[str], low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray
) -> set[tuple[float, ...]]:  # fmt: skip
    """Return places of a box where modes may be softest, or brought down most by friction or gyroscopic forces.

    These are its softest corner and those at both ends of all parameters on which such forces depend, or that are not
    at an end in the softest corner: all of them, or of more than `_CORNERS` those where all are low, or all high.

    Parameters
    ----------
    problem : Problem
        Affine in every parameter.
    parameters : sequence of str
    low, high : (d,) float

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> from fe_squeal.problem.terms import Term
    >>> one, skew = sp.csr_array(np.eye(2)), sp.csr_array(np.array([[0.0, 1.0], [0.0, 0.0]]))
    >>> terms = (Term("k", "K", one, True, {"modulus": 1}), Term("friction", "K", skew, False, {"mu": 1}))
    >>> sorted(corners(Problem(terms, {"modulus": 1.0, "mu": 0.3}), ("modulus", "mu"), (0.8, 0.0), (1.2, 0.6)))
    [(0.8, 0.0), (0.8, 0.3), (0.8, 0.6)]
    """
    start = softest_corner(problem, parameters, low, high)
    both = _open_ends(problem, parameters, low, high, start)
    ends = [[float(low[k]) for k in both], [float(high[k]) for k in both]]
    chosen = product(*zip(*ends, strict=True)) if 2 ** len(both) <= _CORNERS else ends
    places = {start}
    for end in chosen:
        corner = list(start)
        for k, value in zip(both, end, strict=True):
            corner[k] = value
        places.add(tuple(corner))
    return places
