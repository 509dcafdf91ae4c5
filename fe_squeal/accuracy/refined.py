"""A sweep's problem on its mesh with every element cut into eight, and what carries functions over."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..assembly.assembly import Assembly
from ..eigen.linear.choice import factorize_definite
from ..eigen.linear.factor import LinearSolver
from ..eigen.memory import require_memory
from ..eigen.request import Request
from ..errors import SceneError
from ..mesh.refining import refine
from ..problem.forms import collect_powers, interpolate
from ..problem.problem import Problem
from ..reduced import ReducedModel
from ..reduced.undamped import weighted
from ..sweep.result import Sweep
from .two_level import TwoLevelSolver, prolongation

_VALUE = "value"
_CHILDREN = 8  # elements into which one is cut, and about as many times the unknowns
_COPIES = 4  # of the refined matrices: those of the terms, and their sums
_VECTORS = 24  # on the refined mesh for each mode, besides the coarse basis and a copy of it: those of the corrections
_BASIS = 10  # vectors for each mode that a coarse basis is taken to have where there is none yet


@dataclass(frozen=True)
class Refined:
    """The problem of a sweep on the refined mesh.

    Attributes
    ----------
    coarse, fine : Assembly
    problem : Problem
        On the refined mesh, its terms collected by powers of the parameter.
    model : ReducedModel
        Of the problem on the mesh itself.
    parameter : str
        That of the sweep; where it has one value, one that nothing depends on.
    values : (m,) float
        Of that parameter.
    highest : float, rad/s
        Of the modes that were asked for.
    prolongation : (n_fine, n_coarse) sparse
    metric : list of float
        Coefficients of the terms in P = K − σM, the part of Q(λ) without friction and damping.
    P : (n_fine, n_fine) sparse
    solver : TwoLevelSolver
        Applies P⁻¹.
    """

    coarse: Assembly
    fine: Assembly
    problem: Problem
    model: ReducedModel
    parameter: str
    values: np.ndarray
    highest: float
    prolongation: sp.csr_array
    metric: list[float]
    P: sp.csr_array
    solver: TwoLevelSolver


def refine_problem(result: Sweep, linear_solver: LinearSolver | str = "auto") -> Refined:
    """Assemble the problem of a sweep on its mesh with every element cut into eight.

    Where the parameter changes matrices (under preload) both meshes take matrices that are quadratic in it.

    Parameters
    ----------
    linear_solver : LinearSolver or str
        As of `sweep`.

    Raises
    ------
    SceneError
        The problem has no mesh.
    TooLargeError
        The refined mesh does not fit into memory.
    NotConvergedError
        The formulation has functions that a refined mesh does not have.
    """
    problem, parameter = result.problem.solved_with(linear_solver), result.parameter
    assembly = problem.source
    if not isinstance(assembly, Assembly):
        raise SceneError("the error of a mesh is asked for (--estimate), and the scene has matrices instead of a mesh")
    require_memory(refined_memory(result), _CHILDREN * problem.unknowns, "modes on the refined mesh")
    values = np.array([p.value for p in result.points])
    fine = Assembly(assembly.scene, refine(assembly.loaded)).solved_with(linear_solver)
    E = prolongation(assembly.space, fine.space)
    on_fine = fine.problem(problem.changed).prepared(parameter, values)
    affine = [_affine(p, parameter, values) for p in (problem, on_fine)]
    axis, at = (parameter, values) if len(values) > 1 else (_VALUE, np.zeros(1))
    model = result.reduced_model
    if model is None or len(values) == 1 or not problem.is_affine(parameter):
        request = Request(count=max(len(p.modes) for p in result.points) + 2)
        model = ReducedModel(affine[0], axis, at, request, linear_solver=linear_solver)
    basis = model.basis
    own = {t.name: c for t, c in zip(basis.problem.terms, basis.metric, strict=True)}
    collected = collect_powers(affine[1], axis).at({axis: basis.problem.value(axis)})
    metric = [own.get(t.name, 0.0) for t in collected.terms]
    P = weighted(collected, metric)
    solver = TwoLevelSolver(P, E, factorize_definite(weighted(basis.problem, basis.metric), model.linear_solver).solve)
    highest = max(float(p.modes.lam.imag.max(initial=0.0)) for p in result.points)
    return Refined(assembly, fine, collected, model, axis, at, highest, E, metric, P, solver)


def refined_memory(result: Sweep) -> int:
    """Return about how many bytes modes on the refined mesh take besides those of the sweep."""
    pencil = result.problem.pencil()
    entries = sum(A.nnz for A in (pencil.M, pencil.C, pencil.K) if A is not None)
    modes = max((len(p.modes) for p in result.points), default=0)
    basis = _BASIS * modes if result.reduced_model is None else len(result.reduced_model.basis)
    vectors = 2 * basis + _VECTORS * modes
    return _CHILDREN * (_COPIES * 12 * entries + 8 * vectors * result.problem.unknowns)


def _affine(problem: Problem, parameter: str, values: np.ndarray) -> Problem:
    """Return the problem with a parameter that changes coefficients alone; at one value it changes nothing."""
    if len(values) > 1:
        return interpolate(problem, parameter, float(values[0]), float(values[-1]))
    here = problem.at({parameter: float(values[0])}) if problem.has(parameter) else problem
    return replace(here, parameters={**here.parameters, _VALUE: 0.0}, coupled=frozenset())
