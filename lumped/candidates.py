"""Friction coefficients at which stability may change, as eigenvalues of matrix pencils in μ.

Every change of the number of growing motions is among them; so are touches, and numbers without meaning where a pencil
is singular. They are approximations, and what they are is decided elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la

from .spectrum import Complexes
from .springs import Floats

_BALANCING = 12  # sweeps over rows and columns; few are needed to bring them to one order of magnitude


def find_double(A: Floats, B: Floats) -> Complexes:
    """Find all μ at which A + μ B has a double eigenvalue: the roots of its discriminant.

    With D X = A X − X Aᵀ, the map D² takes skew matrices to skew ones. Its eigenvalues there are (θi − θj)², i < j, so
    that its determinant is the discriminant, and it is quadratic in μ.

    Parameters
    ----------
    A, B : (n, n) arrays
        A is symmetric, or nearly so, for the best accuracy with entries of different size.

    Returns
    -------
    (m,) complex

    Examples
    --------
    >>> import numpy as np
    >>> mu = find_double(np.array([[3.0, -1.0], [-1.0, 4.0]]), np.array([[0.0, 4.0], [0.0, 0.0]]))
    >>> [round(float(x.real), 12) for x in mu if abs(x) < 1e6]  # ((3-4)²/4 + 1)/4
    [0.3125]
    """
    size = max(float(np.abs(X).max()) for X in (A, B)) or 1.0
    A, B = (X / size for X in _modal(A, A, B))
    one, P = np.eye(len(A)), _skew(len(A))
    D0, D1 = (np.kron(X, one) - np.kron(one, X) for X in (A, B))
    L0, L1, L2 = _balance([P.T @ X @ P for X in (D0 @ D0, D0 @ D1 + D1 @ D0, D1 @ D1)])
    norm = [float(np.linalg.norm(X)) for X in (L0, L1, L2)]
    # Roots are small, −L0/L1, or large, −L1/L2, or all of the size √(L0/L2): the smaller ones are put near 1.
    scale = min((norm[0] / x for x in (norm[1], np.sqrt(norm[0] * norm[2])) if x > 0), default=1.0) or 1.0
    one, zero = np.eye(len(L0)), np.zeros_like(L0)
    first, second = np.block([[zero, one], [L0, scale * L1]]), np.block([[-one, zero], [zero, scale**2 * L2]])
    return scale * _eigenvalues(first, second)


def find_opposite(A: Floats, B: Floats, C: Floats) -> Complexes:
    """Find all μ at which two eigenvalues λ of q̈ + C q̇ + (A + μ B) q = 0 sum to zero, as ±iω do.

    With the state matrix S, the map X → S X + X Sᵀ takes skew matrices to skew ones, and its eigenvalues there are
    λi + λj, i < j.

    Parameters
    ----------
    A, B, C : (n, n) arrays

    Returns
    -------
    (m,) complex

    Examples
    --------
    >>> import numpy as np
    >>> A, B = np.array([[1.0, 0.0], [0.0, 2.0]]), np.array([[0.0, 1.0], [-1.0, 0.0]])
    >>> mu = find_opposite(A, B, 0.2 * np.eye(2))
    >>> sorted(round(float(x.real), 9) for x in mu if abs(x.imag) < 1e-9 and x.real > 0)  # √(1/4 + 0.2² 3/2)
    [0.556776436]
    """
    n = len(A)
    A, B, C = _modal(A, A, B, C)
    one, zero, P = np.eye(2 * n), np.zeros((n, n)), _skew(2 * n)
    S0, S1 = np.block([[zero, np.eye(n)], [-A, -C]]), np.block([[zero, zero], [-B, zero]])
    return _eigenvalues(*_balance([P.T @ (np.kron(X, one) + np.kron(one, X)) @ P for X in (S0, S1)]))


def find_singular(A: Floats, B: Floats) -> Complexes:
    """Find all μ at which A + μ B is singular, (m,) complex.

    Examples
    --------
    >>> import numpy as np
    >>> find_singular(np.array([[2.0, 0.0], [0.0, 1.0]]), np.array([[-1.0, 0.0], [0.0, 0.0]])).real.tolist()
    [2.0]
    """
    return _eigenvalues(*_balance(_modal(A, A, B)))


def _modal(K: Floats, *matrices: Floats) -> list[Floats]:
    """Return matrices in the eigenvectors of a symmetric K: there stiff motions are apart from soft ones."""
    Q = np.linalg.eigh(K)[1] if np.array_equal(K, K.T) else np.eye(len(K))
    return [Q.T @ X @ Q for X in matrices]


def _skew(n: int) -> Floats:
    """Return an orthonormal basis of the skew n × n matrices, (n², n (n − 1) / 2)."""
    i, j = np.triu_indices(n, 1)
    P = np.zeros((n * n, len(i)))
    P[i * n + j, range(len(i))] = np.sqrt(0.5)
    P[j * n + i, range(len(i))] = -np.sqrt(0.5)
    return P


def _balance(terms: Sequence[Floats]) -> list[Floats]:
    """Return the terms of a pencil with rows and columns scaled to one size, which leaves its eigenvalues."""
    weight = np.sum([X**2 for X in terms], axis=0)
    rows, columns = np.ones(len(weight)), np.ones(len(weight))
    for _ in range(_BALANCING):
        size = np.sqrt((rows[:, None] ** 2 * weight * columns**2).sum(1))
        rows /= np.where(size > 0, size, 1.0)
        size = np.sqrt((rows[:, None] ** 2 * weight * columns**2).sum(0))
        columns /= np.where(size > 0, size, 1.0)
    return [rows[:, None] * X * columns for X in terms]


def _eigenvalues(L0: Floats, L1: Floats) -> Complexes:
    """Return the finite μ at which L0 + μ L1 is singular."""
    if not len(L0):  # of which LAPACK's query for its workspace fails
        return np.zeros(0, complex)
    alpha, beta = la.eigvals(L0, -L1, homogeneous_eigvals=True)
    finite = np.abs(beta) > np.finfo(float).tiny * (1 + np.abs(alpha))
    return np.asarray(alpha[finite] / beta[finite], dtype=complex)
