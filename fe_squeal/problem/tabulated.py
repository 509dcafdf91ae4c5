"""A problem whose matrices a parameter changes, as a sum of terms at those of its values that were asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Never

import scipy.sparse as sp

from ..eigen.pencil import FreeMotions
from .forms import collect_powers
from .parameters import paths_of
from .problem import Problem
from .terms import Term


@dataclass(frozen=True)
class Tabulated(Problem):
    """The terms of a problem at one value of a parameter, and what they differ by at others.

    A static state moves contacts and stresses with the parameter, and contacts open at one point after the other: no
    few powers of the parameter give the matrices. So the terms at the first value stay, and each further place has
    terms of its own, which count there alone. They have few entries where few elements are concerned.

    Attributes
    ----------
    whole : Problem
        What it was made from.
    swept : str
        The parameter.
    known : mapping of float to FreeMotions
        The values that are there, each with the motions that nothing holds at it.
    """

    whole: Problem = field(kw_only=True, repr=False)
    swept: str = field(kw_only=True)
    known: Mapping[float, FreeMotions] = field(kw_only=True, repr=False)

    @classmethod
    def of(cls, problem: Problem, parameter: str, value: float) -> Tabulated:
        """Return the table of a problem that has one value.

        Raises
        ------
        SceneError, NotConvergedError
            As `Problem.at`.
        """
        here = collect_powers(problem.at({parameter: value}), ())
        known = {value: here.free_motions()}
        return cls(
            here.terms, dict.fromkeys(paths_of(parameter), value), free=_free(known, parameter), whole=problem,
            swept=parameter, known=known,
        )  # fmt: skip

    def at(self, values: Mapping[str, float] | None = None, /, *more: Never, **named: float) -> Problem:
        """Return the problem at another value of the parameter, which has to be known, see `Problem.at`."""
        found = super().at(values, *more, **named)
        value = found.value(self.swept)
        if value not in self.known:
            raise KeyError(f"{self.swept} = {value} is not in the table")
        return found

    def with_value(self, value: float) -> Tabulated:
        """Return the table with one value more; its terms are behind those that are there.

        Raises
        ------
        SceneError, NotConvergedError
            As `Problem.at`.
        """
        there = collect_powers(self.whole.at({self.swept: value}), ())
        path = paths_of(self.swept)[0]
        before, now = ({kind_of(t): t for t in p} for p in ([t for t in self.terms if t.only is None], there.terms))
        more = []
        for kind in dict.fromkeys([*before, *now]):
            old, new = before.get(kind), now.get(kind)
            like = new or old
            assert like is not None
            A = _difference(None if new is None else new.matrix, None if old is None else old.matrix)
            if A.nnz:
                name, skew = f"{like.name} at {value:g}", all(t.skew for t in (new, old) if t is not None)
                more.append(Term(name, like.slot, A, like.symmetric, {}, skew, like.imaginary, only={path: value}))
        known = {**self.known, value: there.free_motions()}
        return replace(self, terms=(*self.terms, *more), free=_free(known, self.swept), known=known)


def kind_of(term: Term) -> tuple[str, bool, bool]:
    """Return what distinguishes the terms that `collect_powers` makes of a problem at one place."""
    return term.slot, term.symmetric, term.imaginary


def _free(known: Mapping[float, FreeMotions], parameter: str) -> Callable[[Mapping[str, float]], FreeMotions]:
    path = paths_of(parameter)[0]
    return lambda values: known[values[path]]


def _difference(new: sp.csr_array | None, old: sp.csr_array | None) -> sp.csr_array:
    """Return new − old, where a matrix that is not there is zero; entries that are equal are no entries."""
    if new is None or old is None:
        A = -old if new is None and old is not None else new
        assert A is not None
        return sp.csr_array(A)
    A = sp.csr_array(new - old)
    A.eliminate_zeros()
    return A
