"""From a change of stability on the step model to a critical value of the problem itself."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..eigen.dense import solve_dense
from ..eigen.pencil import Modes
from ..eigen.request import Request
from ..eigen.solve import solve_modes
from ..errors import NotConvergedError
from ..problem.problem import Problem
from .changes import FINEST, Change
from .newton import Root, find_coalescence, find_crossing, find_zero
from .onset import Onset
from .step import Step, real_direction
from .tracking import modal_assurance

_BISECTED = 1e-7  # of the step: the width at which a bisection ends
_CHEAP = 20_000  # unknowns up to which factorisations cost little
_SURE = 1e-7, 1e-8  # relative uncertainty at which an onset of a reduced model is left as it is; where they cost little
_MOVED = 0.1  # of the step: how far a root of the problem may lie from that of the step model
_ONE_SHAPE = 0.999  # MAC of two modes of equal frequency from which they are one defective mode and no doublet
_SAME_SHAPE = 0.9  # MAC of the modes of two roots, of the step model and of the problem, from which they are the same
_WITHIN = 0.5  # of a mode's energy: with more of it in the span of a group's shapes the mode belongs to the group
_FAST = 4.0  # times the highest frequency: |λ| up to which modes may grow
_ASIDE = 1e-3  # of the step: how far from a bisected onset its growth rate is measured

_Newton = Callable[[Problem, float, np.ndarray, np.ndarray], Root]


@dataclass
class Refiner:
    """Refines the changes of stability of one step.

    Attributes
    ----------
    step : Step
    precise : bool
        Refine roots of a reduced model on the problem itself, whatever it costs.
    starts : bool
        Whether the step is the first of the sweep.
    """

    step: Step
    precise: bool
    starts: bool

    def onset(self, change: Change) -> Onset:
        """Return the critical value that a change on the step model leads to.

        Raises
        ------
        NotConvergedError
            If there is none between the limits of the change.
        """
        if self.starts and change.at_start and change.kind == "meeting" and self._theta and self._is_doublet(change):
            lam = np.sqrt(-change.v + 0j)
            start = self.step.ends[0]
            return self._made(change, start, abs(lam.imag) or abs(lam), np.nan, self._doublet_width(change))
        around = self._around(change)
        root, sure = None, False
        # Newton's method fails where several equal pairs meet at once, or where damping is so small that Re λ is lost
        # in rounding on the stable side. Whether modes are unstable can still be told: bisection.
        with suppress(NotConvergedError, ValueError, np.linalg.LinAlgError):
            root, sure = self._root(change)
        if not sure:  # it may be that of another change of the group
            with suppress(NotConvergedError, ValueError, np.linalg.LinAlgError):
                return self._bisected(replace(change, limits=around))
        if root is None:
            return self._bisected(change)
        omega = float(np.sqrt(max(root.theta, 0.0)))
        slow = change.kind in ("zero", "parting") or omega <= 1e-6 * self._speed(change)
        return self._made(change, root.value, 0.0 if slow else omega, root.coefficient, root.uncertainty)

    @property
    def _width(self) -> float:
        return abs(self.step.ends[1] - self.step.ends[0])

    def _around(self, change: Change) -> tuple[float, float]:
        """Return where a change is looked for first: between its samples and as far beyond, inside the limits."""
        spread = abs(change.high - change.low) + FINEST * self._width
        low, high = sorted(change.limits)
        return max(low, change.low - spread), min(high, change.high + spread)

    def _speed(self, change: Change) -> float:
        """Return |λ| of the eigenvalue that changes; where that is zero, the largest |λ| at the start of the step."""
        size = abs(change.v) if self.step.model.is_damped and not self._theta else np.sqrt(abs(change.v))
        return float(size) or float(np.abs(self.step.modes_at_ends[0].lam).max(initial=1.0))

    @property
    def _theta(self) -> bool:
        return not any(t.slot == "C" for t in self.step.model.terms)

    def _made(self, change: Change, value: float, omega: float, speed: float, uncertainty: float) -> Onset:
        kind = "flutter" if omega else "divergence"
        direction = "into" if change.gains >= 0 else "out of"
        return Onset(
            self.step.parameter, float(value), float(omega / (2 * np.pi)), kind, direction, float(speed), 0, None,
            float(uncertainty),
        )  # fmt: skip

    def _is_doublet(self, change: Change) -> bool:
        """Whether a change is that of two modes of equal frequency and different shapes, which couple at once."""
        start = self.step.end(0)
        near = np.argsort(np.abs(start.v - change.v))[:2]
        if len(near) < 2 or change.gains < 0:
            return False
        apart = abs(start.v[near[0]] - start.v[near[1]])
        if apart > 4 * start.blur[near].max() + 1e-9 * abs(change.v):
            return False
        u = start.right[:, near]
        return bool(modal_assurance(u[:, :1], u[:, 1:], start.M)[0, 0] <= _ONE_SHAPE)

    def _doublet_width(self, change: Change) -> float:
        """Return how far from the start a doublet may still be stable: its two eigenvalues are equal to rounding only.

        The coupling grows in proportion to the parameter, up to |Im θ| at the upper end of the change. The pair is
        unstable from where it exceeds half the distance that rounding may have left between the two eigenvalues.
        """
        start, width = self.step.end(0), abs(change.high - self.step.ends[0])
        near = np.argsort(np.abs(start.v - change.v))[:2]
        apart = abs(start.v[near[0]] - start.v[near[1]]) / 2 + start.blur[near].max()
        return float(min(apart / abs(change.v.imag), 1.0) * width + FINEST * self._width)

    # Newton's method, on the step model first.

    def _root(self, change: Change) -> tuple[Root, bool]:
        """Return the root of the problem, and whether it is sure to be that of this change and of no other.

        It is where the root of the step model lies between the samples of the change or close to them, and the problem
        has the same mode there.
        """
        if change.kind == "meeting" and not self._theta:
            raise NotConvergedError("two λ that meet on the imaginary axis: left to bisection")
        near = 0.5 * (change.low + change.high)
        newton = self._newton(change)
        step, slack = self.step, FINEST * self._width
        root = self._between(change, newton(step.model, near, change.right, change.left), slack)
        low, high = self._around(change)
        sure = low <= root.value <= high
        x, y = (step.V @ v for v in (root.right, root.left))
        if step.problem.unknowns == step.model.unknowns and step.reduced_model is None:
            return root, sure
        better, same = self._on_problem(newton, root, x, y)
        shift = abs(better.value - root.value)
        if shift > _MOVED * self._width:
            raise NotConvergedError("Newton's method left the step")
        return self._between(change, better, slack + 2 * shift), sure and (same or low <= better.value <= high)

    def _newton(self, change: Change) -> _Newton:
        name, solver, width = self.step.parameter, self.step.linear_solver, _MOVED * self._width
        theta = float(change.v.real) if self._theta else abs(change.v) ** 2

        def meeting(problem: Problem, p: float, x: np.ndarray, y: np.ndarray) -> Root:
            nonlocal theta
            x, y = (v if np.isrealobj(v) else real_direction(v[:, None]) for v in (x, y))
            root = find_coalescence(problem, name, p, theta, x, y, width, solver)
            theta = root.theta
            if (root.coefficient_sign > 0) != (change.gains > 0) and root.theta > 0:
                raise NotConvergedError("Newton's method found the other end of a window")
            return root

        def zero(problem: Problem, p: float, x: np.ndarray, y: np.ndarray) -> Root:
            x, y = (v if np.isrealobj(v) else real_direction(v[:, None]) for v in (x, y))
            return find_zero(problem, name, p, x, y, width, self.step.free(problem), solver)

        def crossing(problem: Problem, p: float, x: np.ndarray, y: np.ndarray) -> Root:
            nonlocal theta
            lam = change.v if not self._theta else 1j * np.sqrt(change.v)
            omega = abs(lam.imag) if p == 0.5 * (change.low + change.high) else float(np.sqrt(theta))
            root = find_crossing(problem, name, p, omega, x, y, width, solver)
            theta = root.theta
            if (root.coefficient > 0) != (change.gains > 0):
                raise NotConvergedError("Newton's method found another crossing")
            return root

        def parting(problem: Problem, p: float, x: np.ndarray, y: np.ndarray) -> Root:
            nonlocal theta
            x, y = (v if np.isrealobj(v) else real_direction(v[:, None]) for v in (x, y))
            lam = float(change.v.real) if theta > 0 else float(np.sqrt(-theta))
            root = find_coalescence(problem, name, p, lam, x, y, width, solver, damped=True)
            theta = root.theta
            if (root.coefficient_sign > 0) == (change.gains > 0):
                raise NotConvergedError("Newton's method found another double eigenvalue")
            return root

        return {"parting": parting, "meeting": meeting, "zero": zero, "crossing": crossing}[change.kind]

    def _between(self, change: Change, root: Root, slack: float) -> Root:
        """Return a root that lies between the limits of its change; beyond them it belongs to another change.

        Raises
        ------
        NotConvergedError
        """
        slack += root.uncertainty
        low, high = sorted(change.limits)
        if not low - slack <= root.value <= high + slack:
            raise NotConvergedError("Newton's method left the interval of the change")
        return root

    def _on_problem(self, newton: _Newton, root: Root, x: np.ndarray, y: np.ndarray) -> tuple[Root, bool]:
        """Return a root of the problem, starting from one of the step model, and whether their modes are the same.

        Without a reduced model Newton's method goes on with the problem itself. With one it goes on with the reduced
        model, and the residuals tell how far that root may be off. Newton's method on the problem itself follows only
        where that is more than rounding and too much, or where a few factorisations cost little.
        """
        step, reduced, first = self.step, self.step.reduced_model, x
        root = newton(step.problem, root.value, x, y)
        if reduced is None:
            return root, _is_one_shape(first, root.right, step.problem.mass)
        error, rounding = reduced.root_error(root.value, root.theta, root.right, root.left)
        sure = _SURE[step.full.unknowns <= _CHEAP] * abs(root.value)
        if error <= max(rounding, sure) and not self.precise:
            same = _is_one_shape(first, root.right, step.problem.mass)
            return replace(root, uncertainty=root.uncertainty + error + rounding), same
        first, x, y = (reduced.lift(v) for v in (first, root.right, root.left))
        root = newton(step.full, root.value, x, y)
        return root, _is_one_shape(first, root.right, step.full.mass)

    # Bisection, where Newton's method fails.

    def _bisected(self, change: Change) -> Onset:
        """Return the onset between two ever closer values with different numbers of unstable modes of the group."""
        step, highest = self.step, 1.1 * self._highest(change)
        request = Request(max_frequency_hz=highest / (2 * np.pi))

        def unstable(p: float) -> Modes:
            pencil = step.problem.pencil({step.parameter: p})
            if step.reduced_model is None:
                modes = solve_modes(pencil, request, linear_solver=step.linear_solver)
            else:  # its matrices are full
                modes = solve_dense(pencil, _FAST * highest, step.linear_solver)
                modes = modes.select(np.flatnonzero(modes.lam.imag <= highest))
            growing = modes.select(np.flatnonzero(modes.stability == "unstable"))
            u, _ = step.shapes(growing)
            return growing.select(np.flatnonzero(_share_within(change.group, u, step.model.mass) > _WITHIN))

        low, high = change.limits
        before, behind = unstable(low), unstable(high)
        if len(behind) - len(before) != change.gains:
            raise NotConvergedError(
                f"{len(before)} modes are unstable at {low:.8g} and {len(behind)} at {high:.8g} of those that take part"
            )
        while abs(high - low) > _BISECTED * self._width:
            middle = (low + high) / 2
            found = unstable(middle)
            if (len(found) - len(before)) * np.sign(change.gains) > 0:
                high, behind = middle, found
            else:
                low, before = middle, found
        more = behind if change.gains > 0 else before
        # Of the unstable modes the one that grows least has become unstable last. Its growth rate is measured a little
        # farther from the onset, where it is no longer lost in rounding.
        lam = complex(more.lam[np.argmin(more.lam.real)])
        value, into = (low + high) / 2, np.sign(change.gains) * np.sign(high - low)
        aside = min(_ASIDE * self._width, abs((change.limits[1] if change.gains > 0 else change.limits[0]) - value))
        growing = unstable(value + into * aside)
        if not len(growing):
            growing, aside = more, abs(high - low)
        i = int(np.argmin(np.abs(growing.lam - lam)))
        power = 0.5 if change.kind == "meeting" else 1.0
        speed = growing.lam[i].real / aside**power
        # A mode counts as unstable once Re λ exceeds its uncertainty, so that the onset itself lies a little before.
        # Twice that distance is allowed for, since growth is no straight line.
        unseen = float(2 * growing.re_uncertainty[i] / speed) ** (1 / power) + abs(high - low)
        if step.reduced_model is not None and growing.left is not None:
            pair = growing.right[:, i], growing.left[:, i]
            right, left = (real_direction(u[:, None]) for u in pair) if change.kind == "meeting" else pair
            error = step.reduced_model.root_error(value, lam.imag**2, right, left)[0]
            unseen += error if error < self._width else 0.0  # no use as a bound: a modal projection tells by itself
        return self._made(change, value, lam.imag, float(speed * np.sign(change.gains)), unseen)

    def _highest(self, change: Change) -> float:
        lam = change.v if not self._theta else np.sqrt(-change.v + 0j)
        return max(abs(lam.imag), abs(lam.real)) or self._speed(change)


def _is_one_shape(first: np.ndarray, second: np.ndarray, M: sp.csr_array) -> bool:
    return bool(modal_assurance(first[:, None], second[:, None], M)[0, 0] > _SAME_SHAPE)


def _share_within(group: np.ndarray, u: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return the share (k,) of the kinetic energy of each column of u (r, k) within the span of a group (r, m)."""
    if not u.shape[1]:
        return np.zeros(0)
    gram = group.conj().T @ (M @ group)
    cross = group.conj().T @ (M @ u)
    inside = np.einsum("ij,ij->j", cross.conj(), np.linalg.pinv(gram, hermitian=True) @ cross).real
    return np.asarray(inside / np.einsum("ij,ij->j", u.conj(), M @ u).real)
