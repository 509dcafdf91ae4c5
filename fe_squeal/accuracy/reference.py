"""Errors of one result against a reference from a finer mesh: modes are paired by shape, not by number."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..sweep.onset import Onset
from .bars import onset_scale
from .estimate import COMPARED
from .measure import Measurement
from .onset_pairs import branches_of, pair_onsets

# The cost of taking two modes for the same is (1 − MAC) + x/(1 + x), x = |λ₁ − λ₂| / (_FREQUENCY |λ₁|). Both summands
# are between 0 and 1; from a cost of _NO_MATCH on they are different modes.
_FREQUENCY = 0.1
_NO_MATCH = 1.5
# An onset that is not found as one of the reference's may be one of those that are not known, or the other end of a
# window of such a one, if value and frequency differ by less than this part of the interval and of the frequency.
_BESIDE = 0.2
_ROUNDING = 1e-9  # of the highest frequency that counts: growth that is slower may be rounding


@dataclass(frozen=True)
class Reference:
    """What results are compared with.

    Attributes
    ----------
    shapes, last_shapes : (3 p, k) complex
        Displacements of the modes at the p probes, at the first and at the last value.
    lam, last : (k,) complex, rad/s
        Eigenvalues of these modes, at the first and at the last value.
    onsets : (o, 6) float
        The onsets, as in `Measurement`.
    width : float
        Length of the interval that the parameter is swept over.
    uncertainty : Errors
        The errors of the reference itself; NaN where they are not known.
    known, last_known, onsets_known : (k,), (k,) and (o,) bool
        Which of `lam`, `last` and `onsets` are known. The others are those of a mesh, and are not found again when it
        is refined, or onsets of the refined mesh alone: by them others are paired, but not judged.
    """

    shapes: np.ndarray
    last_shapes: np.ndarray
    lam: np.ndarray
    last: np.ndarray
    onsets: np.ndarray
    width: float
    uncertainty: Errors
    known: np.ndarray
    last_known: np.ndarray
    onsets_known: np.ndarray

    @property
    def limit(self) -> float:
        """Up to which |λ|, rad/s, modes and onsets count."""
        return COMPARED * float(self.lam.imag.max(initial=0.0))

    @property
    def counted(self) -> np.ndarray:
        """Which modes count for the error of the frequencies, (k,) bool."""
        return np.asarray((self.lam.imag > 0) & (self.lam.imag <= self.limit))

    @property
    def growing(self) -> np.ndarray:
        """Which modes of the last value count for the error of the growth rates, (k,) bool."""
        return grows(self.last, self.limit)

    @property
    def counted_onsets(self) -> np.ndarray:
        """Which onsets count for the error of the critical values, (o,) bool."""
        return np.asarray(2 * np.pi * self.onsets[:, 1] <= self.limit)

    @property
    def lost(self) -> tuple[int, int, int]:
        """How many modes, growing modes and onsets count and are not known."""
        pairs = ((self.counted, self.known), (self.growing, self.last_known), (self.counted_onsets, self.onsets_known))
        frequencies, rates, values = (int((counts & ~known).sum()) for counts, known in pairs)
        return frequencies, rates, values


@dataclass(frozen=True)
class Errors:
    """The largest relative errors of a result; NaN where there is nothing to compare.

    Attributes
    ----------
    frequency : float
        Error of the frequencies at the first value of the sweep relative to |λ|, for all modes up to 0.8 of the highest
        frequency. A mode that is not found counts as an error of 1.
    growth : float
        Error of Re λ at the last value, for the unstable modes, relative to the largest Re λ.
    onset : float
        Error of the critical values, relative to the value or to a tenth of the sweep's interval, whichever is larger.
        An onset that is not found counts as an error of 1, and so does one that the reference does not have; both ends
        of a window of instability as half its width, which is what closes it.
    """

    frequency: float = np.nan
    growth: float = np.nan
    onset: float = np.nan


def grows(lam: np.ndarray, limit: float) -> np.ndarray:
    """Return which modes (k,) bool grow by more than rounding, and have a frequency of up to `limit`, rad/s."""
    return np.asarray((lam.real > _ROUNDING * limit) & (lam.imag <= limit))


def as_reference(m: Measurement) -> Reference:
    """Return a result, unchanged, as the reference that others are compared with."""
    k, last = (int(np.isfinite(m.lam[i]).sum()) for i in (0, -1))
    known = (np.ones(n, dtype=bool) for n in (k, last, len(m.onsets)))
    return Reference(
        m.first, m.last, m.lam[0, :k], m.lam[-1, :last], m.onsets, float(np.ptp(m.values)), Errors(), *known
    )


def reference_of(m: Measurement) -> Reference:
    """Return a reference with its uncertainty: the likely values for an infinitely fine mesh, and their bars.

    A mode or onset that is not found again when the mesh is refined, or an onset that only the refined mesh has, has no
    known reference, and the uncertainty of the quantity that it counts for is not known. Where the mesh was not refined
    the result itself is the reference.
    """
    own = as_reference(m)
    if not len(m.likely):
        return own
    ends = [(lam, m.likely[i, : len(lam)], m.bars[i, : len(lam)]) for i, lam in ((0, own.lam), (-1, own.last))]
    (known, lam, bars), (last_known, last, last_bars) = (
        (np.isfinite(likely), np.where(np.isfinite(likely), likely, lam), bars) for lam, likely, bars in ends
    )
    found = np.isfinite(m.likely_onsets[:, 0])
    onsets = m.onsets.copy()
    onsets[found, 0] = m.likely_onsets[found, 0]
    reference = replace(
        own, lam=lam, last=last, onsets=np.vstack([onsets, m.appeared]), known=known, last_known=last_known,
        onsets_known=np.append(found, np.zeros(len(m.appeared), dtype=bool)),
    )  # fmt: skip
    scales = np.array([onset_scale(value, m.values) for value in onsets[:, 0]])
    relative = (
        (bars.imag / np.abs(lam))[reference.counted],
        last_bars.real[reference.growing] / max(last.real[reference.growing].max(initial=0.0), np.finfo(float).tiny),
        (m.likely_onsets[:, 1] / scales)[reference.counted_onsets[: len(found)]],
    )
    unsure = (
        np.nan if lost or not len(errors) else float(np.max(errors))
        for errors, lost in zip(relative, reference.lost, strict=True)
    )
    return replace(reference, uncertainty=Errors(*unsure))


def with_exact(reference: Reference, frequencies: np.ndarray) -> Reference:
    """Return a reference whose lowest modes have frequencies that are known exactly.

    Parameters
    ----------
    reference : Reference
    frequencies : (f,) float, Hz
        The exact frequencies of the f lowest modes, ascending. If they include all modes that are compared, the
        uncertainty of the reference's frequencies is zero.
    """
    order = np.argsort(reference.lam.imag)[: len(frequencies)]
    lam = reference.lam.astype(complex)
    lam[order] = 2j * np.pi * frequencies[: len(order)]
    known = reference.known.copy()
    known[order] = True
    exact = replace(reference, lam=lam, known=known)
    if not np.delete(exact.counted, order).any():
        exact = replace(exact, uncertainty=replace(reference.uncertainty, frequency=0.0))
    return exact


def errors_of(m: Measurement, reference: Reference) -> Errors:
    """Return the errors of a result against a reference."""
    k, last = (int(np.isfinite(m.lam[i]).sum()) for i in (0, -1))
    same = same_modes(reference.shapes, reference.lam, m.first, m.lam[0, :k])
    counted = np.flatnonzero(reference.counted & reference.known)
    frequency = [
        abs(m.lam[0, same[i]].imag - reference.lam[i].imag) / abs(reference.lam[i]) if i in same else 1.0
        for i in counted.tolist()
    ]
    growth = _growth_error(m, last, reference)
    return Errors(max(frequency, default=np.nan), growth, _onset_error(m, reference, same))


def along(errors: Errors, m: Measurement, best: Measurement) -> Errors:
    """Return the errors of a result against a better one on the same mesh, the largest over all values of the sweep.

    Frequencies are known at all values there, not only at those that shapes are stored of. Modes are paired by λ, which
    is near enough: both results are of the same matrices, or nearly so. Growth is relative to the fastest at any value.

    Parameters
    ----------
    errors : Errors
        Those of the values with shapes, which they begin with.
    m, best : Measurement
        With the same values.
    """
    limit = as_reference(best).limit
    frequency, growth = [errors.frequency], []
    fastest = float(np.nanmax(np.where(best.lam.imag <= limit, best.lam.real, np.nan), initial=0.0))
    for found, true in zip(m.lam, best.lam, strict=True):
        found, true = found[np.isfinite(found)], true[np.isfinite(true)]
        rows, columns = linear_sum_assignment(np.abs(true[:, None] - found[None, :]))
        counted = (true[rows].imag > 0) & (true[rows].imag <= limit)
        off = found[columns] - true[rows]
        frequency.extend((np.abs(off.imag) / np.abs(true[rows]))[counted])
        growing = counted & (grows(true[rows], limit) | (found[columns].real > _ROUNDING * limit))
        growth.extend(np.abs(off.real)[growing])
        missed, more = np.delete(true, rows), np.delete(found, columns)
        frequency.extend(1.0 for lam in missed if 0 < lam.imag <= limit)
        growth.extend(missed.real[grows(missed, limit)])
        growth.extend(more.real[grows(more, limit)])
    most = max(growth, default=0.0) / fastest if fastest > _ROUNDING * limit else np.nan
    return Errors(float(np.nanmax(frequency)), float(np.fmax(most, errors.growth)), errors.onset)


def same_modes(shapes: np.ndarray, lam: np.ndarray, others: np.ndarray, found: np.ndarray) -> dict[int, int]:
    """Return, by the position of a mode, the position of the same mode in another result, by shape and eigenvalue.

    Parameters
    ----------
    shapes, others : (3 p, k) and (3 p, l) complex
        Displacements of the modes of both results at the same p points, for the modal assurance criterion (MAC).
    lam, found : (k,) and (l,) complex, rad/s
        Their eigenvalues.
    """
    size = np.sqrt(np.outer((np.abs(shapes) ** 2).sum(axis=0), (np.abs(others) ** 2).sum(axis=0)))
    mac = (np.abs(shapes.conj().T @ others) / np.maximum(size, np.finfo(float).tiny)) ** 2
    distance = np.abs(lam[:, None] - found[None, :])
    scale = _FREQUENCY * np.maximum(np.abs(lam[:, None]), np.finfo(float).tiny)
    cost = 1 - mac + distance / (distance + scale)
    rows, columns = linear_sum_assignment(cost)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < _NO_MATCH}


def _growth_error(m: Measurement, k: int, reference: Reference) -> float:
    found, true = m.lam[-1, :k], reference.last
    growing, known = np.flatnonzero(reference.growing).tolist(), reference.last_known
    extra = set(np.flatnonzero(grows(found, reference.limit)).tolist())
    judged = [i for i in growing if known[i]]
    if not growing and not extra:
        return np.nan
    if not judged:
        return np.nan if growing else 1.0
    largest = max(float(true[i].real) for i in judged)
    same = same_modes(reference.last_shapes, true, m.last, found)
    errors = [abs(found[same[i]].real - true[i].real) if i in same else true[i].real for i in judged]
    # Modes that grow here and do not in the reference: their whole growth rate is an error.
    errors += [found[j].real for j in extra - {j for i, j in same.items() if i in growing or not known[i]}]
    return float(max(errors) / largest)


def _onset_error(m: Measurement, reference: Reference, same: dict[int, int]) -> float:
    true, found = (_onsets(o) for o in (reference.onsets, m.onsets))
    paired = pair_onsets(true, found, same, m.values)
    errors, lost = [], []
    for i in np.flatnonzero(reference.counted_onsets & reference.onsets_known).tolist():
        onset, j = true[i], paired[i]
        if j is None:
            lost.append(onset)
        else:
            errors.append(abs(found[j].value - onset.value) / onset_scale(onset.value, m.values))
    unknown = [true[i] for i in np.flatnonzero(~reference.onsets_known).tolist()]
    more = [
        onset for j, onset in enumerate(found)
        if 2 * np.pi * onset.frequency_hz <= reference.limit and j not in paired
        and not any(_is_beside(onset, other, reference.width) for other in unknown)
    ]  # fmt: skip
    return max([*errors, *_errors_alone(lost, m.values), *_errors_alone(more, m.values)], default=np.nan)


def _errors_alone(onsets: list[Onset], values: np.ndarray) -> list[float]:
    """Return the errors of onsets that one of two results alone has: 1, but half the width of a window for its ends.

    Where two modes just miss each other, a small change of the matrices makes such a window or closes it: its ends meet
    half way.
    """
    errors = []
    for onset in onsets:
        beside = [o for o in onsets if o is not onset and branches_of(o) & branches_of(onset)]
        inwards = [o for o in beside if (o.value > onset.value) == (onset.direction == "into")]
        end = min(inwards, key=lambda o: abs(o.value - onset.value), default=onset)
        half = abs(end.value - onset.value) / 2
        errors.append(min(half / onset_scale(onset.value, values), 1.0) if end.direction != onset.direction else 1.0)
    return errors


def _is_beside(one: Onset, other: Onset, width: float) -> bool:
    apart = abs(one.value - other.value) / width, abs(one.frequency_hz - other.frequency_hz)
    return apart[0] <= _BESIDE and apart[1] <= _BESIDE * max(one.frequency_hz, other.frequency_hz)


def _onsets(rows: np.ndarray) -> list[Onset]:
    return [
        Onset("", v, f, "flutter" if flutter else "divergence", "into" if into else "out of", np.nan, int(a),
              None if np.isnan(b) else int(b), 0.0)
        for v, f, flutter, into, a, b in rows.tolist()
    ]  # fmt: skip
