"""The problem: the sum of the terms that exist, and the class that follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from .contact import ContactOperators
from .eigen.pencil import Pencil, ProblemClass
from .spaces import DisplacementSpace
from .terms import Slot, Term


@dataclass(frozen=True)
class Model:
    """Where the terms of a problem come from: the discretisation, for shapes and reports.

    Attributes
    ----------
    space : DisplacementSpace
    bodies : mapping of body to (e,) int elements
    contacts : mapping of contact to its operators
    notes, warnings : what was converted or looks doubtful, a sentence each
    """

    space: DisplacementSpace
    bodies: Mapping[str, np.ndarray]
    contacts: Mapping[str, ContactOperators]
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Problem:
    """A sum of terms with the values of their parameters.

    Attributes
    ----------
    terms : tuple of Term
    parameters : mapping of name to value
        Nominal values, e.g. {"mu": 0.3}.
    model : Model or None
    """

    terms: tuple[Term, ...]
    parameters: Mapping[str, float]
    model: Model | None = None

    def __repr__(self) -> str:
        size = f"{self.unknowns} unknowns, {len(self.terms)} terms"
        return f"Problem({self.problem_class}, {size}, {dict(self.parameters)})"

    @property
    def unknowns(self) -> int:
        """Number of unknowns n."""
        return int(self.terms[0].matrix.shape[0])

    @property
    def problem_class(self) -> ProblemClass:
        """The class of the problem over all values of its parameters."""
        if any(t.slot == "C" for t in self.terms):
            return "quadratic"
        return "symmetric" if all(t.symmetric for t in self.terms) else "nonsymmetric"

    def with_parameters(self, **values: float) -> Problem:
        """Return the same problem at other values of parameters."""
        return replace(self, parameters={**self.parameters, **values})

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
        parameters = {**self.parameters, **values}
        present = [(t, c) for t in self.terms if (c := t.coefficient(parameters)) != 0.0]
        symmetric = all(t.symmetric for t, _ in present if t.slot == "K")
        M, C, K = (_sum([(t.matrix, c) for t, c in present if t.slot == s]) for s in ("M", "C", "K"))
        zero = sp.csr_array((self.unknowns, self.unknowns))
        return Pencil(zero if M is None else M, zero if K is None else K, C, symmetric)

    def project(self, V: np.ndarray) -> Problem:
        """Return the Galerkin projection of every term on the columns of a real V (n, r): terms VᵀAV of size r."""
        terms = tuple(replace(t, matrix=sp.csr_array(V.T @ (t.matrix @ V))) for t in self.terms)
        return Problem(terms, self.parameters)

    def derivative(self, parameter: str, slot: Slot, **values: float) -> sp.csr_array | None:
        """Return ∂M, ∂C or ∂K by a parameter; None where it does not depend on it."""
        parameters = {**self.parameters, **values}
        return _sum([
            (t.matrix, slope)
            for t in self.terms
            if t.slot == slot and (slope := t.slope(parameter, parameters)) != 0.0
        ])  # fmt: skip


def _sum(parts: list[tuple[sp.csr_array, float]]) -> sp.csr_array | None:
    if not parts:
        return None
    total = parts[0][0] * parts[0][1]
    for matrix, coefficient in parts[1:]:
        total = total + matrix * coefficient
    return sp.csr_array(total)
