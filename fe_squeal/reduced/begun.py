"""The start of a reduced model: modes without damping and friction at one value of a parameter."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from ..eigen.block_lanczos import lowest_modes
from ..eigen.columns import part_here
from ..eigen.growth import sizes
from ..eigen.inertia import count_below
from ..eigen.linear.choice import choose, is_large
from ..eigen.linear.factor import LinearSolver
from ..eigen.memory import require_vectors
from ..eigen.pencil import Modes
from ..eigen.request import Request
from ..errors import NotConvergedError
from ..problem.aside import put_aside
from ..problem.forms import collect_powers
from ..problem.parameters import Place, values_at
from ..problem.problem import Problem
from ..problem.tabulated import Tabulated
from .basis import ReducedBasis
from .estimate import is_short, swinging_sizes
from .growing import GrowingModel
from .mode_corrections import ModeCorrections
from .undamped import factorize_undamped

_GUARD = 1.25  # the basis begins with so many times as many undamped modes as modes are asked for
_ROUGH = 1e-4  # accuracy of these undamped modes: the corrections that follow mend the rest
_LANCZOS = 5  # times the number of undamped modes: vectors that the Lanczos iteration keeps (4 of tetrahedra)
_SLOW = 0.1  # part of −σ: a smaller θ, which is known roughly, may belong to a motion that is hardly held
# The basis begins anew with modes up to so many times the highest frequency where it knows too few elsewhere, or up to
# so many times that of the last one needed there, unless it has so many times as many vectors as modes are asked for.
_WIDER, _ABOVE, _MOST = 1.5, 1.05, 12


class BegunModel(GrowingModel):
    """A reduced model that begins with the modes at one place, enough of them for some other places."""

    _least = 0  # modes that are needed at every place
    _number: int | None = None  # of modes of any frequency, where the basis begins with all of them

    def _widen(self, problem: Problem, places: Iterable[Place]) -> None:
        """Begin anew with so many modes that at other places, too, the number asked for is below the highest one.

        That is needed if stiffness that grows on the way raises frequencies, or damping leaves few modes that swing.

        Raises
        ------
        NotConvergedError
            These would be too many.
        """
        places = tuple(places)
        while (short := next((p for p in places if self._is_short(self._every(p))), None)) is not None:
            if self._number is not None:
                self.highest = max(float(sizes(self.basis.modes(p, np.inf).lam).max()) for p in places)
                self._know_nothing(problem, isinstance(self.parameter, str))
                return
            if len(self.basis) > _MOST * self._least:
                raise self._too_few(short)
            reach = max(self._reach(self._every(p)) for p in places)
            self._begin(problem, self.parameter, self._start, self.request, self.linear_solver, reach)

    def _is_short(self, modes: Modes) -> bool:
        return is_short(modes, self._least, self.highest, self._number)

    def _reach(self, modes: Modes) -> float:
        """Return the frequency, rad/s, up to which modes at the start have to be known, judged by those at a place."""
        known = swinging_sizes(modes)
        return _ABOVE * float(known[self._least - 1]) if len(known) >= self._least else _WIDER * self.highest

    def _too_few(self, place: Place) -> NotConvergedError:
        at, start = (
            ", ".join(f"{name} = {value:g}" for name, value in values_at(self.parameter, p).items())
            for p in (place, self._start)
        )
        return NotConvergedError(
            f"at {at} the reduced model has fewer than {self._least} modes in the range in which it knows all at"
            f" {start}"
        )

    def _begin(
        self, problem: Problem, parameter: str | tuple[str, ...], start: Place, request: Request,
        linear_solver: LinearSolver | str, reach: float | None = None,
    ) -> None:  # fmt: skip
        """Put the modes without damping and friction at one place into the basis, and keep the factors of P.

        These are all up to the frequency `reach`, rad/s, or without it some more than are asked for.
        """
        self.linear_solver = choose(linear_solver)
        self.problem = problem = problem.solved_with(self.linear_solver)
        self.parameter, self.request, self._start = parameter, request, start
        factorizations = 0
        self._added: Counter[Place] = Counter()  # how often the modes at a place were added
        self._know_nothing(problem, isinstance(parameter, str))
        collected = collected_at(problem, parameter, start)
        self._put_terms_aside(collected)
        limit = request.max_frequency_hz
        band = reach if limit is None else 2 * np.pi * limit
        base, self._sigma, metric, definite = factorize_undamped(collected, band, self.linear_solver)
        count = request.count or 0
        if band is not None:
            below = count_below(base, band, self.linear_solver)
            if below is None and limit is not None:
                raise NotConvergedError("the linear solver does not count the modes below solve.max_frequency")
            count = int(_WIDER**2 * len(self.basis)) if below is None else below
            factorizations += 1
        M, n, large = base.M, base.n, is_large(base.K.nnz, self.linear_solver)
        del base  # and its K, before there are many vectors
        count = min(int(_GUARD * count) + 4, n)
        require_vectors(n, _LANCZOS * count, 8, part_here(n))
        theta, vectors = lowest_modes(definite, M, self._sigma, count, _ROUGH)
        self._corrections = ModeCorrections(
            problem, self._sigma, request.tolerance, start, self.linear_solver, definite, large
        )
        self._corrections.factorizations = factorizations + 1
        self.highest = float(np.sqrt(theta.max(initial=0.0)))
        self.basis = ReducedBasis(collected, parameter, metric, self._sigma, definite.half_solve, self.linear_solver)
        unheld = collected.free_motions().motions
        if unheld.shape[1]:
            self.basis.append(unheld)  # first, so that the basis has them exactly
        self.basis.append(vectors)
        is_whole = count == n or vectors.shape[1] < count  # where the rank of M is smaller
        self._number = len(self.basis) if is_whole else None
        del vectors
        if (self.basis.undamped_values(self._sigma) < -_SLOW * self._sigma).any():
            self.basis.expect_slow_motions()
        first = self._estimated(start)[0]
        if not len(first):
            raise NotConvergedError("the reduced model has no modes in the range that was asked for")
        self.basis.calibrate(start, first)

    def _put_terms_aside(self, collected: Problem) -> None:
        """Move the terms of a large problem to files: they are not needed before shares are asked for."""
        summed = [t.matrix for t in collected.terms]
        if is_large(max(A.nnz for A in summed), self.linear_solver):
            put_aside(self.problem.terms, summed)


def collected_at(problem: Problem, parameter: str | tuple[str, ...], start: Place) -> Problem:
    """Return a problem with few terms: the powers of a parameter, or a table of one that changes matrices."""
    if isinstance(parameter, tuple) or problem.is_affine(parameter) or problem.source is None:
        return collect_powers(problem, parameter).at(values_at(parameter, start))
    assert isinstance(start, float)
    return Tabulated.of(problem, parameter, start)
