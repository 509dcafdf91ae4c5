"""The basis of a reduced model, to which vectors are added, with what is kept for the errors of its modes."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import combine, cross, cross_in, put_combined, times
from ..eigen.columns import Columns, ColumnStore, LocalStore, store_for, transposed
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import FreeMotions
from ..problem.problem import Problem
from ..problem.tabulated import Tabulated
from .projection import Projection
from .sampled_errors import SAMPLES, SampledErrors
from .vectors import DEPENDENT, normalising

_SEED = 20250411
_LINES = 1000  # rows of V that stand for all rows in norms
_ROOM = 8  # an array is allocated for so many times the present vectors; pages not yet written take no memory
# Parts of a vector outside the basis, as parts of the square of its length: what is smaller than _RANK is rounding;
# what is smaller than _CLEAR is computed once more, since as a difference of larger vectors it has lost digits.
_RANK = 1e-12
_CLEAR = 0.1
_OF_TERMS = "projected", "right", "left"  # names of what is stored of each term


class _Products(NamedTuple):
    """Products VᵀAX, VᵀAᵀX, XᵀAX, ZᵀAX, ZᵀAᵀX of a term A with new vectors X, the basis V and the samples Z."""

    VAX: np.ndarray
    VATX: np.ndarray
    XAX: np.ndarray
    ZAX: np.ndarray
    ZATX: np.ndarray


@dataclass(frozen=True)
class _Held:
    """The motions that nothing holds in a problem of n unknowns where everything is held: none."""

    n: int

    def __call__(self, values: Mapping[str, float]) -> FreeMotions:
        return FreeMotions.none(self.n)


class ReducedBasis(SampledErrors):
    """Vectors V (n, r) with VᵀPV = 1, the terms VᵀAV, and random samples of the residuals of their modes.

    A mode λ, φ = Vy, ψ = Vw of the projected problem has residuals ρ = Q(λ)φ and η = Q(λ)ᴴψ, both orthogonal to V, and
    λ is off by ηᴴQ(λ)⁻¹ρ / ψᴴQ'(λ)φ to leading order: a product of two vectors that are small. What V leaves out has
    frequencies beyond those of the modes; there Q(λ) is close to the positive definite P = K − σM, so that ‖η‖‖ρ‖ in
    the norm of P⁻¹ = L⁻ᵀL⁻¹ bounds the numerator. The norms are estimated as those of Zᵀ Σ A_tV y over the terms t,
    with Z = L⁻ᵀS, S random and E SSᵀ = 1. ZᵀA_tV is kept, so that no vector of length n is formed for any mode.
    (Two-sided Galerkin error: Benner, Gugercin, Willcox, SIAM Rev. 57, 2015; random samples of residuals: Balabanov and
    Nouy, Adv. Comput. Math. 45, 2019.)

    Parameters
    ----------
    problem, parameter, metric, sigma, linear_solver
        As of `Projection`.
    half_solve : callable, optional
        Returns L⁻ᵀS; without it there are no samples, and no errors.
    """

    def __init__(
        self, problem: Problem, parameter: str | tuple[str, ...], metric: Sequence[float], sigma: float,
        half_solve: Callable[[np.ndarray], np.ndarray] | None, linear_solver: LinearSolver | str = "auto",
    ) -> None:  # fmt: skip
        super().__init__(problem, parameter, metric, sigma, linear_solver)
        n = problem.unknowns
        rng = np.random.default_rng(_SEED)
        # Rows of backward errors count in the problem's own units, as in `fe_squeal.eigen.quality`.
        self._units = problem.pencil().units[0]
        self._Z = np.zeros((n, 0))
        if half_solve is not None:
            energy = half_solve(rng.standard_normal((n, SAMPLES)))
            plain = self._units[:, None] * rng.standard_normal((n, SAMPLES))
            self._Z = np.hstack([energy, plain]) / np.sqrt(SAMPLES)
        # Backward errors are relative to the size of the sums that cancel in Q(λ)φ, estimated from some rows.
        self._lines = np.sort(rng.choice(n, min(n, _LINES), replace=False))
        diagonal = sum(c * t.matrix.diagonal() for c, t in zip(metric, problem.terms, strict=True))
        self._size = (self._units * np.abs(diagonal))[self._lines] * np.sqrt(n / len(self._lines))
        self._store: ColumnStore = store_for(n)(n)
        self.V = self._store.columns(0)
        self._right = [np.zeros((self._Z.shape[1], 0)) for _ in problem.terms]  # Zᵀ A V
        self._left = [np.zeros((self._Z.shape[1], 0)) for _ in problem.terms]  # Zᵀ Aᵀ V
        self._sampled_rows = np.zeros((len(self._lines), 0))
        self._cancels = 1.0
        self._sizes = None

    @classmethod
    def restored(
        cls, problem: Problem, parameter: str | tuple[str, ...], arrays: Mapping[str, np.ndarray],
        numbers: Mapping[str, Any], linear_solver: LinearSolver | str = "auto",
    ) -> ReducedBasis:  # fmt: skip
        """Return the basis from what `stored` gave, which includes the vectors (n, r); it cannot be extended.

        Parameters
        ----------
        problem : Problem
            The problem of the stored basis.
        parameter : str or tuple of str
        arrays, numbers : mapping
            The two parts of `stored`.
        linear_solver : LinearSolver or str
        """
        basis = cls.__new__(cls)
        Projection.__init__(basis, problem, parameter, numbers["metric"], numbers["sigma"], linear_solver)
        basis._cancels, basis.has_slow = numbers["cancels"], numbers["has_slow"]
        basis._store, basis._Z = store_for(problem.unknowns).of(arrays["vectors"]), arrays["samples"]
        basis.V = basis._store.columns(basis._store.room)
        basis._units, basis._lines, basis._size = arrays["units"], arrays["lines"], arrays["size"]
        basis._sampled_rows, basis._sizes = arrays["sampled_rows"], None
        basis._projected, basis._right, basis._left = (
            [arrays[f"{name}_{i}"] for i in range(len(problem.terms))] for name in _OF_TERMS
        )
        return basis

    def stored(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return what `restored` needs besides the problem: arrays, and numbers that JSON can hold."""
        parts = (self._projected, self._right, self._left)
        arrays: dict[str, np.ndarray]
        arrays = {f"{n}_{i}": A for n, part in zip(_OF_TERMS, parts, strict=True) for i, A in enumerate(part)}
        arrays |= {
            "vectors": transposed(self.V), "units": self._units, "lines": self._lines, "size": self._size,
            "sampled_rows": self._sampled_rows, "samples": self._Z,
        }  # fmt: skip
        numbers = {"cancels": self._cancels, "sigma": self.sigma, "has_slow": self.has_slow}
        return arrays, {"metric": [float(c) for c in self.metric], **numbers}

    def _take_over(self, table: Tabulated) -> None:
        count = len(self._projected)
        super()._take_over(table)
        new = self._acting[count:]
        self._right = [*self._right, *(self._product_with(part, self._Z) for part in new)]
        self._left = [*self._left, *(part.sign * self._product_with(part.turned, self._Z) for part in new)]

    def append(self, X: np.ndarray, threshold: float = 0.0) -> int:
        """Add directions of X (n, k) as `extend` does, and return how many were added."""
        before = len(self)
        self.extend(X, threshold)
        return len(self) - before

    def extend(self, X: np.ndarray, threshold: float = 0.0) -> np.ndarray:
        """Add the directions of X (n, k) real whose part outside the basis is longer than a threshold in the P-norm.

        P is a sum of the terms, so that the products of the terms with X, needed for the projection, also give lengths
        in the P-norm. Every sparse matrix is multiplied with a vector once; the rest is arithmetic of (r, r) matrices.

        Directions in which the parts outside depend on each other are left out: those with an eigenvalue of their Gram
        matrix, scaled to unit vectors, of at most `DEPENDENT`.

        Returns
        -------
        (r, m) float
            Coordinates, in the extended basis, of columns that span what X was apart from the parts left out.
        """
        known = np.zeros((len(self), X.shape[1]))  # coordinates of what was taken off the columns of X
        within = []  # coordinates of columns without a part outside that counts
        while True:
            parts = [self._meet(i, X) for i in range(len(self.problem.terms))]
            inside = self._in_metric(parts, lambda p: (p.VAX + p.VATX) / 2)
            whole = self._in_metric(parts, lambda p: (p.XAX + p.XAX.T) / 2)
            gram = whole - inside.T @ inside
            length = whole.diagonal()  # squared; of a motion that P hardly resists, rounding may have made it negative
            outside = np.divide(gram.diagonal(), length, out=np.zeros(len(length)), where=length > 0)
            long = (outside > _RANK) & (gram.diagonal() > threshold**2)
            known = known + inside
            if (outside[long] > _CLEAR).all():
                break
            within.append(known[:, ~long])
            # What lies outside is first computed once more, or `gram` would lose digits.
            X, known = X[:, long] - combine(self.V, inside[:, long]), known[:, long]
        within.append(known[:, ~long])
        T = normalising(gram, np.flatnonzero(long), DEPENDENT)
        spanned = np.hstack([known @ T, *within])
        if not T.shape[1]:
            return spanned
        back = inside @ T
        for i, (term, p) in enumerate(zip(self.problem.terms, parts, strict=True)):
            A = self._projected[i]
            right, left = p.VAX @ T - A @ back, p.VATX @ T - A.T @ back
            corner = T.T @ (p.XAX @ T - p.VATX.T @ back) - back.T @ right
            grown = np.block([[A, right], [left.T, corner]])
            self._projected[i] = (grown + grown.T) / 2 if term.symmetric else grown
            self._right[i] = np.hstack([self._right[i], p.ZAX @ T - self._right[i] @ back])
            self._left[i] = np.hstack([self._left[i], p.ZATX @ T - self._left[i] @ back])
        X = combine(X, T) - combine(self.V, back)
        self._sampled_rows = np.hstack([self._sampled_rows, self._size[:, None] * X[self._lines]])
        self._extend(X)
        return np.vstack([spanned, np.eye(X.shape[1], spanned.shape[1])])

    def _meet(self, i: int, X: np.ndarray) -> _Products:
        """Return the products of a term A with X, V and Z."""
        rows, A, transposed, sign = self._acting[i]
        Z, here = (self._Z, X) if rows is None else (self._Z[rows], X[rows])
        AX = times(A, X)
        XAX, ZAX = cross(here, AX), cross(Z, AX)
        if transposed is None:
            [VAX] = cross_in(self.V, rows, AX)
            return _Products(VAX, VAX, XAX, ZAX, ZAX) if sign == 1 else _Products(VAX, -VAX, XAX, ZAX, -ZAX)
        ATX = times(transposed, X)
        VAX, VATX = cross_in(self.V, rows, AX, ATX)
        return _Products(VAX, VATX, XAX, ZAX, cross(Z, ATX))

    def _in_metric(self, parts: list[_Products], take: Callable[[_Products], np.ndarray]) -> np.ndarray:
        return np.asarray(sum(c * take(p) for c, p in zip(self.metric, parts, strict=True) if c))

    def _extend(self, X: np.ndarray) -> None:
        """Put columns behind those of V, each contiguous in memory, without a copy of V as long as there is room."""
        r, k = len(self), X.shape[1]
        if self._store.room < r + k:
            self._store = self._with_room(_ROOM * (r + k), self.V)
        self._store.put(r, X)
        self.V = self._store.columns(r + k)

    def _with_room(self, room: int, V: Columns, W: np.ndarray | None = None) -> ColumnStore:
        """Return a store that begins with V W, or with V."""
        store = type(self._store)(len(V), room)
        put_combined(store, 0, V, W)
        return store

    def shrink(self) -> None:
        """Give up the memory that corrections took behind the vectors, and what is kept of the last value."""
        if self._store.room >= len(self):
            self._store.keep(len(self))
        self._last = self._last_matrices = self._slow = self._contained = None

    def copy(self) -> ReducedBasis:
        """Return a copy that can be extended without changing this basis."""
        other = copy.copy(self)
        other._projected, other._right, other._left = list(self._projected), list(self._right), list(self._left)
        return other

    def without_vectors(self) -> ReducedBasis:
        """Return a copy that gives modes and their errors and holds no vector of the problem's length.

        It takes every motion as held, and cannot be extended.
        """
        small = copy.copy(self)
        small.V = np.zeros((0, len(self)))
        small._store, small._Z = LocalStore(0), np.zeros((0, 0))
        small._units = self._units[self._lines]
        small._lines = np.arange(len(self._lines))
        small.__dict__.pop("_acting", None)
        small._slow, small._contained = (small.V, self.slow), None
        small._last = small._last_matrices = None
        n = self.problem.unknowns
        empty = sp.csr_array((n, n))
        terms = tuple(replace(t, matrix=empty) for t in self.problem.terms)
        small.problem = Problem(terms, self.problem.parameters, free=_Held(n))
        return small

    def restricted(self, W: np.ndarray, lifted: bool = True) -> ReducedBasis:
        """Return the basis of the span of VW alone, W (r, k) orthonormal.

        Parameters
        ----------
        lifted : bool
            Whether the vectors VW are wanted. Modes and their errors need them only to look for motions that nothing
            holds, or hardly anything.
        """
        smaller = self._turned(lambda A: W.T @ A @ W, lambda B: B @ W)
        smaller._store = self._with_room(W.shape[1], self.V, W) if lifted else LocalStore(0, W.shape[1])
        smaller.V = smaller._store.columns(W.shape[1])
        return smaller

    def narrowed(self, count: int, U: np.ndarray) -> ReducedBasis:
        """Return the basis of its first vectors and of some directions U (r − count, k), orthonormal, of the others.

        Its vectors take the place of those of this basis, which must not be used any more.
        """

        def squared(A: np.ndarray) -> np.ndarray:
            corner = U.T @ A[count:, count:] @ U
            return np.block([[A[:count, :count], A[:count, count:] @ U], [U.T @ A[count:, :count], corner]])

        smaller = self._turned(squared, lambda B: np.hstack([B[:, :count], B[:, count:] @ U]))
        put_combined(self._store, count, self.V[:, count:], U)
        smaller.V = self._store.columns(count + U.shape[1])
        return smaller

    def _turned(
        self, squared: Callable[[np.ndarray], np.ndarray], columns: Callable[[np.ndarray], np.ndarray]
    ) -> ReducedBasis:  # fmt: skip
        """Return the basis of other vectors, by what turns (r, r) matrices and columns (·, r) of products with V."""
        smaller = copy.copy(self)
        smaller._projected = [squared(A) for A in self._projected]
        smaller._right, smaller._left = [columns(B) for B in self._right], [columns(B) for B in self._left]
        smaller._sampled_rows = columns(self._sampled_rows)
        return smaller

    def leading(self, count: int) -> ReducedBasis:
        """Return the basis of its first vectors alone."""
        smaller = self._turned(lambda A: A[:count, :count], lambda B: B[:, :count])
        smaller.V, smaller._store = self.V[:, :count], type(self._store)(len(self.V))  # which is not written to
        return smaller
