"""Directions in which the problem is soft at a value of the parameter, and which a basis of another value lacks."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..eigen.blocks import combine, cross, times
from ..eigen.columns import Columns
from ..eigen.inertia import finite_below
from ..eigen.linear.choice import factorize_roughly, negative_eigenvalues
from ..eigen.linear.factor import Factor, LinearSolver
from ..eigen.linear.spread_matrix import in_rows
from ..eigen.pencil import Pencil
from ..errors import NotConvergedError
from ..problem.parameters import Place, values_at
from ..problem.problem import Problem
from ..problem.terms import sum_matrices
from .basis import ReducedBasis
from .vectors import DEPENDENT, normalising, thin_svd

TRIED = np.linspace(1.0, 1.05, 7)  # times the square of the range's end: where soft directions are counted
# A search has blocks of _BLOCK vectors, or of more where so many directions are lacking that _STEPS such blocks would
# hardly hold them. Whether they do is seen after every _STEPS steps, of which there are _MOST at most.
_SEED, _BLOCK, _STEPS, _MOST = 20251107, 8, 5, 40
_RANK = 1e-13  # eigenvalue of VᵀMV for vectors of unit mass: directions below are not taken off
_MASSLESS = 1e-12  # of the largest mass among vectors of V: what has less has a θ far above c
_NOTHING = 1e-20  # of the mass that vectors had: what is left outside V and W, if it is less, is rounding


def leaves_friction_out(basis: ReducedBasis, value: Place) -> bool:
    """Return whether K has terms at a value that are not symmetric and not in P, which may make a mode soft there."""
    here = basis.at(value)
    left_out = [t for t, c in zip(here.terms, basis.metric, strict=True) if not c]
    return any(t.slot == "K" and not t.symmetric and t.coefficient(here.parameters) for t in left_out)


def vectors_beside(
    basis: ReducedBasis, value: Place, highest: float, linear_solver: LinearSolver
) -> tuple[np.ndarray, int] | None:  # fmt: skip
    """Return vectors (n, ·) of the soft directions of the symmetric part K_s of K at a value, which the basis lacks.

    The basis began with the modes at one value without friction. A part of the brake that is stiff there and soft at
    another value, and hardly coupled to the rest, is in none of its modes. But uᵀ(K_s − cM)u < 0 for the motion u of
    that part: K_s − cM has more negative eigenvalues than its projection, if c is about the square of where the
    range ends. If K is linear in the parameter, there are such u between two values only where there are at
    one of these.

    Parameters
    ----------
    basis : ReducedBasis
    value : float or tuple of float
    highest : float, rad/s
        Where the range that was asked for ends.
    linear_solver : LinearSolver

    Returns
    -------
    (n, ·) float and int, or None
        The vectors, and for how many right-hand sides was solved. None where the basis has as many soft directions as
        K_s. Where the solver does not count them they are searched for.

    Raises
    ------
    NotConvergedError
        As `soft_vectors`.
    """
    M, _, K, _ = basis.matrices(value)
    K = (K + K.T).real / 2
    squares = highest**2 * TRIED
    spectra = [np.linalg.eigvalsh(K - c * M) for c in squares]
    clear = int(np.argmax([np.abs(w).min() for w in spectra]))  # no eigenvalue is nearly zero
    c = float(squares[clear])
    problem = basis.problem.at(values_at(basis.parameter, value))
    pivots = _negative_pivots(problem, c, linear_solver)
    soft = _symmetric_part(problem)
    counted = finite_below(soft, pivots, linear_solver)
    if counted is not None and counted <= np.count_nonzero(spectra[clear] < 0):
        return None
    factor = factorize_roughly(lambda: in_rows(soft.K - c * soft.M), True, linear_solver)
    return soft_vectors(basis.V, M, K, soft, c, factor, counted)


def _symmetric_part(problem: Problem) -> Pencil:
    """Return the pencil of the real symmetric part of K, without damping."""
    return Pencil(problem.mass, in_rows(sum_matrices(_symmetric_stiffness(problem))), symmetric=True)


def _symmetric_stiffness(problem: Problem) -> list[tuple[sp.csr_array, float]]:
    """Return the matrices whose sum is the real symmetric part of K, and their factors."""
    at, parts = problem.parameters, []
    for t in problem.terms:
        if t.slot == "K" and not t.imaginary and (c := t.coefficient(at)):
            parts.append((t.matrix if t.symmetric else in_rows((t.matrix + t.matrix.T) / 2), c))
    return parts


def _negative_pivots(problem: Problem, c: float, linear_solver: LinearSolver) -> int | None:
    """Return how many eigenvalues of K_s − cM are negative; None where the factorisation does not tell.

    It is summed from the terms and gone with its factors before K_s and M are summed: all of them at once would be the
    most memory that a large model takes.
    """
    mass = [(t.matrix, -c * t.coefficient(problem.parameters)) for t in problem.terms if t.slot == "M"]
    shifted = [*_symmetric_stiffness(problem), *(part for part in mass if part[1])]
    try:
        return negative_eigenvalues(in_rows(sum_matrices(shifted)), linear_solver)
    except NotConvergedError:
        return None


def soft_vectors(
    V: Columns, M: np.ndarray, K: np.ndarray, soft: Pencil, c: float, factor: Factor, counted: int | None = None
) -> tuple[np.ndarray, int]:  # fmt: skip
    """Return vectors u that a basis V lacks of the space in which uᵀ(K_s − cM)u < 0, and for how many it was solved.

    Some steps of block Lanczos iteration with (K_s − cM)⁻¹M find them, since they have the lowest eigenvalues of that
    operator, and these alone are negative. The vectors W of the iteration are orthonormal in the mass matrix and
    M-orthogonal to V. A norm that knows the part as stiff, as that of P does, would see nothing in them but the motion
    of this part, and nothing of what moves with it. The Ritz vectors of K_s on [V, W] with θ < c show which directions
    of W are soft: as many as there are more of them than on V alone.

    Parameters
    ----------
    V : (n, r) float
    M, K : (r, r) float
        VᵀMV and VᵀK_sV.
    soft : Pencil
        M and K_s.
    c : float, rad²/s²
    factor : Factor
        Factors of K_s − cM.
    counted : int, optional
        How many θ < c there are. The iteration goes on until it has as many; without it, it ends after `_STEPS` steps.

    Returns
    -------
    (n, k) float, and int

    Raises
    ------
    NotConvergedError
        Another number of soft directions is found than was counted.
    """
    mass, T = soft.M, _of_unit_mass(M, _MASSLESS * M.diagonal().max(initial=0.0), _RANK)
    VKV = T.T @ K @ T
    known = int(np.count_nonzero(la.eigvalsh(VKV) < c))
    lacking = 0 if counted is None else counted - known

    def outside(X: np.ndarray, W: np.ndarray) -> np.ndarray:
        MX = times(mass, X)
        return X - combine(V, T @ (T.T @ cross(V, MX))) - combine(W, cross(W, MX))

    W, solves, found = np.zeros((len(V), 0)), 0, known
    block = np.random.default_rng(_SEED).standard_normal((len(V), _BLOCK + max(lacking, 0) // _STEPS))
    for step in range(1, _MOST + 1):
        X = factor.solve(times(mass, block))
        solves += block.shape[1]
        before = float(np.einsum("ij,ij->j", X, times(mass, X)).max(initial=0.0))
        X = outside(outside(X, W), W)
        block = X @ _of_unit_mass(cross(X, times(mass, X)), _NOTHING * before, DEPENDENT)
        W = np.hstack([W, block])
        if block.shape[1] and step % _STEPS:
            continue
        KW = times(soft.K, W)
        VKW = T.T @ cross(V, KW)
        theta, y = la.eigh(np.block([[VKV, VKW], [VKW.T, cross(W, KW)]]))
        below = theta < c
        found = int(np.count_nonzero(below))
        if counted is None or found == counted:
            return combine(W, thin_svd(y[T.shape[1] :, below])[0][:, : max(found - known, 0)]), solves
        if not block.shape[1] or found > counted:  # no subspace has more of them but by rounding
            break
    raise NotConvergedError(f"{counted} soft directions are counted where the reduced model finds {found}")


def _of_unit_mass(gram: np.ndarray, least: float, dependent: float) -> np.ndarray:
    """Return T as `normalising` of those columns whose mass, on the diagonal of their Gram matrix, is above `least`."""
    return normalising(gram, np.flatnonzero(gram.diagonal() > least), dependent)
