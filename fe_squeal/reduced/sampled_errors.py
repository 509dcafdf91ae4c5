"""Errors of the modes of a projection, from random samples of their residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import lift
from ..eigen.pencil import Modes
from ..eigen.quality import ROUNDING
from ..problem.parameters import Place, paths_of
from ..problem.problem import Problem
from ..problem.tabulated import Tabulated
from ..problem.terms import POWER, Slot
from .projection import Projection

SAMPLES = 24  # random vectors per norm: residual norms come out within some 15 %
# Right and left residuals have the same samples. Where they are equal, as of a symmetric problem, their product is χ²
# of 24 degrees of freedom, by 24: it is below a third of what is right once in a thousand times.
_SPREAD = 3.0
_SAMPLED_MODES = 8  # modes in which the size of the sums that cancel is compared with its estimate


class SampledErrors(Projection):
    """A projection with samples of the residuals of its modes, see `fe_squeal.reduced.basis.ReducedBasis`.

    What is kept of the terms A_t, for samples Z (n, 2 s) and vectors V (n, r), is made where vectors are added.
    """

    _right: list[np.ndarray]  # ZᵀA_tV of each term, (2 s, r)
    _left: list[np.ndarray]  # ZᵀA_tᵀV
    _units: np.ndarray  # (n,) units of the rows, in which backward errors count
    _lines: np.ndarray  # (l,) int, the rows of V that stand for all in the size of the sums that cancel
    _size: np.ndarray  # (l,) the size of the diagonal entries there
    _sampled_rows: np.ndarray  # (l, r) these rows of V, times that size
    _cancels: float  # see `calibrate`
    # The sampled rows of the sizes of entries of each term, with the numbers of these rows.
    _sizes: tuple[np.ndarray, list[sp.csr_array]] | None

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

        Errors of λ are in rad/s. The condition is relative, in the P-norm or that of M, the smaller one: ½ at best.
        Rounding is that of the problem's own entries, as in `fe_squeal.eigen.quality`: the projection has it, too.

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
        # P is the stiffness at the start: what is softer at this value is long in its norm, but not for that ill-
        # conditioned.
        masses = [np.einsum("ij,ij->j", x.conj(), y).real for x, y in
                  ((modes.right, inertia), (modes.left, M @ modes.left))]  # fmt: skip
        lengths = np.minimum(lengths, size**2 * np.sqrt(np.maximum(masses[0] * masses[1], 0.0)))
        with np.errstate(divide="ignore", invalid="ignore"):
            condition = np.nan_to_num(lengths / (slope * size), nan=np.inf)
        size_at, other = (np.abs(lift(self._sampled_rows, u)) for u in (modes.right, modes.left))
        sums = self._cancels * np.einsum("l,lj,lj->j", self._weights(), size_at, other)
        with np.errstate(divide="ignore", invalid="ignore"):
            rounding = ROUNDING * np.fmin(sums / slope, np.sqrt(sums / (ROUNDING * mass)))
        exact = ~modes.left.any(axis=0)  # the double λ = 0 of motions that nothing holds or damps
        error, rounding = np.where(exact, 0.0, error), np.where(exact, 0.0, rounding)
        residual, whole = np.linalg.norm(rho[SAMPLES:], axis=0), self._cancels * np.linalg.norm(size_at, axis=0)
        backward = np.divide(residual, whole, out=np.zeros_like(whole), where=whole > 0)  # 0 where nothing acts
        return error, backward, condition, rounding

    def _weights(self) -> np.ndarray:
        """Return what turns products of sampled rows of two vectors into parts of |ψ|ᵀ(|λ|²|M| + |λ||C| + |K|)|φ|."""
        share = np.sqrt(self.problem.unknowns / len(self._lines))
        return np.asarray(share / np.maximum(self._size * self._units[self._lines], np.finfo(float).tiny))

    def root_error(
        self, value: Place, lam: complex, right: np.ndarray, left: np.ndarray, highest: float, parameter: str = "",
        here: Problem | None = None, crosses: bool = False,
    ) -> tuple[float, float]:  # fmt: skip
        """Return how far a parameter at which Q(λ)φ = 0, ψᴴQ(λ) = 0 may be off, ‖η‖‖ρ‖/|ψᴴ(∂Q/∂p)φ|, and by rounding.

        A λ that crosses the imaginary axis moves along it, too: ψᴴQφ = δ, which both errors bound, moves λ by
        −δ/(ψᴴQ'φ), and p has to bring back its real part alone. In place of |ψᴴ(∂Q/∂p)φ| stands |ψᴴQ'φ| |dRe λ/dp|.

        The second number is what rounding of the problem's own entries makes of that parameter. The first one has what
        the projected Q(λ) at the value itself leaves, ψᴴQ(λ)φ, if that is a root of interpolated matrices.

        Parameters
        ----------
        parameter : str, optional
            Which of several parameters p is.
        here : Problem, optional
            The projected problem at the value, affine in the parameter; needed if the basis has a table.
        crosses : bool
            Whether λ crosses the imaginary axis.
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
        change, moved = 0j, 0j
        for term, A in zip(here.terms, matrices, strict=True):
            if slope := sum(term.slope(p, here.parameters) for p in paths_of(along)):
                change += slope * complex(term.unit(lam)) * complex(np.vdot(left, A @ right))
            if crosses and (power := POWER[term.slot]):
                factor = complex(term.factor(1.0, here.parameters)) * power * lam ** (power - 1)
                moved += factor * complex(np.vdot(left, A @ right))
        x, y = lift(self.V, phi), lift(self.V[self._lines], psi)
        share = len(self.V) / len(self._lines)
        rounding = ROUNDING * share * float(np.sum(np.abs(y) * self._magnitude(value, lams, x)))
        slope = abs(moved) * abs((change / moved).real) if moved else abs(change)
        return (both / slope, rounding / slope) if slope else (np.inf, np.inf)

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
        rho = np.zeros((2 * SAMPLES, len(lam)), complex)
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
        both = np.linalg.norm(rho[:SAMPLES], axis=0) * np.linalg.norm(eta[:SAMPLES], axis=0)
        return np.asarray(_SPREAD * both / np.clip(1 - (size / highest) ** 2, 0.05, 1.0))


def _size_of_entries(A: sp.csr_array, lines: np.ndarray) -> sp.csr_array:
    """Return some rows of max(|A_ij|, √|A_ii A_jj|) for the entries of A."""
    root = np.sqrt(np.abs(A.diagonal()))
    rows = sp.csr_array(abs(A[lines]))
    between = np.repeat(root[lines], np.diff(rows.indptr)) * root[rows.indices]
    rows.data = np.maximum(rows.data, between)
    return rows

