"""Refine a change of stability of the step model to a critical value of the problem itself."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .bisection import Bisection, onset_of, speed_of
from .changes import FINEST, Change
from .newton import Root
from .onset import Onset
from .roots import FAILURES, Roots
from .step import Step

_ONE_SHAPE = 0.999  # MAC: two modes of equal frequency with a larger one are one defective mode, and no doublet


@dataclass
class Refiner:
    """Refines the changes of stability of one step.

    Attributes
    ----------
    step : Step
    precise : bool
        Whether to refine onsets on the problem itself even if the reduced model gives them accurately enough.
    starts : bool
        Whether the step is the first of the sweep.
    """

    step: Step
    precise: bool
    starts: bool

    def onset(self, change: Change) -> Onset:
        """Return the onset that a change of stability of the step model stands for, without its branches.

        Raises
        ------
        NotConvergedError
            Neither Newton's method nor bisection finds a critical value between the limits of the change.
        """
        meets_at_start = self.starts and change.at_start and change.kind == "meeting" and self.step.in_theta
        if meets_at_start and self._is_doublet(change):
            lam = np.sqrt(-change.v + 0j)
            start = self.step.ends[0]
            return onset_of(self.step, change, start, abs(lam.imag) or abs(lam), np.nan, self._doublet_width(change))
        around = self._roots.around(change)
        root, sure = None, False
        # Newton's method fails if several equal pairs meet at once, or if damping is so small that Re λ is lost in
        # rounding on the stable side. Bisection still works then: it only needs to know whether modes are unstable.
        with suppress(*FAILURES):
            root, sure = self._roots.of(change)
        if not sure:  # the root may belong to another change of the group
            with suppress(*FAILURES):
                return self._bisection.onset(change, around)
        if root is None:
            return self._bisection.onset(change)
        onset = self._at(change, root)
        exact = None if root.exact is None else replace(self._at(change, root.exact), value=root.exact.value).numbers
        return replace(onset, exact=exact)

    def _at(self, change: Change, root: Root) -> Onset:
        """Return the onset of a change at a root."""
        omega = float(np.sqrt(max(root.theta, 0.0)))
        slow = change.kind in ("zero", "parting") or omega <= 1e-6 * speed_of(self.step, change)
        return onset_of(self.step, change, root.value, 0.0 if slow else omega, root.coefficient, root.uncertainty)

    def _is_doublet(self, change: Change) -> bool:
        """Return whether a change is that of a doublet: two modes of equal frequency and different shapes at the start.

        Such modes couple as soon as the parameter leaves its first value. Equal parts have two modes each.
        """
        start = self.step.end(0)
        near = self._nearest_at_start(change)
        if len(near) < 2 * change.copies or change.gains < 0:
            return False
        if np.abs(start.v[near] - start.v[near[0]]).max() > 4 * start.blur[near].max() + 1e-9 * abs(change.v):
            return False
        u = start.right[:, near]
        cosines = u.conj().T @ (start.M @ u)
        size = np.sqrt(cosines.diagonal().real)
        # Of two shapes the least eigenvalue is 1 − √MAC.
        return bool(np.linalg.eigvalsh(cosines / np.outer(size, size))[0] >= 1 - np.sqrt(_ONE_SHAPE))

    def _nearest_at_start(self, change: Change) -> np.ndarray:
        """Return the places of the modes at the start, two of each copy, whose eigenvalues are nearest to a change."""
        return np.argsort(np.abs(self.step.end(0).v - change.v))[: 2 * change.copies]

    def _doublet_width(self, change: Change) -> float:
        """Return how far from the start a doublet may still be stable, since its θ are equal only up to rounding.

        The coupling of the two modes grows in proportion to the parameter and reaches |Im θ| at the upper end of the
        change. They are unstable once it exceeds half the distance that their θ may have by rounding.
        """
        start, width = self.step.end(0), abs(change.high - self.step.ends[0])
        near = self._nearest_at_start(change)
        apart = np.abs(start.v[near] - start.v[near[0]]).max() / 2 + start.blur[near].max()
        return float(min(apart / abs(change.v.imag), 1.0) * width + FINEST * self.step.width)

    @cached_property
    def _bisection(self) -> Bisection:
        return Bisection(self.step)

    @cached_property
    def _roots(self) -> Roots:
        return Roots(self.step, self.precise)
