"""Static equilibrium with unilateral contact and steady sliding friction, by a semismooth Newton method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..eigen.blocks import with_short_indices
from ..eigen.linear.choice import factorize, is_large
from ..eigen.linear.factor import Factor, LinearSolver
from ..eigen.linear.spread_matrix import in_rows, sizes_times
from ..errors import NotConvergedError

_ITERATIONS = 60
_EQUILIBRIUM = 1e-8  # residual forces over those that cancel in them
_HALVINGS = 12
# Residual forces over those that cancel: as of a direct solve, and where no correction makes them smaller.
_EXACT, _AS_EXACT = 1e-15, 1e-14
_CORRECTIONS, _VECTORS, _DIGITS = 4, 30, 1e-6  # of a solution by other factors: how many, their steps, and their error
_BEFORE = 6  # solutions for earlier tangents that a new one is sought among first
_FLOATING = 1e11  # internal forces over the load beyond which they are rounding of huge rigid motions: nothing holds


@dataclass(frozen=True)
class SlidingContact:
    """One contact in a static solve.

    Attributes
    ----------
    gap : (q, n) sparse
        Gap of the displacements at the contact points.
    slip : (q, n) sparse or None
        Along the sliding direction; None without friction.
    stiffness : (q,) float, N/m
        Contact stiffness times the area of each point.
    mu : float
    opens : bool
        Whether it lifts off; else it also pulls.
    """

    gap: sp.csr_array
    slip: sp.csr_array | None
    stiffness: np.ndarray
    mu: float
    opens: bool

    @property
    def reaction(self) -> sp.csr_array:
        """(q, n) sparse: G_n + μ G_t, whose transpose makes nodal forces of the contact forces."""
        return self.gap if self.slip is None or not self.mu else sp.csr_array(self.gap + self.mu * self.slip)


@dataclass(frozen=True)
class Equilibrium:
    """A static state.

    Attributes
    ----------
    u : (n,) float, m
    closed : tuple of (q,) bool
        The points of each contact that touch.
    iterations : int
    residual : float
        Largest residual force over the forces that cancel in it.
    """

    u: np.ndarray
    closed: tuple[np.ndarray, ...]
    iterations: int
    residual: float


class TangentSolver:
    """Solves with the tangents of one static state after another by few factorisations.

    From value to value of a sweep the tangent changes at contact points alone. Then GMRES with the factors of an
    earlier tangent finds the solution in few steps, to rounding, as residuals show; if not, factors are made anew. It
    starts from that combination of earlier solutions whose residual is smallest. (Saad and Schultz, SIAM J. Sci. Stat.
    Comput. 7, 1986; Fischer, Comput. Methods Appl. Mech. Eng. 163, 1998.)

    Parameters
    ----------
    linear_solver : LinearSolver or str
    """

    def __init__(self, linear_solver: LinearSolver | str = "auto") -> None:
        self._linear_solver = linear_solver
        self._factor: Factor | None = None
        self._keeps = False
        self._before: list[np.ndarray] = []

    def solve(self, A: sp.csr_array, symmetric: bool, b: np.ndarray) -> np.ndarray:
        """Return A⁻¹b (n,); raises NotConvergedError if A (n, n) is singular."""
        u = None
        if self._factor is not None:
            u = _by_other_factors(A, b, self._factor, _nearest(A, b, self._before))
        if u is None:
            self._factor = None  # before others take memory
            self._factor = factorize(A, symmetric, self._linear_solver)
            u = self._factor.solve(b)
        if np.isfinite(u).all():  # else the tangent is singular, which the caller tells
            self._before = [*self._before, u][-_BEFORE:]
        return u

    def settle(self, entries: int) -> None:
        """Give factors of the first static state up, and those of large tangents: they would only take memory."""
        if not self._keeps or is_large(entries, self._linear_solver):
            self._factor = None
        self._keeps = True


class NotHeldError(NotConvergedError):
    """Nothing holds the bodies against the load; `partial` is the last set of closed points."""


def solve_static_contact(
    K: sp.csr_array, load: np.ndarray, contacts: Sequence[SlidingContact],
    start: Sequence[np.ndarray] | None = None, tangents: TangentSolver | None = None,
) -> Equilibrium:  # fmt: skip
    """Solve K u + Σ (G_n + μG_t)ᵀ k_n A min(G_n u, 0) = f for the displacements.

    The forces are piecewise linear in u, so that Newton's method is an active-set method: the next iterate is exact
    once the set of closed points is right, and the method stops where the set repeats itself and the residual is that
    of rounding. Where sets alternate, steps are halved until the residual falls. (Alart and Curnier, Comput. Methods
    Appl. Mech. Eng. 92, 1991; Hintermüller, Ito and Kunisch, SIAM J. Optim. 13, 2003.)

    Parameters
    ----------
    K : (n, n) sparse float, N/m
        Everything but these contacts.
    load : (n,) float, N
    start : sequence of (q,) bool, optional
        Closed points to begin with (default: all).
    tangents : TangentSolver, optional
        What solved for other states of the same bodies before.

    Raises
    ------
    NotHeldError
        If the stiffness with the closed points alone is singular.
    NotConvergedError
        `partial` is the last Equilibrium.
    """
    closed = tuple(np.ones(len(c.stiffness), bool) for c in contacts) if start is None else tuple(start)
    symmetric = all(c.reaction is c.gap for c in contacts)
    tangents = tangents or TangentSolver()
    seen: set[bytes] = set()
    u, state = None, None
    for iteration in range(1, _ITERATIONS + 1):
        full = _solve_linear(K, load, contacts, closed, symmetric, tangents)
        alternates = _key(closed) in seen
        seen.add(_key(closed))
        u = full if u is None or not alternates else _shorter(K, load, contacts, u, full)
        before, closed = closed, _closed(contacts, u)
        state = Equilibrium(u, closed, iteration, _residual(K, load, contacts, u))
        if state.residual <= _EQUILIBRIUM and all((a == b).all() for a, b in zip(before, closed, strict=True)):
            tangents.settle(K.nnz)
            return state
    assert state is not None
    raise NotConvergedError(
        f"the static contact did not settle in {_ITERATIONS} iterations: residual {state.residual:.2g} of the forces",
        partial=state,
    )


def _solve_linear(
    K: sp.csr_array, load: np.ndarray, contacts: Sequence[SlidingContact], closed: Sequence[np.ndarray],
    symmetric: bool, tangents: TangentSolver,
) -> np.ndarray:  # fmt: skip
    # The contacts, which have few entries, are summed first: each sum with K goes through all of K.
    own = [c.reaction.T @ sp.diags_array(c.stiffness * t) @ c.gap for c, t in zip(contacts, closed, strict=True)]
    tangent = in_rows(K + with_short_indices(sp.csr_array(sum(own[1:], own[0])))) if own else K
    if symmetric:
        tangent = in_rows((tangent + tangent.T) / 2)
    try:
        u = tangents.solve(tangent, symmetric, load)
    except NotConvergedError as error:
        raise NotHeldError(str(error), partial=tuple(closed)) from error
    inner = sizes_times(tangent, np.abs(u)).max()
    if not np.isfinite(u).all() or inner > _FLOATING * np.abs(load).max():
        raise NotHeldError("the stiffness is singular", partial=tuple(closed))
    return u


def _nearest(A: sp.csr_array, b: np.ndarray, solutions: Sequence[np.ndarray]) -> np.ndarray | None:
    """Return the combination u (n,) of solutions for other matrices with the smallest |b − Au|; None without any."""
    if not solutions:
        return None
    U = np.column_stack(solutions)
    u = U @ np.linalg.lstsq(A @ U, b, rcond=None)[0]
    return np.asarray(u) if np.isfinite(u).all() else None


def _by_other_factors(
    A: sp.csr_array, b: np.ndarray, factor: Factor, start: np.ndarray | None = None
) -> np.ndarray | None:
    """Return A⁻¹b by GMRES with factors of a matrix near A, as exact as by its own factors; None if it is not."""
    inverse, before = spla.LinearOperator(A.shape, matvec=factor.solve, dtype=float), np.inf
    u = factor.solve(b) if start is None else start
    for _ in range(_CORRECTIONS):
        rest = b - A @ u
        off = float(np.abs(rest).max() / ((sizes_times(A, np.abs(u)) + np.abs(b)).max() or 1.0))
        if off <= _EXACT or (off <= _AS_EXACT and off > before / 2):
            return u
        if not off < before:
            return None
        before = off
        digits = min(max(_DIGITS, _EXACT / off / 2), 0.1)
        u = u + spla.gmres(A, rest, rtol=digits, atol=0.0, restart=_VECTORS, maxiter=1, M=inverse)[0]
    return None


def _closed(contacts: Sequence[SlidingContact], u: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple((c.gap @ u < 0) if c.opens else np.ones(len(c.stiffness), bool) for c in contacts)


def _forces(contacts: Sequence[SlidingContact], u: np.ndarray) -> list[np.ndarray]:
    gaps = [c.gap @ u for c in contacts]
    return [
        c.reaction.T @ (c.stiffness * (np.minimum(g, 0.0) if c.opens else g))
        for c, g in zip(contacts, gaps, strict=True)
    ]


def _residual(K: sp.csr_array, load: np.ndarray, contacts: Sequence[SlidingContact], u: np.ndarray) -> float:
    forces = _forces(contacts, u)
    balance = K @ u - load + sum(forces, start=np.zeros(len(load)))
    size = sizes_times(K, np.abs(u)) + np.abs(load) + sum((np.abs(f) for f in forces), start=np.zeros(len(load)))
    return float(np.abs(balance).max() / (size.max() or 1.0))


def _shorter(
    K: sp.csr_array, load: np.ndarray, contacts: Sequence[SlidingContact], u: np.ndarray, full: np.ndarray
) -> np.ndarray:
    """Return the longest of the halved steps from u to `full` that lowers the residual."""
    least, step = _residual(K, load, contacts, u), 1.0
    for _ in range(_HALVINGS):
        trial = u + step * (full - u)
        if _residual(K, load, contacts, trial) < (1 - 1e-4 * step) * least:
            return trial
        step /= 2
    return u + step * (full - u)


def _key(closed: Sequence[np.ndarray]) -> bytes:
    return b"".join(np.packbits(c).tobytes() for c in closed)
