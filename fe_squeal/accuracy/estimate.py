"""Error bars: how far modes and onsets are from those of an infinitely fine mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..assembly.assembly import Assembly
from ..eigen.dense import solve_dense
from ..eigen.linear.factor import LinearSolver
from ..eigen.memory import require_memory
from ..eigen.pencil import Modes
from ..eigen.request import Request
from ..errors import SceneError
from ..mesh.refining import refine
from ..problem.forms import interpolate
from ..problem.problem import Problem
from ..reduced import ReducedModel
from ..sweep.onsets import Onset
from ..sweep.result import Sweep, SweepPoint
from ..sweep.sweep import sweep
from ..sweep.tracking import match_modes
from .corrected import CorrectedModel
from .two_level import prolongation

# All three are times the change from the mesh to the one refined once. Halving the size leaves 2^-q of an error: q = 4
# for smooth modes of order 2, 2 for those of order 1, and down to 1 where stresses are singular: at edges of contacts,
# clamped edges, re-entrant corners. The error is then between 16/15 and 2 times the change. BAR holds it, EXTRAPOLATED
# is in the middle, and UNSURE is how far from the middle it may be.
BAR, EXTRAPOLATED, UNSURE = 2.0, 1.4, 0.4
COMPARED = 0.8  # of the highest frequency: modes above may leave the range on another mesh, and are not compared
SMALLEST = 0.1  # of the sweep: errors of onsets at smaller values are relative to this
# Onsets on two meshes are paired by the least distance. A move by _FAR of the sweep, or of the frequency, counts one,
# as much as another pair of branches does; from _LOST on they are different onsets.
_FAR = 0.2
_LOST = 2.0
_VALUE = "value"
_CHILDREN = 8  # elements into which one is cut, and about as many times the unknowns
_COPIES = 4  # of the refined matrices: those of the terms, and their sums
_VECTORS = 24  # on the refined mesh for each mode, besides the coarse basis and a copy of it: those of the corrections
_BASIS = 10  # vectors for each mode that a coarse basis is taken to have where there is none yet


@dataclass(frozen=True)
class Changes:
    """What refining the mesh once changes.

    Attributes
    ----------
    modes : tuple of (k,) complex
        Of λ, rad/s, of every mode at every value; NaN where it is not found again.
    onsets : tuple of float
        Of the value of every onset; NaN where it is not found again.
    """

    modes: tuple[np.ndarray, ...]
    onsets: tuple[float, ...]


def with_discretisation(result: Sweep, linear_solver: LinearSolver | str = "auto") -> Sweep:
    """Return a sweep with the error of the mesh on all modes and onsets: `BAR` times what `refined_changes` gives.

    Parameters
    ----------
    linear_solver : LinearSolver or str
        As of `sweep`.

    Raises
    ------
    SceneError
        The problem has no mesh.
    NotConvergedError
        The corrections are not found.
    """
    changes = refined_changes(result, linear_solver)
    points = [
        replace(point, discretisation=BAR * (np.abs(c.real) + 1j * np.abs(c.imag)))
        for point, c in zip(result.points, changes.modes, strict=True)
    ]
    onsets = [
        replace(onset, discretisation=BAR * abs(c)) for onset, c in zip(result.onsets, changes.onsets, strict=True)
    ]
    unknown = sum(int(np.isnan(c).sum()) for c in (*changes.modes, np.array(changes.onsets)))
    doubts = result.doubts
    if unknown:
        doubts += (f"the error of the mesh is not known for {unknown} modes and onsets: refined, they are others",)
    return replace(result, points=tuple(points), onsets=tuple(onsets), doubts=doubts)


def refined_changes(result: Sweep, linear_solver: LinearSolver | str = "auto") -> Changes:
    """Return how the modes and onsets of a sweep change where every element is cut into eight.

    The modes are corrected on the refined mesh, see `CorrectedModel`, and followed over the same sweep. Where the
    parameter changes matrices (under preload) both meshes take matrices that are quadratic in it.

    Parameters
    ----------
    linear_solver : LinearSolver or str
        As of `sweep`.

    Raises
    ------
    SceneError
        The problem has no mesh.
    NotConvergedError
        The corrections are not found.
    TooLargeError
        The refined mesh does not fit into memory.
    """
    problem, parameter = result.problem.solved_with(linear_solver), result.parameter
    assembly = problem.source
    if not isinstance(assembly, Assembly):
        raise SceneError("the error of a mesh is asked for (--estimate), and the scene has matrices instead of a mesh")
    require_memory(_refined_memory(result), _CHILDREN * problem.unknowns, "modes on the refined mesh")
    values = np.array([p.value for p in result.points])
    refined = Assembly(assembly.scene, refine(assembly.loaded)).solved_with(linear_solver)
    E = prolongation(assembly.space, refined.space)
    fine = refined.problem(problem.changed).prepared(parameter, values)
    affine = [_affine(p, parameter, values) for p in (problem, fine)]
    axis, at = (parameter, values) if len(values) > 1 else (_VALUE, np.zeros(1))
    model = result.model
    if model is None or len(values) == 1 or not problem.is_affine(parameter):
        request = Request(count=max(len(p.modes) for p in result.points) + 2)
        model = ReducedModel(affine[0], axis, at, request, linear_solver=linear_solver)
    corrected = CorrectedModel(model, affine[1], E, at)
    changes, first = [], None
    for point, value in zip(result.points, at.tolist(), strict=True):
        before, refined_pencil = model.modes(value), corrected.small.pencil({axis: value})
        now = solve_dense(refined_pencil, 1.5 * model.highest, linear_solver)
        same = _same(corrected, before, now)
        first = same if first is None else first
        changes.append(_changes(point, before, now, same))
    onsets: list[float] = []
    if result.onsets:
        modes = len(model.modes(float(at[0])))
        found = sweep(
            corrected.small, at, axis, modes=modes, method="direct", linear_solver=linear_solver
        ).onsets
        paired = pair_onsets(result.onsets, found, first or {}, float(np.ptp(values)))
        onsets = [
            found[j].value - onset.value if j is not None else np.nan
            for onset, j in zip(result.onsets, paired, strict=True)
        ]
    return Changes(tuple(changes), tuple(onsets))


def _refined_memory(result: Sweep) -> int:
    """Return about how many bytes `refined_changes` takes besides those of the sweep."""
    pencil = result.problem.pencil()
    entries = sum(A.nnz for A in (pencil.M, pencil.C, pencil.K) if A is not None)
    modes = max((len(p.modes) for p in result.points), default=0)
    basis = _BASIS * modes if result.model is None else len(result.model.basis)
    vectors = 2 * basis + _VECTORS * modes
    return _CHILDREN * (_COPIES * 12 * entries + 8 * vectors * result.problem.unknowns)


def _affine(problem: Problem, parameter: str, values: np.ndarray) -> Problem:
    """Return the problem with a parameter that changes coefficients alone; at one value it changes nothing."""
    if len(values) > 1:
        return interpolate(problem, parameter, float(values[0]), float(values[-1]))
    here = problem.at({parameter: float(values[0])}) if problem.has(parameter) else problem
    return replace(here, parameters={**here.parameters, _VALUE: 0.0}, coupled=frozenset())


def _same(corrected: CorrectedModel, before: Modes, now: Modes) -> dict[int, int]:
    """Return which corrected mode belongs to each mode, by shape and eigenvalue together."""
    lifted = replace(before, right=corrected.coordinates(before.right), left=None)
    origin = match_modes(lifted, now, corrected.small.mass).origin
    return {int(i): j for j, i in enumerate(origin) if i >= 0}


def _changes(point: SweepPoint, before: Modes, now: Modes, same: dict[int, int]) -> np.ndarray:
    """Return the changes (k,) of the modes of a point, each of which is the nearest of `before`."""
    changes = np.full(len(point.modes), np.nan * (1 + 1j))
    rows, columns = linear_sum_assignment(np.abs(point.modes.lam[:, None] - before.lam[None, :]))
    for i, near in zip(rows.tolist(), columns.tolist(), strict=True):
        if near in same:
            changes[i] = now.lam[same[near]] - before.lam[near]
    return changes


def pair_onsets(
    onsets: Sequence[Onset], found: Sequence[Onset], same: Mapping[int, int], width: float
) -> list[int | None]:
    """Return for each onset which of others it is, or None: by kind, direction, branches, value and frequency.

    Parameters
    ----------
    same : mapping
        Which mode at the first value belongs to each mode; the branches are named after these.
    width : float
        Of the interval of the parameter.
    """

    def branches(onset: Onset) -> set[int]:
        return {b for b in (onset.branch_a, onset.branch_b) if b is not None}

    def unlike(a: Onset, b: Onset) -> float:
        if (a.kind, a.direction) != (b.kind, b.direction):
            return np.inf
        paired = {same[x - 1] + 1 for x in branches(a) if x - 1 in same}
        moved = abs(a.value - b.value) / width + abs(a.frequency_hz - b.frequency_hz) / max(a.frequency_hz, 1e-300)
        return moved / _FAR + (0.0 if paired == branches(b) else 1.0)

    result: list[int | None] = [None] * len(onsets)
    every = sorted((unlike(a, b), i, j) for i, a in enumerate(onsets) for j, b in enumerate(found))
    taken: set[int] = set()
    for cost, i, j in every:
        if cost < _LOST and result[i] is None and j not in taken:
            result[i] = j
            taken.add(j)
    return result
