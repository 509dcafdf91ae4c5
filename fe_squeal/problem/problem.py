"""The problem: the sum of the terms that exist, and the class that follows from them."""

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
from .terms import POWER, Slot, Term, sum_terms
from .unheld import find_free_motions

_DIFFERENCE = 1e-4  # relative step of the differences that stand for derivatives where terms are made anew


class Source(Protocol):
    """What makes the terms anew at other values."""

    def problem(self, values: Mapping[str, float]) -> Problem:
        """Return the problem with other numbers, by their paths."""

    def number(self, path: str) -> float:
        """Return a number as it stands in the scene."""

    def solved_with(self, linear_solver: LinearSolver | str) -> Source:
        """Return the same source, which finds static states with this linear solver."""


@dataclass(frozen=True)
class Problem:
    """A sum of terms with the values of their parameters.

    A parameter is known by its path in the scene, "mu" for short the friction coefficient. Those that are powers in the
    terms' coefficients are changed by recombining the terms; for others `source` makes the terms that depend on them
    anew. A name of several paths, "a, b", moves these together.

    Attributes
    ----------
    terms : tuple of Term
    parameters : mapping of name to value
        Values of those that are powers in coefficients, e.g. {"mu": 0.3}.
    discretisation : object or None
        Where the terms come from. The problem carries it along for its maker, and does not look into it.
    source : Source or None
    coupled : frozenset of str
        Parameters that the terms' matrices depend on as well, through the static state.
    changed : mapping of path to value
        What differs from the scene.
    motions : (n, r) float or None
        Motions whose span contains all that nothing holds, such as the rigid motions of each body. Where they are not
        known the kernel of K is looked for.
    free : function of the parameters' values, or None
        Returns the motions that nothing holds; of a problem that was made from another one, which is asked.
    kernel : function of a Pencil
        Looks for the kernel of K where motions are not known; see `solved_with`.
    describer : Describer or None
        Says what a mode looks like; whoever makes the terms hands it in.
    state : mapping of place to {quantity: number}
        Quantities of the static state about which the terms are linearised; a sweep keeps them beside the modes.
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
    _sums: dict[object, sp.csr_array | None] = field(default_factory=dict, repr=False, compare=False)
    _unheld: dict[object, Any] = field(default_factory=dict, repr=False, compare=False)

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
        """Whether it has velocity-proportional or structural terms: eigenvalues then come without mirror images."""
        return self.problem_class in ("quadratic", "complex")

    def value(self, parameter: str) -> float:
        """Return the present value of a parameter, the first one of several.

        Raises
        ------
        SceneError
            If there is no such parameter.
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
        """Whether there is such a parameter."""
        try:
            self.value(parameter)
        except SceneError:
            return False
        return True

    def is_affine(self, parameter: str) -> bool:
        """Whether a parameter changes the coefficients of the terms alone."""
        return all(p in self.parameters and p not in self.coupled for p in paths_of(parameter))

    def at(self, values: Mapping[str, float] | None = None, /, *more: Never, **named: float) -> Problem:
        """Return the problem at other values of parameters; terms are made anew where that is needed.

        Parameters
        ----------
        values : mapping of parameter to float
            A parameter is a path of the scene, or several, "a, b", that get the same value.
        more
            Nothing; at("mu", 0.3) raises an error that shows how to write it.
        named : float
            More of them, of parameters whose names have no dots.

        Raises
        ------
        SceneError
            If there is no such parameter, its value is no finite number, what is given is no mapping, or terms are made
            anew and the scene does not allow it there.

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
        """Refuse the value 0 of a parameter of which a term has a negative power."""
        for path, value in moved.items():
            if value == 0 and any(t.powers.get(path, 0) < 0 for t in self.terms):
                raise SceneError(f"{path}: given 0; expected another number: a term counts with a negative power of it")

    def solved_with(self, linear_solver: LinearSolver | str) -> Problem:
        """Return the same problem, for which a linear solver does what the terms themselves need solving for.

        That is a static state where terms are made anew, and the search for motions that nothing holds.
        """
        problem = self if self.source is None else replace(self, source=self.source.solved_with(linear_solver))
        if self.motions is not None or self.free is not None:
            return problem
        return replace(problem, kernel=partial(find_kernel, linear_solver=linear_solver))

    def prepared(self, parameter: str, values: np.ndarray) -> Problem:
        """Return the same problem with every term that occurs at one of the values of a parameter.

        A damper of zero has no term; swept from there on it has one, which is zero at the start.
        """
        if self.is_affine(parameter) or self.source is None:
            return self
        try:
            other = self.at({parameter: float(values[np.argmax(np.abs(values))])})
        except SquealError:  # a sweep that reaches this value says so then, and keeps what it has
            return self
        return other if other.is_affine(parameter) else self

    def pencil(self, values: Mapping[str, float] | None = None, /, *more: Never, **named: float) -> Pencil:
        """Return the matrices at given values of parameters; a term whose coefficient is zero costs nothing.

        Parameters and errors are those of `at`.

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
        M, C, K = (problem._slot(slot, moving) for slot in ("M", "C", "K"))
        zero = sp.csr_array((self.unknowns, self.unknowns))
        pencil = Pencil(zero if M is None else M, zero if K is None else K, C, symmetric)
        return replace(pencil, free=problem.free_motions(pencil))

    def free_motions(self, pencil: Pencil | None = None) -> FreeMotions:
        """Return the motions that nothing holds at the present values of the parameters, and the forces of dampers.

        Parameters
        ----------
        pencil : Pencil, optional
            The matrices at these values, where they are there already.
        """
        if self.free is not None:
            return self.free(self.parameters)
        return find_free_motions(
            self.terms, [t.coefficient(self.parameters) for t in self.terms], self.motions,
            lambda: self.pencil() if pencil is None else pencil, self.kernel, self._unheld,
        )  # fmt: skip

    @property
    def mass(self) -> sp.csr_array:
        """M (n, n) at the present values of the parameters, without the sums of the other slots."""
        M = self._slot("M", ())
        return sp.csr_array((self.unknowns, self.unknowns)) if M is None else M

    def _slot(self, slot: str, moving: Collection[str]) -> sp.csr_array | None:
        """Return the sum of one slot; that of the terms which do not depend on `moving` is kept for the next time."""
        terms = [(t, t.coefficient(self.parameters)) for t in self.terms if t.slot == slot]
        if not moving:
            return sum_terms(terms)
        fixed = tuple(sorted((p, v) for p, v in self.parameters.items() if p not in moving))
        moves = [any(p in t.powers for p in moving) for t, _ in terms]
        if (slot, fixed) not in self._sums:
            self._sums[slot, fixed] = sum_terms(part for part, m in zip(terms, moves, strict=True) if not m)
        rest = sum_terms(part for part, m in zip(terms, moves, strict=True) if m)
        constant = self._sums[slot, fixed]
        return rest if constant is None else constant if rest is None else sp.csr_array(constant + rest)

    def derivative(
        self, parameter: str, slot: Slot | None = None, values: Mapping[str, float] | None = None, /, *more: Never,
        **named: float,
    ) -> sp.csr_array | None:  # fmt: skip
        """Return ∂M, ∂C or ∂K by a parameter; None where it does not depend on it.

        Exact where the parameter is a power in coefficients, a central difference of the matrices elsewhere.

        Parameters
        ----------
        slot : "M", "C" or "K"
        values, more, named
            Where the derivative is taken, as of `at`; errors are the same.
        """
        call = f'problem.derivative("{parameter}", "K"'
        if slot not in POWER:
            raise SceneError(f'given {slot!r} as the matrix; expected "M", "C" or "K", as in {call})')
        here = self.at(self._by_path(values, more, named, f"{call}, "))
        paths = paths_of(parameter)
        if here.is_affine(parameter):
            return sum_terms((t, sum(t.slope(p, here.parameters) for p in paths)) for t in here.terms if t.slot == slot)
        p = here.value(parameter)
        step = _DIFFERENCE * (abs(p) or abs(self.value(parameter)) or 1.0)
        above, below = (here.at({parameter: p + sign * step}) for sign in (1, -1))
        parts = [(t, sign * t.coefficient(q.parameters)) for q, sign in ((above, 1), (below, -1)) for t in q.terms]
        change = sum_terms((t, c / (2 * step)) for t, c in parts if t.slot == slot)
        return change if change is not None and abs(change).max() > 0 else None
