"""What is known of the modes of a growing basis at places, and for how long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..eigen.columns import Columns
from ..eigen.pencil import Modes
from ..eigen.request import Request, is_needed
from ..problem.parameters import Place
from ..problem.problem import Problem
from .basis import ReducedBasis
from .estimate import GUARDED, Estimate, estimated, method_of, neighbours
from .two_sided import TwoSided

_LAST = 5  # places whose modes are all kept, until the basis changes
_BETWEEN = 3  # values whose modes the basis has: from then on modes between them follow from these


class ModesAtPlaces:
    """The modes of a basis at places with their errors, kept until the basis changes, or for good.

    Attributes
    ----------
    basis : ReducedBasis
    request : Request
    highest : float, rad/s
        Frequency up to which the basis holds the modes of the problem without damping and friction.
    """

    basis: ReducedBasis
    request: Request
    highest: float
    # Whether modes that meet the tolerance stay what they are when the basis grows. Not before missing modes were
    # looked for: what the basis gets until then may be a mode that they lack.
    _keeps = False
    _is_made = False  # once the basis is, modes at further values are not kept for those between

    def _know_nothing(self, problem: Problem, along: bool) -> None:
        """Begin with nothing known; `along` tells whether places are values of a single parameter."""
        self._known: dict[Place, Estimate] = {}
        # Places whose modes met the tolerance on so many vectors, and the modes of so many values: they stay.
        self._met: dict[Place, tuple[int, int]] = {}
        self._found_with: dict[Place, tuple[int, int]] = {}  # the same of all places that were looked at
        self._last: dict[Place, Modes] = {}
        self._known_with: Columns | None = None  # the basis that these belong to
        # For modes at values between those whose modes are known.
        is_real = problem.problem_class == "quadratic"
        self._between = TwoSided(self.request.tolerance, is_real) if along and problem.is_damped else None

    def _know_less(self) -> None:
        """Forget what was to stay: the basis got modes that all that was known lacks.

        They may be rough as yet, and out of the range at values where they belong to it: nothing stays until modes have
        been looked for once more.
        """
        self._met.clear()
        self._keeps = False
        if self._between is not None:
            self._between = self._between.emptied()

    def _estimated(self, value: Place) -> Estimate:
        """Return the modes asked for, for each how far it is from meeting the tolerance (1: just met), and |Δλ/λ|."""
        self._forget()
        if value not in self._known:
            size, count = self._met.get(value, self._size())
            basis = self.basis if size == len(self.basis) else self.basis.leading(size)  # of a model that was stored
            modes = None
            if self._between is not None and count >= _BETWEEN and isinstance(value, float):
                modes = self._between.modes(basis, value, self.request, self.highest, count)
            self._found_with[value] = size, count
            if modes is None and basis is self.basis:
                modes = self._every(value)
                if not self._is_made and count >= _BETWEEN:
                    self._keep_beside(value, modes, modes)
            elif modes is None:
                modes = basis.modes(value, GUARDED * self.highest)
            self._known[value] = self._padded(self._estimate(value, basis, modes))
        return self._known[value]

    def _size(self) -> tuple[int, int]:
        """Return how many vectors the basis has, and the modes of how many values are kept beside it."""
        return len(self.basis), 0 if self._between is None else len(self._between)

    def _forget(self) -> None:
        """Drop what is known of modes if the basis has changed, but for those that met the tolerance for good."""
        if self._known_with is not self.basis.V:
            self._known = {p: self._padded(e) for p, e in self._known.items() if p in self._met}
            self._last, self._known_with = {}, self.basis.V

    def _padded(self, estimate: Estimate) -> Estimate:
        """Return modes of the first vectors of the basis in the coordinates of all vectors."""
        modes, off, relative = estimate
        assert modes.left is not None
        more = ((0, len(self.basis) - len(modes.right)), (0, 0))
        right, left = np.pad(modes.right, more), np.pad(modes.left, more)
        return replace(modes, right=right, left=left, method=method_of(self.basis)), off, relative

    def _every(self, value: Place) -> Modes:
        """Return the modes at a value up to above the highest frequency of the basis; the last few are kept."""
        self._forget()
        if value not in self._last:
            for place in list(self._last)[: 1 - _LAST]:
                del self._last[place]
            self._last[value] = self.basis.modes(value, GUARDED * self.highest)
        return self._last[value]

    def _off(self, value: Place) -> float:
        """Return how far the worst mode at a value is from meeting the tolerance: 1 where it just does.

        Modes that meet it may stay what they are when the basis grows, which would change them by less than that.
        """
        off = float(self._estimated(value)[1].max(initial=0.0))
        if self._keeps and off <= 1:
            self._met.setdefault(value, self._found_with[value])
        return off

    def _worst(self, off: dict[Place, float]) -> Place:
        """Return the place that misses the tolerance most.

        Errors fall as the basis grows, so that an earlier error bounds one that was not estimated anew.
        """
        fresh: set[Place] = set()
        while True:
            worst = max(off, key=lambda p: off[p])
            if worst in fresh:
                return worst
            off[worst] = self._off(worst)
            fresh.add(worst)

    def _estimate(self, value: Place, basis: ReducedBasis, every: Modes) -> Estimate:
        return estimated(basis, value, every, self.request, self.highest)

    def _keep_beside(self, value: Place, every: Modes, exact: Modes) -> None:
        """Keep the modes at a value beside the basis, for values between: all that there are, and exact ones."""
        if self._between is not None and isinstance(value, float):
            exact = exact.select(np.flatnonzero(is_needed(exact)))
            near = float(np.abs(neighbours(exact, self.request).lam).max(initial=0.0))
            self._between.add(value, every, exact, near)
