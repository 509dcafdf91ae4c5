"""Right and left modes at one value of a parameter, made exact by corrections: residuals solved for with factors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..eigen.blocks import lift
from ..eigen.linear.choice import factorize_roughly
from ..eigen.linear.factor import DefiniteFactor, Factor, LinearSolver
from ..eigen.linear.spread_matrix import in_rows
from ..eigen.pencil import Modes
from ..eigen.request import is_needed
from ..problem.parameters import Place, values_at
from ..problem.problem import Problem
from .basis import ReducedBasis
from .estimate import GUARDED, Estimate
from .undamped import weighted
from .vectors import range_of, real_columns, thin_svd, unit_columns

ROUNDS = 12  # largest number of corrections of the modes at one value
_CORRECTED = 0.3  # times the tolerance: modes with a larger error are corrected along with those that miss it
_MIDDLE = 0.6  # times the square of the highest frequency of the basis: ω² at which Q is factorised
# Times √tolerance and the largest singular value: directions of modes with a smaller one are left out. Forces of
# dampers may be thousands of times those that P has, and so may be the residuals of what is left out.
_FINE, _FINE_DAMPED = 0.01, 1e-4
_SHORT = 1e-4  # times √tolerance and the length of a mode: shorter corrections are left out
_FAST = 0.1  # of an error: what factors of P have to make of it, or those of Q(iω) take their place for good
# The same where factors of Q(iω) take less time than two projections on the corrections, of which they spare about as
# many. In operations of LAPACK: _DENSE m³ for all eigenvalues and vectors of m rows, and _SPARSE n^1.5 for factors,
# measured with PARDISO on a brake of quadratic solids with 5 274 and with 29 970 unknowns (8 600 and 6 900, real ones
# 6 000 and 4 500). Of more unknowns they take more, and are not taken sooner.
_FASTER, _SPARED, _SPARSE, _DENSE = 0.01, 2, 8000.0, 25.0
_FEW = 2  # corrections that cost no more than other factors; of a large problem all that are left, to spare memory
_BORROWED = 0.03  # of an error: what factors of another value have to make of it, or those of the value itself are made
_MOST = 2**26  # bytes of the residuals of modes that are solved for at once, of real ones on one side
_CLOSE = 1e3  # times the tolerance: larger errors are not left to factors of another value


class ModeCorrections:
    """Corrects modes on a basis: by the factors of P, or where these do little, by those of Q(iω) at the values.

    P is symmetric and has no damping, so that its factors take half the memory of those of a Q(iω) with friction, and a
    quarter of those with damping; and those of P are there, since the basis begins with its modes.

    Attributes
    ----------
    factorizations, solves : int
        Matrices factorised and right-hand sides solved for.
    definite : DefiniteFactor or None
        Factors of P, as long as they are of use.
    definite_suffices : bool
        Whether they made modes exact, and no others were needed so far.

    Parameters
    ----------
    problem : Problem
    sigma : float, rad²/s²
        The shift of the P-norm.
    tolerance : float
    start : float or tuple of float
        The value whose motions that nothing holds are in every basis.
    linear_solver : LinearSolver
    definite : DefiniteFactor, optional
        Factors of P.
    is_large : bool
        Whether memory counts most, see `fe_squeal.eigen.linear.choice.is_large`.
    """

    def __init__(
        self, problem: Problem, sigma: float, tolerance: float, start: Place, linear_solver: LinearSolver,
        definite: DefiniteFactor | None = None, is_large: bool = False,
    ) -> None:  # fmt: skip
        self.factorizations = self.solves = 0
        self._is_damped, self._sigma, self._tolerance = problem.is_damped, sigma, tolerance
        self._start, self._linear_solver = start, linear_solver
        self.definite, self.definite_suffices = definite, False
        self._last: tuple[Place, Factor] | None = None
        self._is_large = is_large

    def factorize(self, basis: ReducedBasis, value: Place, highest: float) -> Factor:
        """Factorise Q(iω) at a value, with ω in the middle of the band up to `highest`, rad/s."""
        values, square = values_at(basis.parameter, value), _MIDDLE * highest**2
        problem = basis.at(value)  # which puts the value into a table, if it is one
        acting = [t for t in problem.terms if t.coefficient(problem.parameters)]
        symmetric = all(t.symmetric and t.slot != "C" for t in acting)

        def shifted() -> sp.csr_array:
            pencil = basis.problem.pencil(values)  # which keeps the sum of what does not change
            Q = pencil.K - square * pencil.M
            return in_rows(Q if pencil.C is None else Q + 1j * np.sqrt(square) * pencil.C)

        self.factorizations += 1
        return factorize_roughly(shifted, symmetric, self._linear_solver)

    def factorize_undamped(self, basis: ReducedBasis, highest: float) -> Factor:
        """Factorise Q(iω) without damping and friction, with ω in the middle of the band up to `highest`, rad/s."""
        problem, metric, above = basis.problem, basis.metric, basis.sigma - _MIDDLE * highest**2
        self.factorizations += 1
        return factorize_roughly(lambda: weighted(problem, metric) + above * problem.mass, True, self._linear_solver)

    def release(self) -> None:
        """Forget all factors, which take the most memory."""
        self._last = self.definite = None

    def _factor_for(
        self, basis: ReducedBasis, value: Place, highest: float, worst: float, before: float, enough: float, size: int,
        more: int,
    ) -> Factor | DefiniteFactor:  # fmt: skip
        """Return factors of P as long as errors fall fast by these, or a few more corrections suffice; then of a value.

        Where errors are small and fall fast by them, these may be those of the last value. `size` is the number of
        vectors that modes are projected on, `more` that of the corrections that may follow.
        """
        ratio = worst / before
        rows = 2 * size if self._is_damped else size
        is_cheap = _SPARSE * basis.problem.unknowns**1.5 < _SPARED * _DENSE * rows**3
        fast = _FASTER if is_cheap else _FAST
        few = more if self._is_large else _FEW
        if self.definite is not None and ratio > fast and worst * ratio**few > enough:
            self.definite, self.definite_suffices = None, False  # before others take memory
        if self.definite is not None:
            self.definite_suffices = True
            return self.definite
        if self._last is not None and self._last[0] != value and (worst > _CLOSE or worst > _BORROWED * before):
            self._last = None  # before others take memory
        if self._last is None:
            self._last = value, self.factorize(basis, value, highest)
        return self._last[1]

    def corrected(
        self, basis: ReducedBasis, value: Place, every: Modes, highest: float, enough: float,
        estimate: Callable[[ReducedBasis, Modes], Estimate],
    ) -> tuple[ReducedBasis, Modes]:  # fmt: skip
        """Return a basis that holds the modes at a value, and these modes; the vectors of the given one come first.

        Each round projects on the modes at this value alone, and on the corrections of those that are not exact. What
        modes do not need of earlier corrections is given up before further ones are added: of a large problem every
        round would take a gigabyte.

        Where modes miss the tolerance by little, the factors of the last value serve once more: what a basis lacks has
        higher frequencies than the modes, and differs less from value to value than these do.

        Parameters
        ----------
        every : Modes
            The modes at the value in coordinates of the basis.
        highest : float, rad/s
            Up to `GUARDED` times this modes are returned.
        enough : float
            Of what an error may be: below that modes are not corrected any more.
        estimate : callable
            Returns modes with their errors for a basis and its modes.
        """
        wide, before = basis.copy(), np.inf
        lifted = basis.has_slow or any(basis.at(p).free_motions().motions.shape[1] for p in (self._start, value))
        for more in reversed(range(ROUNDS)):
            W = self.span(wide, every)
            modes, off, _ = estimate(wide.restricted(W, lifted), _turned(every, W.T))
            worst = float(off.max(initial=0.0))
            if worst <= enough or not more:
                break
            if len(wide) - len(basis) > W.shape[1]:
                wide, W = _narrowed(wide, len(basis), W)
            inexact = _turned(modes.select(np.flatnonzero(off > _CORRECTED * enough)), W)
            # No name here holds the factors, so that they are free before others take memory.
            new = self.correct(
                wide, value, inexact, self._factor_for(basis, value, highest, worst, before, enough, W.shape[1], more)
            )
            W = la.qr(np.hstack([_padded(W, len(wide)), new]), mode="economic", check_finite=False)[0]
            every = _turned(wide.restricted(W, lifted).modes(value, GUARDED * highest), W)
            before = worst
        return wide, every

    def span(self, basis: ReducedBasis, modes: Modes) -> np.ndarray:
        """Return orthonormal coordinates (r, ·) that span right and left modes and the motions that nothing holds."""
        modes = modes.select(np.flatnonzero(is_needed(modes)))
        assert modes.left is not None
        free = basis.free_motions(self._start).motions
        fine = _FINE_DAMPED if self._is_damped else _FINE
        return range_of(unit_columns(modes.right, modes.left), fine * self._tolerance**0.5, free)

    def correct(
        self, basis: ReducedBasis, value: Place, modes: Modes, factor: Factor | DefiniteFactor
    ) -> np.ndarray:
        """Add the corrections of some modes at a value to a basis: their residuals, solved for with a factor.

        Returns
        -------
        (r, m) float
            Coordinates of columns that span the corrections in the extended basis.
        """
        # The error of an eigenvalue is the product of two such errors, relative to the mode's length in the P-norm.
        length = float(np.sqrt(np.abs(modes.lam).min() ** 2 - self._sigma))
        short, before, found = _SHORT * self._tolerance**0.5 * length, len(basis), []
        blocks = self._blocks(modes, len(basis.V))
        for block in blocks:
            X = self._solved(basis, value, block, factor)
            found.append(basis.extend(X, short))
        if len(basis) == before:
            # If all are short, they are added nevertheless: an error just above the tolerance may need no more.
            again = (X if len(blocks) == 1 else self._solved(basis, value, b, factor) for b in blocks)
            found = [basis.extend(X) for X in again]
        return np.hstack([_padded(coordinates, len(basis)) for coordinates in found])

    def _blocks(self, modes: Modes, rows: int) -> list[list[Modes]]:
        """Return groups of modes with shapes of one kind, all of them together unless they take too much memory."""
        groups = [modes]
        if not self._is_damped:  # λ and −λ* have the same shapes, and most shapes are real
            plain = (modes.lam.real == 0) & ~modes.right.imag.any(axis=0)
            groups = [modes.select(np.flatnonzero(f)) for f in (plain, ~plain & ~(modes.lam.real < 0))]
        groups = [g for g in groups if len(g)]
        most = max(1, _MOST // (8 * rows))
        if sum(map(len, groups)) <= most:
            return [groups]
        return [[g.select(np.arange(i, min(i + most, len(g))))] for g in groups for i in range(0, len(g), most)]

    def _solved(
        self, basis: ReducedBasis, value: Place, groups: list[Modes], factor: Factor | DefiniteFactor
    ) -> np.ndarray:  # fmt: skip
        """Return the residuals of modes at a value, solved for with a factor, as real columns (n, ·)."""
        parts = []
        for group in groups:
            assert group.left is not None
            now = len(basis)  # vectors may have been added since the modes were found
            group = replace(group, right=_padded(group.right, now), left=_padded(group.left, now))
            right, left = basis.residuals(value, group)
            if self._is_damped and factor is not self.definite and right.shape[1] > len(group):
                # Else all λ and shapes are real, as of overdamped modes, or the factors are.
                right, left = (x[:, : len(group)] + 1j * x[:, len(group) :] for x in (right, left))
            self.solves += right.shape[1] + left.shape[1]
            parts += [real_columns(factor.solve(right)), real_columns(factor.solve_adjoint(left))]
        return np.hstack(parts)


def _narrowed(wide: ReducedBasis, size: int, W: np.ndarray) -> tuple[ReducedBasis, np.ndarray]:
    """Return a basis without what columns with coordinates W (r, k) do not need behind the first ones, and their W."""
    U, s, _ = thin_svd(W[size:])
    U = U[:, s > np.finfo(float).eps]
    return wide.narrowed(size, U), np.vstack([W[:size], U.T @ W[size:]])


def _padded(W: np.ndarray, size: int) -> np.ndarray:
    return np.pad(W, ((0, size - len(W)), (0, 0)))


def _turned(modes: Modes, W: np.ndarray) -> Modes:
    """Return modes with vectors Wy instead of y."""
    assert modes.left is not None
    return replace(modes, right=lift(W, modes.right), left=lift(W, modes.left))
