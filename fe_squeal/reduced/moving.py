"""The projection of a problem whose matrices a parameter changes, made anew at every value."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from ..eigen.columns import Columns
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import FreeMotions
from ..problem.forms import project
from ..problem.problem import Problem

_KEPT = 4  # projected problems that are kept: at a value, beside it for differences, and one more
_Values = tuple[tuple[str, float], ...]


class MovingSource:
    """Makes a small problem anew for every value of a parameter of a large one.

    Parameters
    ----------
    whole : Problem
        The large problem, with a source of its own.
    make : callable
        Returns the small problem for numbers of the scene by their paths.
    """

    def __init__(self, whole: Problem, make: Callable[[Mapping[str, float]], Problem]) -> None:
        self._whole, self._make = whole, make
        self._made: dict[_Values, Problem] = {}

    def problem(self, values: Mapping[str, float]) -> Problem:
        """Return the small problem with other numbers, by their paths; errors raised are those of `Problem.at`."""
        key = tuple(sorted(values.items()))
        if key not in self._made:
            for old in list(self._made)[: 1 - _KEPT]:
                del self._made[old]
            made = self._make(values)
            coupled = self._whole.coupled | made.coupled
            self._made[key] = replace(made, source=self, coupled=coupled, changed=values)
        return self._made[key]

    def check(self, values: Mapping[str, float]) -> None:
        """Raise SceneError for numbers, by their paths, that the scene of the large problem does not allow."""
        if self._whole.source is not None:
            self._whole.source.check(values)

    def check_effects(self, values: Mapping[str, float]) -> None:
        """Raise SceneError for numbers, by their paths, at which effects make no sense together."""
        if self._whole.source is not None:
            self._whole.source.check_effects(values)

    def number(self, path: str) -> float:
        """Return a number as it stands in the scene; errors raised are those of `Problem.value`."""
        return self._whole.value(path)

    def solved_with(self, linear_solver: LinearSolver | str) -> MovingSource:
        """Return the same source: static states are found with the solver of the large problem."""
        return self


class ProjectedTerms:
    """Every term of a problem on a basis; of those that are made anew for a value, most stay what they are.

    Parameters
    ----------
    whole : Problem
    V : (n, r) float
        The basis.
    coordinates : callable
        Returns those motions that nothing holds and the basis has, in its coordinates.
    """

    def __init__(self, whole: Problem, V: Columns, coordinates: Callable[[FreeMotions], FreeMotions]) -> None:
        self._whole, self._V, self._coordinates = whole, V, coordinates
        self._known: dict[tuple[str, int], tuple[sp.csr_array, sp.csr_array]] = {}  # a matrix, and its projection

    def problem(self) -> Problem:
        """Return the projected problem, which makes its terms anew at other values."""
        here = MovingSource(self._whole, lambda values: self._at(self._whole.at(values)))
        return here.problem(self._whole.changed)

    def _at(self, whole: Problem) -> Problem:
        terms = []
        for i, t in enumerate(whole.terms):
            known = self._known.get((t.name, i))
            if known is None or not _is_same(known[0], t.matrix):
                known = t.matrix, project(replace(whole, terms=(t,)), self._V).terms[0].matrix
                self._known[t.name, i] = known
            terms.append(replace(t, matrix=known[1]))
        free = whole.free_motions()
        return Problem(tuple(terms), whole.parameters, free=lambda _: self._coordinates(free))


def _is_same(A: sp.csr_array, B: sp.csr_array) -> bool:
    """Return whether two matrices have the same entries in the same places."""
    if A is B:
        return True
    return A.nnz == B.nnz and all(
        np.array_equal(a, b) for a, b in ((A.indptr, B.indptr), (A.indices, B.indices), (A.data, B.data))
    )
