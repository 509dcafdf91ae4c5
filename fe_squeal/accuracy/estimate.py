"""What refining the mesh once changes in the modes and the onsets of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..eigen.dense import solve_dense
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Modes
from ..eigen.threads import one_openblas_thread
from ..sweep.onset import Onset
from ..sweep.point import SweepPoint
from ..sweep.result import Sweep
from ..sweep.sweep import sweep
from ..sweep.tracking import match_modes
from .bars import Parts
from .corrected import CorrectedModel
from .corrections import Correction, right_corrections
from .onset_pairs import Likeness, branches_of, pair_onsets
from .refined import Refined, refine_problem
from .spread import growth_asked, parts_of

COMPARED = 0.8  # of the highest frequency: modes above may leave the range on another mesh, and are not compared


@dataclass(frozen=True)
class Interpolated:
    """How far λ and onsets of interpolated matrices are from those of the sweep, on its own mesh.

    A change is found between interpolated matrices of both meshes. How much of it they make is not known: bars are
    wider by as much as they move λ and onsets of the one mesh of which that is known.

    Attributes
    ----------
    modes : tuple of (k,) complex, rad/s
        For every value of the sweep, of Re λ and of Im λ, both positive.
    onsets : (m,) float
        Of every onset of the sweep; NaN where the interpolated matrices have none.
    found : tuple of Onset or None
        Their own onset of each one.
    """

    modes: tuple[np.ndarray, ...]
    onsets: np.ndarray
    found: tuple[Onset | None, ...]


@dataclass(frozen=True)
class Changes:
    """What refining the mesh once changes.

    Attributes
    ----------
    modes : tuple of (k,) complex, rad/s
        For every value of the sweep the change of λ of each mode; NaN where the mode is not found again.
    onsets : tuple of float
        For every onset the change of its value; NaN where the onset is not found again.
    spectra : tuple of (lam (m,), refined (m,), modes (k,) int)
        For every value of the sweep the eigenvalues, rad/s, of all modes of the model of the mesh, the same modes on
        the refined mesh, and the positions in these of the k modes of the sweep. `bent_change` needs them all.
    parts : tuple of Parts
        For every value of the sweep those of Re Δλ, 1/s, see `spread`, of modes that grow; not known of others.
    onset_parts : Parts or None
        Those of every onset; None where they are not known of any.
    appeared : tuple of Onset
        Onsets in the interval that only the refined mesh has. Their branch is 0: no branch of the sweep has them.
    interpolated : Interpolated or None
        None where matrices are not interpolated.
    """

    modes: tuple[np.ndarray, ...]
    onsets: tuple[float, ...]
    spectra: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...] = ()
    appeared: tuple[Onset, ...] = ()
    parts: tuple[Parts, ...] = ()
    onset_parts: Parts | None = None
    interpolated: Interpolated | None = None


def refined_changes(result: Sweep, linear_solver: LinearSolver | str = "auto") -> Changes:
    """Return how the modes and onsets of a sweep change if every element is cut into eight.

    The modes are corrected on the refined mesh, see `CorrectedModel`, and followed over the same sweep. Where the
    parameter changes the matrices themselves, not only their coefficients (μ under preload), the matrices of both
    meshes are interpolated quadratically in it.

    Parameters and errors raised are those of `discretisation.with_discretisation`.
    """
    return changes_by(result, refine_problem(result, linear_solver), linear_solver)


@one_openblas_thread()
def changes_by(
    result: Sweep, refined: Refined, linear_solver: LinearSolver | str = "auto",
    corrections: Mapping[float, Correction] | None = None,
) -> Changes:  # fmt: skip
    """Return the changes of `refined_changes` where the problem on the refined mesh is assembled already.

    So may be the corrections of right modes, see `right_corrections`.
    """
    parameter, values, model = result.parameter, refined.values, refined.model
    corrected = CorrectedModel(refined, right_corrections(result, refined) if corrections is None else corrections)
    first: dict[int, int] | None = None
    pairs, growing = [], []
    for point, value in zip(result.points, values.tolist(), strict=True):
        before, refined_pencil = model.modes(value), corrected.projected.pencil({refined.parameter: value})
        now = solve_dense(refined_pencil, 1.5 * refined.reach, linear_solver)
        same = _same(corrected, before, now)
        first = same if first is None else first
        pairs.append(_changes(point, before, now, same))
        growing.append(growth_asked(refined, point, value, before, pairs[-1][1][2]))
    onsets: list[float] = []
    appeared: list[Onset] = []
    interpolated = None
    if len(values) > 1:
        modes = len(model.modes(float(values[0])))
        found = sweep(
            corrected.projected, values, refined.parameter, modes=modes, method="direct", linear_solver=linear_solver
        ).onsets
        paired = pair_onsets(
            result.onsets, found, first or {}, values, Likeness(refined, corrected, result.onsets, found).alike
        )
        interpolated = _interpolated(result, refined, [b for _, b in pairs], linear_solver)
        own = result.onsets if interpolated is None else interpolated.found
        onsets = [
            found[j].value - onset.value if j is not None and onset is not None else np.nan
            for onset, j in zip(own, paired, strict=True)
        ]
        # Modes near the highest frequency may be in the range of one mesh alone, and so may their onsets: these are not
        # reported unless they are those of modes that the sweep has.
        top = min(float(p.modes.frequency_hz.max(initial=0.0)) for p in result.points)
        known = {same_first + 1 for i, same_first in (first or {}).items() if i in pairs[0][1][2]}
        appeared = [
            replace(o, parameter=parameter, branch_a=0, branch_b=None, two_mode_value=np.nan, discretisation=np.inf)
            for j, o in enumerate(found)
            if j not in paired
            and (o.frequency_hz < COMPARED * top or (o.frequency_hz < top and branches_of(o) <= known))
        ]  # fmt: skip
    by_point, by_onset = parts_of(result, refined, corrected, growing)
    return Changes(
        tuple(c for c, _ in pairs), tuple(onsets), tuple(b for _, b in pairs), tuple(appeared), by_point, by_onset,
        interpolated,
    )  # fmt: skip


def _interpolated(
    result: Sweep, refined: Refined, spectra: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
    linear_solver: LinearSolver | str,
) -> Interpolated | None:  # fmt: skip
    """Return how far interpolated matrices are off on the mesh itself; None where they are not interpolated."""
    if result.problem.is_affine(result.parameter):
        return None
    values, model = refined.values, refined.model
    off = [point.modes.lam - lam[near] for point, (lam, _, near) in zip(result.points, spectra, strict=True)]
    modes, problem = len(model.modes(float(values[0]))), model.basis.collected()
    found = sweep(problem, values, refined.parameter, modes=modes, method="direct", linear_solver=linear_solver).onsets
    one = {i: i for i in range(modes)}
    paired = pair_onsets(result.onsets, found, one, values)
    own = tuple(None if j is None else found[j] for j in paired)
    away = [
        np.nan if there is None else abs(there.value - onset.value)
        for onset, there in zip(result.onsets, own, strict=True)
    ]
    return Interpolated(tuple(np.abs(x.real) + 1j * np.abs(x.imag) for x in off), np.array(away), own)


def _same(corrected: CorrectedModel, before: Modes, now: Modes) -> dict[int, int]:
    """Return the position of the corrected mode by that of the mode it belongs to, by shape and eigenvalue."""
    lifted = replace(before, right=corrected.coordinates(before.right), left=None)
    origin = match_modes(lifted, now, corrected.projected.mass).origin
    return {int(i): j for j, i in enumerate(origin) if i >= 0}


def _changes(
    point: SweepPoint, before: Modes, now: Modes, same: dict[int, int]
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return the changes (k,) complex of the modes of a point, and the entry of `Changes.spectra`.

    Each mode of the point is identified with one of `before`, the modes of the reduced model, by its eigenvalue.
    """
    refined = np.full(len(before), np.nan * (1 + 1j))
    for i, j in same.items():
        refined[i] = now.lam[j]
    rows, columns = linear_sum_assignment(np.abs(point.modes.lam[:, None] - before.lam[None, :]))
    changes, near = np.full(len(point.modes), np.nan * (1 + 1j)), np.zeros(len(point.modes), dtype=int)
    changes[rows], near[rows] = (refined - before.lam)[columns], columns
    return changes, (before.lam, refined, near)
