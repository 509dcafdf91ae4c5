"""Whether anything in a problem depends on one of its parameters."""

from __future__ import annotations

from collections.abc import Iterable

from .parameters import paths_of
from .problem import Problem


def depends_on(problem: Problem, parameter: str, values: Iterable[float]) -> bool:
    """Return whether a term of a problem depends on a parameter, as far as some of its values tell.

    Parameters
    ----------
    problem : Problem
        With all terms that occur at these values, see `Problem.prepared`.
    parameter : str
    values : iterable of float
        At which terms are compared, those that a change of the parameter makes anew.

    Raises
    ------
    SceneError, NotConvergedError
        As `Problem.at`.
    """
    if any(t.powers.get(p, 0) and t.matrix.nnz for t in problem.terms for p in paths_of(parameter)):
        return True
    if problem.is_affine(parameter):
        return False
    first, *others = (problem.at({parameter: value}) for value in values)
    return not all(_alike(first, other) for other in others)


def _alike(a: Problem, b: Problem) -> bool:
    if [(t.name, t.slot) for t in a.terms] != [(t.name, t.slot) for t in b.terms]:
        return False
    return all(
        s.coefficient(a.parameters) == t.coefficient(b.parameters)
        and (s.matrix is t.matrix or not abs(s.matrix - t.matrix).max())
        for s, t in zip(a.terms, b.terms, strict=True)
    )
