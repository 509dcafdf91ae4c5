"""One step of a sweep: a small model that holds on it, and the onsets that it leads to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.optimize import brentq

from ..eigen.dense import solve_dense
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import FreeMotions, Modes
from ..eigen.request import Request
from ..eigen.solve import solve_modes
from ..errors import NotConvergedError
from ..problem.forms import interpolate, project
from ..problem.problem import Problem
from ..reduced import ReducedModel, SlowMotions
from .newton import Root, find_coalescence, find_crossing, find_zero
from .tracking import modal_assurance

_BISECTED = 1e-7  # of the sweep step: the bracket where only stability itself can be told
_CHEAP = 20_000  # unknowns up to which an onset of a reduced model is refined on the problem itself in any case
_SURE = 1e-7  # relative uncertainty of such an onset that is good enough
_DEPENDENT = 1e-9  # eigenvalue of a Gram matrix of unit vectors: what is left out of the basis of a step
_BALANCED = 1e-11  # of the forces that cancel: what rounding leaves of those of a rigid motion
_ONE_SHAPE = 0.999  # MAC of two modes of equal frequency: they have met already, and are no doublet
_SPANNED = 1e-4  # of a vector: what is left of one that others span
_SMALL = 60  # unknowns up to which the small model is the problem itself
_BRACKET = 1e-2  # of the sweep step: where Newton's method takes over from the bracketing

_Start = tuple[float, float, np.ndarray, np.ndarray]  # parameter, θ, right and left vector


@dataclass(frozen=True)
class Onset:
    """A critical value of the sweep parameter.

    Attributes
    ----------
    parameter, value : str, float
    frequency_hz : float
    kind : "flutter" or "divergence"
    direction : "into" or "out of" instability, for a rising parameter
    crossing_speed : float
        dRe λ/dp; at a meeting of two eigenvalues the coefficient of √|p − p_c|. NaN for a doublet that is coupled
        from the start of the interval on, without a threshold.
    branch_a, branch_b : int or None
    uncertainty : float
        Of `value`.
    two_mode_value : float
        What the two branches' modes at the start of the sweep alone would predict; NaN if they never meet.
    discretisation : float
        Error of `value` by the mesh; NaN where it is not estimated.
    """

    parameter: str
    value: float
    frequency_hz: float
    kind: str
    direction: str
    crossing_speed: float
    branch_a: int
    branch_b: int | None
    uncertainty: float
    two_mode_value: float = np.nan
    discretisation: float = np.nan


class Step:
    """One step of a sweep, with a small model that holds on it: the projection on the modes of both ends.

    With right and left modes in the basis the error of its eigenvalues is the product of the two subspace errors, which
    inside one step leaves the small model good enough to start Newton's method on the full one.
    """

    def __init__(
        self, problem: Problem, parameter: str, values: tuple[float, float], modes: tuple[Modes, Modes],
        model: ReducedModel | None, precise: bool, linear_solver: LinearSolver | str,
    ) -> None:  # fmt: skip
        self.full, self.parameter, self.model = problem, parameter, model
        self._linear_solver = linear_solver
        self._precise = precise or problem.unknowns <= _CHEAP
        self.problem = problem = problem if model is None else model.collected
        M = problem.pencil({parameter: values[0]}).M
        rigid = np.hstack([m.right[:, m.lam == 0].real for m in modes])
        self._ends, self.rigid = values, _orthonormal(rigid, M) if rigid.any() else None
        if problem.unknowns <= _SMALL:
            self.V = np.eye(problem.unknowns)
        else:
            vectors = [v for m in modes for v in (m.right, m.left) if v is not None]
            self.V = _orthonormal(np.hstack([p for v in vectors for p in (v.real, v.imag) if p.any()]), M)
            if self.rigid is not None:  # these to the last digit: what they lack is as stiff as the mesh
                Z = self.rigid
                rest = self.V - Z @ (Z.T @ (M @ self.V))
                size = np.sqrt(np.maximum(np.einsum("ij,ij->j", rest, M @ rest), 0.0))
                self.V = np.hstack([Z, _orthonormal(rest[:, size > _SPANNED], M)])
            if self.V.shape[1] == problem.unknowns:  # all modes were asked for: the small model is the problem itself
                self.V = np.eye(problem.unknowns)
        self._inside = interpolate(problem, parameter, *values)
        self.small = project(self._inside, self.V)
        self._MV = M @ self.V
        slow = None
        if self.rigid is not None and model is None:
            slow = SlowMotions.of(problem.pencil({parameter: values[0]}).K, self.rigid, self.rigid.T @ self._MV)
        elif self.rigid is not None and model is not None and model.basis.slow is not None:
            slow = model.basis.slow.on(self.V)
        self._cancelled = None if slow is None else slow.cancelled

    def hidden(
        self, ends: tuple[float, float], first: Modes, onsets: list[Onset], below: float, inner: int
    ) -> float | None:
        """Return a value inside the step where the small model's unstable modes are not those that the onsets explain.

        A pair that couples and parts again between two values of the sweep shows here and at neither end.
        """

        edges = np.array([0.98, 1.02]) * below  # modes at the rim of the range may pass it

        def counts(frequencies: np.ndarray) -> np.ndarray:
            return np.array([np.count_nonzero(frequencies <= edge) for edge in edges])

        def unstable(m: Modes) -> np.ndarray:
            return counts(m.lam.imag[m.stability == "unstable"])

        before, step = unstable(first), abs(ends[1] - ends[0])
        slack = before[1] - before[0]
        for p in np.linspace(*ends, inner + 2)[1:-1]:
            if any(abs(o.value - p) < _BRACKET * step for o in onsets):
                continue
            explained = before
            for onset in (o for o in onsets if o.value < p):
                sign = 1 if onset.direction == "into" else -1
                explained = explained + sign * counts(np.array([2 * np.pi * onset.frequency_hz]))
            low, high = unstable(self.modes(p))
            if not (low - slack <= explained.max() and explained.min() <= high + slack):
                return float(p)
        return None

    def shape(self, mode: Modes) -> np.ndarray:
        """Return the (r, 1) coordinates of a mode."""
        if len(self.V) == self.V.shape[1]:
            return mode.right
        return np.asarray(self._MV.T @ mode.right)

    def modes(self, p: float) -> Modes:
        """Return all modes of the small model."""
        known = self._inside.at({self.parameter: p}).free_motions()
        if len(self.V) > self.V.shape[1]:
            damping = None if known.damping is None else self.V.T @ known.damping
            known = FreeMotions(self._MV.T @ known.motions, damping)
        pencil = replace(self.small.pencil({self.parameter: p}), cancelled=self._cancelled, free=known)
        return solve_dense(pencil, linear_solver=self._linear_solver)

    def flutter(self, ends: tuple[float, float], mode: Modes) -> Onset:
        """Two eigenvalues of an undamped problem meet: the squared half of their distance changes sign."""
        shape = self.shape(mode)
        M = self.small.pencil().M
        plane = _orthonormal(np.hstack([shape.real, shape.imag]), M)
        target = -complex(mode.lam[0]) ** 2

        def pair(p: float) -> Modes:
            near = self.modes(p)
            weight = modal_assurance(plane, near.right, M).sum(axis=0)
            first = int(np.argmax(weight))
            # Of two equal pairs the plane holds parts of both: the partner is the best among different eigenvalues.
            other = np.abs(near.lam**2 - near.lam[first] ** 2) > 1e-9 * abs(near.lam[first]) ** 2
            other &= weight > 1e-2 * weight[first]
            other[first] = False
            if not other.any():
                other = np.arange(len(near)) != first
            return near.select(np.array([first, int(np.argmax(np.where(other, weight, -1.0)))]))

        def discriminant(p: float) -> float:
            a, b = -(pair(p).lam ** 2)
            return float((((a - b) / 2) ** 2).real)

        at_end = pair(ends[0])
        blur = float((2 * np.abs(at_end.lam) * at_end.re_uncertainty).max() ** 2)
        step, rough, met = abs(ends[1] - ends[0]), ends[0], False
        if discriminant(ends[0]) <= max(blur, (1e-9 * abs(target)) ** 2):
            met = modal_assurance(at_end.right[:, :1], at_end.right[:, 1:], M)[0, 0] > _ONE_SHAPE
            if not met:
                # A doublet without friction couples as soon as it acts: no threshold inside the step.
                return self._onset(ends[0], at_end.frequency_hz.mean(), "flutter", np.nan, 0.0)
        else:
            try:
                rough = _root(discriminant, ends)
            except NotConvergedError:
                return self._bisect(ends, mode)
        two = pair(rough)
        theta = float((-(two.lam**2)).real.mean())
        left = two.left
        assert left is not None
        x, y = (self.V @ _real_direction(v / np.linalg.norm(v, axis=0)) for v in (two.right, left))
        try:
            root = self._refined(
                lambda problem, start: find_coalescence(problem, self.parameter, *start, self._linear_solver),
                (rough, theta, x, y),
            )
            if abs(root.value - rough) <= 0.1 * step:
                frequency = np.sqrt(root.theta) / (2 * np.pi)
                if abs(root.value - ends[0]) <= root.uncertainty and not met:  # a doublet but for rounding
                    return self._onset(ends[0], frequency, "flutter", np.nan, root.uncertainty)
                return self._onset(root.value, frequency, "flutter", root.coefficient, root.uncertainty)
        except NotConvergedError:
            pass  # several equal pairs meet at once, where no border is regular: bracket on the full problem instead
        return self._bisect(ends, mode)

    def _bisect(self, ends: tuple[float, float], mode: Modes) -> Onset:
        """Bracket a change of stability on the full problem: between no unstable mode of this frequency and one."""
        omega, growth = float(mode.lam[0].imag), float(mode.lam[0].real)
        request = Request(max_frequency_hz=1.02 * max(omega, abs(growth)) / (2 * np.pi))

        def unstable(p: float) -> np.ndarray:
            pencil = self.problem.pencil({self.parameter: p})
            modes = solve_modes(pencil, request, linear_solver=self._linear_solver)
            near = np.abs(modes.lam.imag - omega) <= max(0.01 * omega, 2 * abs(growth))
            return np.asarray(modes.lam[(modes.stability == "unstable") & near])

        stable_end, unstable_end = ends
        before, behind = unstable(stable_end), unstable(unstable_end)
        if len(behind) <= len(before):
            raise NotConvergedError(f"no change of stability near {omega / (2 * np.pi):.6g} Hz on the full problem")
        while abs(unstable_end - stable_end) > _BISECTED * abs(ends[1] - ends[0]):
            middle = (stable_end + unstable_end) / 2
            found = unstable(middle)
            if len(found) > len(before):
                unstable_end, behind = middle, found
            else:
                stable_end = middle
        value, width = (stable_end + unstable_end) / 2, abs(unstable_end - stable_end)
        # The mode that has just become unstable is the one that hardly grows.
        omega = float(behind[np.argmin(behind.real)].imag)
        return self._onset(value, omega / (2 * np.pi), "flutter" if omega else "divergence", np.nan, width)

    def divergence(self, ends: tuple[float, float], mode: Modes) -> Onset:
        """An eigenvalue θ passes zero."""
        M = self.small.pencil().M
        Z = None if self.rigid is None else self.rigid if len(self.V) == self.V.shape[1] else self._MV.T @ self.rigid

        def elastic(u: np.ndarray) -> np.ndarray:
            """Without rigid motions, of which a mode has more and more as it comes near zero."""
            return u if Z is None else np.asarray(u - Z @ (Z.T @ (M @ u)))

        shape = elastic(self.shape(mode))

        def theta(p: float) -> float:
            near = self.modes(p)
            moving = elastic(near.right)
            share = np.einsum("ij,ij->j", moving.conj(), M @ moving).real
            likeness = modal_assurance(shape, moving, M)[0] * (share > _SPANNED**2)
            best = int(np.argmax(likeness))
            return float((-(near.lam[best] ** 2)).real)

        rough = _root(theta, ends)
        x = mode.right[:, 0].real
        width = 0.1 * abs(ends[1] - ends[0])
        root = self._refined(
            lambda problem, start: find_zero(
                problem, self.parameter, start[0], start[2], start[3], width, self._free(problem), self._linear_solver
            ),
            (rough, 0.0, x, x),
        )  # fmt: skip
        return self._onset(root.value, 0.0, "divergence", root.coefficient, root.uncertainty)

    def _free(self, problem: Problem) -> np.ndarray | None:
        """Return the rigid motions Z of both ends on the unknowns of a problem, where KZ = 0 at both."""
        if self.rigid is None:
            return None
        Z = self.rigid if self.model is None else self.model.lift(self.rigid)
        for p in self._ends:
            K = self.full.pencil({self.parameter: p}).K
            if np.linalg.norm(K @ Z) > _BALANCED * np.linalg.norm(abs(K) @ np.abs(Z)):
                return None
        return self.rigid if problem is self.problem else Z

    def crossing(self, ends: tuple[float, float], mode: Modes) -> Onset:
        """Re λ of a damped mode changes sign."""
        try:
            return self._find_crossing(ends, mode)
        except NotConvergedError:  # so little damping that Re λ is lost in rounding on the stable side
            return self._bisect(ends, mode)

    def _find_crossing(self, ends: tuple[float, float], mode: Modes) -> Onset:
        shape, M, target = self.shape(mode), self.small.pencil().M, complex(mode.lam[0])

        def follow(p: float) -> Modes:
            near = self.modes(p)
            likeness = modal_assurance(shape, near.right, M)[0] - np.abs(near.lam - target) / abs(target)
            return near.select(np.array([int(np.argmax(likeness))]))

        rough = _root(lambda p: float(follow(p).lam[0].real), ends)
        at = follow(rough)
        assert at.left is not None
        x, y = self.V @ at.right[:, 0], self.V @ at.left[:, 0]
        width = 0.1 * abs(ends[1] - ends[0])
        root = self._refined(
            lambda problem, start: find_crossing(
                problem, self.parameter, start[0], float(np.sqrt(start[1])), start[2], start[3], width,
                self._linear_solver,
            ),
            (rough, float(at.lam[0].imag) ** 2, x, y),
        )  # fmt: skip
        omega = np.sqrt(root.theta)
        kind = "flutter" if omega > 1e-6 * abs(target) else "divergence"
        return self._onset(root.value, omega / (2 * np.pi), kind, root.coefficient, root.uncertainty)

    def _refined(self, newton: Callable[[Problem, _Start], Root], start: _Start) -> Root:
        """Return a root of the problem from a start nearby.

        With a reduced model the root is that of the small problem. The residuals of its vectors on the problem itself
        tell how far it may be off; where that is more than rounding and too far, or a few factorisations cost little,
        Newton's method goes on there.
        """
        if self.model is None:
            return newton(self.problem, start)
        root = newton(self.problem, start)
        error, rounding = self.model.root_error(root.value, root.theta, root.right, root.left)
        if error <= max(rounding, _SURE * abs(root.value)) and not self._precise:
            return replace(root, uncertainty=root.uncertainty + error + rounding)
        x, y = (self.model.lift(v) for v in (root.right, root.left))
        return newton(self.full, (root.value, root.theta, x, y))

    def _onset(self, value: float, frequency_hz: float, kind: str, speed: float, uncertainty: float) -> Onset:
        return Onset(
            self.parameter, float(value), float(frequency_hz), kind, "", float(speed), 0, None, float(uncertainty)
        )


def _root(f: Callable[[float], float], ends: tuple[float, float]) -> float:
    """Return where a function of the parameter changes sign.

    Raises
    ------
    NotConvergedError
        It has one sign at both ends.
    """
    if f(ends[0]) * f(ends[1]) > 0:
        raise NotConvergedError(f"the small model changes no sign between {ends[0]:g} and {ends[1]:g}")
    return float(brentq(f, *ends, xtol=_BRACKET * abs(ends[1] - ends[0]), rtol=8.9e-16))


def _real_direction(vectors: np.ndarray) -> np.ndarray:
    """Return the real vector that the columns have in common: the leading left singular vector of their parts."""
    parts = np.hstack([vectors.real, vectors.imag])
    _, v = np.linalg.eigh(parts.T @ parts)
    return np.asarray(parts @ v[:, -1])


def _orthonormal(vectors: np.ndarray, M: sp.csr_array) -> np.ndarray:
    """Return an M-orthonormal basis of the columns' span."""
    size = np.sqrt(np.maximum(np.einsum("ij,ij->j", vectors, M @ vectors), 0.0))  # units may differ by any factor
    vectors = vectors[:, size > 0] / size[size > 0]
    for _ in range(2):  # the second pass restores what the squared condition of the Gram matrix cost
        w, v = np.linalg.eigh(vectors.T @ (M @ vectors))
        keep = w > _DEPENDENT * w.max()
        vectors = np.asarray(vectors @ (v[:, keep] / np.sqrt(w[keep])))
    return vectors
