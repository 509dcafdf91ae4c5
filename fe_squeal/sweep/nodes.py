"""The modes at one value of the parameter, with matrices by which modes at other values are compared with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
from scipy.sparse.csgraph import connected_components

from ..eigen.pencil import Modes
from ..problem.problem import Problem
from ..problem.terms import POWER, Slot

_PARALLEL = 1e-9  # 1 − MAC of two modes below which they are one, that of a defective double eigenvalue
_EQUAL = 1e-6  # relative distance of the two eigenvalues there
_ASIDE = 1e-6  # of such an eigenvalue: distance of the shift of inverse iteration, or the matrix would be singular
_ROUNDS, _SEED = 4, 20261122


@dataclass(frozen=True)
class Basis:
    """Right and left vectors of a group of eigenvalues, with the matrices that stand for these.

    Attributes
    ----------
    right, left : (r, m) complex
    H, HL : (m, m) complex
        M U H² + C U H + K U = 0 and HL² WᴴM + HL WᴴC + WᴴK = 0, or K U = M U H and WᴴK = HL WᴴM without dampers.
    """

    right: np.ndarray
    left: np.ndarray
    H: np.ndarray
    HL: np.ndarray

    def changed(self, S: np.ndarray, T: np.ndarray) -> Basis:
        """Return the same group with right vectors U S⁻¹ and left ones W T⁻¹."""
        inverse, other = la.inv(S), la.inv(T)
        H, HL = S @ self.H @ inverse, other.conj().T @ self.HL @ T.conj().T
        return Basis(self.right @ inverse, self.left @ other, H, HL)


@dataclass(frozen=True)
class Node:
    """Modes at one value, in the coordinates of the step model.

    The eigenvalues v are θ = −λ² without dampers, where the problem is K φ = θ M φ, and λ with them. Without dampers
    λ and −λ have the same v and count once. With dampers and real matrices both λ and λ* are among the eigenvalues.

    Attributes
    ----------
    value : float
    v : (k,) complex
    right, left : (r, k) complex
    lam : (k,) complex
        Those of the modes.
    blur : (k,) float
        How far v may be off by rounding and residuals.
    unstable : (k,) bool
    M, K : (r, r)
    C : (r, r) float, or None where v is θ
    slopes : mapping of slot to (r, r)
        Derivatives of the matrices by the parameter, where they depend on it.
    paired : bool
        Whether every eigenvalue v that is not real has its conjugate beside it: real matrices without dampers.
    symmetric : bool
        Whether the matrices are symmetric: every v is real at every value, and no two become a complex pair.
    conservative : bool
        Whether every λ has −λ* beside it although there is C: gyroscopic forces and a symmetric stiffness.
    """

    value: float
    v: np.ndarray
    right: np.ndarray
    left: np.ndarray
    lam: np.ndarray
    blur: np.ndarray
    unstable: np.ndarray
    M: np.ndarray
    C: np.ndarray | None
    K: np.ndarray
    slopes: Mapping[Slot, np.ndarray]
    paired: bool
    symmetric: bool
    conservative: bool

    def __len__(self) -> int:
        return len(self.v)

    def all(self) -> Basis:
        """Return a basis of all modes, each by itself."""
        return Basis(self.right, self.left, np.diag(self.v), np.diag(self.v))

    def weighted(self, u: np.ndarray) -> np.ndarray:
        """Return vectors in units in which every unknown has the same mass; unknowns without mass stay as they are."""
        mass = self.M.diagonal()
        return np.asarray(np.sqrt(np.where(mass > 0, mass, 1.0))[:, None] * u)

    def basis(self, members: np.ndarray) -> Basis:
        """Return a basis of some of the modes.

        At a defective double eigenvalue two modes are the same; inverse iteration then finds the space of both.
        """
        right, left, v = self.right[:, members].copy(), self.left[:, members].copy(), self.v[members]
        H, HL = np.diag(v).astype(complex), np.diag(v).astype(complex)
        u = self.weighted(right)
        size = np.linalg.norm(u, axis=0)
        with np.errstate(all="ignore"):
            likeness = np.abs(u.conj().T @ u / np.outer(size, size)) ** 2
        near = np.abs(v[:, None] - v[None, :]) <= _EQUAL * np.abs(v)[:, None]
        one = near & (likeness > 1 - _PARALLEL)
        count, label = connected_components(one, directed=False)
        for i in range(count):
            s = np.flatnonzero(label == i)
            if len(s) > 1:
                right[:, s], H[np.ix_(s, s)] = self._invariant(v[s], len(s), adjoint=False)
                left[:, s], back = self._invariant(v[s], len(s), adjoint=True)
                HL[np.ix_(s, s)] = back.conj().T
        return Basis(right, left, H, HL)

    def _invariant(self, v: np.ndarray, m: int, adjoint: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return m vectors that span the invariant space of a multiple eigenvalue, and the matrix H on it."""
        M, K = (A.conj().T if adjoint else A for A in (self.M, self.K))
        if self.C is None:
            A, B = K, M
        else:
            C = self.C.T if adjoint else self.C
            zero, one = np.zeros_like(M), np.eye(len(M))
            A, B = np.block([[zero, one], [-K, -C]]), la.block_diag(one, M)
        mean = v.mean().conj() if adjoint else v.mean()
        factors = la.lu_factor(A - mean * (1 + _ASIDE) * B)
        X = np.random.default_rng(_SEED).standard_normal((len(A), m)).astype(complex)
        for _ in range(_ROUNDS):
            X = la.qr(la.lu_solve(factors, B @ X), mode="economic")[0]
        H = la.lstsq(B @ X, A @ X)[0]
        return X[: len(M)], H

    @property
    def shift(self) -> float:
        """Return how far the quotients of right and left vectors lie from v, of all modes the largest share of |v|."""
        if not len(self.v):
            return 0.0
        U, W, v = self.right, self.left.conj(), self.v
        MU = self.M @ U
        rest = self.K @ U - MU * v if self.C is None else MU * v**2 + (self.C @ U) * v + self.K @ U
        slope = MU if self.C is None else 2 * MU * v + self.C @ U
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.abs(np.einsum("ij,ij->j", W, rest) / (np.einsum("ij,ij->j", W, slope) * v))
        return float(np.nan_to_num(share, nan=0.0, posinf=0.0).max())

    @cached_property
    def rates(self) -> np.ndarray:
        """Return dv/dp (k,) of every mode by itself; not finite at a double eigenvalue."""
        modes = self.all()
        with np.errstate(all="ignore"):
            return np.asarray(self.push(modes).diagonal() / self.cross(modes, modes).diagonal())

    def cross(self, own: Basis, other: Basis) -> np.ndarray:
        """Return WᴴMU, or HL WᴴMU + WᴴMU H + WᴴCU with dampers, of left vectors here with right vectors elsewhere.

        This is the product of left with right vectors of K φ = θ M φ, or of the linearised problem
        [[0, 1], [−K, −C]] z = λ diag(1, M) z, z = (φ, λφ), whose left vector ends with ψ. It is zero between modes of
        one value with different v.
        """
        W = own.left.conj().T
        product = W @ self.M @ other.right
        if self.C is None:
            return np.asarray(product)
        return np.asarray(own.HL @ product + product @ other.H + W @ self.C @ other.right)

    def push(self, own: Basis) -> np.ndarray:
        """Return Wᴴ(∂K U − ∂M U H), or −Wᴴ(∂M U H² + ∂C U H + ∂K U): how the parameter moves the eigenvalues."""
        total = np.zeros((own.left.shape[1], own.right.shape[1]), complex)
        for slot, A in self.slopes.items():
            moved = own.left.conj().T @ (A @ own.right)
            if self.C is None:
                total += moved if slot == "K" else -moved @ own.H
            else:
                total -= moved @ np.linalg.matrix_power(own.H, POWER[slot])
        return total


def node_of(
    problem: Problem, parameter: str, value: float, modes: Modes, shapes: tuple[np.ndarray, np.ndarray]
) -> Node:  # fmt: skip
    """Return the node of a value.

    Parameters
    ----------
    problem : Problem
        The step model.
    modes : Modes
        Rigid motions at λ = 0 are left out, and without dampers λ = −s beside λ = s.
    shapes : (r, k) right and left vectors
        Of these modes in the coordinates of the step model.
    """
    pencil = problem.pencil({parameter: value})
    plain = pencil.C is None and not any(t.slot == "C" for t in problem.terms)
    paired = plain and not any(t.imaginary for t in problem.terms)
    index = np.flatnonzero((modes.lam.imag > 0) | (modes.lam.real > 0) | ((modes.lam.real < 0) & (not plain)))
    lam, spread = modes.lam[index], modes.re_uncertainty[index]
    unstable = modes.stability[index] == "unstable"
    right, left = (s[:, index].astype(complex) for s in shapes)
    if not plain and not any(t.imaginary for t in problem.terms):  # a pair λ, λ* may meet on the real axis
        lower = lam.imag > 0
        lam, spread = np.concatenate([lam, lam[lower].conj()]), np.concatenate([spread, spread[lower]])
        right, left = (np.hstack([u, u[:, lower].conj()]) for u in (right, left))
        unstable = np.concatenate([unstable, unstable[lower]])
    v = -(lam**2) if plain else lam
    blur = np.maximum(2 * np.abs(lam) * spread, spread**2) if plain else spread
    slopes: dict[Slot, np.ndarray] = {}
    for slot in POWER:
        d = problem.derivative(parameter, slot, {parameter: value})
        if d is not None:
            slopes[slot] = d.toarray()
    M, K = pencil.M.toarray(), pencil.K.toarray()
    C = None if plain else np.zeros_like(M) if pencil.C is None else pencil.C.toarray()
    symmetric = paired and all(t.symmetric for t in problem.terms)
    conservative = not plain and all(t.conservative for t in problem.terms)
    return Node(value, v, right, left, lam, blur, unstable, M, C, K, slopes, paired, symmetric, conservative)
