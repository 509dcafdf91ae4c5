"""Roots of a problem for changes of stability of a step model: Newton's method, on the step model first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..errors import NotConvergedError, SceneError, TooLargeError
from ..problem.problem import Problem
from ..reduced import SharperModel
from .bisection import share_within
from .changes import FINEST, Change
from .newton import Root, find_coalescence, find_crossing, find_zero
from .step import Step, real_direction
from .tracking import modal_assurance

_CORRECTIONS = 4  # of the mode of a root of a reduced model, at most, before it is refined on the problem itself
_INTERPOLATED = 6  # times, at most, that matrices are interpolated around a value
_SURE = 1e-7  # of the value: an onset of a reduced model that is less uncertain is not refined on the problem itself
_MOVED = 0.1  # of the step: a root of the problem may be so far from the root of the step model
_SAME_SHAPE = 0.9  # MAC: roots of the step model and of the problem whose modes have a larger one are the same root
_ALONE = 0.05  # of the distance to the next change of the group: a root that is nearer than this belongs to the change

_Newton = Callable[[Problem, float, np.ndarray, np.ndarray], Root]
# What the search for a root may end with. A trial of Newton's method may ask for a value where a scene has no static
# state, outside the sweep too.
FAILURES = NotConvergedError, SceneError, TooLargeError, ValueError, np.linalg.LinAlgError


@dataclass
class Roots:
    """Finds the roots of the changes of stability of one step.

    Attributes
    ----------
    step : Step
    precise : bool
        Whether to find roots on the problem itself even if the reduced model gives them accurately enough.
    """

    step: Step
    precise: bool

    def of(self, change: Change) -> tuple[Root, bool]:
        """Return the root of the problem by Newton's method, and whether it surely belongs to this change.

        It does if the root of the step model is between the samples of the change or close to them, or `_is_alone`, and
        the root of the problem has the same mode or is there too.

        Raises
        ------
        NotConvergedError
            Newton's method fails, or leaves the step or the interval of the change, or bisection is better.
        """
        if change.kind == "meeting" and not self.step.in_theta:
            raise NotConvergedError("two λ that meet on the imaginary axis: left to bisection")
        if change.kind in ("parting", "zero") and self.step.problem.problem_class == "complex":
            raise NotConvergedError("a real λ of complex matrices: left to bisection")
        near = 0.5 * (change.low + change.high)
        newton = self._newton(change)
        step, slack = self.step, FINEST * self.step.width
        root = self._between(change, newton(step.model, near, change.right, change.left), slack)
        x, y = (step.V @ v for v in (root.right, root.left))
        exact = step.problem.unknowns == step.model.unknowns and step.problem.is_affine(step.parameter)
        if exact and step.reduced_model is None:
            return root, self._is_around(change, root) or self._is_alone(change, root)
        better, same = self._on_problem(newton, root, x, y)
        # The step model has the rounding of the problem's matrices, which its own, smaller ones do not show.
        blurred = replace(root, uncertainty=max(root.uncertainty, better.uncertainty))
        sure = self._is_around(change, blurred) or self._is_alone(change, root)
        shift = abs(better.value - root.value)
        if shift > _MOVED * self.step.width:
            raise NotConvergedError("Newton's method left the step")
        return self._between(change, better, slack + 2 * shift), sure and (same or self._is_around(change, better))

    def _is_alone(self, change: Change, root: Root) -> bool:
        """Return whether a root of the step model is far nearer to a change than to any other of the same group.

        Its mode has to belong to the group. Samples are of the group matrix, whose error may move a change by more than
        the distance between two samples.
        """
        middle = 0.5 * (change.low + change.high)
        room = min(abs(limit - middle) for limit in change.limits)
        right, M = root.right[:, None].astype(complex), self.step.model.mass
        inside = share_within(change.group, right, M)[0] > _SAME_SHAPE
        return bool(inside) and abs(root.value - middle) <= _ALONE * room

    def _newton(self, change: Change) -> _Newton:
        """Return Newton's method for the kind of a change: a function of problem, parameter, right and left mode."""
        name, solver = self.step.parameter, self.step.linear_solver
        width = _MOVED * self.step.width + abs(change.high - change.low) / 2  # from the middle of the change
        theta = float(change.v.real) if self.step.in_theta else abs(change.v) ** 2

        def meeting(problem: Problem, p: float, x: np.ndarray, y: np.ndarray) -> Root:
            nonlocal theta
            x, y = (v if np.isrealobj(v) else real_direction(v[:, None]) for v in (x, y))
            root = find_coalescence(problem, name, p, theta, x, y, width, solver, enough=self._enough(problem))
            theta = root.theta
            if (root.coefficient_sign > 0) != (change.gains > 0) and root.theta > 0:
                raise NotConvergedError("Newton's method found the other end of a window")
            return root

        def zero(problem: Problem, p: float, x: np.ndarray, y: np.ndarray) -> Root:
            x, y = (v if np.isrealobj(v) else real_direction(v[:, None]) for v in (x, y))
            return find_zero(problem, name, p, x, y, width, self.step.free(problem), solver, self._enough(problem))

        def crossing(problem: Problem, p: float, x: np.ndarray, y: np.ndarray) -> Root:
            nonlocal theta
            lam = change.v if not self.step.in_theta else 1j * np.sqrt(change.v)
            omega = abs(lam.imag) if p == 0.5 * (change.low + change.high) else float(np.sqrt(theta))
            root = find_crossing(problem, name, p, omega, x, y, width, solver, self._enough(problem))
            theta = root.theta
            if (root.coefficient > 0) != (change.gains > 0):
                raise NotConvergedError("Newton's method found another crossing")
            return root

        def parting(problem: Problem, p: float, x: np.ndarray, y: np.ndarray) -> Root:
            nonlocal theta
            x, y = (v if np.isrealobj(v) else real_direction(v[:, None]) for v in (x, y))
            lam = float(change.v.real) if theta > 0 else float(np.sqrt(-theta))
            root = find_coalescence(problem, name, p, lam, x, y, width, solver, True, self._enough(problem))
            theta = root.theta
            if (root.coefficient_sign > 0) == (change.gains > 0):
                raise NotConvergedError("Newton's method found another double eigenvalue")
            return root

        return {"parting": parting, "meeting": meeting, "zero": zero, "crossing": crossing}[change.kind]

    def _enough(self, problem: Problem) -> float:
        """Return the part of a value below which a step of Newton's method on a problem is the last.

        Each step on the problem itself factorises its matrices. Behind a reduced model it starts from that model's root
        and has to be as certain as this root would have had to be.
        """
        reduced = self.step.reduced_model is not None and not self.precise
        return _SURE if reduced and problem is self.step.full else 0.0

    def _between(self, change: Change, root: Root, slack: float) -> Root:
        """Return a root if it is between the limits of its change.

        Raises
        ------
        NotConvergedError
            It is beyond the limits, and so belongs to another change.
        """
        slack += root.uncertainty
        low, high = sorted(change.limits)
        if not low - slack <= root.value <= high + slack:
            raise NotConvergedError("Newton's method left the interval of the change")
        return root

    def _on_problem(self, newton: _Newton, root: Root, x: np.ndarray, y: np.ndarray) -> tuple[Root, bool]:
        """Return a root of the problem from one of the step model, and whether the two roots have the same mode.

        Without a reduced model Newton's method continues on the problem itself. With a reduced model it continues on
        that, and residuals tell how far its root may be from that of the problem. If this is more than rounding and
        more than `_SURE` allows, or with `precise`, the root of the problem itself is found apart from it: of a modal
        projection it is the same, with that error.
        """
        step, reduced, first = self.step, self.step.reduced_model, x
        if reduced is None:
            root = newton(step.problem, root.value, x, y)
            return root, _is_one_shape(first, root.right, step.problem.mass)
        root, here = self._on_reduced(newton, step.problem, root.value, x, y)
        error, rounding = reduced.root_error(root.value, root.lam, root.right, root.left, here, root.crosses)
        same = _is_one_shape(first, root.right, step.problem.mass)
        whole = replace(root, uncertainty=root.uncertainty + error + rounding)
        if error <= max(rounding, _SURE * abs(root.value)) and not self.precise:
            return whole, same
        exact: Root | None = whole
        if self.precise or not reduced.is_modal:
            exact = None if self.precise else self._sharpened(newton, root)
            if exact is not None and not self._is_same(root, exact):
                exact = None
        if exact is None:
            x, y = (reduced.lift(v) for v in (root.right, root.left))
            exact = newton(step.full, root.value, x, y)
            if not _is_one_shape(x, exact.right, step.full.mass):
                raise NotConvergedError("Newton's method found another mode")
        if abs(exact.value - root.value) > max(_MOVED * step.width, error):
            raise NotConvergedError("Newton's method left the step")
        return replace(root, uncertainty=root.uncertainty + rounding, exact=exact), same

    def _on_reduced(
        self, newton: _Newton, problem: Problem, value: float, x: np.ndarray, y: np.ndarray
    ) -> tuple[Root, Problem]:  # fmt: skip
        """Return the root of a reduced problem, and that problem at it, affine in the parameter.

        If the parameter changes matrices, each of Newton's steps would need them at three values. So they are
        interpolated beside the root, once more if it turns out to be farther away; what that leaves is in the error of
        the root, see `ReducedBasis.root_error`.

        Raises
        ------
        NotConvergedError
            As `newton`, or roots of interpolated matrices stay away from where they were interpolated.
        """
        name = self.step.parameter
        if problem.is_affine(name):
            return newton(problem, value, x, y), problem
        for _ in range(_INTERPOLATED):
            around = self.step.beside(problem, value)
            root = newton(around, 0.0, x, y)
            away, root = root.value, replace(root, value=value + root.value)
            if abs(away) <= self.step.near(value):
                return root, around.at({name: away})
            value, x, y = float(np.clip(root.value, *self.step.ends)), root.right, root.left
        raise NotConvergedError("the root of interpolated matrices does not settle")

    def around(self, change: Change) -> tuple[float, float]:
        """Return the interval in which a root surely belongs to a change: its samples, widened, within its limits."""
        spread = abs(change.high - change.low) + FINEST * self.step.width
        low, high = sorted(change.limits)
        return max(low, change.low - spread), min(high, change.high + spread)

    def _is_around(self, change: Change, root: Root) -> bool:
        low, high = self.around(change)
        return low - root.uncertainty <= root.value <= high + root.uncertainty

    @cached_property
    def _sharper(self) -> SharperModel:
        assert self.step.reduced_model is not None
        return SharperModel(self.step.reduced_model)

    def _is_same(self, root: Root, exact: Root) -> bool:
        """Return whether a root of the sharper model has the mode of one of the reduced model."""
        first = self._sharper.padded(root.right)
        return _is_one_shape(first, self._sharper.padded(exact.right), self._sharper.problem.mass)

    def _sharpened(self, newton: _Newton, root: Root) -> Root | None:
        """Return a root of the reduced model that corrections of its mode make as certain as `_SURE`; None if not so.

        The factors are those in the middle of the sweep first, and only then those at the root itself.
        """
        sharper, reduced = self._sharper, self.step.reduced_model
        assert reduced is not None
        for trial in range(_CORRECTIONS):
            factor = None  # before others take memory
            factor = reduced.middle if trial < _CORRECTIONS // 2 else reduced.factorize(root.value)
            x, y = sharper.padded(root.right), sharper.padded(root.left)
            try:
                sharper.correct(root.value, root.lam, x, y, factor)
                x, y = sharper.padded(x), sharper.padded(y)
                root, here = self._on_reduced(newton, sharper.problem, root.value, x, y)
            except FAILURES:
                return None
            error, rounding = sharper.root_error(root.value, root.lam, root.right, root.left, here, root.crosses)
            if error <= max(rounding, _SURE * abs(root.value)):
                return replace(root, uncertainty=root.uncertainty + error + rounding)
        return None


def _is_one_shape(first: np.ndarray, second: np.ndarray, M: sp.csr_array) -> bool:
    return bool(modal_assurance(first[:, None], second[:, None], M)[0, 0] > _SAME_SHAPE)
