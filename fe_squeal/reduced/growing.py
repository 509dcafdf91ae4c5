"""How the basis of a reduced model grows: by the modes at the values where it is worst, and by modes that it lacks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..eigen.linear.choice import factorize_definite_roughly
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Modes
from ..eigen.request import is_needed
from ..errors import NotConvergedError
from ..problem.forms import is_linear
from ..problem.parameters import Place
from .basis import ReducedBasis
from .estimate import Estimate, neighbours
from .missing import SEARCH_SOLVES, end_of_range, missing_modes, search_vectors
from .mode_corrections import ROUNDS, ModeCorrections
from .places import ModesAtPlaces
from .soft import leaves_friction_out, vectors_beside
from .undamped import weighted
from .vectors import thin_svd, unit_columns
from .whirling import whirl_rate, whirling_vectors

_NODES = 24  # largest number of values whose modes span the basis
_CANDIDATES = 5  # number of values among which the one with the largest error is next
_KEPT = 0.1  # times √tolerance: parts of unit modes outside the basis that are shorter are left out
_FURTHER = 0.3  # times what an error may be: each time that modes are added at a value once more
_COUNTED = 25  # values at which soft directions are counted, at most, where K is not linear in the parameter
_SUPPLEMENTS = 6  # how often the basis is extended for values that were no candidates


class GrowingModel(ModesAtPlaces):
    """A basis to which modes at places are added until those at all places meet the tolerance.

    Attributes
    ----------
    parameter : str or tuple of str
    linear_solver : LinearSolver
    enough : float
        Of what an error may be: below that modes that are put into the basis are not corrected any more.
    """

    parameter: str | tuple[str, ...]
    linear_solver: LinearSolver
    enough = 1.0
    _counts_start = False  # whether modes are counted here at the start too, where P has all of the symmetric part of K
    _start: Place  # where the basis has all modes of the problem without damping and friction
    _corrections: ModeCorrections
    _added: Counter[Place]  # how often the modes at a place were added
    _outside: np.ndarray | None = None  # vectors (n, ·) to look for missing modes with

    def _grow(self, values: np.ndarray) -> None:
        """Add the modes at a few values, each the worst of the candidates, until all meet the tolerance there.

        Then the values half way between candidates are candidates, too: modes are least exact far from all values whose
        modes the basis has.
        """
        candidates = spread(values, _CANDIDATES)
        self._search()  # as long as there are factors of P
        if self._off(self._start) > 1:
            self._add_modes(self._start)
        else:
            every = self._every(self._start)
            self._keep_beside(self._start, every, every)
        searched = None  # the basis in which no mode was missing
        found: dict[Place, float] = dict.fromkeys(candidates, np.inf)
        for _ in range(_NODES):
            worst = self._worst(found)
            if found[worst] <= 1 and (between := set(spread(values, 2 * _CANDIDATES - 1)) - found.keys()):
                found |= dict.fromkeys(sorted(between), np.inf)
                worst = self._worst(found)
            if found[worst] <= 1 and searched is self.basis.V:
                return
            if found[worst] > 1:
                self._add_modes(worst)
            if searched is None or found[worst] <= 1:
                if self._add_missing([candidates[0], candidates[-1]]):  # rough ones: another search may have more
                    self._know_less()
                    found = dict.fromkeys(found, np.inf)
                else:
                    searched = self.basis.V
                self._keeps = True
        raise self._misses(worst, found[worst])

    def _supplement(self, values: np.ndarray) -> None:
        """Add the modes at further values, the worst first, until all values meet the tolerance on one basis.

        The basis misses no mode any more, so that none is looked for.
        """
        for _ in range(_SUPPLEMENTS):
            basis = self.basis.V
            missed = {p: off for p in values.tolist() if (off := self._off(p)) > 1}
            while missed and missed[worst := self._worst(missed)] > 1:
                if self._added[worst] >= ROUNDS:
                    raise self._misses(worst, missed[worst])
                self._add_modes(worst)
            if self.basis.V is basis:
                return
        raise self._misses(worst, missed[worst])

    def _far_from_the_start(self, values: np.ndarray) -> set[Place]:
        """Return where modes are looked for that are soft there and in no mode of the basis.

        These are the ends of the sweep, and if K is not linear in the parameter values between them too: one that is
        soft elsewhere alone may still be missed.
        """
        assert isinstance(self.parameter, str)
        places: set[Place] = {float(values[0]), float(values[-1])}
        if not is_linear(self.basis.problem, self.parameter):
            places.update(spread(values, _COUNTED))
        return places

    def _add_soft(self, places: Iterable[Place]) -> bool:
        """Add modes that are soft at some places and in no mode of the basis, and return whether there are any."""
        places = sorted(places)
        found: list[np.ndarray] = []
        for value in places:
            for outside in self._brought_down(value):
                known = [self._every(value)]
                found += missing_modes(self.basis, [value], known, self.request, self.highest, outside)
        return bool(found) and self.basis.append(np.hstack(found)) > 0

    def _brought_down(self, value: Place) -> Iterator[np.ndarray]:
        """Yield vectors (n, ·) that may hold modes which the terms left out of P bring into the range at a value.

        The symmetric part of K is counted. At the start, where P has all of it unless friction is left out, a sweep
        counts later. Gyroscopic terms may bring a mode down, too: their Hermitian matrix is counted with it, unless
        they are too small for that.
        """
        highest = end_of_range(self._every(value), self.request, self.highest)
        if highest**2 + highest * whirl_rate(self.basis.at(value)) > self.highest**2:
            self._corrections.factorizations += 1
            yield from self._counted(whirling_vectors(self.basis, value, highest, self.linear_solver))
        if value != self._start or self._counts_start or leaves_friction_out(self.basis, value):
            self._corrections.factorizations += 1
            yield from self._counted(vectors_beside(self.basis, value, highest, self.linear_solver))

    def _counted(self, outside: tuple[np.ndarray, int] | None) -> Iterator[np.ndarray]:
        """Yield the vectors that a count found lacking, if any, and count the solutions that found them."""
        if outside is not None:
            self._corrections.factorizations += 1
            self._corrections.solves += outside[1]
            yield outside[0]

    def _misses(self, value: Place, off: float) -> NotConvergedError:
        return NotConvergedError(
            f"the reduced model misses the tolerance {off:.2g} times at {self.parameter} = {value:g} with"
            f" {len(self.basis)} vectors"
        )

    def _add_modes(self, value: Place) -> None:
        """Add the right and left modes at a value, corrected until they meet the tolerance.

        The corrections tried on the way do not stay in the basis. At a value between those whose modes the basis has,
        the error of an eigenvalue is the product of the errors of its right and left modes, so that few values suffice.
        Where that was done before and was not enough, they are corrected further, however little they miss.
        """
        again = self._added[value]
        self._added[value] += 1

        def estimate(basis: ReducedBasis, modes: Modes) -> Estimate:
            return self._estimate(value, basis, modes)

        known, before = self._every(value), len(self.basis)
        wide, every = self._corrections.corrected(
            self.basis, value, known, self.highest, self.enough * _FURTHER**again, estimate
        )
        columns, least = self._kept(wide, every, again)
        if len(wide) == before:  # no correction lies outside the basis
            self._keep_beside(value, known, every)
            return
        U, s, _ = thin_svd(columns[before:])
        new = U[:, s > least]
        if new.shape[1]:
            self.basis = wide.narrowed(before, new)
        assert every.left is not None
        # In coordinates of the basis as it is now, without the parts that were left out.
        right, left = (np.vstack([x[:before], new.T @ x[before:]]) for x in (every.right, every.left))
        self._keep_beside(value, known, replace(every, right=right, left=left))

    def _kept(self, wide: ReducedBasis, every: Modes, again: int) -> tuple[np.ndarray, float]:
        """Return what is kept of the modes at a value: columns of coordinates, and which parts of them are left out.

        These are directions whose angle with the basis has a smaller sine. The error of an eigenvalue is the product of
        the errors of its right and left modes, so that each of these may be the root of the tolerance. If modes were
        added at this value before and that was not enough, a tenth of it.
        """
        # Modes above those asked for stay too: what the basis lacks is then far from the modes asked for, as the
        # estimated errors suppose.
        every = neighbours(every.select(np.flatnonzero(is_needed(every))), self.request)
        assert every.left is not None
        return unit_columns(every.right, every.left), _KEPT * self.request.tolerance**0.5 * 0.1**again

    def _search(self) -> None:
        """Find vectors of modes that the basis may lack, by factors of P."""
        definite = self._corrections.definite
        if definite is None:
            self._corrections.release()
            self._corrections.factorizations += 1
            base, metric = self.basis.problem, self.basis.metric
            definite = factorize_definite_roughly(lambda: weighted(base, metric), self.linear_solver)
        self._outside = search_vectors(self.basis, definite)
        self._corrections.solves += SEARCH_SOLVES

    def _add_missing(self, values: Sequence[Place]) -> bool:
        """Add modes that the basis does not hold, if there are any, and return whether there were."""
        if self._outside is None:  # modes were found by the last search: there may be more than it could find
            self._search()
        assert self._outside is not None
        known = [self._every(p) for p in values]
        found = missing_modes(self.basis, values, known, self.request, self.highest, self._outside)
        if not found or not self.basis.append(np.hstack(found)):
            return False
        self._outside = None
        return True


def spread(values: np.ndarray, count: int) -> list[float]:
    """Return so many of some values (m,), or all, from the first to the last one in equal steps of their positions."""
    positions = np.unique(np.round(np.linspace(0, len(values) - 1, count)).astype(int))
    return [float(p) for p in values[positions]]
