"""The problem of a sweep on its mesh with every element cut into eight, and the prolongation between the two meshes."""

from __future__ import annotations

import gc
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..assembly.assembly import Assembly
from ..assembly.contacts import with_gap_tolerances
from ..eigen.linear.choice import factorize, factorize_definite_roughly
from ..eigen.linear.factor import LinearSolver
from ..eigen.memory import available_memory, require_memory
from ..eigen.request import Request
from ..eigen.threads import one_openblas_thread
from ..errors import NotConvergedError, SceneError
from ..fem.spaces import DisplacementSpace
from ..mesh.refining import refine
from ..problem.forms import collect_powers
from ..problem.interpolation import interpolate
from ..problem.parameters import paths_of
from ..problem.problem import Problem
from ..process.ahead import Ahead
from ..reduced import ReducedModel, TransferredModel
from ..reduced.undamped import weighted
from ..sweep.result import Sweep
from .prolongation import prolongation
from .shares import Hierarchy
from .two_level import TwoLevelSolver

_VALUE = "value"
_CHILDREN = 8  # elements that replace one; the refined problem has about as many times the unknowns
_COPIES = 4  # copies of M, C and K on the refined mesh that memory is counted for: the terms, and their sums
_ROOM = 2  # times the memory of its matrices: so much has to be free for the refined mesh beside a sweep
_VECTORS = 24  # vectors on the refined mesh that the corrections of one mode take
_NEAR = 1e-6  # of |λ|: the error up to which modes on the mesh itself come from the sweep's basis; a choice, not a fit
_KNOWN = 1.1  # times the frequency up to which modes are asked for: so far they are known, as in a sweep of many values
_BASIS = 10  # vectors in the coarse basis for each mode, where the sweep has made no basis yet
ABOVE = 1.02  # times the highest frequency asked for: modes up to this frequency are corrected


@dataclass(frozen=True)
class Refined:
    """The problem of a sweep on the refined mesh, beside that on the mesh itself.

    Attributes
    ----------
    coarse : Assembly
        What assembly knows of the mesh itself.
    space : DisplacementSpace
        The unknowns on the refined mesh.
    problem : Problem
        The problem on the refined mesh, its terms collected by powers of the parameter.
    model : ReducedModel or TransferredModel
        Of the problem on the mesh itself.
    parameter : str
        The parameter of the sweep. If the sweep has a single value, a parameter that nothing depends on stands in.
    values : (m,) float
        Values of the parameter.
    highest : float, rad/s
        The highest frequency of the modes that were asked for, or the one up to which all were.
    prolongation : (n_fine, n_coarse) sparse
        Writes a displacement on the mesh itself as one on the refined mesh.
    metric : list of float
        Coefficients of the terms of `problem` whose sum is P.
    P : (n_fine, n_fine) sparse, symmetric positive definite
        K − σM on the refined mesh with σ below all θ: the part of Q(λ) without friction and damping.
    solver : TwoLevelSolver
        Applies P⁻¹.
    """

    coarse: Assembly
    space: DisplacementSpace
    problem: Problem
    model: ReducedModel | TransferredModel
    parameter: str
    values: np.ndarray
    highest: float
    prolongation: sp.csr_array
    metric: list[float]
    P: sp.csr_array
    solver: TwoLevelSolver

    @property
    def reach(self) -> float:
        """Up to which |λ|, rad/s, modes of projections are taken: those of the whole sweep, and of its model."""
        return max(self.model.highest, ABOVE * self.highest)

    @cached_property
    def hierarchy(self) -> Hierarchy:
        """Which element of the mesh itself, and along which axis, a change comes from."""
        return Hierarchy(self.coarse.space, self.space, self.prolongation)


@dataclass(frozen=True)
class FinerMesh:
    """What can be made of the refined mesh before there are modes.

    Attributes
    ----------
    assembly : Assembly or None
        None where its terms are collected already.
    space : DisplacementSpace
        Its unknowns.
    prolongation : (n_fine, n_coarse) sparse
    collected : Problem or None
        The problem on it, its terms collected by powers of the sweep's parameter, with the numbers `changed`.
    changed : mapping of str to float
    """

    assembly: Assembly | None
    space: DisplacementSpace
    prolongation: sp.csr_array
    collected: Problem | None = None
    changed: Mapping[str, float] = field(default_factory=dict)

    def serves(self, axis: str, changed: Mapping[str, float]) -> bool:
        """Return whether terms that are collected are those over the powers of a parameter, with these numbers."""
        return self.collected is None or (self.collected.has(axis) and self.changed == changed)

    @classmethod
    def of(cls, coarse: Assembly) -> FinerMesh:
        """Cut every element of a mesh into eight."""
        fine = Assembly(with_gap_tolerances(coarse.scene, coarse.loaded), refine(coarse.loaded))
        return cls(fine, fine.space, prolongation(coarse.space, fine.space))

    @classmethod
    def prepared(
        cls, problem: Problem, parameter: str, values: Sequence[float], linear_solver: LinearSolver | str
    ) -> FinerMesh:  # fmt: skip
        """Do the same for the mesh of a problem, and collect its terms; static states are found for that.

        Of a single value (m = 1) nothing is collected.
        """
        coarse = problem.source
        assert isinstance(coarse, Assembly)
        finer = cls.of(coarse)
        assert finer.assembly is not None
        finer.assembly.prepare()
        if len(values) == 1:
            return finer
        changed = _changed(problem, parameter, values)
        collected = _collected(finer.assembly, changed, parameter, np.array(values), parameter, linear_solver)
        made = cls(None, finer.space, finer.prolongation, collected, changed)
        del finer
        gc.collect()  # an assembly and its problems refer to each other; the terms are as large as their sums
        return made


def finer_mesh_ahead(
    problem: Problem, parameter: str, values: Sequence[float], linear_solver: LinearSolver | str = "auto"
) -> Ahead[FinerMesh] | None:  # fmt: skip
    """Begin with the refined mesh of a problem beside its sweep: most of assembly takes one core alone.

    None where the problem has no mesh, or memory for both is not sure.
    """
    if not isinstance(problem.source, Assembly) or _ROOM * _matrices_memory(problem) > available_memory():
        return None
    return Ahead(lambda: FinerMesh.prepared(problem, parameter, values, linear_solver))


@one_openblas_thread()
def refine_problem(
    result: Sweep, linear_solver: LinearSolver | str = "auto", ahead: Ahead[FinerMesh] | None = None
) -> Refined:  # fmt: skip
    """Assemble the problem of a sweep on its mesh with every element cut into eight.

    Where the parameter changes the matrices themselves, not only their coefficients (μ under preload), the matrices of
    both meshes are interpolated quadratically in it.

    Parameters
    ----------
    result : Sweep
        Sweep of a problem that was assembled from a mesh.
    linear_solver : LinearSolver or str
        As for `sweep`.
    ahead : Ahead of FinerMesh, optional
        What was begun beside the sweep.

    Raises
    ------
    SceneError
        The problem has no mesh.
    TooLargeError
        The refined mesh does not fit into memory.
    NotConvergedError
        The mixed formulation has functions that the refined mesh does not have, or a solve did not converge.
    """
    problem, parameter = result.problem.solved_with(linear_solver), result.parameter
    assembly = problem.source
    if not isinstance(assembly, Assembly):
        raise SceneError("the error of a mesh is asked for (--estimate), and the scene has matrices instead of a mesh")
    taken = 0 if ahead is None else _matrices_memory(problem) // _COPIES  # by the terms that are there already
    finer = None if ahead is None else ahead.take()
    require_memory(refined_memory(result) - taken, _CHILDREN * problem.unknowns, "modes on the refined mesh")
    values = np.array([p.value for p in result.points])
    changed = _changed(problem, parameter, values)
    axis, at = (parameter, values) if len(values) > 1 else (_VALUE, np.zeros(1))
    if finer is None or not finer.serves(axis, changed):
        finer = FinerMesh.of(assembly)
    model = _model(result, _affine(problem, parameter, values), axis, at, linear_solver)
    basis, E, space = model.basis, finer.prolongation, finer.space
    own = {t.name: c for t, c in zip(basis.problem.terms, basis.metric, strict=True)}
    if finer.collected is None:
        assert finer.assembly is not None
        own_terms = _collected(finer.assembly, changed, parameter, values, axis, linear_solver)
        finer = replace(finer, assembly=None, collected=own_terms)
        gc.collect()  # an assembly and its problems refer to each other; the terms are as large as their sums
    assert finer.collected is not None
    collected = finer.collected.at({axis: basis.problem.value(axis)})
    del finer
    metric = [own.get(t.name, 0.0) for t in collected.terms]
    P = weighted(collected, metric)
    coarse = model.definite if isinstance(model, TransferredModel) else None
    coarse = coarse or factorize_definite_roughly(lambda: weighted(basis.problem, basis.metric), model.linear_solver)
    solver = TwoLevelSolver(P, E, coarse.solve, lambda: factorize(P, True, model.linear_solver).solve)
    highest = max(float(p.modes.lam.imag.max(initial=0.0)) for p in result.points)
    if result.max_frequency is not None:
        highest = max(highest, 2 * np.pi * result.max_frequency)  # a mode above it may be below it on the refined mesh
    return Refined(assembly, space, collected, model, axis, at, highest, E, metric, P, solver)


def _model(
    result: Sweep, affine: Problem, axis: str, at: np.ndarray, linear_solver: LinearSolver | str
) -> ReducedModel | TransferredModel:
    """Return a reduced model of the problem on the mesh itself in its affine form: that of the sweep if it serves."""
    model, single = result.reduced_model, len(at) == 1
    if model is not None and not single and result.problem.is_affine(result.parameter):
        return model
    if model is not None and not single:
        with suppress(NotConvergedError):
            transferred = TransferredModel(model, affine, model.basis.problem.value(axis))
            if all(transferred.error(float(p)) <= _NEAR for p in at):
                return transferred
    found = max(len(p.modes) for p in result.points)
    if found and result.max_frequency is not None:
        request = Request(max_frequency_hz=_KNOWN * result.max_frequency)
    else:
        request = Request(count=found + 2)
    return ReducedModel(affine, axis, at, request, linear_solver=linear_solver)


def refined_memory(result: Sweep) -> int:
    """Return about how many bytes the modes on the refined mesh take, in addition to what the sweep takes."""
    modes = max((len(p.modes) for p in result.points), default=0)
    basis = _BASIS * modes if result.reduced_model is None else len(result.reduced_model.basis)
    vectors = 2 * basis + _VECTORS * modes
    return _matrices_memory(result.problem) + _CHILDREN * 8 * vectors * result.problem.unknowns


def _matrices_memory(problem: Problem) -> int:
    """Return about how many bytes the matrices on the refined mesh take."""
    pencil = problem.pencil()
    entries = sum(A.nnz for A in (pencil.M, pencil.C, pencil.K) if A is not None)
    return _CHILDREN * _COPIES * 12 * entries


def _changed(problem: Problem, parameter: str, values: Sequence[float] | np.ndarray) -> Mapping[str, float]:
    """Return the numbers that differ from those of the scene where the refined problem is made.

    A parameter that changes matrices has its first value there, so that no other static state is found than those that
    are interpolated.
    """
    if problem.is_affine(parameter):
        return problem.changed
    return {**problem.changed, **dict.fromkeys(paths_of(parameter), float(values[0]))}


def _collected(
    fine: Assembly, changed: Mapping[str, float], parameter: str, values: np.ndarray, axis: str,
    linear_solver: LinearSolver | str,
) -> Problem:  # fmt: skip
    """Return the problem of the refined mesh in its affine form, its terms collected by powers of a parameter."""
    on_fine = fine.solved_with(linear_solver).problem(changed).prepared(parameter, values)
    return collect_powers(_affine(on_fine, parameter, values), axis)


def _affine(problem: Problem, parameter: str, values: np.ndarray) -> Problem:
    """Return the problem in a form where the parameter changes coefficients alone, never matrices.

    For a single value that is the problem at this value, with the parameter `_VALUE` that nothing depends on.
    """
    if len(values) > 1:
        return interpolate(problem, parameter, float(values[0]), float(values[-1]))
    here = problem.at({parameter: float(values[0])}) if problem.has(parameter) else problem
    return replace(here, parameters={**here.parameters, _VALUE: 0.0}, coupled=frozenset())
