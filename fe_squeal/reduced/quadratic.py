"""The projected matrices of a damped problem, its modes in small spans of two sides, and corrections of these."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from ..eigen.blocks import lift
from ..eigen.lapack import regular_lu
from .estimate import GUARDED, ILL

_ROUNDS = 6  # of corrections; each takes a digit or so off the residuals
_NEARLY = 100  # times what is enough: modes above those asked for whose errors are larger are left out
# θ = −λ² at which corrections are solved for, in squares of the highest frequency of the basis: within the band, and
# off the axis on the side of growth, where no mode is so near that its share in a residual would be blown up. Each mode
# takes the nearest one: what others do to it falls with its distance to that. Chosen with three models of
# benchmarks/gallery in sight (Rayleigh, loss, rotating).
_SHIFTS = np.array([0.05 - 0.05j, 0.2 - 0.15j, 0.6 - 0.4j])
Pairs = tuple[np.ndarray, np.ndarray, np.ndarray]  # λ (k,), right and left vectors (r, k)


@dataclass(frozen=True)
class Quadratic:
    """Q(λ) = λ²M + λC + K, all (r, r), C None where nothing depends on velocity; `highest` is in rad/s."""

    M: np.ndarray
    C: np.ndarray | None
    K: np.ndarray
    highest: float

    def projected(self, U: np.ndarray, W: np.ndarray) -> Pairs:
        """Return λ up to `GUARDED` times `highest`, by rising frequency, and the modes in the spans of U and W (r, m).

        Raises
        ------
        LinAlgError
            WᴴMU is singular.
        """
        h, adjoint = self.highest, W.conj().T
        mass = h**2 * (adjoint @ (self.M @ U))  # eigenvalues in multiples of h
        K = la.solve(mass, adjoint @ (self.K @ U))
        if self.C is None:
            theta, y, x = la.eig(K, left=True, right=True)
            lam = 1j * np.sqrt(theta.astype(complex))
        else:
            C = la.solve(mass, h * (adjoint @ (self.C @ U)))
            m = len(K)
            A = np.block([[np.zeros((m, m)), np.eye(m)], [-K, -C]])
            lam, y, x = la.eig(A, left=True, right=True)
            x, y = x[:m], y[m:]
        at = np.flatnonzero((np.abs(lam) <= GUARDED) & (lam.imag >= 0))
        at = at[np.argsort(lam.imag[at], kind="stable")]
        return h * lam[at], U @ x[:, at], W @ la.solve(mass.conj().T, y[:, at])

    def corrected(
        self, lam: np.ndarray, right: np.ndarray, left: np.ndarray, wanted: int, enough: float
    ) -> Pairs | None:  # fmt: skip
        """Return modes corrected until the relative error of the first λ of them is small enough; None if it stays.

        Of the others those are returned that are as exact by then, or nearly.

        Each λ is the root of ψᴴQ(λ)φ near it, and off by less than ‖Q(λ)ᴴψ‖‖Q(λ)φ‖/|ψᴴQ'(λ)φ| in the norm of
        coordinates, see `ReducedBasis`. As there, modes near a double eigenvalue are known less well.
        """
        nearest = np.abs(-((lam[:, None] / self.highest) ** 2) - _SHIFTS).argmin(axis=1)
        try:
            factors = [(np.flatnonzero(nearest == i), self._factor(i)) for i in np.unique(nearest)]
        except la.LinAlgError:
            return None
        x, y, worst = right, left, np.inf
        for _ in range(_ROUNDS):
            x, y = x / np.linalg.norm(x, axis=0), y / np.linalg.norm(y, axis=0)
            Mx, Kx = lift(self.M, x), lift(self.K, x)
            Cx = np.zeros_like(Mx) if self.C is None else lift(self.C, x)
            for _ in range(2):  # steps of Newton's method
                slope = np.einsum("ij,ij->j", y.conj(), 2 * lam * Mx + Cx)
                lam = lam - np.einsum("ij,ij->j", y.conj(), lam**2 * Mx + lam * Cx + Kx) / slope
            rho, eta = lam**2 * Mx + lam * Cx + Kx, self._adjoint(lam, y)
            scale = 1 / np.maximum(np.abs(slope * lam), np.finfo(float).tiny)
            # Both residuals are to be small, not their product alone: they are added to what lies outside the basis.
            size = np.maximum(np.linalg.norm(rho, axis=0), np.linalg.norm(eta, axis=0))
            masses = [np.einsum("ij,ij->j", u.conj(), v).real for u, v in ((x, Mx), (y, lift(self.M, y)))]
            condition = scale * np.minimum(np.abs(lam) ** 2 * np.sqrt(np.maximum(masses[0] * masses[1], 0.0)), 1.0)
            error = size**2 * scale / np.maximum(condition / ILL, 1.0)
            before, worst = worst, float(error[:wanted].max(initial=0.0))
            if worst <= enough:
                known = np.flatnonzero((error <= _NEARLY * enough) | (np.arange(len(lam)) < wanted))
                return lam[known], x[:, known], y[:, known]
            if not worst < before:  # also where it is not a number
                return None
            for at, lu in factors:
                x[:, at] -= la.lu_solve(lu, rho[:, at], check_finite=False)
                y[:, at] -= la.lu_solve(lu, eta[:, at], trans=2, check_finite=False)
        return None

    def _factor(self, i: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the factors of Q at one of the shifts; raises LinAlgError if it is singular there."""
        s = self.highest * np.sqrt(-_SHIFTS[i])
        Q = s**2 * self.M + self.K
        return regular_lu(Q if self.C is None else Q + s * self.C)

    def _adjoint(self, lam: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return Q(λ)ᴴψ."""
        conjugate = lam.conj()
        eta = conjugate**2 * lift(self.M.T, y) + lift(self.K.conj().T, y)
        return eta if self.C is None else eta + conjugate * lift(self.C.conj().T, y)
