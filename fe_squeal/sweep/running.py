"""A running sweep: modes of the last value, branches, onsets and warnings so far.

This file is longer than others, since every step reads and changes the same state, which is stored and restored as a
whole.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Modes
from ..eigen.request import Completeness, Request, wanted_count
from ..eigen.solve import prove_completeness, solve_modes
from ..eigen.threads import one_openblas_thread
from ..errors import NotConvergedError, SceneError, TooLargeError
from ..problem.description import Describer, Description
from ..problem.problem import Problem
from ..problem.sensitivity import sensitivities
from ..reduced import ReducedModel
from .balance import Census, entered, is_newcomer, unbalanced
from .counting import count_apart
from .doubts import without_narrow_windows
from .forecast import is_reduced
from .onset import Onset
from .onsets import Found, find_step_onsets, two_mode_value, windows
from .point import LiftedShapes, SweepPoint
from .result import Sweep
from .scale import Scale
from .state import Record, Store, SweepState, lifted
from .told import Told
from .tracking import match_modes, mirror_partners
from .warnings import rounding_warnings, tie_warnings

_INSIDE = 0.95  # of the highest frequency reported: an onset below this is reported whatever its branches are
# Equal parts of the sweep: a reduced model meets the tolerance at least at the ends of these, and modes are followed
# from one to the next, however few values were asked for. Fewer parts save little: where many modes meet in a step, it
# is halved again and again, and what was found on the longer steps was in vain.
_CHECKED = 8
_BESIDE = 1 / 8  # of a step: a critical value of the sweep itself is passed from so far before it to so far behind it
_EDGES = 1e-4, 1e-2, _BESIDE  # of a step: so near to the ends of a sweep that are critical modes are followed, if known
_EQUAL = 1e-9  # of |λ|: two eigenvalues that are closer may be those of equal parts of a brake
_REFINEMENTS = 4  # halvings of a step, at most, while it is not clear which mode continues which


class RunningSweep:
    """A sweep between two of its values: everything that is known so far, and the step to the next value.

    Parameters
    ----------
    problem : Problem
    parameter : str
    request : Request
        Which modes are asked for, and to what tolerance.
    values : (m,) float
        All values of the sweep, ascending.
    precise : bool
        Whether to refine onsets on the problem itself even if the reduced model gives them accurately enough.
    linear_solver : LinearSolver or str
    """

    def __init__(
        self, problem: Problem, parameter: str, request: Request, values: np.ndarray, precise: bool,
        linear_solver: LinearSolver | str = "auto",
    ) -> None:  # fmt: skip
        self.problem, self.parameter, self.request = problem, parameter, request
        self._values, self._steps, self._precise, self._linear_solver = values, len(values) - 1, precise, linear_solver
        self._scale = Scale.of(values)
        self._guarded = _with_guard(request) if self._steps else request
        self.points: list[SweepPoint] = []
        self.onsets: list[Onset] = []
        stages = ("reduction", "eigenvalues", "tracking", "onsets", "completeness", "descriptors")
        self.seconds = dict.fromkeys(stages, 0.0)
        self.told = Told(parameter)
        self.window = 0.0  # every window of instability wider than this was found
        self.completeness = Completeness(0, None, False)
        self._first: Modes | None = None
        self._previous: Modes | None = None
        self._branches = np.zeros(0, int)
        self._first_branches = np.zeros(0, int)
        self._next_branch = 1
        self._start = self._value = np.nan
        self._M = problem.mass  # shapes are compared by this mass at all values, even if the sweep changes mass
        self._reduced_model: ReducedModel | None = None
        self._describer: Describer | None = None
        self._described: np.ndarray | None = None  # the basis in whose coordinates the describer takes shapes
        self._tracked = problem  # modes are given in coordinates of this one: the problem, or that of the reduced model

    def reduce(self, values: np.ndarray, method: str, store: Store | None, known: SweepState | None) -> None:
        """Make the reduced model if the method uses one, or take the one that `store` has.

        Parameters
        ----------
        values : (m,) float
            The values of the sweep that are to be solved.
        method : "auto", "direct", "reduced" or "modal"
        store : Store, optional
            Where the reduced model is kept.
        known : SweepState, optional
            The state that the sweep resumes from.
        """
        if not is_reduced(self.problem, self.parameter, len(values), method) or (known and not known.reduced):
            return
        clock = time.perf_counter()
        stored = None if store is None else store.load_model()
        # The reduced model has to be accurate between the values too, where steps are halved and onsets are found.
        values = self._scale.filled(values, _CHECKED)
        try:
            with one_openblas_thread():
                if stored is not None:
                    model = ReducedModel.restored(
                        self.problem, self.parameter, values, self._guarded, *stored, self._linear_solver
                    )
                else:
                    modal, swinging = method == "modal", method == "auto"
                    model = ReducedModel(
                        self.problem, self.parameter, values, self._guarded, modal, self._linear_solver, swinging
                    )
        except (NotConvergedError, SceneError) as error:  # a scene may have no static state at one of the values
            if method != "auto":
                raise
            self.told.add(f"solved directly at every value: {error}")
            self._spend("reduction", clock)
            return
        self._reduced_model, self._tracked = model, model.projected
        self._M = self._tracked.mass
        if method == "modal":
            self.told.add(
                f"modal projection: an eigenvalue may be off by {100 * model.worst:.2g} % of |λ|, as estimated"
            )
        self._spend("reduction", clock)
        if store is not None and stored is None:
            store.save_model(Record(*model.stored()))

    def state(self) -> SweepState:
        """Return what is needed to resume the sweep after its last value."""
        assert self._first is not None and self._previous is not None
        return SweepState(
            tuple(self.points), tuple(self.onsets), tuple(self.told.warnings), self.completeness, dict(self.seconds),
            self._first, self._previous, self._first_branches, self._branches, self._next_branch, self._start,
            self._value, self._reduced_model is not None, self.window, tuple(self.told.unsettled),
        )  # fmt: skip

    def restore(self, state: SweepState) -> None:
        """Take over a state, to continue after its last value."""
        V = None if self._reduced_model is None else self._reduced_model.basis.V
        self.points = [point if V is None else lifted(point, V) for point in state.points]
        self.onsets, self.told = list(state.onsets), Told(self.parameter, state.warnings, state.unsettled)
        self.completeness, self.seconds = state.completeness, dict(state.seconds)
        self._first, self._previous = state.first, state.previous
        self._first_branches, self._branches = state.first_branches, state.branches
        self._next_branch, self._start, self._value = state.next_branch, state.start, state.value
        self.window = state.window

    def advance(self, value: float, keep_all: bool) -> None:
        """Solve at the next value and follow the modes to it; `keep_all` keeps the shapes of all its modes."""
        modes = self._solve(value)
        if self._previous is None:
            self._begin(value, modes)
            branches = self._branches
            self._leave(value, modes)
        elif _at_rest(modes) > _at_rest(self._previous):
            branches = self._pass(value, modes)
        else:
            self._follow_within(value, modes)
            self._follow(value, modes, _REFINEMENTS)
            branches = self._branches
        last = self.points[-1].value if self.points else value
        for middle, pair in windows(self.onsets, last, value):
            self.points.append(self._window(middle, pair))
        self.points.append(self._point(value, modes, branches, keep_all))
        if all(is_newcomer(t) for t in self.told.unsettled):  # else an onset that was not refined may be its own
            self.told.of_onsets(*entered(self.parameter, self.points, self.onsets))

    def _point(self, value: float, modes: Modes, branches: np.ndarray, keep_all: bool) -> SweepPoint:
        wanted = wanted_count(modes, self.request)
        growing = np.flatnonzero(modes.stability == "unstable")
        above, growing = modes.lam[growing[growing >= wanted]], growing[growing < wanted]
        shapes: Mapping[int, np.ndarray] = {
            int(i): modes.right[:, i].copy() for i in (range(wanted) if keep_all else growing)
        }
        here = self._tracked.at({self.parameter: value})
        found = sensitivities(here, modes, growing) if len(growing) else {}
        moves = {
            int(i): {path: (here.value(path), complex(d[k])) for path, d in found.items()}
            for k, i in enumerate(growing)
        }
        reported = modes.select(np.arange(wanted)).without_shapes()
        pressed = self.problem.at({self.parameter: value}).state
        if self._reduced_model is not None:
            shapes = LiftedShapes(shapes, self._reduced_model.basis.V)
        description = self._describe(here, modes.right[:, :wanted])
        return SweepPoint(
            value, reported, branches[:wanted], shapes, moves, pressed, above=tuple(complex(lam) for lam in above),
            description=description,
        )  # fmt: skip

    def _describe(self, here: Problem, shapes: np.ndarray) -> Description:
        """Return what modes look like, from their shapes (n, k); empty if the problem has no describer."""
        if self.problem.describer is None:
            return {}
        clock = time.perf_counter()
        V = None if self._reduced_model is None else self._reduced_model.basis.V
        if self._describer is None or self._described is not V:
            self._describer = self.problem.describer if V is None else self.problem.describer.on(V)
            self._described = V
        description = self._describer.describe(here.terms, here.parameters, shapes)
        self._spend("descriptors", clock)
        return description

    def _window(self, middle: float, pair: tuple[Onset, Onset]) -> SweepPoint:
        """Return the point in the middle of a window of instability between two values of the sweep."""
        assert self._previous is not None
        modes = self._solve(middle)
        branches = self._named(self._known(modes))
        growing = np.flatnonzero(modes.stability == "unstable")
        if len(growing):
            omega = np.pi * (pair[0].frequency_hz + pair[1].frequency_hz)
            i = int(growing[np.argmin(np.abs(modes.lam[growing].imag - omega))])
            positions = i, int(mirror_partners(modes)[i])
            for position, name in zip(positions, (pair[0].branch_a, pair[0].branch_b), strict=True):
                if position < 0 or name is None:
                    continue
                there = np.flatnonzero(branches == name)  # the mode that likeness takes for this branch, if any
                branches[there] = branches[position]
                branches[position] = name
        return replace(self._point(middle, modes, branches, keep_all=False), between=True)

    def _known(self, modes: Modes) -> np.ndarray:
        """Return the branches that modes belong to, by their likeness to the modes of the last value; 0: to none."""
        assert self._previous is not None
        origin = match_modes(self._previous, modes, self._M).origin
        return np.array([self._branches[i] if i >= 0 else 0 for i in origin], dtype=int)

    def _named(self, branches: np.ndarray) -> np.ndarray:
        """Return branches with new ones for 0."""
        new = branches == 0
        named = branches.copy()
        named[new] = self._next_branch + np.arange(new.sum())
        self._next_branch += int(new.sum())
        return named

    def _solve(self, value: float) -> Modes:
        clock = time.perf_counter()
        if self._reduced_model is not None:
            modes = self._reduced_model.modes(value)
        else:
            band = None if self._previous is None else float(self._previous.lam.imag.max(initial=0.0)) or None
            try:
                pencil = self.problem.pencil({self.parameter: value})
                modes = solve_modes(pencil, self._guarded, band, self._linear_solver)
            except TooLargeError as error:
                if not self._steps or not self.problem.is_affine(self.parameter):
                    raise
                raise TooLargeError(f'{error}, or solve.method = "reduced"') from error
        self._spend("eigenvalues", clock)
        return _without_cut(modes, wanted_count(modes, self.request))

    def _begin(self, value: float, modes: Modes) -> None:
        clock = time.perf_counter()
        # A reduced model has the terms summed up already.
        summed = self.problem if self._reduced_model is None else self._reduced_model.basis.problem
        c = prove_completeness(summed.pencil({self.parameter: value}), modes, self._linear_solver)
        if c.expected is None and self._reduced_model is None:
            here = self.problem.at({self.parameter: value})
            c = replace(c, expected=count_apart(here, modes, self._guarded, self._linear_solver))
        elif c.expected is None and self._reduced_model is not None:
            counted = self._reduced_model.counted()
            if counted is False:
                raise NotConvergedError("the reduced model lacks modes that the inertia without friction counts", modes)
            c = replace(c, expected=c.found if counted else None)
        c = c.without(len(modes) - wanted_count(modes, self.request))
        if c.expected is not None and c.found != c.expected:
            raise NotConvergedError(f"{c.found} modes found where the inertia counts {c.expected}", modes)
        wanted = modes.select(np.arange(wanted_count(modes, self.request)))
        self.told.add(*rounding_warnings(wanted))
        if any(t.penalty for t in self._tracked.terms):
            self.told.add(*tie_warnings(self._tracked.at({self.parameter: value}), wanted))
        self.completeness, self._start, self._first = c, value, modes
        self._branches = self._first_branches = np.arange(1, len(modes) + 1)
        self._next_branch = len(modes) + 1
        self._value, self._previous = value, modes
        self._spend("completeness", clock)

    def _leave(self, value: float, modes: Modes) -> None:
        """Follow modes from a value beside the first one, if some have λ = 0 at the first value alone and grow there.

        Those that swing beside it can be followed from the first value itself, as of a spring whose stiffness begins at
        zero.
        """
        if not self._steps or not _at_rest(modes):
            return
        free = self.problem.at({self.parameter: self._beside(value, float(self._values[1]))}).free_motions().motions
        if free.shape[1] >= _at_rest(modes):
            return
        behind, found = self._edge(value, modes, float(self._values[1]))
        if _growing(found) <= _growing(modes):
            return
        self._branches = self._first_branches = self._named(self._known(found))
        self._first = self._previous = found
        self._start = self._value = behind
        self.told.edge("first", value, behind, _at_rest(modes) - _at_rest(found))

    def _pass(self, value: float, modes: Modes) -> np.ndarray:
        """Return the branches at a value where more modes have λ = 0 than at the last one, and go past it.

        It is a critical value: a mode that diverges just there has no eigenvalue that could be followed on either side.
        So the modes are followed from a value before it to one behind it.
        """
        assert self._previous is not None
        last = value >= self._values[-1]
        if last:
            before, found = self._edge(value, modes, self._value)
        else:
            before = self._beside(value, self._value)
            found = self._solve(before)
        self._follow(before, found, _REFINEMENTS)
        branches = self._known(modes)
        if last:
            self.told.edge("last", value, before, _at_rest(modes) - _at_rest(found))
            return self._named(branches)
        behind = self._beside(value, float(self._values[np.searchsorted(self._values, value, "right")]))
        self._follow(behind, self._solve(behind), _REFINEMENTS)
        later = self._known(modes)
        return self._named(np.where((branches == 0) & ~np.isin(later, branches), later, branches))

    def _edge(self, value: float, modes: Modes, other: float) -> tuple[float, Modes]:
        """Return the value nearest to an end of the sweep at which fewer modes have λ = 0, and the modes there."""
        for share in _EDGES:
            beside = self._beside(value, other, share)
            found = self._solve(beside)
            if _at_rest(found) < _at_rest(modes):
                break
        return beside, found

    def _beside(self, value: float, other: float, share: float = _BESIDE) -> float:
        """Return a value beside one, at a share of the way to another."""
        x = self._scale.x(value)
        return self._scale.p(x + share * (self._scale.x(other) - x))

    def _follow_within(self, value: float, modes: Modes) -> None:
        """Follow the modes of a reduced model over the values on the way to the next one at which it was checked."""
        assert self._previous is not None
        if self._reduced_model is None:
            return
        for between in self._scale.filled(self._values, _CHECKED).tolist():
            if self._value < between < value:
                found = self._solve(between)
                if _at_rest(found) <= max(_at_rest(self._previous), _at_rest(modes)):
                    self._follow(between, found, _REFINEMENTS)

    def _follow(self, value: float, modes: Modes, refinements: int) -> None:
        """Name the branches at the next value and find the onsets on the way to it.

        If it is not clear which mode continues which, or an onset is not found, the step is halved; `refinements` says
        how often it still may be.
        """
        assert self._previous is not None
        clock = time.perf_counter()
        match = match_modes(self._previous, modes, self._M)
        clock = self._spend("tracking", clock)
        doubtful = bool(match.doubtful[: wanted_count(modes, self.request)].any())
        if not (doubtful and refinements):
            names = itertools.count(self._next_branch)
            branches = np.array([self._branches[i] if i >= 0 else next(names) for i in match.origin], dtype=int)
            found = self._find_onsets(value, modes, branches, refinements > 0)
            clock = self._spend("onsets", clock)
            if not ((found.warnings or found.missing) and refinements):
                if found.missing:
                    raise NotConvergedError(found.missing[0])
                self.told.of_onsets(*found.warnings)
                # A window of instability may reach from step to step.
                self.onsets, narrow = without_narrow_windows(self.onsets + found.onsets, 0.0)
                self.told.doubts(found.doubts + narrow)
                self.onsets = self.told.absorbed(self.onsets, self._start, value)
                self.window = max(self.window, found.width)
                self._next_branch = next(names)
                self._value, self._previous, self._branches = value, modes, branches
                return
        self._follow(*self._halved(value, modes), refinements - 1)
        self._follow(value, modes, refinements - 1)

    def _halved(self, value: float, modes: Modes) -> tuple[float, Modes]:
        """Return the middle of the step to a value, and the modes there, or nearer to its start.

        The middle may be a critical value itself: a mode that diverges just there has λ = 0, and no eigenvalue that
        could be followed on either side.
        """
        assert self._previous is not None
        middle = self._scale.middle(self._value, value)
        found = self._solve(middle)
        if _at_rest(found) > max(_at_rest(self._previous), _at_rest(modes)):
            middle = self._scale.middle(self._value, middle)
            found = self._solve(middle)
        return middle, found

    def result(self) -> Sweep:
        """Return the result so far."""
        return Sweep(
            self.problem, self.parameter, tuple(self.points), tuple(sorted(self.onsets, key=lambda o: o.value)),
            self.completeness, dict(self.seconds), tuple(self.told.warnings), self._reduced_model, self.window,
            tuple(self.told.unsettled),
        )  # fmt: skip

    def _find_onsets(self, value: float, modes: Modes, branches: np.ndarray, halved: bool) -> Found:
        """Return the onsets of the reported branches between the last value and this one, and what was not decided."""
        assert self._previous is not None and self._first is not None
        name = self.parameter
        known, wanted = wanted_count(self._previous, self.request), wanted_count(modes, self.request)
        # A branch with a reported onset is reported until it is stable again, even if it leaves the range.
        reported_before = {name for o in self.onsets for name in (o.branch_a, o.branch_b)} - {None}
        reported = {*self._branches[:known], *branches[:wanted], *reported_before}
        limit = _limit(self.request)
        below = max(limit, _reach(self._previous, known), _reach(modes, wanted))
        found = find_step_onsets(
            self.problem, name, (self._value, value), (self._previous, modes), (self._branches, branches), below,
            self._reduced_model, self._precise, self._linear_solver, self._scale,
            self._value == self._start, halved, _limit(self._guarded), self.request.tolerance,
        )  # fmt: skip
        # The branches of an onset are found by shape and may be wrong. Inside the range it is reported in any case; the
        # end of the range moves where a number of modes is asked for.
        inside = _INSIDE * (
            limit or min(m.lam[:k].imag.max(initial=0.0) for m, k in ((self._previous, known), (modes, wanted)))
        )
        end = (limit or inside) / (2 * np.pi)
        kept = [o for o in found.onsets if reported & {o.branch_a, o.branch_b} or o.frequency_hz <= end]
        onsets = []
        for onset in found.onsets:
            # Of equal parts of a brake, whose shapes may be taken for each other's, all onsets are reported or none.
            if not any(onset.is_copy_of(other) for other in kept):
                continue
            at = [np.flatnonzero(self._first_branches == b) for b in (onset.branch_a, onset.branch_b)]
            if all(len(i) for i in at) and not self.problem.is_damped:
                predicted = two_mode_value(self._tracked, name, self._start, self._first, int(at[0][0]), int(at[1][0]))
                onset = replace(onset, two_mode_value=predicted)
            onsets.append(onset)
        before, now = (
            Census.of_modes(p, m, self.problem.is_damped) for p, m in ((self._value, self._previous), (value, modes))
        )
        # If the solver found no more modes than were asked for, there are no others, and none enters or leaves the
        # range.
        complete = all(m.exhaustive and len(m) <= (self.request.count or 0) for m in (self._previous, modes))
        imbalance = unbalanced(name, before, now, onsets, np.inf if complete else float(inside))
        if imbalance and not found.warnings:
            found.tell(imbalance, name, halved)
        return replace(found, onsets=onsets)

    def _spend(self, stage: str, since: float) -> float:
        now = time.perf_counter()
        self.seconds[stage] += now - since
        return now


def _at_rest(modes: Modes) -> int:
    """Return how many modes have λ = 0: free motions, and those at the edge of divergence."""
    return int(np.count_nonzero(modes.lam == 0))


def _growing(modes: Modes) -> int:
    """Return how many modes are unstable."""
    return int(np.count_nonzero(modes.stability == "unstable"))


def _reach(modes: Modes, wanted: int) -> float:
    """Return the highest frequency Im λ of the first `wanted` modes, rad/s; of a growing mode |λ| counts instead."""
    lam, growing = modes.lam[:wanted], modes.stability[:wanted] == "unstable"
    return float(np.where(growing, np.abs(lam), lam.imag).max(initial=0.0))


def _limit(request: Request) -> float:
    """Return the frequency up to which modes are asked for, rad/s; 0 where a number of them is."""
    return 2 * np.pi * (request.max_frequency_hz or 0.0)


def _without_cut(modes: Modes, wanted: int) -> Modes:
    """Return modes without the last one, and those equal to it, beyond the `wanted` ones, if there are equal ones.

    Where modes are multiple, as of equal pads, the last may be some of a set alone. A step model with these would not
    treat all pads alike, and tell their modes apart.
    """
    size, lam = np.abs(modes.lam), modes.lam
    equal = np.abs(np.diff(lam)) <= _EQUAL * size[1:]
    if not equal.any():
        return modes
    last = np.minimum(np.abs(lam - lam[-1]), np.abs(lam + lam[-1].conj())) <= _EQUAL * size[-1]
    return modes.select(np.flatnonzero(~last | (np.arange(len(lam)) < wanted)))


def _with_guard(request: Request) -> Request:
    """Return a request for some more modes, so that a mode is followed already when it enters the range asked for."""
    if request.max_frequency_hz is not None:
        return replace(request, max_frequency_hz=1.1 * request.max_frequency_hz)
    assert request.count is not None
    return replace(request, count=request.count + max(4, request.count // 5))
