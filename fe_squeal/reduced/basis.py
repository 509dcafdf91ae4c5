"""The basis of a reduced model, to which vectors are added, and the errors of the modes of the projection on it.

In one file, since the errors need all that is kept of the products when vectors are added.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import combine, cross, lift, times
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import FreeMotions, Modes
from ..eigen.quality import ROUNDING
from ..problem.parameters import Place, paths_of
from ..problem.problem import Problem
from ..problem.tabulated import Tabulated
from ..problem.terms import POWER, Slot
from .projection import Projection
from .vectors import DEPENDENT, normalising

_SAMPLES = 24  # random vectors per norm: residual norms come out within some 15 %
_SPREAD = 1 + 3 / np.sqrt(_SAMPLES)  # three standard deviations of the product of two such norms, 1/√(2·24) each
_SEED = 20250411
_SAMPLED_MODES = 8  # modes in which the size of the sums that cancel is compared with its estimate
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


class ReducedBasis(Projection):
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

    # The sampled rows of the sizes of entries of each term, with the numbers of these rows.
    _sizes: tuple[np.ndarray, list[sp.csr_array]] | None

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
            energy = half_solve(rng.standard_normal((n, _SAMPLES)))
            plain = self._units[:, None] * rng.standard_normal((n, _SAMPLES))
            self._Z = np.hstack([energy, plain]) / np.sqrt(_SAMPLES)
        # Backward errors are relative to the size of the sums that cancel in Q(λ)φ, estimated from some rows.
        self._lines = np.sort(rng.choice(n, min(n, _LINES), replace=False))
        diagonal = sum(c * t.matrix.diagonal() for c, t in zip(metric, problem.terms, strict=True))
        self._size = (self._units * np.abs(diagonal))[self._lines] * np.sqrt(n / len(self._lines))
        self._store = np.zeros((0, n))
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
        basis.V, basis._store, basis._Z = arrays["vectors"].T, arrays["vectors"], arrays["samples"]
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
            "vectors": self.V.T, "units": self._units, "lines": self._lines, "size": self._size,
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
            outside = gram.diagonal() / np.maximum(whole.diagonal(), np.finfo(float).tiny)
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
        V, Z, here = (self.V, self._Z, X) if rows is None else (self.V[rows], self._Z[rows], X[rows])
        AX = times(A, X)
        XAX, VAX, ZAX = cross(here, AX), cross(V, AX), cross(Z, AX)
        if transposed is None:
            return _Products(VAX, VAX, XAX, ZAX, ZAX) if sign == 1 else _Products(VAX, -VAX, XAX, ZAX, -ZAX)
        ATX = times(transposed, X)
        return _Products(VAX, cross(V, ATX), XAX, ZAX, cross(Z, ATX))

    def _in_metric(self, parts: list[_Products], take: Callable[[_Products], np.ndarray]) -> np.ndarray:
        return np.asarray(sum(c * take(p) for c, p in zip(self.metric, parts, strict=True) if c))

    def _extend(self, X: np.ndarray) -> None:
        """Put columns behind those of V, each contiguous in memory, without a copy of V as long as there is room."""
        r, k = len(self), X.shape[1]
        if len(self._store) < r + k:
            store = np.empty((_ROOM * (r + k), len(X)))
            store[:r] = self.V.T
            self._store = store
        self._store[r : r + k] = X.T
        self.V = self._store[: r + k].T

    def shrink(self) -> None:
        """Give up the memory that corrections took behind the vectors."""
        store = np.empty((_ROOM * len(self), len(self.V)))
        store[: len(self)] = self.V.T
        self._store, self.V = store, store[: len(self)].T
        self._last = self._last_matrices = self._slow = self._contained = None  # what they hold has the old vectors

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
        small._store = small._Z = np.zeros((0, 0))
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
        smaller.V = combine(self.V, W) if lifted else np.zeros((0, W.shape[1]))
        smaller._store = smaller.V.T
        return smaller

    def narrowed(self, count: int, U: np.ndarray) -> ReducedBasis:
        """Return the basis of its first vectors and of some directions U (r − count, k), orthonormal, of the others.

        Its vectors take the place of those of this basis, which must not be used any more.
        """

        def squared(A: np.ndarray) -> np.ndarray:
            corner = U.T @ A[count:, count:] @ U
            return np.block([[A[:count, :count], A[:count, count:] @ U], [U.T @ A[count:, :count], corner]])

        smaller = self._turned(squared, lambda B: np.hstack([B[:, :count], B[:, count:] @ U]))
        self._store[count : count + U.shape[1]] = combine(self.V[:, count:], U).T
        smaller.V = self._store[: count + U.shape[1]].T
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
        smaller.V, smaller._store = self.V[:, :count], self._store[:count]
        return smaller

    def calibrate(self, value: Place, modes: Modes) -> None:
        """Set the factor between the size of the sums that cancel in Q(λ)φ and its estimate in `errors`.

        The estimate takes only the diagonals of the matrices; the factor is the smallest one among some of the modes.
        """
        modes = modes.select(np.unique(np.linspace(0, len(modes) - 1, _SAMPLED_MODES).astype(int)))
        u = lift(self.V, modes.right)
        scale = self._units[self._lines, None] * np.sqrt(len(u) / len(self._lines))
        exact = scale * self._magnitude(value, modes.lam, u)
        known = np.linalg.norm(self._size[:, None] * u[self._lines], axis=0)
        self._cancels = float((np.linalg.norm(exact, axis=0) / known).min())

    def _magnitude(self, value: Place, lam: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the sampled rows of (|λ|²|M| + |λ||C| + |K|)|u|, see `Pencil.magnitude`."""
        at = self.at(value)
        if self._sizes is None or self._sizes[0] is not self._lines:
            self._sizes = self._lines, []
        lines, known = self._sizes  # a table may have got further terms since
        self._sizes = lines, [*known, *(_size_of_entries(t.matrix, lines) for t in at.terms[len(known) :])]
        total = np.zeros((len(self._lines), len(lam)))
        for term, rows in zip(at.terms, self._sizes[1], strict=True):
            total += (rows @ np.abs(u)) * np.abs(term.factor(np.abs(lam), at.parameters))
        return total

    def errors(
        self, value: Place, modes: Modes, highest: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Return how far λ may be off by the reduction, backward errors, condition, and how far λ is off by rounding.

        Errors of λ are in rad/s; the condition is relative, in the P-norm, ½ at best. Rounding is that of the problem's
        own entries, as in `fe_squeal.eigen.quality`: the projection has it, too.

        Parameters
        ----------
        modes : Modes
            Modes of the projected problem.
        highest : float, rad/s
            Frequency up to which the basis holds the modes of the problem without damping and friction.
        """
        assert modes.left is not None
        rho, eta = self._sampled(value, modes.lam, modes.right, modes.left)
        both = self._product(rho, eta, np.abs(modes.lam), highest)
        M, C, _, _ = self.matrices(value)
        size, inertia = np.abs(modes.lam), M @ modes.right
        derivative = 2 * modes.lam * inertia if C is None else 2 * modes.lam * inertia + C @ modes.right
        mass, slope = (np.abs(np.einsum("ij,ij->j", modes.left.conj(), x)) for x in (inertia, derivative))
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.fmin(both / slope, np.sqrt(both / mass))
        lengths = np.linalg.norm(modes.right, axis=0) * np.linalg.norm(modes.left, axis=0)  # in the P-norm
        with np.errstate(divide="ignore", invalid="ignore"):
            condition = np.nan_to_num(lengths / (slope * size), nan=np.inf)
        size_at, other = (np.abs(lift(self._sampled_rows, u)) for u in (modes.right, modes.left))
        sums = self._cancels * np.einsum("l,lj,lj->j", self._weights(), size_at, other)
        with np.errstate(divide="ignore", invalid="ignore"):
            rounding = ROUNDING * np.fmin(sums / slope, np.sqrt(sums / (ROUNDING * mass)))
        backward = np.linalg.norm(rho[_SAMPLES:], axis=0) / (self._cancels * np.linalg.norm(size_at, axis=0))
        return error, backward, condition, rounding

    def _weights(self) -> np.ndarray:
        """Return what turns products of sampled rows of two vectors into parts of |ψ|ᵀ(|λ|²|M| + |λ||C| + |K|)|φ|."""
        share = np.sqrt(self.problem.unknowns / len(self._lines))
        return np.asarray(share / np.maximum(self._size * self._units[self._lines], np.finfo(float).tiny))

    def root_error(
        self, value: Place, lam: complex, right: np.ndarray, left: np.ndarray, highest: float, parameter: str = "",
        here: Problem | None = None,
    ) -> tuple[float, float]:  # fmt: skip
        """Return how far a parameter at which Q(λ)φ = 0, ψᴴQ(λ) = 0 may be off, ‖η‖‖ρ‖/|ψᴴ(∂Q/∂p)φ|, and by rounding.

        The second number is what rounding of the problem's own entries makes of that parameter. The first one has what
        the projected Q(λ) at the value itself leaves, ψᴴQ(λ)φ, if that is a root of interpolated matrices.

        Parameters
        ----------
        parameter : str, optional
            Which of several parameters p is.
        here : Problem, optional
            The projected problem at the value, affine in the parameter; needed if the basis has a table.
        """
        lams, phi, psi = np.array([lam]), right[:, None], left[:, None]
        rho, eta = self._sampled(value, lams, phi, psi)
        both = float(self._product(rho, eta, np.array([abs(lam)]), highest)[0])
        along = parameter or (self.parameter if isinstance(self.parameter, str) else self.parameter[0])
        matrices: Sequence[np.ndarray | sp.csr_array] = self._projected
        if isinstance(self.problem, Tabulated):
            assert here is not None
            M, C, K, _ = self.matrices(value)
            Q = lam**2 * M + K if C is None else lam**2 * M + lam * C + K
            both += abs(complex(np.vdot(left, Q @ right)))
            matrices = [t.matrix for t in here.terms]
        else:
            here = self.at(value)
        change = 0j
        for term, A in zip(here.terms, matrices, strict=True):
            if slope := sum(term.slope(p, here.parameters) for p in paths_of(along)):
                change += slope * complex(term.unit(lam)) * complex(np.vdot(left, A @ right))
        x, y = lift(self.V, phi), lift(self.V[self._lines], psi)
        share = len(self.V) / len(self._lines)
        rounding = ROUNDING * share * float(np.sum(np.abs(y) * self._magnitude(value, lams, x)))
        return (both / abs(change), rounding / abs(change)) if change else (np.inf, np.inf)

    def residual_product(
        self, value: Place, lam: complex, right: np.ndarray, left: np.ndarray, highest: float
    ) -> float:  # fmt: skip
        """Return ‖η‖‖ρ‖, how far ψᴴQ(λ)φ may be off by the reduction, for φ, ψ (r,) of the projected Q(λ)."""
        lams, phi, psi = np.array([lam]), right[:, None], left[:, None]
        return float(self._product(*self._sampled(value, lams, phi, psi), np.abs(lams), highest)[0])

    def _sampled(
        self, value: Place, lam: np.ndarray, phi: np.ndarray, psi: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the samples of Q(λ)φ and of Q(λ)ᴴψ."""
        at = self.at(value)
        rho = np.zeros((2 * _SAMPLES, len(lam)), complex)
        eta = np.zeros_like(rho)
        for slot, power in POWER.items():
            right, left = self._summed(self._right, slot, at), self._summed(self._left, slot, at)
            if right is not None and left is not None:
                rho += lift(right, phi) * lam**power
                eta += lift(left.conj(), psi) * (lam**power).conj()
        return rho, eta

    def _summed(self, of_terms: list[np.ndarray], slot: Slot, at: Problem) -> np.ndarray | None:
        """Return the sum over the terms of one slot at some values of the parameters."""
        total = None
        for term, A in zip(at.terms, of_terms, strict=True):
            if term.slot == slot and (c := term.factor(1.0, at.parameters)):
                total = c * A if total is None else total + c * A
        return total

    def _product(self, rho: np.ndarray, eta: np.ndarray, size: np.ndarray, highest: float) -> np.ndarray:
        """Return ‖η‖‖ρ‖ in the norm of P⁻¹, enlarged for |λ| near `highest`, where Q(λ) is smaller than P."""
        both = np.linalg.norm(rho[:_SAMPLES], axis=0) * np.linalg.norm(eta[:_SAMPLES], axis=0)
        return np.asarray(_SPREAD * both / np.clip(1 - (size / highest) ** 2, 0.05, 1.0))


def _size_of_entries(A: sp.csr_array, lines: np.ndarray) -> sp.csr_array:
    """Return some rows of max(|A_ij|, √|A_ii A_jj|) for the entries of A."""
    root = np.sqrt(np.abs(A.diagonal()))
    rows = sp.csr_array(abs(A[lines]))
    between = np.repeat(root[lines], np.diff(rows.indptr)) * root[rows.indices]
    rows.data = np.maximum(rows.data, between)
    return rows

