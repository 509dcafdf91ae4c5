"""Models that solve the places of a study: a reduced model over the box of its parameters, or the problem itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import psutil
from threadpoolctl import threadpool_limits

from ..assembly.assembly import assemble
from ..eigen.dense import DENSE_LIMIT
from ..eigen.linear.factor import LinearSolver
from ..eigen.request import Request
from ..eigen.solve import solve_modes
from ..errors import MeshError, NotConvergedError, SceneError
from ..problem.dependence import depends_on
from ..problem.parameters import paths_of
from ..problem.problem import Problem
from ..reduced import BoxModel, OnlineModel
from ..scene import Scene
from ..scene.numbers import GEOMETRY, with_numbers
from ..sweep.forecast import predict_memory
from .outcome import Outcome, outcome_of

_DIRECT = 1e-8  # backward error of direct solves
_MODES = 100  # for a prediction of memory where their number is not given
_PROCESS = 200 * 2**20  # bytes: of a worker that has not solved anything yet
Values = Sequence[float] | np.ndarray


class Model(Protocol):
    """Solves for the modes at a place, given the values of the parameters; can be sent to another process."""

    def outcome(self, values: Values) -> Outcome | None:
        """Return the outcome at a place; None where the model is not accurate enough."""


@dataclass(frozen=True)
class CertifiedModel:
    """A reduced model that gives no outcome where its error exceeds the tolerance, or modes are too few."""

    online: OnlineModel

    def outcome(self, values: Values) -> Outcome | None:
        """Return the outcome at a place; None where the estimated error of a mode exceeds the tolerance.

        None also where fewer modes than were asked for are in the range of the basis: beyond it some may be missing.
        """
        modes, off, relative = self.online.modes(tuple(float(v) for v in values))
        if off.max(initial=0.0) > 1 or self.online.is_short(modes):
            return None
        return outcome_of(modes, self.online.whole.request, float(relative.max(initial=0.0)), direct=False)


@dataclass(frozen=True)
class DirectModel:
    """The problem itself, solved at every place."""

    problem: Problem
    names: tuple[str, ...]
    request: Request
    linear_solver: LinearSolver | str = "auto"

    @cached_property
    def memory(self) -> int:
        """The bytes that a process of its own is predicted to take for a direct solve."""
        modes = self.request.count or _MODES
        forecast = predict_memory(self.problem, self.names[0], 1, modes, "direct", self.linear_solver)
        terms = sum(t.matrix.nnz * (t.matrix.dtype.itemsize + 4) for t in self.problem.terms)
        return forecast.total - int(psutil.Process().memory_info().rss) + terms + _PROCESS

    def outcome(self, values: Values) -> Outcome:
        """Return the outcome at a place; its error is the largest product of backward error and condition of a mode."""
        with _named(self.names, values):
            at = self.problem.at({n: float(v) for n, v in zip(self.names, values, strict=True)})
            return _solved(at, self.request, self.linear_solver)


@dataclass(frozen=True)
class RemeshedModel:
    """A scene whose geometry is meshed and assembled anew at every place, for parameters of the geometry."""

    scene: Scene
    names: tuple[str, ...]
    request: Request
    linear_solver: LinearSolver | str = "auto"

    def outcome(self, values: Values) -> Outcome:
        """Return the outcome at a place, on a mesh made for it."""
        moved = {p: float(v) for n, v in zip(self.names, values, strict=True) for p in paths_of(n)}
        with _named(self.names, values):
            scene = without_file(with_numbers(self.scene, moved))
            return _solved(assemble(scene, linear_solver=self.linear_solver), self.request, self.linear_solver)


def without_file(scene: Scene) -> Scene:
    """Return the scene with the mesh of its geometry, which is made anew, and not that of its file."""
    return scene.model_copy(update={"mesh": scene.mesh.model_copy(update={"file": None})})


@contextmanager
def _named(names: Sequence[str], values: Values) -> Iterator[None]:
    """Have an error of the scene or its mesh say at which place of the study it occurred."""
    try:
        yield
    except (SceneError, MeshError) as error:
        place = ", ".join(f"{n} = {v:.6g}" for n, v in zip(names, values, strict=True))
        raise type(error)(f"study, at {place}: {error}") from error


def _solved(problem: Problem, request: Request, linear_solver: LinearSolver | str) -> Outcome:
    exact = replace(request, tolerance=min(request.tolerance, _DIRECT))
    modes = solve_modes(problem.pencil(), exact, linear_solver=linear_solver)
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.minimum(modes.backward_error * modes.condition, 1.0)
    return outcome_of(modes, request, float(np.nan_to_num(error, nan=0.0).max(initial=0.0)), direct=True)


@dataclass(frozen=True)
class Solver:
    """How the places of a study are solved.

    Attributes
    ----------
    model : Model
        The model that is tried first.
    direct : DirectModel or None
        Solves the places at which `model` gives no outcome; None if `model` always gives one.
    box : BoxModel or None
        The reduced model with all its vectors, if there is one.
    why : str
        A sentence on which method was chosen, and why.
    """

    model: Model
    direct: DirectModel | None
    box: BoxModel | None
    why: str

    def outcome(self, values: Values) -> Outcome:
        """Return the outcome at a place, in this process."""
        with threadpool_limits(limits=1, user_api="blas"):
            found = self.model.outcome(values)
        if found is None:
            assert self.direct is not None
            found = self.direct.outcome(values)
            assert found is not None
        return found


def make_solver(
    problem: Problem, names: Sequence[str], low: np.ndarray, high: np.ndarray,
    draw: Callable[[int], list[tuple[float, ...]]], request: Request, linear_solver: LinearSolver | str = "auto",
    method: str = "auto", scene: Scene | None = None, progress: Callable[[str], None] = lambda text: None,
) -> Solver:  # fmt: skip
    """Return how a study is solved: by a reduced model if every parameter only changes coefficients of terms.

    Otherwise every place is solved directly, and on a mesh of its own if a parameter is a number of the geometry.

    Parameters
    ----------
    problem : Problem
    names : sequence of str
        The d parameters.
    low, high : (d,) float
        The box that contains all places.
    draw : callable of int
        Returns points for the reduced model, see `BoxModel`.
    request : Request
        Which modes are asked for, and to what tolerance.
    linear_solver : LinearSolver or str
    method : "auto", "direct" or "reduced"
        "direct": no reduced model is made.
    scene : Scene, optional
        The scene of the problem; needed if a parameter is a number of its geometry.
    progress : callable of str
        Gets a sentence about what is being done.

    Raises
    ------
    SceneError
        The problem does not have a parameter, nothing depends on it, or the scene is needed and missing.
    """
    names = tuple(names)
    meshed = [p for n in names for p in paths_of(n) if p.startswith(GEOMETRY)]
    if meshed:
        if scene is None:
            raise SceneError(f'given "{meshed[0]}"; expected a scene, which is meshed anew for every value')
        why = f"direct solves: {meshed[0]} changes the mesh, which is made anew at every place"
        return Solver(RemeshedModel(scene, names, request, linear_solver), None, None, why)
    for name, least, most in zip(names, low, high, strict=True):
        _require_effect(problem, name, float(least), float(most))
    problem = problem.solved_with(linear_solver)
    for name, least, most in zip(names, low, high, strict=True):
        problem = problem.prepared(name, np.array([least, most]))
    direct = DirectModel(problem, names, request, linear_solver)
    if method == "direct":
        return Solver(direct, None, None, 'direct solves, which method = "direct" asks for')
    others = [n for n in names if not problem.is_affine(n)]
    if others:
        why = f"direct solves: {others[0]} changes matrices, not their coefficients alone"
        return Solver(direct, None, None, why)
    if problem.unknowns <= DENSE_LIMIT:
        why = f"direct solves: {problem.unknowns} unknowns are few enough for LAPACK on the whole matrices"
        return Solver(direct, None, None, why)
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            box = BoxModel(problem, names, low, high, draw, request, linear_solver, progress)
        except NotConvergedError as error:
            return Solver(direct, None, None, f"direct solves: {error}")
    online = box.online()
    small = 0 if box.condensed is None else len(box.condensed.basis)
    why = (
        f"reduced model of {len(box.basis)} vectors{f', condensed to {small}' if small else ''}, from modes at"
        f" {len(box.places)} places; largest error {box.error:.1e} at {box.checked} other places, {box.missed} of which"
        " miss the tolerance"
    )
    if not box.proven:
        why += "; the softest corner is not known: modes are counted at places, and not proven between them"
    return Solver(CertifiedModel(online or box.certified()), direct, box, why)


def _require_effect(problem: Problem, name: str, low: float, high: float) -> None:
    """Check that something in the problem depends on a parameter.

    Raises
    ------
    SceneError
        The problem does not have the parameter, or nothing depends on it.
    """
    problem.value(name)  # raises SceneError if the problem does not have it
    if not depends_on(problem, name, (low, high)):
        raise SceneError(f'study: given "{name}", on which nothing in the problem depends; expected another parameter')
