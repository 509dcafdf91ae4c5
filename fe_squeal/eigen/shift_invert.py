"""The shift-inverted operator of a pencil, on those unknowns alone that have inertia or damping."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import DTypeLike
from scipy.sparse.linalg import ArpackError, ArpackNoConvergence, LinearOperator, eigs, eigsh

from ..errors import NotConvergedError
from .blocks import lift
from .deflation import Deflation
from .dense import DENSE_LIMIT
from .disc import largest_within, room_for
from .free_modes import FreeModes, States
from .linear.choice import choose, factorize
from .linear.factor import Factor, LinearSolver, SingularError, Solve
from .linear.spread_matrix import in_rows, sizes_times
from .memory import require_vectors
from .pencil import Pencil
from .threads import one_openblas_thread

_SEED = 20240607
# Relative accuracy asked of 1/(θ − σ): the residuals of the modes then lie at the level of rounding. A looser one would
# save little, because the last restart gains several digits at once.
_TOLERANCE = 1e-13
# All eigenvalues of the operator by LAPACK are safer than Krylov steps. They cost less up to _SMALL unknowns, or where
# one in _SHARE of them is wanted anyway; of large ones, where most are.
_SMALL, _SHARE, _MOST_OF = 100, 4, 1.5
_FULL = 6  # full matrices of the operator's size that LAPACK and what goes into it take
# Vectors that are multiplied at once: solves for several right-hand sides read the factors once for all of them. Of 4
# to 16 this took the least time for 54 modes of strong friction on 7 257 and 24 789 unknowns. Restarts, at most. With
# fewer unknowns than the last number ARPACK is quicker, whose projected matrices are smaller: blocks took 1.4 times its
# time for 50 modes of 3 078 unknowns.
_BLOCK, _RESTARTS, _IN_BLOCKS = 8, 100, 5000
_APART = 1e-6  # of a shift: an eigenvalue that is nearer is the shift itself
_ALIKE = 1e3  # ratio of units of the unknowns up to which scaling is not worth a copy of the matrices

Pairs = tuple[np.ndarray, np.ndarray]  # eigenvalues (k,), vectors (n, k)


class ShiftInverted:
    """(K − σM)⁻¹M, or the inverse of the shifted linearisation of λ²M + λC + K, with eigenvalues 1/(θ − σ), 1/(λ − σ).

    Unknowns without mass (nodes that only carry springs, Lagrange multipliers) follow the others statically. As
    unknowns of the operator they would bring eigenvalues 0 in Jordan blocks, whose rounding looks like modes, and parts
    of the vectors that the M-norm of a Krylov method does not see; so it acts on the others, and its vectors are
    expanded by a solve in the end. With C the state is (u, λu/σ): u of unknowns with mass or damping, λu of those with
    mass.

    Time has the pencil's own unit, since ARPACK takes eigenvalues below 1e-11 for zero. Unknowns of unlike units
    (rotations beside translations, penalties) are scaled: the norm of a Krylov space would see the large ones alone.

    Parameters
    ----------
    sigma : float, or complex with C
        A shift of θ, rad²/s², with C one of λ, rad/s.
    free : FreeModes, optional
        What is known of motions that nothing holds. Their eigenvalues, multiple and with damping defective, are taken
        out of the operator by the spectral projector. In their place it has zero, the image of an infinite eigenvalue.
    known : pair of States, optional
        States of other modes that are known already, of the problem and of the adjoint one, to be taken out as well.
    linear_solver : LinearSolver or str
        Factorises the shifted matrices.

    Attributes
    ----------
    negative_pivots : int or None
        Number of negative pivots of K − σM if K is symmetric; None otherwise.
    linear_solver : LinearSolver
    size : int
        Number of unknowns of the operator.
    """

    def __init__(
        self, pencil: Pencil, sigma: complex, free: FreeModes | None = None, linear_solver: LinearSolver | str = "auto",
        known: tuple[States, States] | None = None,
    ) -> None:  # fmt: skip
        d, omega0 = pencil.units
        self._d = d if d.max() > _ALIKE * d.min() else None
        self._unit = omega0**2 if pencil.C is None else omega0
        self.pencil = pencil = _scaled(pencil, self._d, omega0)
        self.sigma, self._shift = sigma, sigma / self._unit
        self.linear_solver = choose(linear_solver)
        self._factor = self._factorized(self._shift)
        self.negative_pivots = self._factor.negative_pivots
        mass = occupied(pencil.M)
        active = mass if pencil.C is None else mass | occupied(pencil.C)
        self._active, self._mass = np.flatnonzero(active), np.flatnonzero(mass)
        self._moving = np.flatnonzero(mass[active])  # those with mass among the active ones
        self.size = len(self._active) + (0 if pencil.C is None else len(self._mass))
        if not len(self._mass):
            raise NotConvergedError("no unknown has a mass")
        out = [] if free is None else [(free.states, free.adjoint_states)]
        if known is not None:
            out.append(known)
        # States of the problem, and of the adjoint one, that are taken out.
        self._out = [
            self._own_units((np.hstack([s[0] for s in states]), np.hstack([s[1] for s in states])), d, omega0)
            for states in zip(*out, strict=True)
        ]
        self._deflations: dict[bool, Deflation] = {}
        self._motions: tuple[np.ndarray, np.ndarray] | None = None  # what a symmetric pencil's operator takes out

    def largest(self, count: int, adjoint: bool = False) -> Pairs:
        """Return the θ or λ nearest the shift and the vectors u; fewer where there are no more.

        Parameters
        ----------
        adjoint : bool
            Whether to solve the adjoint problem, whose vectors are the left modes of λ*, nearest the shift's conjugate.

        Raises
        ------
        NotConvergedError
            `partial` has the λ (k,) and vectors u (n, k) that converged; None of the adjoint problem.
        SingularError
            The shift is an eigenvalue.
        """
        apply, finish, dtype = self._operator(adjoint)
        if self.takes_all(count):
            require_vectors(self.size, _FULL * self.size, np.dtype(dtype).itemsize)
            nu, z = la.eig(apply(np.eye(self.size, dtype=dtype)))
            order = np.argsort(-np.abs(nu), kind="stable")[:count]
            return finish(nu[order], z[:, order])
        if not self.in_blocks:
            operator, v0 = _operator(self.size, apply, dtype), _start(self.size).astype(dtype)
            basis, remain = _basis_size(count, self.size), self._remain(adjoint)
            v0 = v0 if remain is None else remain(v0)
            require_vectors(self.size, basis + 2 * count, v0.itemsize)
            return self._run(
                lambda: eigs(operator, count, which="LM", tol=_TOLERANCE, v0=v0, ncv=basis), finish, count, adjoint
            )
        with one_openblas_thread():
            nu, z, _ = largest_within(apply, self.size, np.inf, count, _RESTARTS, block=_BLOCK)
        if np.abs(nu).max(initial=0.0) * _APART * abs(self._shift) > 1:  # beside it others would be inexact
            raise SingularError(f"the shift {self.sigma:.6g} is an eigenvalue")
        if len(nu) < count:
            found = None if adjoint else self.eigenpairs(*finish(nu, z))
            raise NotConvergedError(f"block Krylov-Schur: {len(nu)} of {count} modes converged", found)
        return finish(nu, z)

    def within(
        self, radius: float, most: int, adjoint: bool = False, restarts: int = 12, draw: int = 0,
        needed: Callable[[np.ndarray], np.ndarray] | None = None, least: int = 0,
    ) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
        """Return the θ or λ in a disc around the shift, the vectors u, and a radius inside which these are all.

        Parameters
        ----------
        radius : float
            In the unit of the shift.
        most : int
            Largest number of eigenvalues to look for; if there are more, the radius returned is smaller.
        adjoint : bool
            As for `largest`.
        restarts, draw, least : int
            As for `largest_within`.
        needed : callable, optional
            As for `largest_within`, of θ or λ (k,).
        """
        apply, finish, dtype = self._operator(adjoint)
        if self.size <= room_for(most) + most:
            nu, z = la.eig(apply(np.eye(self.size, dtype=dtype)))
            inside = np.abs(nu) * radius > self._unit
            return *finish(nu[inside], z[:, inside]), radius

        def patient(nu: np.ndarray) -> np.ndarray:
            values = self.sigma + self._unit / (nu.conj() if adjoint else nu)
            return np.zeros(len(nu), bool) if needed is None else needed(values)

        with one_openblas_thread():
            nu, z, known = largest_within(
                apply, self.size, radius / self._unit, most, restarts, draw, patient, least=least
            )
        return *finish(nu, z), known * self._unit

    def _operator(self, adjoint: bool) -> tuple[Solve, Callable[[np.ndarray, np.ndarray], Pairs], DTypeLike]:
        """Return the operator on columns z, what makes θ or λ and u of its eigenvalues and vectors, and its type."""
        solve = self._factor.solve_adjoint if adjoint else self._factor.solve
        respond = (self._undamped if self.pencil.C is None else self._damped)(solve, adjoint)
        shift = np.conj(self._shift) if adjoint else self._shift
        dtype, k = np.result_type(self.pencil.K.dtype, type(self._shift)), len(self._active)

        def step(z: np.ndarray) -> np.ndarray:
            u = respond(z)
            if self.pencil.C is None:
                return u[self._active]
            return np.concatenate([u[self._active], u[self._mass] + z[:k][self._moving] / shift])

        remain = self._remain(adjoint)

        def apply(z: np.ndarray) -> np.ndarray:
            return step(z) if remain is None else remain(step(remain(z)))

        def finish(nu: np.ndarray, z: np.ndarray) -> Pairs:
            nu, z = _nonzero(nu, z, self.size)
            u = z[:k] if k == self.pencil.n or not len(nu) else respond(z)
            return self._unit * (shift + 1 / nu), self._in_units(u if len(nu) else np.zeros((self.pencil.n, 0), dtype))

        return apply, finish, dtype

    def largest_symmetric(self, count: int, which: str, tolerance: float = _TOLERANCE) -> Pairs:
        """Return θ and φ of an undamped symmetric pencil: those nearest the shift ("LM"), or those below it ("SA")."""
        n, sigma, rows = self.pencil.n, self._shift, self._active
        M = sp.csr_array(_columns(self.pencil.M, rows)[rows]) if self.size < n else self.pencil.M
        respond = self._without_free
        if self.takes_all(count):
            require_vectors(self.size, _FULL * self.size, 8)
            root = _root(M.toarray())
            x = respond(self._factor.solve(self._pad(root)))
            nu, y = la.eigh(root.T @ x[rows])
            order = np.argsort(-np.abs(nu) if which == "LM" else nu)[:count]
            nu, y = _nonzero(nu[order], y[:, order], self.size)
            return self._unit * (sigma + 1 / nu), self._in_units(x @ y)
        require_vectors(self.size, _basis_size(count, self.size) + 2 * count, 8)
        mass = _operator(self.size, lambda u: M @ u, float)
        operator = _operator(self.size, lambda b: respond(self._factor.solve(self._pad(b)))[rows], float)
        v0 = respond(self._pad(_start(self.size)))[rows]

        def finish(theta: np.ndarray, x: np.ndarray) -> Pairs:
            _, index = _nonzero(1 / (theta - sigma), np.arange(len(theta))[None, :], self.size)
            theta, x = theta[index[0]], x[:, index[0]]
            # Where unknowns are left out or scaled, the M-norm may hardly see some: one more solve makes these right.
            plain = self.size == n and self._d is None
            return self._unit * theta, self._in_units(x if plain else respond(self._factor.solve(self._pad(M @ x))))

        return self._run(
            lambda: eigsh(
                mass, count, M=mass, sigma=sigma, which=which, OPinv=operator, tol=tolerance, v0=v0,
                ncv=_basis_size(count, self.size),
            ),
            finish, count,
        )  # fmt: skip

    def eigenpairs(self, values: np.ndarray, u: np.ndarray) -> Pairs:
        """Return λ (k,) and u (n, k) of pairs of θ, or λ with C, as a failed search hands on those it has found."""
        return (1j * np.sqrt(values.astype(complex)) if self.pencil.C is None else values), u

    def _run(
        self, call: Callable[[], Pairs], finish: Callable[[np.ndarray, np.ndarray], Pairs], count: int,
        adjoint: bool = False,
    ) -> Pairs:  # fmt: skip
        try:
            with one_openblas_thread():
                return finish(*call())
        except ArpackNoConvergence as error:
            number = len(error.eigenvalues)
            some = number > 0 and not adjoint
            found = self.eigenpairs(*finish(error.eigenvalues, error.eigenvectors)) if some else None
            raise NotConvergedError(f"ARPACK: {number} of {count} modes converged", found) from error
        except ArpackError as error:
            raise NotConvergedError(f"ARPACK: {error}") from error

    def without(self, x: np.ndarray) -> ShiftInverted:
        """Return the operator of an undamped symmetric pencil with eigenvectors x (n, k) alone taken out.

        It shares the factors.
        """
        Z, other = x if self._d is None else x / self._d[:, None], copy(self)
        MZ = self.pencil.M @ Z
        other._motions = Z, np.linalg.pinv(MZ.T @ Z) @ MZ.T
        return other

    def _factorized(self, sigma: complex) -> Factor:
        M, C, K = self.pencil.M, self.pencil.C, self.pencil.K
        if C is not None:
            return factorize(in_rows(sigma**2 * M + sigma * C + K), False, self.linear_solver)
        return factorize(in_rows(K - sigma * M), self.pencil.symmetric, self.linear_solver)

    def _in_units(self, x: np.ndarray) -> np.ndarray:
        return x if self._d is None else self._d[:, None] * x

    def _undamped(self, solve: Solve, adjoint: bool) -> Solve:
        M = _columns(self.pencil.M, self._active)
        return lambda z: solve(M @ z)

    def _damped(self, solve: Solve, adjoint: bool) -> Solve:
        """With the n×n factors of Q(σ) alone: (u, v) of (A − σ)(u, v) = (a, b) is u = −Q(σ)⁻¹(Mb + (C + σM)a)."""
        assert self.pencil.C is not None
        M = _columns(self.pencil.M, self._mass)
        C = _columns(in_rows(self.pencil.C.T) if adjoint else self.pencil.C, self._active)
        sigma, k = np.conj(self._shift) if adjoint else self._shift, len(self._active)
        return lambda z: -solve(lift(M, sigma * (z[k:] + z[:k][self._moving])) + lift(C, z[:k]))

    def _own_units(self, states: States, d: np.ndarray, omega0: float) -> States:
        """Return states (u, λu) in the units of the scaled pencil."""
        d = d if self._d is not None else np.ones(len(d))
        return states[0] / d[:, None], states[1] / d[:, None] / omega0

    def _remain(self, adjoint: bool) -> Solve | None:
        """Return what takes the known states out of columns, of the problem or the adjoint one; None without any."""
        if not self._out or not self._out[0][0].shape[1]:
            return None
        if adjoint not in self._deflations:
            own, other = self._out[::-1] if adjoint else self._out
            C, shift = self.pencil.C, np.conj(self._shift) if adjoint else self._shift
            transposed = C if C is None or adjoint else in_rows(C.T)
            self._deflations[adjoint] = Deflation(
                self.pencil.M, transposed, shift, self._active, self._mass, own, other
            )  # fmt: skip
        return self._deflations[adjoint].beside

    def _without_free(self, u: np.ndarray) -> np.ndarray:
        """Return displacements (n, ...) of an undamped symmetric pencil less their parts in its free motions."""
        if self._motions is None and self._out:
            Z, MW = self._out[0][0], self.pencil.M @ self._out[1][0]
            self._motions = Z, np.linalg.pinv(MW.conj().T @ Z) @ MW.conj().T
        if self._motions is None:
            return u
        Z, weights = self._motions
        return np.asarray(u - Z @ (weights @ u))

    def _pad(self, b: np.ndarray) -> np.ndarray:
        full = np.zeros((self.pencil.n, *b.shape[1:]), b.dtype)
        full[self._active] = b
        return full

    @property
    def in_blocks(self) -> bool:
        """Whether vectors are multiplied several at once by `largest`, and not one after the other by ARPACK."""
        return self.pencil.n >= _IN_BLOCKS

    def takes_all(self, count: int) -> bool:
        """Return whether LAPACK finds all eigenvalues where so many are asked for."""
        share = _SHARE if self.size <= 2 * DENSE_LIMIT else _MOST_OF
        return self.size <= _SMALL or share * count >= self.size


def _scaled(pencil: Pencil, d: np.ndarray | None, omega0: float) -> Pencil:
    """Return the pencil of D(λ²M + λC + K)D with λ in multiples of ω0."""

    def scale(A: sp.csr_array, factor: float) -> sp.csr_array:
        if d is not None:
            A = sp.csr_array(sp.diags_array(d) @ A @ sp.diags_array(d))
        return A if factor == 1 else A * factor

    C = None if pencil.C is None else scale(pencil.C, omega0)
    return replace(pencil, M=scale(pencil.M, omega0**2), C=C, K=scale(pencil.K, 1.0), free=None)


def _columns(A: sp.csr_array, index: np.ndarray) -> sp.csr_array:
    return A if len(index) == A.shape[1] else sp.csr_array(A[:, index])


def occupied(A: sp.csr_array) -> np.ndarray:
    """Return (n,) bool, which rows or columns of a matrix hold anything."""
    one = np.ones(A.shape[0])
    return np.asarray((sizes_times(A, one) > 0) | (sizes_times(A.T, one) > 0))


def _operator(n: int, apply: Solve, dtype: DTypeLike) -> LinearOperator:
    """Return an (n, n) operator as ARPACK wants it, without SciPy's checks of each vector: those cost a small solve."""
    operator = LinearOperator((n, n), matvec=apply, dtype=dtype)
    operator.matvec = apply
    return operator


def _root(M: np.ndarray) -> np.ndarray:
    """Return L with M = LLᵀ, of as many columns as M has rank."""
    d = np.sqrt(M.diagonal())
    w, v = la.eigh(M / d[:, None] / d)
    keep = w > len(w) * np.finfo(float).eps
    return np.asarray(d[:, None] * v[:, keep] * np.sqrt(w[keep]))


def _nonzero(nu: np.ndarray, z: np.ndarray, size: int) -> Pairs:
    """Return the pairs without those that are zero but for rounding: infinite eigenvalues, which are no modes."""
    keep = np.abs(nu) > size * np.finfo(float).eps * np.abs(nu).max(initial=0.0)
    return nu[keep], z[:, keep]


def _basis_size(count: int, n: int) -> int:
    return min(n, max(2 * count + 1, 20))


def _start(n: int) -> np.ndarray:
    return np.random.default_rng(_SEED).standard_normal(n)
