"""A problem whose matrices a parameter changes, as a sum of terms at those of its values that were asked for."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Never

import scipy.sparse as sp

from ..eigen.linear.spread_matrix import SpreadMatrix
from ..eigen.pencil import FreeMotions
from .forms import collect_powers
from .parameters import paths_of
from .problem import Problem
from .terms import Slot, Term, sum_matrices


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
    first : Problem
        The problem itself at the first of them.
    """

    whole: Problem = field(kw_only=True, repr=False)
    swept: str = field(kw_only=True)
    known: Mapping[float, FreeMotions] = field(kw_only=True, repr=False)
    first: Problem = field(kw_only=True, repr=False)

    @classmethod
    def of(cls, problem: Problem, parameter: str, value: float) -> Tabulated:
        """Return the table of a problem that has one value.

        Raises
        ------
        SceneError, NotConvergedError
            As `Problem.at`.
        """
        first = problem.at({parameter: value})
        here = collect_powers(first, ())
        known = {value: here.free_motions()}
        return cls(
            here.terms, dict.fromkeys(paths_of(parameter), value), free=_free(known, parameter), whole=problem,
            swept=parameter, known=known, first=first,
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
        there, path = self.whole.at({self.swept: value}), paths_of(self.swept)[0]
        more = []
        for (slot, symmetric, imaginary), changes in _changes(self.first, there).items():
            A = sum_matrices((matrix, 1.0) for matrix, _ in changes)
            if A is not None and A.nnz:
                skew = all(s for _, s in changes)
                name = f"{slot}{'' if symmetric else 'n'}{'i' if imaginary else ''} at {value:g}"
                more.append(Term(name, slot, A, symmetric, {}, skew, imaginary, only={path: value}))
        known = {**self.known, value: there.free_motions()}
        return replace(self, terms=(*self.terms, *more), free=_free(known, self.swept), known=known)


def kind_of(term: Term) -> tuple[Slot, bool, bool]:
    """Return what distinguishes the terms that `collect_powers` makes of a problem at one place."""
    return term.slot, term.symmetric, term.imaginary


def _free(known: Mapping[float, FreeMotions], parameter: str) -> Callable[[Mapping[str, float]], FreeMotions]:
    path = paths_of(parameter)[0]
    return lambda values: known[values[path]]


def _changes(first: Problem, there: Problem) -> dict[tuple[Slot, bool, bool], list[tuple[sp.csr_array, bool]]]:
    """Return by how much terms of one problem differ from those of another, and whether they are skew, by their kind.

    Terms are compared one by one: most are the same matrices at all values, and in others many entries are equal.
    """
    found: dict[tuple[Slot, bool, bool], list[tuple[sp.csr_array, bool]]] = {}
    old, new = _by_name(first), _by_name(there)
    for key in dict.fromkeys([*old, *new]):
        for before, now in itertools.zip_longest(old.get(key, []), new.get(key, [])):
            change = _difference(now, before)
            if change is not None and change.nnz:
                skew = all(part[0].skew for part in (before, now) if part is not None)
                found.setdefault(key[1:], []).append((change, skew))
    return found


def _by_name(problem: Problem) -> dict[tuple[str, Slot, bool, bool], list[tuple[Term, float]]]:
    """Return the terms that act, with their coefficients, by name and kind; several may have one name."""
    found: dict[tuple[str, Slot, bool, bool], list[tuple[Term, float]]] = {}
    for term in problem.terms:
        if c := term.coefficient(problem.parameters):
            found.setdefault((term.name, *kind_of(term)), []).append((term, c))
    return found


def _difference(new: tuple[Term, float] | None, old: tuple[Term, float] | None) -> sp.csr_array | None:
    """Return new − old, where a term that is not there is zero; entries that are equal are no entries."""
    parts = [(part[0].matrix, sign * part[1]) for part, sign in ((new, 1), (old, -1)) if part is not None]
    if len(parts) == 2 and parts[0][0] is parts[1][0]:
        parts = [(parts[0][0], parts[0][1] + parts[1][1])]
    A = sum_matrices((matrix, factor) for matrix, factor in parts if factor)
    if isinstance(A, SpreadMatrix):
        return A if A.largest() else sp.csr_array(A.shape)
    if A is not None and len(parts) == 2:
        A.eliminate_zeros()
    return A
