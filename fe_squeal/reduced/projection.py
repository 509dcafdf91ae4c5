"""The projection of every term of a problem on few vectors, and its modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..eigen.blocks import combine, cross, form, lift, times
from ..eigen.columns import Columns
from ..eigen.dense import solve_dense
from ..eigen.growth import may_grow_dense, sizes
from ..eigen.kernel import null_columns
from ..eigen.linear.factor import LinearSolver
from ..eigen.linear.spread_matrix import SpreadMatrix, in_rows
from ..eigen.pencil import FreeMotions, Modes, Pencil
from ..problem.forms import project
from ..problem.parameters import Place, paths_of, values_at
from ..problem.problem import Problem
from ..problem.tabulated import Tabulated
from ..problem.terms import Slot, Term
from .moving import MovingSource, ProjectedTerms
from .undamped import weighted
from .vectors import SlowMotions

_SPARSE = 0.3  # of all rows: a term that acts in fewer is multiplied in these rows alone
_SLOW = 1e-3  # of the shift σ: a motion with less |θ| counts as hardly held
_CONTAINED = 1e-12  # of the mass of a motion: a part outside the basis that is smaller is rounding
_Matrices = tuple[np.ndarray, np.ndarray | None, np.ndarray, bool]


class _Acting(NamedTuple):
    """A term A in the rows (m,) that it or its transposed matrix acts in, None for all rows.

    The transposed matrix is `sign` times A itself where there is none.
    """

    rows: np.ndarray | None
    matrix: sp.csr_array
    transposed: sp.csr_array | None
    sign: float

    @property
    def turned(self) -> _Acting:
        """The transposed matrix in place of A; both are the same up to `sign` where there is no transposed one."""
        return self if self.transposed is None else self._replace(matrix=self.transposed, transposed=self.matrix)


class Projection:
    """Vectors V (n, r) with VᵀPV = 1, P = K − σM, and the terms VᵀAV.

    Parameters
    ----------
    problem : Problem
        Affine in the parameter, its terms collected by powers: few of them. Or a table, which gets every value that
        matrices are asked for at.
    parameter : str or tuple of str
        If there are several parameters, a value is the tuple of their values.
    metric : (terms,) float
        The coefficients of the terms in P, see `factorize_undamped`.
    sigma : float, rad²/s²
    linear_solver : LinearSolver or str
        Passed on to where motions that nothing holds are looked for.
    """

    def __init__(
        self, problem: Problem, parameter: str | tuple[str, ...], metric: Sequence[float], sigma: float,
        linear_solver: LinearSolver | str = "auto",
    ) -> None:  # fmt: skip
        self.problem, self.parameter, self.metric, self.sigma = problem, parameter, metric, sigma
        self._linear_solver = linear_solver
        self.V: Columns = np.zeros((problem.unknowns, 0))
        self._projected = [np.zeros((0, 0)) for _ in problem.terms]
        self.has_slow = False
        # Of the last calls, with the V that they belong to.
        self._last: tuple[Place, Columns, Pencil] | None = None
        self._last_matrices: tuple[Place, Columns, _Matrices] | None = None
        self._slow: tuple[Columns, SlowMotions | None] | None = None  # with the V that they belong to
        # The motions and the basis of the last call of `_coordinates`, and what it found for them.
        self._contained: tuple[np.ndarray, Columns, np.ndarray, np.ndarray] | None = None

    def __len__(self) -> int:
        return int(self.V.shape[1])

    def project(self, problem: Problem) -> Problem:
        """Return another problem of the same unknowns, projected on the basis; anew at each value of a table."""
        if isinstance(self.problem, Tabulated):
            return ProjectedTerms(problem, self.V, self._coordinates).problem()

        def free(values: Mapping[str, float]) -> FreeMotions:
            return self._coordinates(replace(problem, parameters=values).free_motions())

        return replace(project(problem, self.V), coupled=problem.coupled, free=free)

    def at(self, value: Place) -> Problem:
        """Return the problem at a value of the parameter."""
        if isinstance(self.problem, Tabulated) and value not in self.problem.known:
            assert isinstance(value, float)
            self._take_over(self.problem.with_value(value))
        return self.problem.at(values_at(self.parameter, value))

    def _take_over(self, table: Tabulated) -> None:
        """Go on with a table that has further terms, behind those that are there."""
        new = [_acting(t) for t in table.terms[len(self._projected) :]]
        self._acting = [*self._acting, *new]
        self.problem, self.metric = table, [*self.metric, *[0.0] * len(new)]
        self._projected = [*self._projected, *(self._product_with(part, self.V) for part in new)]

    def _product_with(self, part: _Acting, left: Columns) -> np.ndarray:
        """Return UᵀAV of a term A, for any U (n, k)."""
        rows, A = part.rows, part.matrix
        return form(left if rows is None else left[rows], A, self.V)

    def pencil(self, value: Place) -> Pencil:
        """Return the projected matrices at a value of the parameter; those of the last one are kept."""
        if self._last is None or self._last[0] != value or self._last[1] is not self.V:
            self._last = value, self.V, self._pencil(value)
        return self._last[2]

    def _pencil(self, value: Place) -> Pencil:
        M, C, K, symmetric = self.matrices(value)
        slow = self.slow
        return Pencil(M, K, C, symmetric, None if slow is None else slow.cancelled, self.free_motions(value))

    def matrices(self, value: Place) -> _Matrices:
        """Return the projected M, C and K at a value, (r, r) each, and whether K is symmetric; the last are kept."""
        if self._last_matrices is None or self._last_matrices[0] != value or self._last_matrices[1] is not self.V:
            self._last_matrices = value, self.V, self._matrices(value)
        return self._last_matrices[2]

    def _matrices(self, value: Place) -> _Matrices:
        at = self.at(value)
        sums: dict[Slot, np.ndarray | None] = {"M": None, "C": None, "K": None}
        symmetric = True
        for term, A in zip(at.terms, self._projected, strict=True):
            c = term.factor(1.0, at.parameters)
            if not c:
                continue
            symmetric &= term.symmetric or term.slot != "K"
            part = A * c
            before = sums[term.slot]
            sums[term.slot] = part if before is None else before + part
        M, C, K = sums.values()
        assert M is not None and K is not None
        return M, C, K, symmetric

    def free_motions(self, value: Place) -> FreeMotions:
        """Return the motions that nothing holds at a value of the parameter, in the coordinates of the basis."""
        return self._coordinates(self.at(value).free_motions())

    def _coordinates(self, known: FreeMotions) -> FreeMotions:
        """Return those motions of the problem that lie in the span of the basis, in its coordinates."""
        Z, V = known.motions, self.V
        if not Z.shape[1]:
            return FreeMotions.none(V.shape[1])
        if self._contained is None or self._contained[0] is not Z or self._contained[1] is not V:
            own, MZ = self._projected_mass(), times(self.problem.mass, Z)
            part = cross(V, MZ)
            Y = la.lstsq(own, part, lapack_driver="gelsy")[0]
            mass = Z.T @ MZ
            N = null_columns(mass - part.T @ Y, _CONTAINED * float(la.norm(mass)))
            self._contained = Z, V, Y @ N, N
        Y, N = self._contained[2:]
        return FreeMotions(Y, None if known.damping is None else cross(V, known.damping) @ N)

    def _projected_mass(self) -> np.ndarray:
        at, pairs = self.problem.parameters, zip(self.problem.terms, self._projected, strict=True)
        return np.asarray(sum(t.coefficient(at) * A for t, A in pairs if t.slot == "M"))

    def expect_slow_motions(self) -> None:
        """From now on look for motions that are hardly held whenever the basis has changed."""
        self.has_slow, self._last = True, None

    @property
    def slow(self) -> SlowMotions | None:
        """The motions that are hardly held, in the coordinates of the basis."""
        if not self.has_slow:
            return None
        if self._slow is None or self._slow[0] is not self.V:
            M = self._projected_mass()
            nu, Y = la.eigh(M)
            slow = (nu > 0) & (np.abs(1 + self.sigma * np.maximum(nu, 0.0)) < _SLOW)  # θ = σ + 1/ν
            Y = Y[:, slow] / np.sqrt(nu[slow])
            K = weighted(self.problem, self.metric) + self.sigma * self.problem.mass
            self._slow = self.V, SlowMotions.of(K, lift(self.V, Y), Y.T @ M) if slow.any() else None
        return self._slow[1]

    def modes(self, value: Place, highest: float) -> Modes:
        """Return the modes of the projected problem up to |λ| = highest, rad/s, with vectors of length r.

        With them come those that swing below that and grow faster, if there are any: seldom, which is told at once.
        """
        if not may_grow_dense(*self.matrices(value)[:3], highest):
            return solve_dense(self.pencil(value), highest, self._linear_solver)
        every = solve_dense(self.pencil(value), linear_solver=self._linear_solver)
        return every.select(np.flatnonzero(sizes(every.lam) <= highest))

    def base(self, sigma: float) -> Pencil:
        """Return the pencil of K = P + σM."""
        M = self.problem.mass
        return Pencil(M, in_rows(weighted(self.problem, self.metric) + sigma * M), symmetric=True)

    def undamped_values(self, sigma: float) -> np.ndarray:
        """Return the rising θ of the projected problem without damping and friction.

        VᵀPV = 1, so that θ = σ + 1/ν with the eigenvalues ν of VᵀMV.
        """
        nu = la.eigvalsh(self._projected_mass())[::-1]
        return np.asarray(sigma + 1 / nu[nu > len(nu) * np.finfo(float).eps * nu[0]])

    def collected(self) -> Problem:
        """Return the projected problem: the terms collected by powers of the parameter, or made anew at each value."""
        if isinstance(self.problem, Tabulated):
            table, path = self.problem, paths_of(self.problem.swept)[0]
            moving = MovingSource(table.whole, lambda values: self._made_at(values[path]))
            return moving.problem({**table.whole.changed, **table.parameters})
        terms = tuple(
            replace(t, matrix=sp.csr_array(A)) for t, A in zip(self.problem.terms, self._projected, strict=True)
        )

        def free(values: Mapping[str, float]) -> FreeMotions:
            return self._coordinates(replace(self.problem, parameters=values).free_motions())

        return Problem(terms, self.problem.parameters, free=free)

    def _made_at(self, value: float) -> Problem:
        """Return the projected problem at a value of a table; a value that it does not have is not taken over."""
        table, projected = self.problem, self._projected
        assert isinstance(table, Tabulated)
        if value not in table.known:
            table = table.with_value(value)
            new = table.terms[len(projected) :]
            projected = [*projected, *(self._product_with(_acting(t), self.V) for t in new)]
        at, known = table.at({table.swept: value}).parameters, table.known[value]
        terms = [
            replace(t, matrix=sp.csr_array(A), only=None)
            for t, A in zip(table.terms, projected, strict=True) if t.coefficient(at)
        ]  # fmt: skip
        swept = frozenset(paths_of(table.swept))  # which changes more than coefficients
        return Problem(tuple(terms), at, coupled=swept, free=lambda _: self._coordinates(known))

    @cached_property
    def _acting(self) -> list[_Acting]:
        return [_acting(t) for t in self.problem.terms]

    def residuals(self, value: Place, modes: Modes) -> tuple[np.ndarray, np.ndarray]:
        """Return Q(λ)φ and Q(λ)ᴴψ of each mode as real columns.

        Returns
        -------
        right, left : (n, k) or (n, 2k)
            Real parts, and imaginary ones behind them where there are any.
        """
        assert modes.left is not None
        at = self.at(value)
        factors = [t.factor(modes.lam, at.parameters) for t in at.terms]
        real = not any(x.imag.any() for x in (modes.right, modes.left, *factors))
        found = []
        for vectors, adjoint in ((modes.right, False), (modes.left, True)):
            u = combine(self.V, vectors.real if real else np.hstack([vectors.real, vectors.imag]))
            total = np.zeros_like(u)
            for (rows, A, transposed, sign), c in zip(self._acting, factors, strict=True):
                part = times(transposed if adjoint and transposed is not None else A, u)
                if adjoint and sign != 1:
                    part *= sign
                re, im = np.diag(c.real), np.diag(-c.imag if adjoint else c.imag)
                # Complex multiplication, on columns of real parts and columns of imaginary ones.
                part = part * c.real if real else combine(part, np.block([[re, im], [-im, re]]))
                total[slice(None) if rows is None else rows] += part
            found.append(total)
        return found[0], found[1]


def _acting(term: Term) -> _Acting:
    """Return a term in the rows in which it acts."""
    A = term.matrix
    transposed = None if term.symmetric or term.skew else in_rows(A.T)
    sign = -1.0 if term.skew else 1.0
    if isinstance(A, SpreadMatrix):
        return _Acting(None, A, transposed, sign)
    acts = np.diff(A.indptr) > 0
    acts[A.indices] = True  # in the rows of the transposed matrix
    rows = np.flatnonzero(acts)
    if len(rows) >= _SPARSE * A.shape[0]:
        return _Acting(None, A, transposed, sign)
    return _Acting(rows, sp.csr_array(A[rows]), None if transposed is None else sp.csr_array(transposed[rows]), sign)
