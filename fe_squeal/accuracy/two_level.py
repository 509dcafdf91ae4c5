"""Solves on the refined mesh with factors of the coarse problem."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..eigen.blocks import times
from ..eigen.linear.factor import Solve
from ..eigen.linear.refinement import in_single

_ITERATIONS, _FEWEST = 60, 4  # steps of conjugate gradients, at most and at least
_SETTLED = 0.05  # of the energy ½ xᵀPx so far: the conjugate gradients end where a step leaves less
_NESTED = 0.03  # of the energy of soft functions of the coarse mesh: how far that on the refined mesh may be off
# Steps on a random vector, and the largest κ that they may show. By then they see about a third of it; 150 to 200 are
# usual for discs with pads, 400 where elements are five times as wide as thick, 7000 where they are a hundred times.
_PROBED, _SLOW, _SEED = 20, 600.0, 20261130
_ROWS = 4096  # whose products are summed in single precision: sums of many more would lose digits
_COLUMNS = 32  # right-hand sides that are solved at once: more take memory, and no less time


class TwoLevelSolver:
    """Applies P⁻¹ on the refined mesh by conjugate gradients, preconditioned by B = diag(P)⁻¹ + E P_coarse⁻¹ Eᵀ.

    The second summand is exact on what the coarse mesh can represent. What it cannot represent oscillates from node to
    node, and for such vectors the diagonal of P is equivalent to P up to a factor that does not depend on the mesh
    (Bank, Dupont, Yserentant, Numer. Math. 52, 1988), but does on the shape of its elements and on their material.

    Errors of some per cent do not matter, and all but the coarse solves is limited by the memory that it reads: so it
    is done in single precision (unless numbers are beyond that, see `in_single`). How slowly it converges is known from
    the spectrum of BP, which steps on a random vector show (Lanczos): the energy that is left falls by no less than
    ρ = ((√κ − 1)/(√κ + 1))² a step in the end, so that a step that adds g leaves up to g ρ/(1 − ρ).

    Where conjugate gradients would be slow or wrong P is factorised instead: flat elements and nearly incompressible
    ones make κ large, soft thin parts have less energy than single precision resolves, and functions of the coarse mesh
    have another energy on the refined one with elements of the mixed formulation.

    Parameters
    ----------
    P : (n_fine, n_fine) sparse, symmetric positive definite
    E : (n_fine, n_coarse) sparse
        The prolongation.
    coarse : callable
        Takes (n_coarse, k) to P_coarse⁻¹ times it.
    exactly : callable
        Factorises P, and returns what takes (n_fine, k) to P⁻¹ times it.

    Attributes
    ----------
    iterations : int
        Steps of conjugate gradients so far, each on a block of right-hand sides; 0 if P is factorised.
    """

    def __init__(
        self, P: sp.csr_array, E: sp.csr_array, coarse: Callable[[np.ndarray], np.ndarray], exactly: Callable[[], Solve]
    ) -> None:
        self._coarse, self._exactly, self.iterations = coarse, exactly, 0
        self._factors: Solve | None = None
        self._is_known = False  # whether conjugate gradients serve
        self._left = 0.0  # of what a step adds: what it leaves at most
        self._P = in_single(P)
        self._E = sp.csr_array((E.data.astype(self._P.dtype), E.indices, E.indptr), shape=E.shape)
        self._restriction = sp.csr_array(self._E.T)
        self._diagonal = self._P.diagonal()[:, None]

    @property
    def is_exact(self) -> bool:
        """Whether P was factorised."""
        return self._factors is not None

    def solve(self, B: np.ndarray, negligible: np.ndarray | float = 0.0) -> np.ndarray:
        """Return P⁻¹B for B (n_fine, k) real, with an error of a few per cent of each column in the energy norm.

        Parameters
        ----------
        B : (n_fine, k) float
        negligible : (k,) float, optional
            Energies xᵀPx so small that it does not matter whether they are found.

        Raises
        ------
        TooLargeError
            P has to be factorised, for which there is no memory.
        """
        limits = np.broadcast_to(negligible, B.shape[1])
        X, loaded = np.zeros(B.shape), np.flatnonzero(B.any(axis=0))  # imaginary parts of real vectors are zero
        if not len(loaded):
            return X
        if not self._is_known:
            self._is_known = True
            if not self._converges():
                self._factors = self._exactly()
        for own in np.array_split(loaded, -(-len(loaded) // _COLUMNS)):
            if self._factors is None:
                size = np.abs(B[:, own]).max(axis=0)  # numbers in single precision end at 1e38
                found = self._iterated((B[:, own] / size).astype(self._P.dtype), limits[own] / size**2)
                if found is not None:
                    X[:, own] = size * found
                    continue
                self._factors = self._exactly()
            X[:, own] = self._factors(B[:, own])
        return X

    def _converges(self) -> bool:
        """Return whether conjugate gradients are sure to serve, and find out how much a step of them may leave."""
        probe = np.random.default_rng(_SEED).standard_normal(self._diagonal.shape) * np.sqrt(self._diagonal)
        R = (probe / np.abs(probe).max()).astype(self._P.dtype)
        loads = times(self._restriction, R)
        soft = self._coarse(loads).astype(R.dtype)
        fine = times(self._E, soft)
        if not np.abs(_dots(fine, times(self._P, fine)) / _dots(soft, loads) - 1) <= _NESTED:
            return False
        Z = np.empty_like(R)
        self._precondition(R, Z)
        D, rz = Z.copy(), _dots(R, Z)
        alphas, betas = [], []
        for _ in range(_PROBED):
            AD = times(self._P, D)
            curvature = _dots(D, AD)
            if not (rz[0] > 0 and curvature[0] > 0):
                return False
            alphas.append(float(rz[0] / curvature[0]))
            R -= AD * R.dtype.type(alphas[-1])
            self._precondition(R, Z)
            before, rz = rz, _dots(R, Z)
            betas.append(float(rz[0] / before[0]))
            D = Z + D * R.dtype.type(betas[-1])
        least, most = _ends_of_spectrum(np.array(alphas), np.array(betas))
        if not least * _SLOW >= most:
            return False
        root = np.sqrt(most / least)
        falls = ((root - 1) / (root + 1)) ** 2
        self._left = falls / (1 - falls)
        return True

    def _iterated(self, B: np.ndarray, negligible: np.ndarray) -> np.ndarray | None:
        """Return P⁻¹B, or None where conjugate gradients break down or do not settle."""
        X, R, Z, part = np.zeros_like(B), B.copy(), np.empty_like(B), np.empty_like(B)
        self._precondition(R, Z)
        D, rz = Z.copy(), _dots(R, Z)
        energy = np.zeros(B.shape[1])
        for step in range(_ITERATIONS):
            AD = times(self._P, D)
            curvature = _dots(D, AD)
            if not ((rz >= 0) & ((curvature > 0) | (rz == 0))).all():
                return None
            alpha = np.divide(rz, curvature, out=np.zeros_like(rz), where=rz > 0)
            length = alpha.astype(D.dtype)
            X += np.multiply(D, length, out=part)
            R -= np.multiply(AD, length, out=part)
            gain = alpha * rz  # twice what this step adds to the energy ½ xᵀPx
            energy += gain
            self.iterations += 1
            if step + 1 >= _FEWEST and (self._left * gain <= np.maximum(_SETTLED * energy, negligible)).all():
                return X
            self._precondition(R, Z)
            before, rz = rz, _dots(R, Z)
            D *= np.divide(rz, before, out=np.zeros_like(rz), where=before > 0).astype(D.dtype)
            D += Z
        return None

    def _precondition(self, R: np.ndarray, Z: np.ndarray) -> None:
        """Write the preconditioner times R to Z."""
        np.divide(R, self._diagonal, out=Z)
        Z += times(self._E, self._coarse(times(self._restriction, R)).astype(Z.dtype, copy=False))


def _ends_of_spectrum(alphas: np.ndarray, betas: np.ndarray) -> tuple[float, float]:
    """Return the least and the largest eigenvalue that steps of conjugate gradients have seen, by Lanczos' matrix."""
    diagonal = 1 / alphas
    diagonal[1:] += betas[:-1] / alphas[:-1]
    seen = la.eigvalsh_tridiagonal(diagonal, np.sqrt(betas[:-1]) / alphas[:-1])
    return float(seen[0]), float(seen[-1])


def _dots(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Return the products xᵀy (k,) of the columns of X and Y (n, k)."""
    blocks = (slice(first, first + _ROWS) for first in range(0, len(X), _ROWS))
    return np.asarray(sum(np.einsum("ij,ij->j", X[rows], Y[rows]).astype(float) for rows in blocks))
