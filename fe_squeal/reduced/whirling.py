"""Modes that gyroscopic terms bring into the range from far beyond it, and which a basis may lack."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..eigen.blocks import times
from ..eigen.growth import gyroscopic_rate
from ..eigen.inertia import count_below
from ..eigen.linear.choice import factorize_roughly
from ..eigen.linear.factor import Factor, LinearSolver
from ..eigen.pencil import Pencil
from ..errors import NotConvergedError
from ..problem.parameters import Place, values_at
from ..problem.problem import Problem
from ..problem.terms import sum_matrices
from .basis import ReducedBasis
from .soft import TRIED
from .vectors import real_columns

_SEED, _BLOCK, _STEPS = 20251107, 4, 5  # vectors of a block have complex solutions, of a real and an imaginary part
_ROUNDS = 12  # searches from new random vectors, at most
SEARCH_SOLVES = _STEPS * _BLOCK  # right-hand sides that a search solves for


def whirl_rate(problem: Problem) -> float:
    """Return the bound of `gyroscopic_rate`, rad/s, at the problem's parameters; infinite with other terms in C.

    Terms that are neither symmetric nor skew are meant.
    """
    at = problem.parameters
    terms = [t for t in problem.terms if t.slot == "C" and not t.symmetric and t.coefficient(at)]
    if not all(t.skew and not t.imaginary for t in terms):
        return np.inf
    G = sum_matrices((t.matrix, t.coefficient(at)) for t in terms)
    return 0.0 if G is None else gyroscopic_rate(problem.mass, G)


def whirling_vectors(
    basis: ReducedBasis, value: Place, highest: float, linear_solver: LinearSolver
) -> tuple[np.ndarray, int] | None:
    """Return real vectors (n, ·) of the soft directions of the Hermitian part of Q(iω), which the basis lacks.

    That is H(ω) = (Q + Qᴴ)/2 = K_s − ω²M + iωG, of the symmetric part K_s of K and the skew part G of C. A mode φ that
    grows with λ = α + iω has φᴴH(ω)φ = −α²φᴴMφ − αφᴴC_sφ ≤ 0, whatever friction does. If the basis lacks the mode that
    gyroscopic forces have slowed down, H has more negative eigenvalues than its projection, near the end of the range
    too. They are counted by the inertia of a real matrix of twice the size, where each is there twice:
    [[Re H, −Im H], [Im H, Re H]]. (Derived here, no source.)

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
        H. Where the solver does not count them they are searched for, once.

    Raises
    ------
    NotConvergedError
        Fewer soft directions are found than were counted.
    """
    frequencies = highest * np.sqrt(TRIED)
    spectra = [np.linalg.eigvalsh(_projected(basis, value, w)) for w in frequencies]
    clear = int(np.argmax([np.abs(w).min() for w in spectra]))  # no eigenvalue is nearly zero
    omega, found = float(frequencies[clear]), np.count_nonzero(spectra[clear] < 0)
    pencil = basis.problem.pencil(values_at(basis.parameter, value))
    counted = _counted(pencil, omega, linear_solver)
    if counted is not None and counted <= found:
        return None
    factor = factorize_roughly(lambda: _hermitian(pencil, omega) - omega**2 * pencil.M, False, linear_solver)
    trial, rng = basis.copy(), np.random.default_rng(_SEED)
    for k in range(_ROUNDS):
        _extend(trial, factor, rng)
        found = np.count_nonzero(np.linalg.eigvalsh(_projected(trial, value, omega)) < 0)
        if counted is None or counted <= found:
            return np.array(trial.V[:, len(basis) :], order="C"), (k + 1) * SEARCH_SOLVES
    raise NotConvergedError(f"{counted} soft directions are counted where the reduced model finds {found}")


def _hermitian(pencil: Pencil, omega: float) -> sp.csr_array:
    """Return the Hermitian part of K + iωC."""
    Q = pencil.K if pencil.C is None else pencil.K + 1j * omega * pencil.C
    return sp.csr_array((Q + Q.conj().T) / 2)


def _projected(basis: ReducedBasis, value: Place, omega: float) -> np.ndarray:
    """Return the Hermitian part of Q(iω) on a basis, (r, r)."""
    M, C, K, _ = basis.matrices(value)
    Q = K - omega**2 * M if C is None else K - omega**2 * M + 1j * omega * C
    return np.asarray((Q + Q.conj().T) / 2)


def _counted(pencil: Pencil, omega: float, linear_solver: LinearSolver) -> int | None:
    """Return the number of negative eigenvalues of the Hermitian part of Q(iω), None where the solver gives none."""
    H = _hermitian(pencil, omega)
    K = sp.csr_array(sp.block_array([[H.real, -H.imag], [H.imag, H.real]]))
    twice = count_below(Pencil(sp.csr_array(sp.block_diag([pencil.M] * 2)), K, symmetric=True), omega, linear_solver)
    return None if twice is None or twice % 2 else twice // 2


def _extend(trial: ReducedBasis, factor: Factor, rng: np.random.Generator) -> None:
    """Extend a basis by real vectors that span the lowest complex modes outside it, roughly.

    Each step adds what its solutions have outside the basis, real and imaginary parts, and goes on from as many random
    mixtures of these as it began with.
    """
    block = rng.standard_normal((trial.problem.unknowns, _BLOCK))
    for _ in range(_STEPS):
        found = factor.solve(times(trial.problem.mass, block).astype(complex))
        size = len(trial)
        if not trial.append(real_columns(found)):
            break
        new = np.asarray(trial.V[:, size:])
        block = new @ rng.standard_normal((new.shape[1], min(_BLOCK, new.shape[1])))
