"""A running sweep: modes of the last value, branches, onsets and warnings so far.

Every step reads and changes the same state, which is stored and restored as a whole.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from ..eigen.linear.factor import LinearSolver
from ..eigen.multiple import have_copies
from ..eigen.pencil import Modes
from ..eigen.request import Completeness, Request, wanted_count
from ..errors import NotConvergedError
from ..problem.problem import Problem
from .balance import Census, entered, unbalanced
from .clock import Clock
from .doubts import without_narrow_windows
from .onset import Onset, certified
from .onsets import Found, find_step_onsets
from .point import SweepPoint
from .result import Sweep
from .scale import Scale
from .solving import CHECKED, ValueSolver
from .state import Store, SweepState, lifted
from .told import Told
from .tracking import match_modes, mirror_partners
from .windows import two_mode_value, windows

_INSIDE = 0.95  # of the highest frequency reported: an onset below this is reported whatever its branches are
_BESIDE = 1 / 8  # of a step: a critical value of the sweep itself is passed from so far before it to so far behind it
_EDGES = 1e-4, 1e-2, _BESIDE  # of a step: so near to the ends of a sweep that are critical modes are followed, if known
_SLOW = 1e-6  # of the largest |λ|, far above the square root of a rounding: what rounding has made of λ = 0 is smaller
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
        self._values, self._precise, self._scale = values, precise, Scale.of(values)
        self._clock, self.told = Clock(), Told(parameter)
        self._solver = ValueSolver(problem, parameter, request, values, linear_solver, self._clock, self.told)
        self.points: list[SweepPoint] = []
        self.onsets: list[Onset] = []
        self.window = 0.0  # every window of instability wider than this was found
        self.completeness = Completeness(0, None, False)
        self._first: Modes | None = None
        self._previous: Modes | None = None
        self._branches = np.zeros(0, int)
        self._first_branches = np.zeros(0, int)
        self._next_branch = 1
        self._start = self._value = np.nan

    def reduce(self, values: np.ndarray, method: str, store: Store | None, known: SweepState | None) -> None:
        """Make the reduced model if the method uses one, see `ValueSolver.reduce`; `known` is resumed from."""
        if known is None or known.reduced:
            self._solver.reduce(values, method, store)

    def state(self) -> SweepState:
        """Return what is needed to resume the sweep after its last value."""
        assert self._first is not None and self._previous is not None
        return SweepState(
            tuple(self.points), tuple(self.onsets), tuple(self.told.warnings), self.completeness,
            dict(self._clock.seconds), self._first, self._previous, self._first_branches, self._branches,
            self._next_branch, self._start, self._value, self._solver.model is not None, self.window,
            tuple(self.told.unsettled), self.told.doubt, self.told.beyond, self.told.unsearched,
        )  # fmt: skip

    def restore(self, state: SweepState) -> None:
        """Take over a state, to continue after its last value."""
        self.onsets, self.completeness = list(state.onsets), state.completeness
        self.told = self._solver.told = Told(
            self.parameter, state.warnings, state.unsettled, state.doubt, state.beyond, state.unsearched
        )
        self._clock.seconds = dict(state.seconds)
        self._first, self._previous = state.first, state.previous
        self._first_branches, self._branches = state.first_branches, state.branches
        self._next_branch, self._start, self._value = state.next_branch, state.start, state.value
        self.window = state.window
        V = self._solver.basis
        # Last: where there are points, an interruption takes all else to be there.
        self.points = [point if V is None else lifted(point, V) for point in state.points]

    def advance(self, value: float, keep_all: bool) -> None:
        """Solve at the next value and follow the modes to it; `keep_all` keeps the shapes of all its modes."""
        modes, before = self._solve(value), self.told.of_steps()
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
        self.points.append(self._solver.point(value, modes, branches, keep_all))
        is_modal = self._solver.model is not None and self._solver.model.is_modal  # whose points may hide growth
        if before >= self.told.of_steps() and not is_modal:  # else an onset that was not refined may be its own
            self.told.of_onsets(*entered(self.parameter, self.points, self.onsets))
        if rate := self._solver.growth_beyond(value, modes):
            self.told.beyond_losses(value, rate)

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
        return replace(self._solver.point(middle, modes, branches, keep_all=False), between=True)

    def _known(self, modes: Modes) -> np.ndarray:
        """Return the branches that modes belong to, by their likeness to the modes of the last value; 0: to none."""
        assert self._previous is not None
        origin = match_modes(self._previous, modes, self._solver.mass).origin
        return np.array([self._branches[i] if i >= 0 else 0 for i in origin], dtype=int)

    def _named(self, branches: np.ndarray) -> np.ndarray:
        """Return branches with new ones for 0."""
        new = branches == 0
        named = branches.copy()
        named[new] = self._next_branch + np.arange(new.sum())
        self._next_branch += int(new.sum())
        return named

    def _solve(self, value: float) -> Modes:
        """Return the modes at a value, of the sweep or between two, and tell what was not looked for there."""
        modes = self._solver.modes(value, self._previous)
        self.told.not_searched(value, modes.unsearched)
        return modes

    def _begin(self, value: float, modes: Modes) -> None:
        clock = self._clock.now()
        self.completeness, self._start, self._first = self._solver.prove(value, modes), value, modes
        self._branches = self._first_branches = np.arange(1, len(modes) + 1)
        self._next_branch = len(modes) + 1
        self._value, self._previous = value, modes
        self._clock.spend("completeness", clock)

    def _leave(self, value: float, modes: Modes) -> None:
        """Follow modes from a value beside the first one, if some have λ = 0 at the first value alone and grow there.

        Those that swing beside it can be followed from the first value itself, as of a spring whose stiffness begins at
        zero.
        """
        if len(self._values) == 1 or not _at_rest(modes):
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

    def _skip(self, value: float, modes: Modes, missing: str) -> None:
        """Follow modes from this value on, if one that has no counterpart at the first value has λ = 0 there.

        It moves too slowly at first to be followed from there, as one whose stiffness begins with the square of the
        parameter.

        Raises
        ------
        NotConvergedError
            A mode is missing for another reason.
        """
        assert self._previous is not None
        rest = _at_rest(self._previous) - _at_rest(modes)
        if self._value != self._start or rest <= 0:
            raise NotConvergedError(missing)
        self.told.edge("first", self._start, value, rest)
        self._branches = self._first_branches = self._named(self._known(modes))
        self._first = self._previous = modes
        self._start = self._value = value

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
        # Where rounding hides a slow mode, it may have λ = 0 at all values beside the last one as well.
        known = min(_at_rest(found), _at_rest(self._previous))
        self._follow(before, found, _REFINEMENTS)
        branches = self._known(modes)
        if last:
            self.told.edge("last", value, before, _at_rest(modes) - known)
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
        if self._solver.model is None:
            return
        for between in self._scale.filled(self._values, CHECKED).tolist():
            if self._value < between < value:
                found = self._solve(between)
                if _at_rest(found) <= max(_at_rest(m) for m in (self._previous, modes)):
                    self._follow(between, found, _REFINEMENTS)

    def _follow(self, value: float, modes: Modes, refinements: int) -> None:
        """Name the branches at the next value and find the onsets on the way to it.

        If it is not clear which mode continues which, or an onset is not found, the step is halved; `refinements` says
        how often it still may be.
        """
        assert self._previous is not None
        clock = self._clock.now()
        match = match_modes(self._previous, modes, self._solver.mass)
        clock = self._clock.spend("tracking", clock)
        doubtful = bool(match.doubtful[: wanted_count(modes, self.request)].any())
        if not (doubtful and refinements):
            names = itertools.count(self._next_branch)
            branches = np.array([self._branches[i] if i >= 0 else next(names) for i in match.origin], dtype=int)
            found = self._find_onsets(value, modes, branches, refinements > 0)
            clock = self._clock.spend("onsets", clock)
            if not ((found.warnings or found.missing) and refinements):
                if found.missing:
                    self._skip(value, modes, found.missing[0])
                    return
                self.told.of_onsets(*found.warnings)
                # A window of instability may reach from step to step.
                self.onsets, narrow = without_narrow_windows(
                    self.onsets + found.onsets, 0.0, value - self._value, len(self.onsets)
                )  # fmt: skip
                self.told.doubts(found.doubts + narrow)
                self.onsets = self.told.absorbed(self.onsets, self._start, value)
                self.window = max(self.window, found.width)
                unclear = np.flatnonzero(match.doubtful[: wanted_count(modes, self.request)])
                unclear = unclear[~have_copies(modes.lam)[unclear] & (modes.lam[unclear].imag > 0)]
                if len(unclear):
                    self.told.unclear_branches(self._value, value, modes.lam[unclear].imag)
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
        if _at_rest(found) > max(_at_rest(m) for m in (self._previous, modes)):
            middle = self._scale.middle(self._value, middle)
            found = self._solve(middle)
        return middle, found

    def result(self) -> Sweep:
        """Return the result so far."""
        ends = float(self._values[0]), float(self._values[-1])
        onsets, outside, vague = certified(self.onsets, self.parameter, self._values.tolist(), ends)
        return Sweep(
            self.problem, self.parameter, tuple(self.points), onsets, self.completeness, dict(self._clock.seconds),
            (*self.told.warnings, *outside, *vague), self._solver.model, self.window, (*self.told.unsettled, *vague),
            self.request.max_frequency_hz,
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
            self._solver.model, self._precise, self._solver.linear_solver, self._scale,
            self._value == self._start, halved, _limit(self._solver.guarded), self.request.tolerance,
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
                a, b = (int(i[0]) for i in at)
                predicted = two_mode_value(self._solver.tracked, name, self._start, self._first, a, b)
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


def _at_rest(modes: Modes) -> int:
    """Return how many modes have λ = 0 but for rounding: free motions, and those at the edge of divergence.

    Rounding of a stiffness moves λ = 0 by its square root. What is larger and as uncertain is so for another reason.
    """
    size = np.abs(modes.lam)
    return int(np.count_nonzero(size <= np.minimum(modes.re_uncertainty, _SLOW * size.max(initial=0.0))))


def _growing(modes: Modes) -> int:
    """Return how many modes are unstable."""
    return int(np.count_nonzero(modes.stability == "unstable"))


def _reach(modes: Modes, wanted: int) -> float:
    """Return the highest frequency Im λ of the first `wanted` modes, rad/s; of a growing mode |λ| counts instead.

    Where none of them swings or grows, the largest |λ|: an overdamped mode may become unstable.
    """
    lam, growing = modes.lam[:wanted], modes.stability[:wanted] == "unstable"
    reach = float(np.where(growing, np.abs(lam), lam.imag).max(initial=0.0))
    return reach or float(np.abs(lam).max(initial=0.0))


def _limit(request: Request) -> float:
    """Return the frequency up to which modes are asked for, rad/s; 0 where a number of them is."""
    return 2 * np.pi * (request.max_frequency_hz or 0.0)
