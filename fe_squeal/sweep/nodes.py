"""The modes at one value of the parameter, with the matrices by which modes at other values are compared with them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la
from scipy.sparse.csgraph import connected_components

from ..eigen.blocks import lift
from ..eigen.pencil import Modes
from ..problem.problem import Problem
from ..problem.terms import POWER, Slot

# Two modes are taken for the one mode of a defective double eigenvalue if their eigenvalues differ by less than _EQUAL,
# relatively, and 1 − MAC of their shapes is less than _PARALLEL.
_PARALLEL = 1e-9
_EQUAL = 1e-6
_ASIDE = 1e-6  # of such an eigenvalue: the shift of inverse iteration is so far from it that the matrix is regular
_REAL = 1e-12  # of the largest entry: so small an imaginary part of the mode of a real eigenvalue is rounding
_OWN = 0.9  # likeness: modes that resemble one another less have shapes of their own
_ROUNDS, _SEED = 4, 20261122  # rounds of inverse iteration, and the seed of its random start


@dataclass(frozen=True)
class Basis:
    """Right and left bases of a group of m eigenvalues, and matrices whose eigenvalues these are.

    Attributes
    ----------
    right, left : (r, m) complex
        The bases U and W.
    H, HL : (m, m) complex
        The matrices with K U = M U H and WᴴK = HL WᴴM; with dampers M U H² + C U H + K U = 0 and
        HL² WᴴM + HL WᴴC + WᴴK = 0.
    """

    right: np.ndarray
    left: np.ndarray
    H: np.ndarray
    HL: np.ndarray

    def changed(self, S: np.ndarray, T: np.ndarray) -> Basis:
        """Return the same group with the right basis U S⁻¹ and the left basis W T⁻¹; S and T are (m, m)."""
        inverse, other = la.inv(S), la.inv(T)
        H, HL = S @ self.H @ inverse, other.conj().T @ self.HL @ T.conj().T
        return Basis(self.right @ inverse, self.left @ other, H, HL)

    def real(self) -> Basis:
        """Return the same group, of real matrices without dampers, with real bases; itself where that is not possible.

        Its eigenvalues have to be real or in conjugate pairs, and the columns of the bases its modes. With K u = v M u
        the real and the imaginary part of u span what u and its conjugate do: K [Re u, Im u] = M [Re u, Im u] B with
        B = [[Re v, Im v], [−Im v, Re v]].
        """
        v = self.H.diagonal()
        upper, lower, alone = (np.flatnonzero(f) for f in (v.imag > 0, v.imag < 0, v.imag == 0))
        plain = not (self.H - np.diag(v)).any() and not (self.HL - np.diag(v)).any()
        if not plain or sorted(v[upper].tolist(), key=_parts) != sorted(v[lower].conj().tolist(), key=_parts):
            return self
        columns = []
        for u in (self.right, self.left):
            one = u[:, alone]
            largest = np.take_along_axis(one, np.abs(one).argmax(axis=0)[None, :], axis=0)
            one = one / np.where(largest == 0, 1.0, largest)
            if np.abs(one.imag).max(initial=0.0) > _REAL:
                return self
            columns.append(np.hstack([one.real, u[:, upper].real, u[:, upper].imag]))
        a, b = np.diag(v[upper].real), np.diag(v[upper].imag)
        H = la.block_diag(np.diag(v[alone].real), np.block([[a, b], [-b, a]]))
        return Basis(columns[0], columns[1], H, H)


def _parts(z: complex) -> tuple[float, float]:
    return z.real, z.imag


@dataclass(frozen=True)
class Node:
    """Modes at one value, in the coordinates of the step model.

    The eigenvalues v are θ = −λ² without dampers, where the problem is K φ = θ M φ, and λ with them. Without dampers
    λ and −λ have the same v and count once. With dampers and real matrices both λ and λ* are among the eigenvalues.

    Attributes
    ----------
    value : float
        Value of the parameter.
    v : (k,) complex
        The eigenvalues: θ, rad²/s², or λ, rad/s.
    right, left : (r, k) complex
        Right and left vectors of the modes.
    lam : (k,) complex, rad/s
        λ of the modes.
    blur : (k,) float
        How far v may be off by rounding and residuals, in the unit of v.
    unstable : (k,) bool
    M, K : (r, r) float or complex
    C : (r, r) float or None
        None without dampers, where v is θ.
    slopes : mapping of "M", "C" or "K" to (r, r)
        Derivatives by the parameter of those matrices that depend on it.
    paired : bool
        Whether v is real or has its conjugate among the eigenvalues: the matrices are real and there are no dampers.
    symmetric : bool
        Whether the matrices are symmetric, so that every v is real at every value and no two become a complex pair.
    conservative : bool
        Whether −λ* is an eigenvalue for every λ although there is C: gyroscopic forces and a symmetric stiffness.
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

    @property
    def is_complex(self) -> bool:
        """Whether a matrix is complex, as of losses that hold at each mode's own frequency."""
        return np.iscomplexobj(self.K)

    def noise_of_copies(self, width: float, apart: float) -> float:
        """Return by how much, relatively, slopes part eigenvalues of copies over a width of the parameter.

        The parameter moves them all alike and couples none with another, up to the errors of their shapes. Copies are
        modes of their own shapes whose eigenvalues are closer than `apart`, relatively.
        """
        copies = _are_copies(self.v, self.right, apart)
        if not copies.any():
            return 0.0
        push, own = self.own
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = push / own[:, None] / self.v[:, None]
        unlike = slopes.diagonal()[:, None] - slopes.diagonal()[None, :]
        noise = np.maximum(np.abs(slopes), np.abs(unlike))[copies]
        return float(width * np.nan_to_num(noise, nan=0.0, posinf=0.0).max())

    def all(self) -> Basis:
        """Return the basis of all modes, whose columns are the modes themselves."""
        return Basis(self.right, self.left, np.diag(self.v), np.diag(self.v))

    def weighted(self, u: np.ndarray) -> np.ndarray:
        """Return vectors u (r, k) with every row times the root of its mass, so that rows are of one unit.

        Rows of unknowns without mass stay as they are.
        """
        mass = self.M.diagonal()
        return np.asarray(np.sqrt(np.where(mass > 0, mass, 1.0))[:, None] * u)

    def basis(self, members: np.ndarray) -> Basis:
        """Return a basis of some of the modes; `members` (m,) int are their positions.

        At a defective double eigenvalue two modes have the same vector. The space of dimension two that belongs to the
        eigenvalue is then found by inverse iteration.
        """
        right, left, v = self.right[:, members].copy(), self.left[:, members].copy(), self.v[members]
        H, HL = np.diag(v).astype(complex), np.diag(v).astype(complex)
        near = np.abs(v[:, None] - v[None, :]) <= _EQUAL * np.abs(v)[:, None]
        if np.count_nonzero(near) <= len(v):  # each eigenvalue is near itself alone
            return Basis(right, left, H, HL)
        u = self.weighted(right)
        size = np.linalg.norm(u, axis=0)
        with np.errstate(all="ignore"):
            likeness = np.abs(u.conj().T @ u / np.outer(size, size)) ** 2
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
        """Return m vectors that span the invariant space of nearly equal eigenvalues v (m,), and the matrix H on it."""
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

    @cached_property
    def shift(self) -> float:
        """Return the largest relative difference between v of a mode and the quotient of its right and left vector.

        The quotient is the eigenvalue that the matrices of the step model give for these vectors.
        """
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
    def lengths(self) -> tuple[np.ndarray, np.ndarray]:
        """√(φᴴMφ) and √(ψᴴMψ), both (k,), of right and left vectors."""
        right, left = (
            np.sqrt(np.maximum(np.einsum("ij,ij->j", u.conj(), lift(self.M, u)).real, np.finfo(float).tiny))
            for u in (self.right, self.left)
        )
        return right, left

    @cached_property
    def own(self) -> tuple[np.ndarray, np.ndarray]:
        """`push` (k, k) of all modes, and the diagonal (k,) of `cross` of all modes with themselves."""
        modes = self.all()
        return self.push(modes), self.cross(modes, modes).diagonal()

    @cached_property
    def rates(self) -> np.ndarray:
        """dv/dp (k,) of every mode; not finite at a double eigenvalue."""
        push, own = self.own
        with np.errstate(all="ignore"):
            return np.asarray(push.diagonal() / own)

    def moved(self, value: float) -> Node | None:
        """Return the node of a value very near by, with eigenvalues and stability alone: right and left are those here.

        The matrix of all known modes as one group is diag(v) here, and changes by `push` over `cross`, the projection
        on right and left modes. What it leaves out is of second order in the distance. Rounding blurs eigenvalues there
        as it does here; of two that meet between the values it does so too, for that depends on how near they are.

        Returns
        -------
        Node or None
            None for complex stiffness, of which stability is not judged by Re λ alone, and for modes that are equal up
            to rounding.
        """
        if not len(self) or np.iscomplexobj(self.K) or not (self.paired or self.C is not None):
            return None
        modes = self.all()
        gram = self.cross(modes, modes)
        with warnings.catch_warnings():
            warnings.simplefilter("error", la.LinAlgWarning)
            try:
                H = np.diag(self.v) + (value - self.value) * la.solve(gram, self.own[0])
            except (la.LinAlgError, la.LinAlgWarning, ValueError):
                return None
        v = la.eigvals(H)
        blur = self.blur[np.abs(v[:, None] - self.v[None, :]).argmin(axis=1)]
        v = np.where(np.abs(v.imag) <= blur, v.real, v)  # the modes are complex, and leave rounding in a real one
        if self.C is not None:
            return replace(self, value=value, v=v, lam=v, blur=blur, unstable=v.real > blur)
        lam = 1j * np.sqrt(v)
        lam = np.where((v.real < -blur) & (v.imag == 0), np.abs(lam), lam)
        lam = np.where(np.abs(v) <= blur, 0.0, lam)
        return replace(self, value=value, v=v, lam=lam, blur=blur, unstable=lam.real > spread_of(lam, blur))

    def cross(self, own: Basis, other: Basis) -> np.ndarray:
        """Return the products (m, l) of the left vectors of `own` with the right vectors of `other`.

        They are WᴴMU, or with dampers HL WᴴMU + WᴴMU H + WᴴCU. That is the product of left and right vectors of
        K φ = θ M φ, or of the linearised problem [[0, 1], [−K, −C]] z = λ diag(1, M) z with z = (φ, λφ) and a left
        vector that ends with ψ. For two modes at the same value with different v it is zero.
        """
        W = own.left.conj().T
        product = W @ lift(self.M, other.right)
        if self.C is None:
            return np.asarray(product)
        return np.asarray(own.HL @ product + product @ other.H + W @ lift(self.C, other.right))

    def push(self, own: Basis) -> np.ndarray:
        """Return how the parameter moves a group: Wᴴ(∂K U − ∂M U H), or with dampers −Wᴴ(∂M U H² + ∂C U H + ∂K U).

        ∂ is the derivative by the parameter. The result (m, m) is divided by `cross(own, own)` to give dH/dp.
        """
        total = np.zeros((own.left.shape[1], own.right.shape[1]), np.result_type(own.left, own.right, own.H))
        for slot, A in self.slopes.items():
            moved = own.left.conj().T @ lift(A, own.right)
            if self.C is None:
                total += moved if slot == "K" else -moved @ own.H
            else:
                total -= moved @ np.linalg.matrix_power(own.H, POWER[slot])
        return total


def spread_of(lam: np.ndarray, blur: np.ndarray) -> np.ndarray:
    """Return how far (k,) Re λ may be off where θ = −λ² may be off by `blur` (k,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.fmin(blur / (2 * np.abs(lam)), np.sqrt(blur)))


def _are_copies(v: np.ndarray, right: np.ndarray, apart: float) -> np.ndarray:
    """Return which pairs (k, k) of eigenvalues may be those of copies.

    They are closer than `apart`, relatively, and have shapes of their own; those of a nearly defective pair have one.
    """
    near = np.abs(v[:, None] - v[None, :]) <= apart * np.abs(v)[:, None]
    np.fill_diagonal(near, False)
    if not near.any():
        return near
    u = right / np.linalg.norm(right, axis=0)
    return np.asarray(near & (np.abs(u.conj().T @ u) ** 2 < _OWN))


def node_of(
    problem: Problem, parameter: str, value: float, modes: Modes, shapes: tuple[np.ndarray, np.ndarray],
    apart: float = 0.0,
) -> Node:  # fmt: skip
    """Return the node of modes at one value.

    Parameters
    ----------
    problem : Problem
        The step model.
    parameter : str
    value : float
        Value of the parameter.
    modes : Modes
        Motions with λ = 0 are left out, and without dampers those with real λ < 0, whose θ is that of −λ.
    shapes : ((r, k), (r, k)) float or complex
        Right and left vectors of these modes in the coordinates of the step model.
    apart : float
        How far eigenvalues of copies may be apart, relatively, by more than rounding.
    """
    pencil = problem.pencil({parameter: value})
    plain = pencil.C is None and not any(t.slot == "C" for t in problem.terms)
    paired = plain and not any(t.imaginary for t in problem.terms)
    index = np.flatnonzero((modes.lam.imag > 0) | (modes.lam.real > 0) | ((modes.lam.real < 0) & (not plain)))
    lam, spread = modes.lam[index], modes.re_uncertainty[index]
    unstable = modes.stability[index] == "unstable"
    right, left = (s[:, index].astype(complex) for s in shapes)
    # With dampers and real matrices λ* is added to every λ, since the two may meet on the real axis.
    if not plain and not any(t.imaginary for t in problem.terms):
        lower = lam.imag > 0
        lam, spread = np.concatenate([lam, lam[lower].conj()]), np.concatenate([spread, spread[lower]])
        right, left = (np.hstack([u, u[:, lower].conj()]) for u in (right, left))
        unstable = np.concatenate([unstable, unstable[lower]])
    v = -(lam**2) if plain else lam
    blur = np.maximum(2 * np.abs(lam) * spread, spread**2) if plain else spread
    if paired and apart:
        distance = np.where(_are_copies(v, right, apart), np.abs(v[:, None] - v[None, :]), 0.0)
        blur = np.maximum(blur, distance.max(axis=1, initial=0.0))
        unstable &= lam.real > spread_of(lam, blur)
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
