"""The largest relative error of a sweep, by its error bars, as a target for it is compared with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..sweep.onset import Onset
from ..sweep.point import SweepPoint
from ..sweep.result import Sweep
from .bars import onset_scale
from .estimate import COMPARED
from .quantities import KINDS, SLOW

_ROUNDING = 1e-6  # of |λ|: growth below this is what rounding makes of two equal eigenvalues
_ONE_MODE = 1e-2  # of a frequency: onsets of one branch whose frequencies differ by less belong to one window


def estimated_error(result: Sweep, kinds: Sequence[str] = KINDS) -> float:
    """Return the largest relative error of a sweep according to its error bars; NaN where a bar is not known.

    - "frequencies": the bar over |λ|, for all modes at all values. Of a mode that is lightly damped |λ| is the
      frequency. Near critical damping the frequency falls to zero, and any change of λ is large beside it.
    - "growth": for each branch at the value where it grows fastest, the bar over the largest growth rate of all
      branches, those that diverge without oscillating included. At other values growth may be small, and its error
      there is the error of the onset. A mode that does not grow on the mesh, but does by its extrapolated value, grows
      as fast as that says.
    - "onsets": the bar of a critical value over this value, or over a tenth of the sweep's interval if that is larger.

    Modes and onsets above 0.8 of the highest frequency whose bar is not known are left out: on the refined mesh they
    may lie above the range that is solved for. So are both ends of a window of instability that one of the meshes alone
    has, if nothing grows in it faster than 0.02 of the largest growth rate: where two modes just miss each other, any
    change of the mesh makes such a window or closes it.

    Parameters
    ----------
    result : Sweep
        With the error of the mesh, see `with_discretisation`.
    kinds : sequence of "frequencies", "growth", "onsets"
        Which of these count.
    """
    highest = max(float(p.modes.lam.imag.max(initial=0.0)) for p in result.points)
    found: list[float] = []

    def add(kind: str, error: np.ndarray, frequency: np.ndarray) -> None:
        """Take relative errors, but for the unknown ones near the highest frequency."""
        if kind in kinds:
            found.extend(error[np.isfinite(error) | (frequency <= COMPARED * highest)].tolist())

    peaks: dict[int, tuple[float, float, float]] = {}  # growth, its bar and the frequency, by branch
    for point in result.points:
        assert point.discretisation is not None
        lam, bar = point.modes.lam, point.discretisation
        swinging = lam.imag > 0
        add("frequencies", (bar.imag / np.where(swinging, np.abs(lam), 1.0))[swinging], lam.imag[swinging])
        growth = np.where(point.modes.stability == "unstable", lam.real, hidden_growth(point))
        for i in np.flatnonzero(growth > 0).tolist():
            branch, own = int(point.branches[i]), (float(growth[i]), float(bar[i].real), float(lam[i].imag))
            peaks[branch] = max(peaks.get(branch, own), own)
    if peaks:
        growth, bars, frequencies = np.array(list(peaks.values())).T
        asked = np.isfinite(bars) | (growth >= SLOW * growth.max())
        add("growth", (bars / growth.max())[asked], frequencies[asked])
    values = np.array([p.value for p in result.points])
    slow = slow_windows(result, SLOW * max((own[0] for own in peaks.values()), default=0.0))
    for o in result.onsets:
        if o in slow:
            continue
        relative = np.array([o.discretisation / onset_scale(o.value, values)])
        add("onsets", relative, np.array([2 * np.pi * o.frequency_hz]))
        if not np.isfinite(o.discretisation):  # there is growth beside it on one of the meshes, maybe not on the other
            add("growth", relative, np.array([2 * np.pi * o.frequency_hz]))
    return float(np.max(found)) if found else 0.0


def hidden_growth(point: SweepPoint) -> np.ndarray:
    """Return Re λ (k,), 1/s, of modes that grow by their extrapolated values and not on the mesh; 0 of all others."""
    lam, further = point.modes.lam, point.extrapolated
    if further is None:
        return np.zeros(len(lam))
    grows = np.nan_to_num(further).real > np.maximum(point.modes.re_uncertainty, _ROUNDING * np.abs(lam))
    return np.where(grows & (point.modes.stability != "unstable"), np.nan_to_num(further).real, 0.0)


def slow_windows(result: Sweep, limit: float) -> list[Onset]:
    """Return the onsets at both ends of windows that one mesh alone has, in which nothing grows faster than a limit.

    Windows that interpolated matrices lack are taken for such: no change is known that the other mesh makes.

    Two modes that meet at a and b grow by κ√((p − a)(b − p)) between, at most by κ(b − a)/2 = c√(b − a)/2, with the
    crossing speed c at the ends. Where one crosses alone the growth between is taken to be concave, so that it lies
    below its tangents at both ends: at most c(b − a)/2. A window whose speeds are not known counts.
    """
    alone = sorted((o for o in result.onsets if not np.isfinite(o.discretisation)), key=lambda o: o.value)
    found: list[Onset] = []
    for into in (o for o in alone if o.direction == "into"):
        same = [o for o in alone if o.value > into.value and o.branch_a == into.branch_a and _near(o, into)]
        if not same or same[0].direction != "out of":
            continue
        length = same[0].value - into.value
        if np.max([o.growth_within(length) for o in (into, same[0])]) / 2 < limit:  # NaN is not
            found += [into, same[0]]
    return found


def _near(one: Onset, other: Onset) -> bool:
    return abs(one.frequency_hz - other.frequency_hz) <= _ONE_MODE * one.frequency_hz
