"""The projection of every term of a problem on few vectors, and its modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..eigen.blocks import combine, times
from ..eigen.dense import solve_dense
from ..eigen.pencil import Modes, Pencil
from ..problem.problem import Problem
from ..problem.terms import Slot, Term
from .undamped import weighted
from .vectors import FreeMotions, lift

POWER: dict[Slot, int] = {"M": 2, "C": 1, "K": 0}  # of λ, of what stands in the slot
_SPARSE = 0.3  # of all rows: what a term has at most that is handled by its own rows
_RIGID = 1e-3  # of the shift: θ of a motion that nothing holds
_Acting = tuple[np.ndarray | None, sp.csr_array, sp.csr_array | None]


class Projection:
    """Vectors V (n, r) with VᵀPV = 1, P = K − σM, and the terms VᵀAV.

    Parameters
    ----------
    problem : Problem
        Affine in the parameter and condensed: few terms.
    parameter : str
    metric : (terms,) float
        The coefficients of the terms in P, see `factorize_undamped`.
    sigma : float, rad²/s²
    """

    def __init__(self, problem: Problem, parameter: str, metric: Sequence[float], sigma: float) -> None:
        self.problem, self.parameter, self.metric, self.sigma = problem, parameter, metric, sigma
        self.V = np.zeros((problem.unknowns, 0))
        self._small = [np.zeros((0, 0)) for _ in problem.terms]
        self.has_free = False
        self._free: tuple[np.ndarray, FreeMotions | None] | None = None  # and of which V

    def __len__(self) -> int:
        return int(self.V.shape[1])

    def project(self, problem: Problem) -> Problem:
        """Return another problem of the same unknowns on the basis."""
        return problem.project(self.V)

    def pencil(self, value: float) -> Pencil:
        """Return the small matrices at a value of the parameter."""
        at = self.problem.at(**{self.parameter: value})
        sums: dict[Slot, np.ndarray | None] = {"M": None, "C": None, "K": None}
        symmetric = True
        for term, A in zip(at.terms, self._small, strict=True):
            c = term.coefficient(at.parameters)
            if not c:
                continue
            symmetric &= term.symmetric or term.slot != "K"
            part = A * (1j * c if term.imaginary else c)
            before = sums[term.slot]
            sums[term.slot] = part if before is None else before + part
        M, C, K = (None if A is None else sp.csr_array(A) for A in sums.values())
        assert M is not None and K is not None
        free = self.free
        return Pencil(M, K, C, symmetric, None if free is None else free.cancelled)

    def expect_free_motions(self) -> None:
        """Look for motions that nothing holds from now on."""
        self.has_free = True

    @property
    def free(self) -> FreeMotions | None:
        """The motions that nothing holds, in the coordinates of the basis."""
        if not self.has_free:
            return None
        if self._free is None or self._free[0] is not self.V:
            at = self.problem.parameters
            pairs = zip(self.problem.terms, self._small, strict=True)
            M = sum(t.coefficient(at) * A for t, A in pairs if t.slot == "M")
            nu, Y = la.eigh(M)
            rigid = (nu > 0) & (np.abs(1 + self.sigma * np.maximum(nu, 0.0)) < _RIGID)  # θ = σ + 1/ν
            Y = Y[:, rigid] / np.sqrt(nu[rigid])
            K = weighted(self.problem, self.metric) + self.sigma * self.problem.mass
            self._free = self.V, FreeMotions.of(K, lift(self.V, Y), Y.T @ M) if rigid.any() else None
        return self._free[1]

    def modes(self, value: float, highest: float) -> Modes:
        """Return the modes of the small problem up to |λ| = highest, rad/s, with vectors of length r."""
        return solve_dense(self.pencil(value), highest)

    def base(self, sigma: float) -> Pencil:
        """Return the pencil of K = P + σM."""
        M = self.problem.mass
        return Pencil(M, sp.csr_array(weighted(self.problem, self.metric) + sigma * M), symmetric=True)

    def undamped_values(self, sigma: float) -> np.ndarray:
        """Return the rising θ of the small problem without damping and friction: VᵀPV = 1, so θ = σ + 1/ν of VᵀMV."""
        at = self.problem.parameters
        M = sum(t.coefficient(at) * A for t, A in zip(self.problem.terms, self._small, strict=True) if t.slot == "M")
        nu = la.eigvalsh(M)[::-1]
        return np.asarray(sigma + 1 / nu[nu > len(nu) * np.finfo(float).eps * nu[0]])

    def condensed(self) -> Problem:
        """Return the small terms as a problem."""
        terms = tuple(
            replace(t, matrix=sp.csr_array(A)) for t, A in zip(self.problem.terms, self._small, strict=True)
        )
        return Problem(terms, self.problem.parameters)

    @cached_property
    def _acting(self) -> list[_Acting]:
        return [_acting(t) for t in self.problem.terms]

    def residuals(self, value: float, modes: Modes) -> tuple[np.ndarray, np.ndarray]:
        """Return Q(λ)φ and Q(λ)ᴴψ of each mode as real columns.

        Returns
        -------
        right, left : (n, k) or (n, 2k)
            Real parts, and imaginary ones behind them where there are any.
        """
        assert modes.left is not None
        at = self.problem.at(**{self.parameter: value})
        scale = [t.coefficient(at.parameters) * (1j if t.imaginary else 1.0) for t in at.terms]
        factors = [c * modes.lam ** POWER[t.slot] for c, t in zip(scale, at.terms, strict=True)]
        real = not any(x.imag.any() for x in (modes.right, modes.left, *factors))
        found = []
        for vectors, adjoint in ((modes.right, False), (modes.left, True)):
            u = combine(self.V, vectors.real if real else np.hstack([vectors.real, vectors.imag]))
            total = np.zeros_like(u)
            for (rows, A, transposed), c in zip(self._acting, factors, strict=True):
                part = times(transposed if adjoint and transposed is not None else A, u)
                re, im = np.diag(c.real), np.diag(-c.imag if adjoint else c.imag)
                # Complex multiplication, on columns of real parts and columns of imaginary ones.
                part = part * c.real if real else combine(part, np.block([[re, im], [-im, re]]))
                total[slice(None) if rows is None else rows] += part
            found.append(total)
        return found[0], found[1]


def _acting(term: Term) -> _Acting:
    """Return the rows in which a term acts, None for all, and these of its matrix and of the transposed one."""
    A = term.matrix
    transposed = None if term.symmetric else sp.csr_array(A.T)
    rows = np.flatnonzero(np.diff(sp.csr_array(abs(A) + abs(A.T)).indptr))
    if len(rows) >= _SPARSE * A.shape[0]:
        return None, A, transposed
    return rows, sp.csr_array(A[rows]), None if transposed is None else sp.csr_array(transposed[rows])
