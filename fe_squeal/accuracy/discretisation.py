"""Error bars: how far modes and onsets are from those of an infinitely fine mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..assembly.assembly import Assembly
from ..eigen.linear.factor import LinearSolver
from ..sweep.onset import Onset
from ..sweep.point import SweepPoint
from ..sweep.result import Sweep
from ..sweep.tracking import mirror_partners
from .bars import (
    NOTCHED,
    SHARE,
    Parts,
    bar_of,
    bar_of_parts,
    beyond,
    enveloped,
    factors_of,
    mirrored,
    scattered,
)
from .closing import with_closing_windows
from .edges import acting_on_points, has_end_in_a_notch
from .estimate import Changes, refined_changes
from .largest_error import hidden_growth
from .pairs import bent_change, extrapolated, growth_beyond, may_couple, may_diverge, near_zero
from .polygons import straight_edges

_ROUNDING = 1e-6  # of |λ|: growth below this is what rounding makes of two equal eigenvalues


def with_discretisation(result: Sweep, linear_solver: LinearSolver | str = "auto") -> Sweep:
    """Return a sweep with the error of the mesh on all modes and onsets, by the rules of `bars`.

    `discretisation` of each point (k,) complex holds the bars of Re λ and Im λ, rad/s, that of each onset the bar of
    its value; `extrapolated` holds the likely values for an infinitely fine mesh, and `extrapolated_discretisation`
    the bars of these. An onset that only one of the mesh and the refined mesh has is listed with an infinite error, and
    one that matrices interpolated between the values lack with NaN: its error is not known.

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
    unknown = tuple(Parts.unknown(len(point.modes)) for point in result.points)
    found = [
        _bars(
            point, change, parts, spectrum, order, result.problem.is_damped,
            (may_couple(result.problem, result.parameter, point.value),
             may_diverge(result.problem, result.parameter, point.value)),
        )
        for point, change, parts, spectrum in zip(
            result.points, changes.modes, changes.parts or unknown, changes.spectra, strict=True
        )
    ]
    if changes.interpolated is not None:
        found = [f.wider(x) for f, x in zip(found, changes.interpolated.modes, strict=True)]
    source = result.problem.source
    is_notched = order > 1 and isinstance(source, Assembly) and has_end_in_a_notch(source)
    if is_notched:
        found = [f.longer(NOTCHED) for f in found]
    branches, parted = [point.branches for point in result.points], [f.parted for f in found]
    wide = enveloped([f.bars for f in found], branches, parted)
    narrow = enveloped([f.bars_beyond for f in found], branches, parted)
    onsets = _onsets(result.onsets, changes, order, NOTCHED if is_notched else 1.0)
    likely = [replace(o, value=o.extrapolated, discretisation=o.extrapolated_discretisation) for o in onsets]
    points = [
        replace(
            point, discretisation=near_onsets(point, bar, onsets), extrapolated=own.extrapolated,
            extrapolated_discretisation=near_onsets(point, other, likely),
        )
        for point, own, bar, other in zip(result.points, found, wide, narrow, strict=True)
    ]  # fmt: skip
    warnings, name = list(result.warnings), result.parameter
    lost = sum(int(np.isnan(c).sum()) for c in changes.modes)
    if lost:
        warnings.append(f"the error of the mesh is not known for {lost} modes: refined, they are others")
    warnings += _entering(result, changes)
    for onset in onsets:
        if np.isinf(onset.discretisation):
            warnings.append(f"the onset at {_told(onset, name)}, vanishes on the refined mesh")
        elif np.isnan(onset.discretisation):
            warnings.append(
                f"the error of the mesh is not known for the onset at {_told(onset, name)}: matrices interpolated"
                " between the values have no such onset; more values of the sweep would have it"
            )
    warnings += [f"an onset at {_told(onset, name)}, appears on the refined mesh alone" for onset in changes.appeared]
    warnings += _hidden(points, onsets, name)
    if isinstance(result.problem.source, Assembly):
        warnings += [
            f"{path} acts on nodes that cover no face: what its forces displace there has no limit as elements become"
            " smaller, and the error of the mesh none either"
            for path in acting_on_points(result.problem.source)
        ]
        warnings += straight_edges(result.problem.source)
    listed = sorted([*onsets, *changes.appeared], key=lambda o: o.value)
    return replace(result, points=tuple(points), onsets=tuple(listed), warnings=tuple(warnings))


def _entering(result: Sweep, changes: Changes) -> list[str]:
    """Return a sentence if modes above `max_frequency` are below it on the refined mesh."""
    limit = result.max_frequency
    if limit is None:
        return []
    down: list[float] = []
    for _, refined, asked in changes.spectra:
        others = np.delete(refined, asked).imag / (2 * np.pi)
        if len(below := others[(others > 0) & (others < limit)]) > len(down):
            down = below.tolist()
    if not down:
        return []
    return [
        f"modes that are above solve.max_frequency here are below it on the refined mesh, {len(down)} down to"
        f" {min(down):.4g} Hz: they are missing in these results; ask for a higher one"
    ]


@dataclass(frozen=True)
class _Bars:
    """Of the k modes at one value: their bars, rad/s, their likely values, and the bars of these.

    Bars of Re λ are the real parts, those of Im λ the imaginary ones. `parted` (k,) bool tells of which modes the parts
    of the change are known.
    """

    bars: np.ndarray
    extrapolated: np.ndarray
    bars_beyond: np.ndarray
    parted: np.ndarray

    def wider(self, more: np.ndarray) -> _Bars:
        """Return the same with all bars wider by `more` (k,)."""
        return replace(self, bars=self.bars + more, bars_beyond=self.bars_beyond + more)

    def longer(self, factor: float) -> _Bars:
        """Return the same with bars that many times as long; those of the likely values reach as far."""
        return replace(self, bars=factor * self.bars, bars_beyond=self.bars_beyond + (factor - 1) * self.bars)


def _bars(
    point: SweepPoint, change: np.ndarray, parts: Parts, spectrum: tuple[np.ndarray, np.ndarray, np.ndarray],
    order: int, is_damped: bool, may: tuple[bool, bool],
) -> _Bars:  # fmt: skip
    """Return the bars of a point's modes by the rules of `bars`; parameters are those of `Changes`.

    `may` tells whether modes may couple, and whether one may diverge. Where two modes cannot couple, each is
    extrapolated by itself, however near to another it is, and none grows but one that diverges.
    """
    (lam, refined, modes), partner = spectrum, mirror_partners(point.modes)
    opposite = parts.times(np.full(len(partner), -1.0)).at(partner)  # of a mode that decays as its mirror image grows
    parts = parts.where(parts.known | (partner < 0), opposite)
    uncertain = point.modes.re_uncertainty
    still = (np.abs(point.modes.lam.real) <= uncertain) & (not is_damped)
    here, paired = lam[modes].real, parts.known & (not is_damped)
    growth, likely, width = growth_beyond(here, here + change.real, parts, order, paired)
    factors = factors_of(change.real, parts, order)
    least, middle, most = factors_of(np.zeros(len(lam)), Parts.unknown(len(lam)), order)
    least[modes], middle[modes], most[modes] = factors
    further = extrapolated(lam, refined, middle, *may)
    bent = [
        bent_change(lam, refined, order, most, first, about, *may)[modes]
        for first, about in ((None, None), (least, further))
    ]
    moved = (further - lam)[modes]
    # Two modes that approach each other have Re λ = 0 on both meshes, and not where their extrapolated values meet; nor
    # has a mode whose frequency falls to zero, which may lie within the bar alone.
    reach = np.where(near_zero(lam, refined, *may)[modes], bent[0].real, np.abs(np.nan_to_num(moved).real))
    meets = reach > np.maximum(uncertain, _ROUNDING * np.abs(point.modes.lam))
    balanced = still & (np.abs(np.nan_to_num(change).real) <= uncertain) & ~meets
    bars = bar_of(change, bent[0], balanced, order, growth)

    moved = np.where(parts.known, likely - here, moved.real) + 1j * moved.imag
    half = np.maximum(factors[2] - factors[1], factors[1] - factors[0])
    re, im = (half * np.maximum(np.abs(x), SHARE * np.abs(change)) for x in (change.real, change.imag))
    re = np.where(balanced, 0.0, np.where(parts.known, width, np.maximum(re, bent[1].real)))
    values = point.modes.lam + moved
    values = np.where(balanced, 1j * values.imag, values)
    values.imag = np.where(point.modes.lam.imag > 0, np.maximum(values.imag, 0.0), values.imag)  # frequencies
    # A mode that swings no more has no frequency: what is left of one is the difference of λ in two bases.
    values.imag[further[modes].imag == 0] = 0.0
    beyond_bars = re + 1j * np.maximum(im, bent[1].imag)
    return _Bars(mirrored(bars, partner), values, mirrored(beyond_bars, partner), parts.known)


def _onsets(onsets: Sequence[Onset], changes: Changes, order: int, longer: float) -> list[Onset]:
    """Return onsets with their bars, their likely values, and the bars of these.

    They are infinite where the refined mesh lacks the onset, and NaN where the mesh itself, with interpolated matrices,
    lacks it already. Bars are `longer` times as long as the rules of `bars` have them.
    """
    change = np.array(changes.onsets)
    parts = changes.onset_parts or Parts.unknown(len(change))
    bars, (shift, width) = bar_of_parts(change, parts, order), beyond(change, parts, order)
    width = width + scattered(shift, parts, order)
    bars, width = longer * bars, width + (longer - 1) * bars
    bars = with_closing_windows(onsets, change, bars)
    if changes.interpolated is not None:
        bars, width = bars + changes.interpolated.onsets, width + changes.interpolated.onsets
    own = onsets if changes.interpolated is None else changes.interpolated.found  # on the mesh itself
    lost = [np.nan if there is None else np.inf for there in own]
    return [
        replace(
            onset, discretisation=none if np.isnan(bar) else bar, extrapolated=onset.value + s,
            extrapolated_discretisation=none if np.isnan(w) else w,
        )
        for onset, none, bar, s, w in zip(onsets, lost, bars.tolist(), shift.tolist(), width.tolist(), strict=True)
    ]  # fmt: skip


def _hidden(points: Sequence[SweepPoint], onsets: Sequence[Onset], name: str) -> list[str]:
    """Return a sentence for each branch that grows by extrapolated values alone, where no onset's bar says so."""
    fastest: dict[int, tuple[float, ...]] = {}  # growth, its bar, value of the parameter and frequency, by branch
    for point in points:
        growth = hidden_growth(point)
        near = [o for o in onsets if not abs(o.value - point.value) > o.discretisation]  # or its bar is not known
        told = {b for o in near for b in (o.branch_a, o.branch_b)}
        for i in np.flatnonzero(growth).tolist():
            bar = np.nan if point.extrapolated_discretisation is None else point.extrapolated_discretisation[i].real
            branch = int(point.branches[i])
            own = float(growth[i]), float(bar), point.value, float(point.modes.frequency_hz[i])
            if branch not in told:
                fastest[branch] = max(fastest.get(branch, own), own)
    return [
        f"at {name} = {value:.6g} a mode of {hz:.5g} Hz does not grow on this mesh, and grows by {growth:.3g} ±"
        f" {bar:.2g} 1/s by its extrapolated value: there may be an onset on finer meshes"
        # The fastest at the end, where similar ones are told once.
        for growth, bar, value, hz in sorted(fastest.values())
    ]


def _told(onset: Onset, name: str) -> str:
    """Return which onset it is, in words; `name` is that of the parameter."""
    return f"{name} = {onset.value:.6g}, {onset.frequency_hz:.5g} Hz, {onset.direction} instability"


def near_onsets(point: SweepPoint, bar: np.ndarray, onsets: Sequence[Onset]) -> np.ndarray:
    """Return the bars (k,) complex, rad/s, widened where an onset may lie on the other side of the point.

    If the distance d of the point from the onset is less than the error e of the onset, its modes may be stable or
    unstable. Their growth rate is then uncertain by c √(d + e) or c (d + e), by the law of the onset and with its
    crossing speed c.

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
        error, apart = onset.discretisation, abs(point.value - onset.value)
        reach = onset.growth_within(apart + error)
        if not (np.isfinite(reach) and apart <= error):
            continue
        own = np.isin(point.branches, [b for b in (onset.branch_a, onset.branch_b) if b])
        wide.real = np.where(own, np.maximum(wide.real, reach), wide.real)
    return wide
