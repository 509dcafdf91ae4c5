"""Error bars: how far modes and onsets are from those of an infinitely fine mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..assembly.assembly import Assembly
from ..eigen.dense import solve_dense
from ..eigen.linear.factor import LinearSolver
from ..eigen.pencil import Modes
from ..sweep.onsets import Onset
from ..sweep.point import SweepPoint
from ..sweep.result import Sweep
from ..sweep.sweep import sweep
from ..sweep.tracking import match_modes, mirror_partners
from .bars import bar_of, bar_of_parts, bent_change, enveloped, extrapolated, mirrored
from .corrected import CorrectedModel
from .refined import Refined, refine_problem
from .spread import growth_asked, spreads_of

# Times the change by refining the mesh once. The error is between 1 and 2 times this change, see `bars`. EXTRAPOLATED
# is about the middle of this range, and UNSURE how far from it the error may be.
EXTRAPOLATED, UNSURE = 1.4, 0.4
COMPARED = 0.8  # of the highest frequency: modes above may leave the range on another mesh, and are not compared
# An onset on one mesh and one on the other are paired where the sum of these costs is least: the move of the value over
# _FAR times the interval, the move of the frequency over _FAR times the frequency, and 1 if the branches are others.
# From a cost of _LOST on they are taken for different onsets.
_FAR = 0.2
_LOST = 2.0


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
    spreads : tuple of (k,) float
        Sums of the sizes of the parts of Re Δλ, 1/s, see `spread`, of modes that grow; NaN of others.
    onset_spreads : tuple of float
        The same of every onset.
    appeared : tuple of Onset
        Onsets in the interval that only the refined mesh has. Their branch is 0: no branch of the sweep has them.
    """

    modes: tuple[np.ndarray, ...]
    onsets: tuple[float, ...]
    spectra: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...] = ()
    appeared: tuple[Onset, ...] = ()
    spreads: tuple[np.ndarray, ...] = ()
    onset_spreads: tuple[float, ...] = ()


def with_discretisation(result: Sweep, linear_solver: LinearSolver | str = "auto") -> Sweep:
    """Return a sweep with the error of the mesh on all modes and onsets, by the rules of `bars`.

    `discretisation` of each point (k,) complex holds the bars of Re λ and Im λ, rad/s, that of each onset the bar of
    its value; `extrapolated` holds the likely values for an infinitely fine mesh. An onset that only one of the mesh
    and the refined mesh has is listed with an infinite error.

    Parameters
    ----------
    result : Sweep
        Sweep of a problem that was assembled from a mesh.
    linear_solver : LinearSolver or str
        As for `sweep`.

    Raises
    ------
    SceneError
        The problem has no mesh.
    TooLargeError
        The refined mesh does not fit into memory.
    NotConvergedError
        The modes on the refined mesh are not found, or the mixed formulation has functions that it does not have.
    """
    return with_changes(result, refined_changes(result, linear_solver))


def with_changes(result: Sweep, changes: Changes) -> Sweep:
    """Return a sweep with the error of the mesh, see `with_discretisation`, from changes that are known already."""
    order = result.problem.source.space.order if isinstance(result.problem.source, Assembly) else 2
    bars, known = [], []
    unknown_spreads = tuple(np.full(len(point.modes), np.nan) for point in result.points)
    for point, change, spread, (lam, refined, modes) in zip(
        result.points, changes.modes, changes.spreads or unknown_spreads, changes.spectra, strict=True
    ):
        bent = bent_change(lam, refined, order)[modes]
        still = np.abs(point.modes.lam.real) <= point.modes.re_uncertainty
        moved = np.abs(np.nan_to_num(change).real) > point.modes.re_uncertainty
        partner = mirror_partners(point.modes)
        spread = np.where(np.isnan(spread) & (partner >= 0), spread[partner], spread)
        bar = bar_of(change, bent, still & ~moved & (not result.problem.is_damped), order, spread)
        bars.append(mirrored(bar, partner))
        known.append(np.isfinite(spread))
    bars = enveloped(bars, [point.branches for point in result.points], known)
    moved_by = bar_of_parts(np.array(changes.onsets), np.array(changes.onset_spreads), order).tolist()
    onsets = [
        replace(
            onset, discretisation=np.inf if np.isnan(bar) else bar, extrapolated=onset.value + EXTRAPOLATED * change
        )
        for onset, bar, change in zip(result.onsets, moved_by, changes.onsets, strict=True)
    ]
    points = [
        replace(
            point, discretisation=near_onsets(point, bar, onsets),
            extrapolated=_extrapolated(point, lam, refined, modes, result.problem.is_damped),
        )
        for point, bar, (lam, refined, modes) in zip(result.points, bars, changes.spectra, strict=True)
    ]  # fmt: skip
    warnings, name = list(result.warnings), result.parameter
    unknown = sum(int(np.isnan(c).sum()) for c in changes.modes)
    if unknown:
        warnings.append(f"the error of the mesh is not known for {unknown} modes: refined, they are others")
    for onset in onsets:
        if np.isinf(onset.discretisation):
            warnings.append(f"the onset at {_told(onset, name)}, vanishes on the refined mesh")
    warnings += [f"an onset at {_told(onset, name)}, appears on the refined mesh alone" for onset in changes.appeared]
    listed = sorted([*onsets, *changes.appeared], key=lambda o: o.value)
    return replace(result, points=tuple(points), onsets=tuple(listed), warnings=tuple(warnings))


def _extrapolated(
    point: SweepPoint, lam: np.ndarray, refined: np.ndarray, modes: np.ndarray, is_damped: bool
) -> np.ndarray:
    """Return the λ (k,) complex, rad/s, that the modes of a point are likely to have on an infinitely fine mesh.

    Re λ is zero there if the problem is undamped and Re λ is zero on both meshes up to rounding.
    """
    found = point.modes.lam + (extrapolated(lam, refined, EXTRAPOLATED) - lam)[modes]
    uncertain = point.modes.re_uncertainty
    still = (np.abs(point.modes.lam.real) <= uncertain) & (np.abs((refined - lam)[modes].real) <= uncertain)
    return np.where(still & (not is_damped), 1j * found.imag, found)


def _told(onset: Onset, name: str) -> str:
    """Return which onset it is, in words; `name` is that of the parameter."""
    return f"{name} = {onset.value:.6g}, {onset.frequency_hz:.5g} Hz, {onset.direction} instability"


def near_onsets(point: SweepPoint, bar: np.ndarray, onsets: Sequence[Onset]) -> np.ndarray:
    """Return the bars (k,) complex, rad/s, widened where an onset may lie on the other side of the point.

    If the distance d of the point from the onset is less than the error e of the onset, its modes may be stable or
    unstable. Their growth rate is then uncertain by c √(d + e) where two modes meet, and by c (d + e) where one mode
    crosses alone; c is the crossing speed of the onset.

    Parameters
    ----------
    point : SweepPoint
    bar : (k,) complex, rad/s
        The bars of its modes, of Re λ and of Im λ.
    onsets : sequence of Onset
        With the error of the mesh.
    """
    wide = bar.copy()
    for onset in onsets:
        error, speed = onset.discretisation, abs(onset.crossing_speed)
        apart = abs(point.value - onset.value)
        if not (np.isfinite(error) and np.isfinite(speed) and apart <= error):
            continue
        reach = speed * (np.sqrt(apart + error) if onset.branch_b is not None else apart + error)
        own = np.isin(point.branches, [b for b in (onset.branch_a, onset.branch_b) if b])
        wide.real = np.where(own, np.maximum(wide.real, reach), wide.real)
    return wide


def refined_changes(result: Sweep, linear_solver: LinearSolver | str = "auto") -> Changes:
    """Return how the modes and onsets of a sweep change if every element is cut into eight.

    The modes are corrected on the refined mesh, see `CorrectedModel`, and followed over the same sweep. Where the
    parameter changes the matrices themselves, not only their coefficients (μ under preload), the matrices of both
    meshes are interpolated quadratically in it.

    Parameters and errors raised are those of `with_discretisation`.
    """
    return changes_by(result, refine_problem(result, linear_solver), linear_solver)


def changes_by(result: Sweep, refined: Refined, linear_solver: LinearSolver | str = "auto") -> Changes:
    """Return the changes of `refined_changes` where the problem on the refined mesh is assembled already."""
    parameter, values, model = result.parameter, refined.values, refined.model
    corrected = CorrectedModel(refined)
    first: dict[int, int] | None = None
    pairs, growing = [], []
    for point, value in zip(result.points, values.tolist(), strict=True):
        before, refined_pencil = model.modes(value), corrected.projected.pencil({refined.parameter: value})
        now = solve_dense(refined_pencil, 1.5 * model.highest, linear_solver)
        same = _same(corrected, before, now)
        first = same if first is None else first
        pairs.append(_changes(point, before, now, same))
        growing.append(growth_asked(refined, point, value, before, pairs[-1][1][2]))
    onsets: list[float] = []
    appeared: list[Onset] = []
    if len(values) > 1:
        modes = len(model.modes(float(values[0])))
        found = sweep(
            corrected.projected, values, refined.parameter, modes=modes, method="direct", linear_solver=linear_solver
        ).onsets
        paired = pair_onsets(result.onsets, found, first or {}, float(np.ptp(values)))
        onsets = [
            found[j].value - onset.value if j is not None else np.nan
            for onset, j in zip(result.onsets, paired, strict=True)
        ]
        # Modes near the highest frequency may be in the range of one mesh alone, and so may their onsets: not reported.
        top = min(float(p.modes.frequency_hz.max(initial=0.0)) for p in result.points)
        appeared = [
            replace(o, parameter=parameter, branch_a=0, branch_b=None, two_mode_value=np.nan, discretisation=np.inf)
            for j, o in enumerate(found) if j not in paired and o.frequency_hz < COMPARED * top
        ]  # fmt: skip
    by_point, by_onset = spreads_of(result, refined, corrected, growing)
    return Changes(
        tuple(c for c, _ in pairs), tuple(onsets), tuple(b for _, b in pairs), tuple(appeared), by_point, by_onset
    )


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


def pair_onsets(
    onsets: Sequence[Onset], found: Sequence[Onset], same: Mapping[int, int], width: float
) -> list[int | None]:
    """Return for each onset the position in `found` of the same onset, or None: by kind, branches, value and frequency.

    Parameters
    ----------
    onsets, found : sequence of Onset
        Onsets on two meshes.
    same : mapping of int to int
        The position of each mode at the first value of the sweep among those on the other mesh. Branches are numbered
        by the modes at the first value, from 1 on.
    width : float
        Width of the interval of the parameter.
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
