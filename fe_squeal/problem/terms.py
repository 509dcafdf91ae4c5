"""Terms of the equation of motion: one matrix each, in one slot, with its own dependence on parameters."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import with_short_indices
from ..eigen.definite import signs_of
from ..eigen.linear.spread_matrix import SpreadMatrix
from ..errors import SceneError, suggest
from .parameters import paths_of, product_of_powers
from .symmetry import measure_symmetry

Slot = Literal["M", "C", "K"]
POWER: dict[Slot, int] = {"M": 2, "C": 1, "K": 0}  # the power of λ that multiplies the matrix of a slot in Q(λ)

_REAL = "fiub"  # NumPy's kinds of real numbers
_CLAIMED = 1e-8  # of the largest entries of row and column: how far a matrix may be from what it is said to be


@dataclass(frozen=True)
class Term:
    """One summand of M, C or K: matrix · Π parameter**power, times i if it is imaginary.

    Attributes
    ----------
    name : str
        The effect and the place where it acts, as in "friction.outer".
    slot : "M", "C" or "K"
        The matrix that it is a summand of.
    matrix : (n, n) sparse float
        In kg, N s/m or N/m after multiplication by the powers of the parameters; other real numbers are converted.
        It is not to be changed: sums are kept, and what is large may lie in a file.
    symmetric : bool
        Whether the matrix is symmetric by its mathematics, apart from rounding.
    powers : mapping of str to int
        Exponents of the parameters.
    skew : bool
        Whether the matrix is skew-symmetric by its mathematics.
    imaginary : bool
        Whether it is multiplied by i, as structural damping is.
    penalty : bool
        Whether it stands for a constraint, which it approaches with rising stiffness.
    only : mapping of str to float, or None
        Values of parameters at which it counts, and nowhere else.
    """

    name: str
    slot: Slot
    matrix: sp.csr_array
    symmetric: bool
    powers: Mapping[str, int] = field(default_factory=dict)
    skew: bool = False
    imaginary: bool = False
    penalty: bool = False
    only: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        if self.slot not in POWER:
            raise SceneError(f'term {self.name}: given the slot {self.slot!r}; expected "M", "C" or "K"')
        if sp.issparse(self.matrix) and (self.matrix.format != "csr" or isinstance(self.matrix, sp.spmatrix)):
            object.__setattr__(self, "matrix", sp.csr_array(self.matrix))
        # Sums of integers wrap around, and those of single precision are exact to seven digits alone.
        if sp.issparse(self.matrix) and self.matrix.dtype.kind in _REAL and self.matrix.dtype != float:
            object.__setattr__(self, "matrix", self.matrix.astype(float))
        # SciPy's products of small matrices come with long indices, and sums with the large ones would take them over.
        if sp.issparse(self.matrix) and self.matrix.format == "csr":
            object.__setattr__(self, "matrix", with_short_indices(self.matrix))

    @cached_property
    def full(self) -> np.ndarray:
        """The matrix as an array, which is kept: for small problems whose matrices are full."""
        return np.asarray(self.matrix.toarray())

    @cached_property
    def signs(self) -> set[int]:
        """The signs of the eigenvalues of a symmetric matrix, see `signs_of`, which are kept."""
        return signs_of(self.matrix)

    @cached_property
    def fault(self) -> str:
        """What is wrong with the matrix of a term that somebody made by hand, in words; "" for nothing."""
        A = self.matrix
        if not sp.issparse(A):
            return f"given a {type(A).__name__} as the matrix; expected a sparse one, as scipy.sparse.csr_array(A)"
        if A.ndim != 2 or A.shape[0] != A.shape[1] or not A.shape[0]:
            return f"the matrix has the shape {A.shape}; expected a square one"
        if A.dtype.kind not in _REAL:
            return f"the matrix is {A.dtype}; expected real numbers, and another term with imaginary=True for losses"
        if self.imaginary and self.slot != "K":
            return f'given imaginary=True in the slot "{self.slot}"; expected it in the slot "K"'
        if not np.isfinite(A.data).all():
            return "the matrix has entries that are not finite; expected finite numbers"
        if not A.data.any():
            return ""
        is_mass = self.slot == "M"
        kind = measure_symmetry(A, _CLAIMED) if self.symmetric or self.skew or is_mass else "general"
        if is_mass and kind != "symmetric":
            return "the mass matrix is not symmetric; expected that it is"
        if self.symmetric and kind != "symmetric":
            return "the matrix is not symmetric, but symmetric=True; expected False"
        if self.skew and kind != "skew":
            return "the matrix is not skew-symmetric, but skew=True; expected False"
        return ""

    @property
    def conservative(self) -> bool:
        """Whether the term can do no net work in a period of a steady vibration, whatever the shape."""
        if self.slot == "C":
            return self.skew
        return self.symmetric and not self.imaginary

    def coefficient(self, parameters: Mapping[str, float]) -> float:
        """Return Π parameter**power, or 0 where the term does not count.

        Raises
        ------
        SceneError
            A parameter has no value, or the product is no finite number.
        """
        if self.only is not None and any(parameters[p] != value for p, value in self.only.items()):
            return 0.0
        return self._product(self.powers, parameters)

    def _product(self, powers: Mapping[str, int], parameters: Mapping[str, float]) -> float:
        try:
            return product_of_powers(powers, parameters)
        except SceneError as error:
            raise SceneError(f"term {self.name}: {error}") from error

    def depends_on(self, parameters: Collection[str]) -> bool:
        """Return whether the coefficient depends on one of some parameters."""
        return any(p in self.powers or p in (self.only or ()) for p in parameters)

    def unit(self, lam: Any = 1.0) -> Any:
        """Return λ², λ or 1 by the slot, times i where the term is imaginary; without λ its factor in M, C or K."""
        power = lam ** POWER[self.slot]
        return 1j * power if self.imaginary else power

    def factor(self, lam: Any, parameters: Mapping[str, float]) -> Any:
        """Return what the matrix counts with in Q(λ) = λ²M + λC + K: coefficient and unit together.

        Parameters
        ----------
        lam : complex or (k,) complex, rad/s

        Examples
        --------
        >>> damper = Term("damper", "C", sp.csr_array([[2.0]]), symmetric=True, powers={"c": 1})
        >>> damper.factor(3j, {"c": 5.0})
        15j
        """
        return self.coefficient(parameters) * self.unit(lam)

    def slope(self, parameter: str, parameters: Mapping[str, float]) -> float:
        """Return the derivative of the coefficient by one parameter; raises what `coefficient` does."""
        e = self.powers.get(parameter, 0)
        if e == 0:
            return 0.0
        return e * self._product({**self.powers, parameter: e - 1}, parameters)


def check_terms(terms: Sequence[Term], parameters: Collection[str]) -> None:
    """Refuse terms that somebody made by hand and that are none of one equation of motion.

    Parameters
    ----------
    terms : sequence of Term
    parameters : collection of str
        The names that have values.

    Raises
    ------
    SceneError
        See `Term.fault`; or the matrices have different sizes, or a power is of a name that stands for other ones or
        has no value.
    """
    for term in terms:
        if term.fault:
            raise SceneError(f"term {term.name}: {term.fault}")
        for name in term.powers:
            if paths_of(name) != [name]:
                known = " and ".join(f'"{path}"' for path in paths_of(name))
                raise SceneError(f'term {term.name}: given a power of "{name}", which means {known}; expected that')
            if name not in parameters:
                raise SceneError(
                    f'term {term.name}: given a power of "{name}", which has no value{suggest(name, parameters)};'
                    " expected it among the parameters of the problem"
                )
        n, first = term.matrix.shape[0], terms[0]
        if n != first.matrix.shape[0]:
            raise SceneError(
                f"term {term.name}: the matrix has {n} rows, and that of {first.name} {first.matrix.shape[0]}; expected"
                " one size"
            )


def sum_terms(parts: Iterable[tuple[Term, float]]) -> sp.csr_array | None:
    """Return Σ coefficient · matrix, complex where a term is imaginary; None where every coefficient is zero."""
    factors = ((term.matrix, coefficient * term.unit()) for term, coefficient in parts)
    return sum_matrices((A, c) for A, c in factors if c)


def sum_matrices(parts: Iterable[tuple[sp.csr_array, complex]]) -> sp.csr_array | None:
    """Return Σ factor · matrix, or None without any.

    Those with few entries come first: each sum goes through all entries that were added before.
    """
    total = None
    for matrix, factor in sorted(parts, key=lambda part: int(part[0].nnz)):
        own = matrix if factor == 1 else matrix * factor
        total = own if total is None else total + own
    return total if total is None or isinstance(total, SpreadMatrix) else total.tocsr()


def is_finite(A: sp.csr_array) -> bool:
    """Return whether all entries are finite numbers; of semidefinite ones on all processes the diagonal tells."""
    if not isinstance(A, SpreadMatrix):
        return bool(np.isfinite(A.data.sum()))
    return bool(np.isfinite(A.diagonal().sum()) and (A.rest is None or np.isfinite(A.rest.data.sum())))
