"""The matrices of one eigenvalue problem, and the modes that solve it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import scipy.sparse as sp

from .blocks import lift
from .linear.spread_matrix import SpreadMatrix, in_rows
from .polish import equilibrate
from .unsearched import ALL_SEARCHED, Unsearched

ProblemClass = Literal["symmetric", "nonsymmetric", "quadratic", "complex"]
_Matrix: TypeAlias = sp.csr_array | np.ndarray
_ROWS = 512  # of a sparse matrix, for which numbers per entry are made at once


@dataclass(frozen=True)
class FreeMotions:
    """Motions Z with K Z = 0, which nothing holds.

    Attributes
    ----------
    motions : (n, k) float
        Linearly independent columns; k = 0 where every motion is held.
    damping : (n, k) float or None
        C Z, the forces of dampers, without rounding of what cancels in them; None without damping.
    """

    motions: np.ndarray
    damping: np.ndarray | None = None

    @classmethod
    def none(cls, n: int) -> FreeMotions:
        """Return the free motions of n unknowns in which every motion is held: none."""
        return cls(np.zeros((n, 0)), np.zeros((n, 0)))


@dataclass(frozen=True)
class Pencil:
    """Matrices of (λ²M + λC + K) u = 0, sparse, or arrays as of projections.

    Attributes
    ----------
    M : (n, n) sparse float, kg
        Symmetric positive semidefinite.
    K : (n, n) sparse float or complex, N/m
        Complex with structural damping. That law belongs to oscillations of Im λ > 0 alone (its conjugate to the other
        half plane), so only these eigenvalues mean anything then.
    C : (n, n) sparse float or None, N s/m
    symmetric : bool
        Whether K = Kᵀ, also where it is complex.
    cancelled : (n, n) float array or None, N/m
        Sizes of what cancelled when K was projected, where that is more than its entries show: rounding of these moves
        eigenvalues that are zero.
    free : FreeMotions or None
        Motions that nothing holds. None where they are not known: they are then looked for, see `kernel`.
    """

    M: sp.csr_array
    K: sp.csr_array
    C: sp.csr_array | None = None
    symmetric: bool = False
    cancelled: np.ndarray | None = None
    free: FreeMotions | None = None

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return int(self.M.shape[0])

    @property
    def is_complex(self) -> bool:
        """Whether K is complex, by its type."""
        return bool(np.iscomplexobj(self.K))

    @property
    def problem_class(self) -> ProblemClass:
        """The cheapest class that the matrices allow; complex with or without C."""
        if self.is_complex:
            return "complex"
        if self.C is not None:
            return "quadratic"
        return "symmetric" if self.symmetric else "nonsymmetric"

    def apply(self, lam: np.ndarray, u: np.ndarray, Mu: np.ndarray | None = None) -> np.ndarray:
        """Return the columns (λ²M + λC + K) u for λ (k,) and u (n, k); M u may be known."""
        r = (lift(self.M, u) if Mu is None else Mu) * lam**2 + lift(self.K, u)
        return r if self.C is None else r + lift(self.C, u) * lam

    @cached_property
    def units(self) -> tuple[np.ndarray, float]:
        """Units of the unknowns (n,) and of λ in which the entries of all matrices are of order one, powers of two."""
        return equilibrate(self.M, self.C, self.K)

    @cached_property
    def _absolute(self) -> tuple[tuple[_Matrix, ...], ...]:
        return tuple(_scale_of_entries(A) for A in (self.M, self.K, self.C) if A is not None)

    def magnitude(self, lam: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return (|λ|²|M| + |λ||C| + |K|)|u|, the size of what cancels in `apply`.

        |A| stands for max(|A_ij|, √(A_ii A_jj)): a small entry between large diagonal ones is what a cancellation left
        in the assembly, and is known no better than these.
        """
        a, size = np.abs(u), np.abs(lam)
        M, K, *C = self._absolute
        r = _times(M, a) * size**2 + _times(K, a)
        if self.cancelled is not None:
            r = r + self.cancelled @ a
        return r + _times(C[0], a) * size if C else r

    def derivative(self, lam: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the columns (2λM + C) u."""
        r = lift(self.M, u) * (2 * lam)
        return r if self.C is None else r + lift(self.C, u)

    def dense(self) -> Pencil:
        """Return the pencil with full arrays, whose products are faster where the matrices are small and full."""
        return replace(self, M=_full(self.M), K=_full(self.K), C=None if self.C is None else _full(self.C))

    def transposed(self) -> Pencil:
        """Return the pencil of the left modes, λ*²M + λ*Cᵀ + Kᴴ: the left mode of λ is its mode of λ*."""
        if self.symmetric and self.C is None and not self.is_complex:
            return self
        C = None if self.C is None else in_rows(self.C.T)
        return replace(self, K=in_rows(self.K.T.conj()), C=C, free=None)


@dataclass(frozen=True)
class Modes:
    """Eigenpairs of a pencil, by rising Im λ ≥ 0: one of each conjugate pair, or those of the upper half plane.

    Attributes
    ----------
    lam : (k,) complex, rad/s
        Eigenvalues; Re λ is the growth rate in 1/s.
    right, left : (n, k) float or complex
        Columns φ and ψ with Q(λ)φ = 0 and ψᴴQ(λ) = 0, scaled so that φᴴMφ = 1 and, without damping, ψᴴMφ = 1, or with
        damping ψᴴ(2λM + C)φ = 1. Real arrays if all modes are real.
    backward_error : (k,) float
        ‖Q(λ)φ‖ / ‖(|λ|²|M| + |λ||C| + |K|)|φ|‖: the smallest relative change of the matrices' entries that makes the
        pair exact, up to the norm. Rows are taken in the pencil's own units, so that forces and moments can be
        compared.
    re_uncertainty : (k,) float, 1/s
        How far Re λ may be from that of the exact matrices, because of residual and rounding, see `quality`.
    condition : (k,) float
        Relative change of λ for a relative change of the entries of the matrices.
    method : str
        How they were found, in words.
    exhaustive : bool
        Whether the method cannot miss a mode in its range, as LAPACK on the whole matrices.
    beyond : float
        Largest Re λ, 1/s, of eigenvalues that are left out since loss factors alone let them swing, see `quality`; 0
        for none.
    unsearched : Unsearched
        What was not looked for.
    """

    lam: np.ndarray
    right: np.ndarray
    left: np.ndarray | None
    backward_error: np.ndarray
    re_uncertainty: np.ndarray
    condition: np.ndarray
    method: str = ""
    exhaustive: bool = False
    beyond: float = 0.0
    unsearched: Unsearched = ALL_SEARCHED

    def __len__(self) -> int:
        return len(self.lam)

    def select(self, index: np.ndarray) -> Modes:
        """Return some of the modes; `index` (m,) int are their positions."""
        left = None if self.left is None else self.left[:, index]
        return replace(
            self, lam=self.lam[index], right=self.right[:, index], left=left, condition=self.condition[index],
            backward_error=self.backward_error[index], re_uncertainty=self.re_uncertainty[index],
        )  # fmt: skip

    def without_shapes(self) -> Modes:
        """Return the modes with no vectors."""
        return replace(self, right=np.zeros((0, len(self))), left=None)

    @property
    def eigenvalue_count(self) -> int:
        """How many eigenvalues, of 2n, the modes surely stand for: two for each that swings, one for a real one.

        λ = 0 is a double one, unless beside it a free motion that is damped decays. A real λ with a −λ beside it is not
        such a decay, but one of the two eigenvalues of a mode that diverges.
        """
        real = self.lam.imag == 0
        at_rest = int(np.count_nonzero(self.lam == 0))
        growing, decaying = (np.flatnonzero(real & (sign * self.lam.real > 0)) for sign in (1, -1))
        sizes, spread = np.abs(self.lam), self.re_uncertainty
        apart = np.abs(sizes[decaying][:, None] - sizes[growing])
        mirrored = apart <= spread[decaying][:, None] + spread[growing]
        pairs = min(int(np.count_nonzero(mirrored.any(axis=axis))) for axis in (0, 1))
        return 2 * len(self.lam) - int(np.count_nonzero(real)) + at_rest - min(at_rest, len(decaying) - pairs)

    @property
    def frequency_hz(self) -> np.ndarray:
        """(k,) Im λ / 2π."""
        return self.lam.imag / (2 * np.pi)

    @property
    def stability(self) -> np.ndarray:
        """(k,) str: unstable or stable beyond the uncertainty of Re λ, else marginal."""
        re, u = self.lam.real, self.re_uncertainty
        return np.where(re > u, "unstable", np.where(re < -u, "stable", "marginal"))


def _full(A: sp.csr_array | np.ndarray) -> np.ndarray:
    return A if isinstance(A, np.ndarray) else np.asarray(A.toarray())


def _scale_of_entries(A: _Matrix) -> tuple[_Matrix, ...]:
    """Return matrices whose sum is max(|A_ij|, √(|A_ii A_jj|)) for all i, j with an entry at (i, j) or (j, i).

    The first has the entries of A, whose indices it shares. The second has those at (j, i) alone, few as of friction.
    """
    if isinstance(A, SpreadMatrix):
        return (A.scale_of_entries(),)
    root = np.sqrt(np.abs(A.diagonal()))
    if isinstance(A, np.ndarray):
        size = np.abs(A)
        return (np.maximum(size, np.where(size + size.T > 0, np.outer(root, root), 0.0)),)
    pattern = sp.csr_array((np.ones(A.nnz, bool), A.indices, A.indptr), shape=A.shape)
    alone = sp.csr_array(sp.csr_array(pattern.T) > pattern)
    sizes = sp.csr_array((np.abs(A.data), A.indices, A.indptr), shape=A.shape)
    others = sp.csr_array((np.zeros(alone.nnz), alone.indices, alone.indptr), shape=A.shape)
    for part in (sizes, others):
        # In pieces, so that not even one more number per entry is held at a time.
        for start in range(0, len(root), _ROWS):
            rows = root[start : start + _ROWS]
            bounds = part.indptr[start : start + len(rows) + 1]
            piece = slice(bounds[0], bounds[-1])
            products = np.repeat(rows, np.diff(bounds)) * root[part.indices[piece]]
            np.maximum(part.data[piece], products, out=part.data[piece])
    return (sizes, others) if others.nnz else (sizes,)


def _times(parts: tuple[_Matrix, ...], u: np.ndarray) -> np.ndarray:
    first, *others = (A @ u for A in parts)
    return np.asarray(sum(others, first))


def is_mirror(a: complex, b: complex) -> bool:
    """Whether a and b are the two modes λ and −λ* of one complex pair θ, θ*."""
    return bool(a.real * b.real < 0 and abs(a + b.conjugate()) <= 1e-6 * abs(a))
