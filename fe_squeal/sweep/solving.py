"""Solve a problem at single values of a sweep, directly or by a reduced model, and describe the modes found there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..eigen.columns import Columns
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
from .clock import Clock
from .counting import count_apart
from .forecast import is_reduced
from .losses import growth_beyond
from .point import LiftedShapes, SweepPoint
from .scale import Scale
from .state import Record, Store
from .told import Told
from .warnings import rounding_warnings, tie_warnings

# Equal parts of the sweep: a reduced model meets the tolerance at least at the ends of these, and modes are followed
# from one to the next, however few values were asked for. Fewer parts save little: where many modes meet in a step, it
# is halved again and again, and what was found on the longer steps was in vain.
CHECKED = 8
_EQUAL = 1e-9  # of |λ|: two eigenvalues that are closer may be those of equal parts of a brake


class ValueSolver:
    """Solves the problem of a sweep at one value at a time.

    Parameters
    ----------
    problem : Problem
    parameter : str
    request : Request
        Which modes are asked for, and to what tolerance.
    values : (m,) float
        All values of the sweep, ascending.
    linear_solver : LinearSolver or str
    clock : Clock
    told : Told
        Gets what the user has to know.

    Attributes
    ----------
    told : Told
    guarded : Request
        Asks for some more modes, so that a mode is followed already when it enters the range asked for.
    model : ReducedModel or None
        The reduced model, if there is one.
    tracked : Problem
        Modes are given in coordinates of this one: the problem, or that of the reduced model.
    mass : (n, n)
        M of that one: shapes are compared by it at all values, even if the sweep changes mass.
    """

    def __init__(
        self, problem: Problem, parameter: str, request: Request, values: np.ndarray,
        linear_solver: LinearSolver | str, clock: Clock, told: Told,
    ) -> None:  # fmt: skip
        self.problem, self.parameter, self.request = problem, parameter, request
        self.linear_solver, self._clock, self.told = linear_solver, clock, told
        self._is_swept, self._scale = len(values) > 1, Scale.of(values)
        self.guarded = _with_guard(request) if self._is_swept else request
        self.model: ReducedModel | None = None
        self.tracked, self.mass = problem, problem.mass
        self._describer: Describer | None = None
        self._described: Columns | None = None  # the basis in whose coordinates the describer takes shapes

    @property
    def basis(self) -> Columns | None:
        """V (n, r) of the reduced model; None without one."""
        return None if self.model is None else self.model.basis.V

    def reduce(self, values: np.ndarray, method: str, store: Store | None) -> None:
        """Make the reduced model if the method uses one, or take the one that `store` has.

        Parameters
        ----------
        values : (m,) float
            The values of the sweep that are to be solved.
        method : "auto", "direct", "reduced" or "modal"
        store : Store, optional
            Where the reduced model is kept.

        Raises
        ------
        NotConvergedError, SceneError
            There is no reduced model, and the method is not "auto".
        """
        if not is_reduced(self.problem, self.parameter, len(values), method):
            return
        clock = self._clock.now()
        stored = None if store is None else store.load_model()
        # The reduced model has to be accurate between the values too, where steps are halved and onsets are found.
        places, solver = self._scale.filled(values, CHECKED), self.linear_solver
        try:
            with one_openblas_thread():
                if stored is not None:
                    model = ReducedModel.restored(self.problem, self.parameter, places, self.guarded, *stored, solver)
                else:
                    model = ReducedModel(
                        self.problem, self.parameter, places, self.guarded, method == "modal", solver, method == "auto",
                        self.request.count or 0,
                    )
        except (NotConvergedError, SceneError) as error:  # a scene may have no static state at one of the values
            if method != "auto":
                raise
            self.told.add(f"solved directly at every value: {error}")
            self._clock.spend("reduction", clock)
            return
        self.model, self.tracked = model, model.projected
        self.mass = self.tracked.mass
        if model.is_modal:
            self.told.add(
                f"modal projection: an eigenvalue may be off by {100 * model.worst:.2g} % of |λ|, as estimated"
            )
        self._clock.spend("reduction", clock)
        if store is not None and stored is None:
            store.save_model(Record(*model.stored()))

    def modes(self, value: float, before: Modes | None) -> Modes:
        """Return the modes at a value, those asked for and some more.

        Those of a reduced model are followed as the modes of its projected problem, see `ReducedModel.own_modes`:
        `point` reports them with the errors of the projection, and each onset has its own.

        Parameters
        ----------
        value : float
        before : Modes, optional
            Those at another value: they tell about how many there are, and how high.

        Raises
        ------
        NotConvergedError, SceneError, TooLargeError
        """
        clock = self._clock.now()
        if self.model is not None:
            modes = self.model.own_modes(value)
        else:
            try:
                pencil = self.problem.pencil({self.parameter: value})
                count, highest = (0, 0.0) if before is None else (len(before), float(before.lam.imag.max(initial=0.0)))
                modes = solve_modes(pencil, self.guarded, highest or None, self.linear_solver, count or None)
            except TooLargeError as error:
                if not self._is_swept or not self.problem.is_affine(self.parameter):
                    raise
                raise TooLargeError(f'{error}, or solve.method = "reduced"') from error
        self._clock.spend("eigenvalues", clock)
        return _without_cut(modes, wanted_count(modes, self.request))

    def prove(self, value: float, modes: Modes) -> Completeness:
        """Return how many modes were found at the first value, and how many there are.

        Raises
        ------
        NotConvergedError
            A mode is known to be missing.
        """
        # A reduced model has the terms summed up already.
        summed = self.problem if self.model is None else self.model.basis.problem
        highest = self.request.max_frequency_hz
        limit = None if highest is None else 2 * np.pi * highest
        c = prove_completeness(summed.pencil({self.parameter: value}), modes, self.linear_solver, limit)
        if c.expected is None and self.model is None:
            here = self.problem.at({self.parameter: value})
            c = replace(c, expected=count_apart(here, modes, self.guarded, self.linear_solver))
        elif c.expected is None and self.model is not None:
            counted = self.model.counted()
            if counted is False:
                raise NotConvergedError("the reduced model lacks modes that the inertia without friction counts", modes)
            c = replace(c, expected=c.found if counted else None)
        c = c.without(len(modes) - wanted_count(modes, self.request))
        if c.expected is not None and c.found != c.expected:
            raise NotConvergedError(f"{c.found} modes found where the inertia counts {c.expected}", modes)
        wanted = modes.select(np.arange(wanted_count(modes, self.request)))
        self.told.add(*rounding_warnings(wanted))
        if any(t.penalty for t in self.tracked.terms):
            self.told.add(*tie_warnings(self.tracked.at({self.parameter: value}), wanted))
        return c

    def point(self, value: float, modes: Modes, branches: np.ndarray, keep_all: bool) -> SweepPoint:
        """Return what is reported of the modes at a value.

        Parameters
        ----------
        value : float
        modes : Modes
            From `modes`, at the same value.
        branches : (k,) int
            The branch of each.
        keep_all : bool
            Whether to keep the shapes of all modes, and not of the unstable ones alone.
        """
        wanted = wanted_count(modes, self.request)
        modes = self._certified(value, modes)
        growing = np.flatnonzero(modes.stability == "unstable")
        above, growing = modes.lam[growing[growing >= wanted]], growing[growing < wanted]
        shapes: Mapping[int, np.ndarray] = {
            int(i): modes.right[:, i].copy() for i in (range(wanted) if keep_all else growing)
        }
        here = self.tracked.at({self.parameter: value})
        found = sensitivities(here, modes, growing) if len(growing) else {}
        moves = {
            int(i): {path: (here.value(path), complex(d[k])) for path, d in found.items()}
            for k, i in enumerate(growing)
        }
        reported = modes.select(np.arange(wanted)).without_shapes()
        pressed = self.problem.at({self.parameter: value}).state
        if self.basis is not None:
            shapes = LiftedShapes(shapes, self.basis)
        description = self._describe(here, modes.right[:, :wanted])
        return SweepPoint(
            value, reported, branches[:wanted], shapes, moves, pressed, above=tuple(complex(lam) for lam in above),
            description=description,
        )  # fmt: skip

    def _certified(self, value: float, modes: Modes) -> Modes:
        """Return modes at a value, the first of those asked for, with the errors of the projection, if there is one."""
        if self.model is None:
            return modes
        # The modes that `modes` gave are the same, without those that it left out behind the ones asked for.
        certified = _without_cut(self.model.modes(value), wanted_count(modes, self.request))
        if self.model.is_modal:
            certified = replace(certified, method=f"modal projection on {len(self.model.basis)} vectors")
        return certified

    def growth_beyond(self, value: float, modes: Modes) -> float:
        """Return the growth rate, 1/s, of which complex stiffness says nothing at a value, see `growth_beyond`."""
        if self.problem.problem_class != "complex":
            return 0.0
        clock = self._clock.now()
        rate = growth_beyond(self.tracked.pencil({self.parameter: value}), modes)
        self._clock.spend("completeness", clock)
        return rate

    def _describe(self, here: Problem, shapes: np.ndarray) -> Description:
        """Return what modes look like, from their shapes (n, k); empty if the problem has no describer."""
        if self.problem.describer is None:
            return {}
        clock, V = self._clock.now(), self.basis
        if self._describer is None or self._described is not V:
            self._describer = self.problem.describer if V is None else self.problem.describer.on(V)
            self._described = V
        description = self._describer.describe(here.terms, here.parameters, shapes)
        self._clock.spend("descriptors", clock)
        return description


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
