"""The problem: the sum of the terms that exist, and the class that follows from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import cross, times
from ..eigen.kernel import find_kernel, kernel_within, null_columns, unforced
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import FreeMotions, Pencil, ProblemClass
from ..errors import SceneError, SquealError, suggest
from .parameters import paths_of
from .terms import Slot, Term

# Of the forces that cancel when a body moves as a whole: what rounding of its coordinates leaves, also far from the
# origin; each term counts for itself, so that a soft spring is not taken for the rounding of a stiff body.
_FREE = 1e-9
_DIFFERENCE = 1e-4  # relative step of the differences that stand for derivatives where terms are made anew


class Source(Protocol):
    """What makes the terms anew at other values."""

    def problem(self, values: Mapping[str, float]) -> Problem:
        """Return the problem with other numbers, by their paths."""

    def number(self, path: str) -> float:
        """Return a number as it stands in the scene."""


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
        Where the terms come from, for whoever made them: a problem carries it along and does not look into it.
    source : Source or None
    coupled : frozenset of str
        Parameters that the terms' matrices depend on as well, through the static state.
    changed : mapping of path to value
        What differs from the scene.
    motions : (n, r) float or None
        The motions among which those are that nothing holds, such as the rigid motions of each body. Where they are not
        known the kernel of K is looked for.
    free : function of the parameters' values, or None
        Returns the motions that nothing holds, of a problem made from another one, which knows.
    kernel : function of a Pencil
        Looks for the kernel of K where motions are not known; see `searched_by`.
    state : mapping of place to {quantity: number}
        What the state is like about which the terms are linearised; a sweep keeps it beside the modes.
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

    def at(self, **values: float) -> Problem:
        """Return the problem at other values of parameters; terms are made anew where that is needed.

        Raises
        ------
        SceneError
            If there is no such parameter, or the scene does not allow its value.
        """
        wanted = {path: value for name, value in values.items() for path in paths_of(name)}
        moved = {p: v for p, v in wanted.items() if self.value(p) != v}
        if not moved:
            return self
        changed = {**self.changed, **moved}
        if all(self.is_affine(p) for p in moved):
            return replace(self, parameters={**self.parameters, **moved}, changed=changed)
        if self.source is None:
            raise SceneError(f"a problem without a scene cannot be made anew at {moved}")
        return self.source.problem(changed)

    def searched_by(self, linear_solver: LinearSolver | str) -> Problem:
        """Return the same problem; where motions that nothing holds are looked for, it is with this linear solver."""
        if self.motions is not None or self.free is not None:
            return self
        return replace(self, kernel=partial(find_kernel, linear_solver=linear_solver))

    def prepared(self, parameter: str, values: np.ndarray) -> Problem:
        """Return the same problem with every term that occurs at one of the values of a parameter.

        A damper of zero has no term; swept from there on it has one, which is zero at the start.
        """
        if self.is_affine(parameter) or self.source is None:
            return self
        try:
            other = self.at(**{parameter: float(values[np.argmax(np.abs(values))])})
        except SquealError:  # a sweep that reaches this value says so then, and keeps what it has
            return self
        return other if other.is_affine(parameter) else self

    def pencil(self, **values: float) -> Pencil:
        """Return the matrices at given values of parameters; a term whose coefficient is zero costs nothing.

        Examples
        --------
        >>> import numpy as np
        >>> one = sp.csr_array(np.eye(2))
        >>> skew = sp.csr_array(np.array([[0.0, 1.0], [0.0, 0.0]]))
        >>> terms = (Term("m", "M", one, True), Term("k", "K", one, True), Term("f", "K", skew, False, {"mu": 1}))
        >>> problem = Problem(terms, {"mu": 0.3})
        >>> problem.pencil().problem_class, problem.pencil(mu=0.0).problem_class
        ('nonsymmetric', 'symmetric')
        """
        moving = {path for name in values for path in paths_of(name)}
        problem = self.at(**values)
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
        acting = [(i, c) for i, t in enumerate(self.terms) if (c := t.coefficient(self.parameters))]
        stiff = tuple(i for i, _ in acting if self.terms[i].slot == "K")
        if stiff not in self._unheld:
            self._unheld[stiff] = self._find_unheld(stiff, pencil)
        Z = self._unheld[stiff]
        if self.motions is None and Z.shape[1]:  # an eigenvalue may have been zero by chance where Z was found
            Z = kernel_within(self.pencil() if pencil is None else pencil, Z)
        dampers = [(i, c) for i, c in acting if self.terms[i].slot == "C"]
        if not dampers or not Z.shape[1]:
            return FreeMotions(Z, np.zeros_like(Z) if dampers else None)
        return FreeMotions(Z, np.asarray(sum(c * self._damping(i, Z) for i, c in dampers)))

    def _damping(self, i: int, Z: np.ndarray) -> np.ndarray:
        """Return the forces (n, k) of a term along some motions, zero where they are rounding."""
        known = self._unheld.get(("damping", i))
        if known is None or known[0] is not Z:
            A = self.terms[i].matrix
            N = unforced(A, Z, _FREE)
            self._unheld["damping", i] = known = Z, A @ (Z - Z @ N @ N.T)
        return known[1]

    def _find_unheld(self, stiff: tuple[int, ...], pencil: Pencil | None) -> np.ndarray:
        """Return the motions that some of the terms leave free."""
        if self.motions is None:
            return self.kernel(self.pencil() if pencil is None else pencil)
        Z = self.motions
        for i in sorted(stiff, key=lambda i: self.terms[i].matrix.nnz):  # small springs and contacts hold most of them
            Z = Z @ unforced(self.terms[i].matrix, Z, _FREE)
        return Z

    @property
    def mass(self) -> sp.csr_array:
        """M (n, n) at the present values of the parameters, without the sums of the other slots."""
        M = self._slot("M", set())
        return sp.csr_array((self.unknowns, self.unknowns)) if M is None else M

    def _slot(self, slot: str, moving: set[str]) -> sp.csr_array | None:
        """Return the sum of one slot; that of the terms which do not depend on `moving` is kept for the next time."""
        terms = [t for t in self.terms if t.slot == slot]
        if not moving:
            return _sum([(t, t.coefficient(self.parameters)) for t in terms])
        fixed = tuple(sorted((p, v) for p, v in self.parameters.items() if p not in moving))
        if (slot, fixed) not in self._sums:
            still = [t for t in terms if not moving & set(t.powers)]
            self._sums[slot, fixed] = _sum([(t, t.coefficient(self.parameters)) for t in still])
        rest = _sum([(t, t.coefficient(self.parameters)) for t in terms if moving & set(t.powers)])
        constant = self._sums[slot, fixed]
        return rest if constant is None else constant if rest is None else sp.csr_array(constant + rest)

    def collected(self, parameter: str) -> Problem:
        """Return the same problem over one parameter as few terms: one for each slot, power of it and symmetry.

        Raises
        ------
        SceneError
            If the parameter does more than change coefficients.
        """
        paths = paths_of(parameter)
        if not self.is_affine(parameter):
            raise SceneError(f"{parameter} changes matrices, not coefficients alone")
        groups: dict[tuple[Slot, int, bool, bool], list[tuple[Term, float]]] = {}
        for t in self.terms:
            others = replace(t, powers={p: e for p, e in t.powers.items() if p not in paths})
            c = others.coefficient(self.parameters)
            if c:
                key = (t.slot, sum(t.powers.get(p, 0) for p in paths), t.symmetric, t.imaginary)
                groups.setdefault(key, []).append((replace(t, imaginary=False), c))
        terms = []
        for (slot, power, symmetric, imaginary), parts in groups.items():
            matrix = _sum(parts)
            assert matrix is not None
            skew = all(t.skew for t, _ in parts)
            name = f"{slot}{power}" + ("" if symmetric else "n") + ("i" if imaginary else "")
            terms.append(Term(name, slot, matrix, symmetric, {paths[0]: power}, skew, imaginary))
        own = self.parameters

        def free(values: Mapping[str, float]) -> FreeMotions:
            return replace(self, parameters={**own, **{p: values[p] for p in paths}}).free_motions()

        return Problem(tuple(terms), dict.fromkeys(paths, self.value(parameter)), free=free)

    def project(self, V: np.ndarray) -> Problem:
        """Return the Galerkin projection of every term on the columns of a real V (n, r): terms VᵀAV of size r.

        What is free among the combinations of V is for the caller to say: entries of the projected matrices are too
        small to tell it from rounding.
        """
        none = FreeMotions.none(V.shape[1])
        terms = []
        for t in self.terms:
            rows = np.flatnonzero(np.diff(t.matrix.indptr))  # springs and contacts have few
            terms.append(replace(t, matrix=sp.csr_array(cross(V[rows], times(sp.csr_array(t.matrix[rows]), V)))))
        return Problem(tuple(terms), self.parameters, free=lambda _: none)

    def derivative(self, parameter: str, slot: Slot, **values: float) -> sp.csr_array | None:
        """Return ∂M, ∂C or ∂K by a parameter; None where it does not depend on it.

        Exact where the parameter is a power in coefficients, a central difference of the matrices elsewhere.
        """
        here = self.at(**values)
        paths = paths_of(parameter)
        if here.is_affine(parameter):
            slopes = [(t, sum(t.slope(p, here.parameters) for p in paths)) for t in here.terms if t.slot == slot]
            return _sum(slopes)
        p = here.value(parameter)
        step = _DIFFERENCE * (abs(p) or abs(self.value(parameter)) or 1.0)
        above, below = (here.at(**{parameter: p + sign * step}) for sign in (1, -1))
        parts = [(t, sign * t.coefficient(q.parameters)) for q, sign in ((above, 1), (below, -1)) for t in q.terms]
        change = _sum([(t, c / (2 * step)) for t, c in parts if t.slot == slot])
        return change if change is not None and abs(change).max() > 0 else None

    def interpolated(self, parameter: str, low: float, high: float) -> Problem:
        """Return a problem whose matrices are quadratic in a parameter and agree at both ends and the middle.

        Itself where the parameter changes coefficients alone. It knows no other parameter.
        """
        if self.is_affine(parameter):
            return self
        nodes = np.array([low, (low + high) / 2, high])
        basis = np.linalg.inv(np.vander(nodes, 3, increasing=True))  # power, node
        pencils = [self.pencil(**{parameter: float(p)}) for p in nodes]
        symmetric = all(p.symmetric for p in pencils)
        terms = []
        for slot in ("M", "C", "K"):
            given = [getattr(p, slot) for p in pencils]
            if all(A is None for A in given):
                continue
            parts = [sp.csr_array(pencils[0].M.shape) if A is None else A for A in given]
            for power in range(3):
                A = sp.csr_array(sum(w * part for w, part in zip(basis[power], parts, strict=True)))
                for matrix, imaginary in ((A.real, False), (A.imag, True)):
                    if imaginary <= np.iscomplexobj(A):
                        powers = {paths_of(parameter)[0]: power}
                        term = Term(f"{slot}{power}", slot, sp.csr_array(matrix), slot == "M" or symmetric, powers)
                        terms.append(replace(term, imaginary=imaginary))
        always = _common([p.free for p in pencils if p.free is not None])
        return Problem(tuple(terms), dict.fromkeys(paths_of(parameter), low), free=lambda _: always)


def _common(found: list[FreeMotions]) -> FreeMotions:
    """Return the motions that are free in all of several cases."""
    Z = found[0].motions
    for other in found[1:]:
        Q = np.linalg.qr(other.motions)[0]
        Z = Z @ null_columns(Z - Q @ (Q.T @ Z), _FREE * float(np.linalg.norm(Z)))
    return FreeMotions(Z)


def _sum(parts: list[tuple[Term, float]]) -> sp.csr_array | None:
    """Return Σ coefficient · matrix, complex where a term is imaginary; None where nothing is left."""
    total = None
    for term, coefficient in parts:
        if coefficient:
            matrix = term.matrix * (coefficient * term.unit())
            total = matrix if total is None else total + matrix
    return None if total is None else sp.csr_array(total)
