"""The problem: the sum of the terms that exist, and the class that follows from them.

This file is longer than others, since changing parameters, summing terms and keeping sums need the same private state.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Never, Protocol

import numpy as np
import scipy.sparse as sp

from ..eigen.kernel import find_kernel
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import FreeMotions, Pencil, ProblemClass
from ..errors import SceneError, SquealError, suggest
from .description import Describer
from .parameters import MU, paths_of, values_by_path
from .terms import POWER, Slot, Term, is_finite, sum_terms
from .unheld import find_free_motions, holds_everything

_DIFFERENCE = 1e-4  # of a parameter: step of the difference quotient by a parameter that changes matrices
_LEAST = 0.01  # of the scene's own number: values below do not make the step smaller, which would end in rounding


class Source(Protocol):
    """Makes the terms anew for other numbers of the scene."""

    def problem(self, values: Mapping[str, float]) -> Problem:
        """Return the problem with other numbers, by their paths."""

    def check(self, values: Mapping[str, float]) -> None:
        """Raise SceneError for numbers, by their paths, that the scene does not allow."""

    def check_effects(self, values: Mapping[str, float]) -> None:
        """Raise SceneError for numbers, by their paths, at which effects make no sense together."""

    def number(self, path: str) -> float:
        """Return a number as it stands in the scene."""

    def solved_with(self, linear_solver: LinearSolver | str) -> Source:
        """Return the same source, which finds static states with this linear solver."""


@dataclass(frozen=True)
class Problem:
    """The equation of motion (λ²M + λC + K)u = 0 as a sum of terms, with the values of its parameters.

    A parameter is a number of the scene, known by its path such as "springs.piston.stiffness"; "mu" is short for the
    friction coefficient. Several paths in one name, "a, b", are changed together. A parameter that only changes
    coefficients of terms is changed by adding the terms up anew; for any other one `source` makes the terms anew that
    depend on it. `assemble` makes a problem from a scene.

    Attributes
    ----------
    terms : tuple of Term
        Whose sum M, C and K are, (n, n) each, in kg, N s/m and N/m.
    parameters : mapping of str to float
        Values of the parameters that change coefficients of terms, e.g. {"mu": 0.3}.
    discretisation : object or None
        What the terms were made from, for those who made them; the problem does not use it.
    source : Source or None
        Makes the terms anew; None for a problem that was not made from a scene.
    coupled : frozenset of str
        Parameters that change not only coefficients but also matrices, through the static state.
    changed : mapping of str to float
        Numbers that differ from those of the scene, by path.
    motions : (n, r) float or None
        Motions whose span contains all motions that nothing holds, such as the rigid motions of each body. If they are
        None, the kernel of K is looked for.
    free : callable, or None
        Takes the values of the parameters and returns the motions that nothing holds. A problem that was made from
        another one asks that one by it.
    kernel : callable
        Takes a Pencil and returns the kernel of K; used if `motions` is None, see `solved_with`.
    describer : Describer or None
        Says what modes look like.
    state : mapping of str to {str: float}
        Quantities of the static state, such as contact forces, about which the terms are linearised.
    """

    terms: tuple[Term, ...]
    parameters: Mapping[str, float]
    discretisation: object | None = None
    source: Source | None = None
    coupled: frozenset[str] = frozenset()
    changed: Mapping[str, float] = field(default_factory=dict)
    motions: np.ndarray | None = field(default=None, repr=False, compare=False)
    free: Callable[[Mapping[str, float]], FreeMotions] | None = field(default=None, repr=False, compare=False)
    state: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    kernel: Callable[[Pencil], np.ndarray] = field(default=find_kernel, repr=False, compare=False)
    describer: Describer | None = field(default=None, repr=False, compare=False)
    _sums: dict[object, tuple[object, sp.csr_array | None]] = field(default_factory=dict, repr=False, compare=False)
    _unheld: dict[object, Any] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.terms:
            raise SceneError("problem: given no terms; expected at least those of M and K")

    def __repr__(self) -> str:
        size = f"{self.unknowns} unknowns, {len(self.terms)} terms"
        return f"Problem({self.problem_class}, {size}, {len(self.parameters)} parameters)"

    @property
    def unknowns(self) -> int:
        """Number of unknowns n."""
        return int(self.terms[0].matrix.shape[0])

    @property
    def problem_class(self) -> ProblemClass:
        """The class of the problem over all values of its parameters."""
        if any(t.imaginary for t in self.terms):
            return "complex"
        if any(t.slot == "C" for t in self.terms):
            return "quadratic"
        return "symmetric" if all(t.symmetric for t in self.terms) else "nonsymmetric"

    @property
    def is_damped(self) -> bool:
        """Whether there are terms in C or structural damping, so that −λ* is not an eigenvalue for every λ."""
        return self.problem_class in ("quadratic", "complex")

    def value(self, parameter: str) -> float:
        """Return the present value of a parameter; if the name has several paths, that of the first.

        Raises
        ------
        SceneError
            There is no such parameter.
        """
        path = paths_of(parameter)[0]
        if path in self.parameters:
            return self.parameters[path]
        if path in self.changed:
            return self.changed[path]
        if self.source is None:
            raise SceneError(f'the problem has no parameter "{path}"{suggest(path, self.parameters)}')
        return self.source.number(path)

    def has(self, parameter: str) -> bool:
        """Return whether there is such a parameter."""
        try:
            self.value(parameter)
        except SceneError:
            return False
        return True

    def is_affine(self, parameter: str) -> bool:
        """Return whether a parameter changes only coefficients of terms, and no matrix."""
        return all(p in self.parameters and p not in self.coupled for p in paths_of(parameter))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What looks doubtful of the scene, a sentence each; none of a problem of matrices."""
        return tuple(getattr(self.discretisation, "warnings", ()))

    def at(self, values: Mapping[str, float] | None = None, /, *more: Never, **named: float) -> Problem:
        """Return the problem at other values of some parameters; terms are made anew if that is needed.

        Parameters
        ----------
        values : mapping of str to float
            New values, by path; several paths in one name, "a, b", get the same value.
        more
            Not used: at("mu", 0.3) raises an error that shows how to write it.
        named : float
            New values of parameters whose names have no dots: at(mu=0.3).

        Returns
        -------
        Problem

        Raises
        ------
        SceneError
            There is no such parameter, a value is not a finite number, or what is given is not a mapping. Values for
            which terms are made anew are those that the scene allows; what only multiplies terms, such as a stiffness,
            may have any value at which effects make sense together, since sweeps and difference quotients go through
            zero.
        NotConvergedError
            The static state under preload is not found at these values.

        Examples
        --------
        >>> import numpy as np
        >>> one = sp.csr_array(np.eye(2))
        >>> terms = (Term("m", "M", one, True), Term("piston", "K", one, True, {"springs.piston.stiffness": 1}))
        >>> problem = Problem(terms, {"springs.piston.stiffness": 1e7})
        >>> problem.at({"springs.piston.stiffness": 2e7}).value("springs.piston.stiffness")
        20000000.0
        >>> problem.at({"springs.piston.stifness": 2e7})
        Traceback (most recent call last):
        fe_squeal.errors.SceneError: the problem has no parameter "springs.piston.stifness"; \
did you mean "springs.piston.stiffness"?
        """
        wanted = self._by_path(values, more, named, "problem.at(")
        moved = {p: v for p, v in wanted.items() if self.value(p) != v}
        if not moved:
            return self
        changed = {**self.changed, **moved}
        if all(self.is_affine(p) for p in moved):
            self._refuse_poles(moved)
            if self.source is not None:
                self.source.check_effects(changed)
            return replace(self, parameters={**self.parameters, **moved}, changed=changed)
        if self.source is None:
            raise SceneError(f"a problem without a scene cannot be made anew at {moved}")
        return self.source.problem(changed)

    def _by_path(
        self, values: object, more: Sequence[object], named: Mapping[str, float], call: str
    ) -> dict[str, float]:  # fmt: skip
        """Return the values that a caller gave, by the path of each parameter."""
        example = MU if MU in self.parameters else min(self.parameters, default=MU)
        return values_by_path(values, more, named, call, example)

    def _refuse_poles(self, moved: Mapping[str, float]) -> None:
        """Raise SceneError for the value 0 of a parameter that a term has a negative power of."""
        for path, value in moved.items():
            if value == 0 and any(t.powers.get(path, 0) < 0 for t in self.terms):
                raise SceneError(f"{path}: given 0; expected another number: a term counts with a negative power of it")

    def solved_with(self, linear_solver: LinearSolver | str) -> Problem:
        """Return the same problem with a linear solver for what the terms need: static states, and the kernel of K."""
        problem = self if self.source is None else replace(self, source=self.source.solved_with(linear_solver))
        if self.motions is not None or self.free is not None:
            return problem
        return replace(problem, kernel=partial(find_kernel, linear_solver=linear_solver))

    def prepared(self, parameter: str, values: np.ndarray) -> Problem:
        """Return the same problem with all terms that occur at any of the values (m,) of a parameter.

        A damper of zero, for instance, has no term. If its damping is swept from zero on it needs one, which is zero at
        the first value.
        """
        if self.is_affine(parameter) or self.source is None:
            return self
        try:
            other = self.at({parameter: float(values[np.argmax(np.abs(values))])})
        except SquealError:  # the sweep raises the same error when it reaches this value, and keeps what it has by then
            return self
        return other if other.is_affine(parameter) else self

    def pencil(self, values: Mapping[str, float] | None = None, /, *more: Never, **named: float) -> Pencil:
        """Return the matrices M, C and K at given values of parameters; a term whose coefficient is zero costs nothing.

        Parameters and errors raised are those of `at`; an entry that is no finite number raises SceneError, too.

        Examples
        --------
        >>> import numpy as np
        >>> one = sp.csr_array(np.eye(2))
        >>> skew = sp.csr_array(np.array([[0.0, 1.0], [0.0, 0.0]]))
        >>> terms = (Term("m", "M", one, True), Term("k", "K", one, True), Term("f", "K", skew, False, {"mu": 1}))
        >>> problem = Problem(terms, {"mu": 0.3})
        >>> problem.pencil().problem_class, problem.pencil({"mu": 0.0}).problem_class
        ('nonsymmetric', 'symmetric')
        """
        moving = self._by_path(values, more, named, "problem.pencil(")
        problem = self.at(moving)
        symmetric = all(t.symmetric for t in problem.terms if t.slot == "K" and t.coefficient(problem.parameters))
        with np.errstate(over="ignore", invalid="ignore"):
            sums: dict[Slot, sp.csr_array | None] = {slot: problem._slot(slot, moving) for slot in POWER}
            beyond = [slot for slot, A in sums.items() if A is not None and not is_finite(A)]
        if beyond:
            raise SceneError(
                f"{' and '.join(beyond)}: entries times powers of parameters are beyond the largest number, 1.8e308;"
                " expected other units"
            )
        M, C, K = sums["M"], sums["C"], sums["K"]
        M, K = (sp.csr_array((self.unknowns, self.unknowns)) if A is None else A for A in (M, K))
        pencil = Pencil(M, K, C, symmetric)
        return replace(pencil, free=problem.free_motions(pencil))

    def free_motions(self, pencil: Pencil | None = None) -> FreeMotions:
        """Return the motions that nothing holds at the present values of the parameters, and their damper forces.

        Parameters
        ----------
        pencil : Pencil, optional
            The matrices at these values, if they are known already.
        """
        if self.free is not None:
            return self.free(self.parameters)
        return find_free_motions(
            self.terms, [t.coefficient(self.parameters) for t in self.terms], self.motions,
            lambda: self.pencil() if pencil is None else pencil, self.kernel, self._unheld,
        )  # fmt: skip

    def is_held(self, moving: Collection[str] = ()) -> bool:
        """Return whether no motion is free whatever the values of some parameters; False where that is not known.

        Parameters
        ----------
        moving : collection of str
            Terms that depend on these parameters may act or not.
        """
        acts = [0.0 if t.depends_on(moving) else t.coefficient(self.parameters) for t in self.terms]
        return self.free is None and holds_everything(self.terms, acts, self.motions, self._unheld)

    @property
    def mass(self) -> sp.csr_array:
        """M (n, n) sparse, kg, at the present values of the parameters; C and K are not summed for it."""
        M = self._slot("M", ())
        return sp.csr_array((self.unknowns, self.unknowns)) if M is None else M

    def _slot(self, slot: str, moving: Collection[str]) -> sp.csr_array | None:
        """Return the sum of the terms of one slot, or None.

        The sum of those terms that do not depend on the parameters `moving` is kept for the next call; of one set of
        such parameters the last one alone, since each is a whole matrix.
        """
        terms = [(t, t.coefficient(self.parameters)) for t in self.terms if t.slot == slot]
        if not moving:
            return sum_terms(terms)
        fixed = tuple(sorted((p, v) for p, v in self.parameters.items() if p not in moving))
        moves = [t.depends_on(moving) for t, _ in terms]
        key = slot, frozenset(moving)
        known = self._sums.get(key)
        if known is None or known[0] != fixed:
            known = None
            self._sums.pop(key, None)  # before the next one takes memory
            known = fixed, sum_terms(part for part, m in zip(terms, moves, strict=True) if not m)
            self._sums[key] = known
        rest = sum_terms(part for part, m in zip(terms, moves, strict=True) if m)
        constant = known[1]
        return rest if constant is None else constant if rest is None else constant + rest

    def derivative(
        self, parameter: str, slot: Slot | None = None, values: Mapping[str, float] | None = None, /, *more: Never,
        **named: float,
    ) -> sp.csr_array | None:  # fmt: skip
        """Return ∂M, ∂C or ∂K (n, n) by a parameter; None if the matrix does not depend on it.

        It is exact if the parameter only changes coefficients; otherwise it is a central difference of the matrices, or
        one to one side at the end of what is allowed.

        Parameters
        ----------
        parameter : str
        slot : "M", "C" or "K"
        values, more, named
            Values of parameters at which the derivative is taken, as for `at`.

        Raises
        ------
        SceneError
            `slot` is not one of these, or as `at`.
        """
        call = f'problem.derivative("{parameter}", "K"'
        if slot not in POWER:
            raise SceneError(f'given {slot!r} as the matrix; expected "M", "C" or "K", as in {call})')
        here = self.at(self._by_path(values, more, named, f"{call}, "))
        paths = paths_of(parameter)
        if here.is_affine(parameter):
            return sum_terms((t, sum(t.slope(p, here.parameters) for p in paths)) for t in here.terms if t.slot == slot)
        p = here.value(parameter)
        own = max(abs(self.value(parameter)), 0.0 if self.source is None else abs(self.source.number(paths[0])))
        step = _DIFFERENCE * (max(abs(p), _LEAST * own) or 1.0)
        (below, low), (above, high) = (self._beside(here, parameter, p + way * step) for way in (-1, 1))
        if low == high:
            raise SceneError(f"{parameter}: given {p:g}, the only value around it that is allowed")
        parts = [(t, sign * t.coefficient(q.parameters)) for q, sign in ((above, 1), (below, -1)) for t in q.terms]
        change = sum_terms((t, c / (high - low)) for t, c in parts if t.slot == slot)
        return change if change is not None and abs(change).max() > 0 else None

    @staticmethod
    def _beside(here: Problem, parameter: str, value: float) -> tuple[Problem, float]:
        """Return the problem at a value of a parameter, with the value; where that is not allowed, as it is here."""
        try:
            return here.at({parameter: value}), value
        except SceneError:
            return here, here.value(parameter)
