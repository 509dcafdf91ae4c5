"""A reduced model that stands for a problem over an interval of a parameter, within a tolerance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..eigen.blocks import lift
from ..eigen.linear.choice import choose
from ..eigen.linear.factor import Factor, LinearSolver
from ..eigen.multiple import have_copies
from ..eigen.pencil import Modes
from ..eigen.request import Request, is_needed
from ..errors import NotConvergedError
from ..problem.aside import forget_pages
from ..problem.parameters import Place, values_at
from ..problem.problem import Problem
from ..problem.tabulated import Tabulated
from .basis import ReducedBasis
from .begun import BegunModel, collected_at
from .corners import softest_value
from .estimate import error_scale
from .growing import spread
from .missing import holds_all
from .mode_corrections import ModeCorrections
from .shapes import corrected_shapes

_FOLLOWED = 1e-8  # of |λ|: errors of a projection up to here count as rounding where modes are followed
_TRIED = 3  # values at which the number of modes is looked at before all others
_SOFT = 4  # times that modes are looked for which are soft far from the start, each on the basis with those before
_CROWD = 0.25  # of the modes that the basis begins with: more overdamped ones are a crowd


class ReducedModel(BegunModel):
    """The projection of a problem on right and left modes at a few values of a parameter.

    Attributes
    ----------
    problem : Problem
    parameter : str or tuple of str
    basis : ReducedBasis
    highest : float, rad/s
        Frequency up to which the basis holds the modes of the problem without damping and friction.
    linear_solver : LinearSolver
    enough : float
        Of what an error may be: below that modes that are put into the basis are not corrected any more.
    is_modal : bool
        Whether it stops at the modes of the problem without damping and friction, whatever the error.
    """

    def __init__(
        self, problem: Problem, parameter: str, values: Sequence[float] | np.ndarray, request: Request,
        modal: bool = False, linear_solver: LinearSolver | str = "auto", swinging: bool = False, least: int = 0,
    ) -> None:  # fmt: skip
        """Build the model.

        Parameters
        ----------
        problem : Problem
            Its matrices are made anew at each value where the parameter changes more than coefficients.
        values : (m,) float, increasing
        request : Request
        modal : bool
            As `is_modal`.
        linear_solver : LinearSolver or str
            Factorises the matrices that the model is made from.
        swinging : bool
            Whether to give up where many modes are overdamped.
        least : int
            Of the number of modes that the request has, so many are needed at every value; the others are neighbours.

        Raises
        ------
        NotConvergedError
            If the tolerance is not met, the problem without damping and friction is not positive semidefinite, or too
            many modes are overdamped.
        """
        self._values = values = np.asarray(values, float)
        self._least, self.is_modal = least, modal
        self._begin(problem, parameter, softest_value(problem, parameter, values), request, linear_solver)
        if swinging:
            self._refuse_overdamped((float(values[0]), float(values[-1])))
        self._widen(problem, spread(values, _TRIED))
        if modal:
            self._without = self.basis.undamped_values(self._sigma)
        else:
            self._grow(values)
            self._without = self.basis.undamped_values(self._sigma)
            self._supplement(values)
            self._corrections.release()  # before others take memory
            for _ in range(_SOFT):
                if not self._add_soft(self._far_from_the_start(values)):
                    break
                self._know_less()
                self._grow(values)
                self._supplement(values)
            else:
                raise NotConvergedError(
                    f"the reduced model still lacks modes that are soft at other values of {parameter}"
                )
        short = next((p for p in values.tolist() if self._is_short(self.own_modes(p))), None)
        if short is not None:
            raise self._too_few(short)
        self._release()

    def _release(self) -> None:
        """Forget the factors and the vectors of the search for missing modes; no vectors are added from now on."""
        self._corrections.release()
        self._outside, self._is_made = None, True
        self._forget()
        self.basis.shrink()
        self._known_with = self.basis.V  # which is the same

    def _refuse_overdamped(self, values: Sequence[Place]) -> None:
        """Raise NotConvergedError where many modes at some values decay without swinging.

        A basis cannot part a crowd of such modes from the swinging ones: what it makes of the crowd swings, too, and
        has to be corrected like a mode. Discs of a direct solve leave the crowd out.
        """
        for value in values:
            needed = is_needed(self._every(value))
            if np.count_nonzero(~needed) > _CROWD * len(needed):
                raise NotConvergedError(
                    f"{np.count_nonzero(~needed)} of {len(needed)} modes decay without swinging at"
                    f" {self.parameter} = {value:g}"
                )

    @classmethod
    def restored(
        cls, problem: Problem, parameter: str, values: Sequence[float] | np.ndarray, request: Request,
        arrays: Mapping[str, np.ndarray], numbers: Mapping[str, Any], linear_solver: LinearSolver | str = "auto",
    ) -> ReducedModel:  # fmt: skip
        """Return the model from the arrays and numbers of `stored`, for the same problem, values (m,) and request."""
        model = cls.__new__(cls)
        model.linear_solver = choose(linear_solver)
        model.problem = problem = problem.solved_with(model.linear_solver)
        model.parameter, model.request = parameter, request
        model._start, model._is_made, model.is_modal = numbers["start"], True, numbers["modal"]
        model._know_nothing(problem, True)
        model._met = {place: (size, count) for place, (size, count) in numbers["met"]}
        between = numbers["between"]
        if model._between is not None:
            model._between = model._between.restored(arrays, between)
        model._values = np.asarray(values, float)
        model._sigma, model.highest, model._without = numbers["sigma"], numbers["highest"], arrays["without"]
        made = ModeCorrections(problem, model._sigma, request.tolerance, model._start, model.linear_solver)
        made.factorizations, made.solves = numbers["factorizations"], numbers["solves"]
        made.definite_suffices = numbers["definite_suffices"]
        model._corrections = made
        collected = collected_at(problem, parameter, numbers["start"])
        for value in numbers["table"]:
            assert isinstance(collected, Tabulated)
            collected = collected.with_value(value)
        model._put_terms_aside(collected)
        model.basis = ReducedBasis.restored(collected, parameter, arrays, numbers["basis"], model.linear_solver)
        return model

    def stored(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return what `restored` needs besides the problem: arrays, and numbers that JSON can hold."""
        arrays, numbers = self.basis.stored()
        known, between = ({}, None) if self._between is None else self._between.stored()
        return arrays | {"without": self._without} | known, {
            "basis": numbers, "between": between, "sigma": self._sigma, "highest": self.highest,
            "factorizations": self.factorizations, "solves": self.solves, "start": self._start, "modal": self.is_modal,
            "met": list(self._met.items()),
            "definite_suffices": self._corrections.definite_suffices,
            "table": list(table.known)[1:] if isinstance(table := self.basis.problem, Tabulated) else [],
        }  # fmt: skip

    @property
    def factorizations(self) -> int:
        """Matrices factorised."""
        return self._corrections.factorizations

    @property
    def solves(self) -> int:
        """Right-hand sides solved for."""
        return self._corrections.solves

    @property
    def worst(self) -> float:
        """The largest estimated error of λ over the values asked for, relative to |λ|."""
        found = [float(self._estimated(float(p))[2].max(initial=0.0)) for p in self._values]
        return max(found, default=0.0)

    def modes(self, value: Place) -> Modes:
        """Return the modes asked for at one value, with vectors of length r and the errors of the projection."""
        return self._estimated(value)[0]

    def own_modes(self, value: Place) -> Modes:
        """Return the same modes as those of the projected problem itself, hardly more uncertain than by rounding.

        Of these it is known which are stable and where two of them meet. Of those of the problem it may not be: the
        error of a modal projection, or of one with a large tolerance, may exceed growth rates. What it would be with a
        tolerance of `_FOLLOWED` stays: by so much a projection may part the modes of equal parts of a brake. Where most
        modes are those of equal parts, which any error parts, all of it stays.
        """
        if self._has_copies:
            return self.modes(value)
        modes, _, relative = self._estimated(value)
        share = min(1.0, _FOLLOWED / self.request.tolerance)
        kept = np.minimum(relative, _FOLLOWED) if self.is_modal else share * relative
        scale = error_scale(modes, self.highest)
        rounding = np.maximum(modes.re_uncertainty - relative * scale, 0.0)
        return replace(modes, re_uncertainty=rounding + kept * scale)

    def counted(self) -> bool | None:
        """Return whether the basis holds all modes without damping and friction up to `highest`, by the inertia.

        Modes with damping and friction grow out of these. Others can only come from beyond `highest`; `missing_modes`
        looks for them. None where the linear solver does not give the inertia.
        """
        counted = holds_all(self._without, self.highest, self.basis.base(self._sigma), self.linear_solver)
        self._corrections.factorizations += counted is not None
        return counted

    @cached_property
    def _has_copies(self) -> bool:
        """Whether most modes at the start are equal to others, as of equal pads."""
        lam = self._estimated(self._start)[0].lam
        equal = have_copies(lam[lam.imag > 0])
        return bool(2 * np.count_nonzero(equal) > len(equal))

    def lift(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors (r,) or (r, k) of the reduced model as vectors (n,) or (n, k) of the problem."""
        return lift(self.basis.V, vectors)

    def shapes(self, value: Place, positions: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Return shapes (n, k) of modes at a value, as exact as the tolerance asks, and their backward errors (k,).

        The lifted vectors of `modes` are less exact: only as exact as their eigenvalues need.
        """
        self.__dict__.pop("middle", None)
        every = self._every(value)
        wanted = self._estimated(value)[0].lam[list(positions)]
        _, at = linear_sum_assignment(np.abs(wanted[:, None] - every.lam[None, :]))
        lifted = replace(every, right=self.lift(every.right), left=None)
        pencil, tolerance = self.basis.problem.pencil(values_at(self.parameter, value)), self.request.tolerance
        if self._corrections.definite_suffices:
            undamped = partial(self._corrections.factorize_undamped, self.basis, self.highest)
            shapes, errors = corrected_shapes(pencil, lifted, at, undamped, tolerance)
            if errors.max(initial=0.0) <= tolerance:
                return shapes, errors
            self._corrections.definite_suffices = False
        return corrected_shapes(pencil, lifted, at, partial(self.factorize, value), tolerance)

    @cached_property
    def projected(self) -> Problem:
        """The projected problem with every term of the problem: for shares and sensitivities."""
        found = self.basis.project(self.problem)
        forget_pages(self.problem.terms)
        return found

    @cached_property
    def collected(self) -> Problem:
        """The projected problem with its terms collected by powers of the parameter, the others at their values."""
        return self.basis.collected()

    def root_error(
        self, value: Place, lam: complex, right: np.ndarray, left: np.ndarray, here: Problem | None = None,
        crosses: bool = False,
    ) -> tuple[float, float]:  # fmt: skip
        """Return how far a critical value may be off because of the reduction, and because of rounding.

        Parameters
        ----------
        value : float or tuple of float
            The critical value.
        lam : complex, rad/s
            The eigenvalue there.
        right, left : (r,) float or complex
            The right and left vector there, in the coordinates of the reduced model.
        here, crosses
            See `ReducedBasis.root_error`.
        """
        return self.basis.root_error(value, lam, right, left, self.highest, here=here, crosses=crosses)

    @cached_property
    def middle(self) -> Factor:
        """Factors of Q(iω) at the value in the middle, kept until shapes are asked for, which need their memory.

        Without friction and damping where these change modes so little that factors of P sufficed.
        """
        if self._corrections.definite_suffices:
            return self._corrections.factorize_undamped(self.basis, self.highest)
        return self.factorize(float(self._values[len(self._values) // 2]))

    def factorize(self, value: Place) -> Factor:
        """Factorise Q(iω) at a value, with ω in the middle of the band; those of `middle` are given up."""
        self.__dict__.pop("middle", None)
        return self._corrections.factorize(self.basis, value, self.highest)

    def correct(self, basis: ReducedBasis, value: Place, modes: Modes, factor: Factor) -> None:
        """Add the corrections of some modes at a value to a basis, see `ModeCorrections.correct`."""
        self._corrections.correct(basis, value, modes, factor)
