"""Errors of one result against another on a finer mesh: modes are paired by shape, not by number."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..sweep.onset import Onset
from .estimate import COMPARED, EXTRAPOLATED, SMALLEST, UNSURE, pair_onsets
from .measure import Measurement

_FREQUENCY = 0.1  # relative change of an eigenvalue that weighs half as much as a wholly different shape
_NO_MATCH = 1.5


@dataclass(frozen=True)
class Reference:
    """What results are compared with.

    Attributes
    ----------
    shapes, last_shapes : (3 p, k) complex
        At the first and the last value.
    lam, last : (k,) complex, rad/s
    onsets : (o, 6) float
        As in `Measurement`.
    width : float
        Of the sweep.
    uncertainty : Errors
        Its own, as far as known.
    """

    shapes: np.ndarray
    last_shapes: np.ndarray
    lam: np.ndarray
    last: np.ndarray
    onsets: np.ndarray
    width: float
    uncertainty: Errors


@dataclass(frozen=True)
class Errors:
    """Relative errors; NaN where there is nothing to compare.

    Attributes
    ----------
    frequency : float
        The largest of a mode at the first value, over the modes up to 0.8 of the highest frequency; 1 for a mode that
        is not found.
    growth : float
        The largest of Re λ at the last value, over the modes that are unstable, relative to the largest Re λ.
    onset : float
        The largest of a critical value, relative to itself (to a tenth of the sweep where it is less); 1 for one that
        is not found.
    """

    frequency: float = np.nan
    growth: float = np.nan
    onset: float = np.nan


def as_reference(m: Measurement) -> Reference:
    """Return a result as what others are compared with, as it is."""
    k, last = (int(np.isfinite(m.lam[i]).sum()) for i in (0, -1))
    return Reference(m.first, m.last, m.lam[0, :k], m.lam[-1, :last], m.onsets, float(np.ptp(m.values)), Errors())


def reference_of(m: Measurement) -> Reference:
    """Return the extrapolation of a result by what refining its mesh once changes, with its uncertainty.

    The change is between half and 15/16 of the error, see `bars`; the middle is taken.
    """
    if not len(m.changes):
        return as_reference(m)
    onsets = m.onsets.copy()
    onsets[:, 0] += EXTRAPOLATED * np.nan_to_num(m.onset_changes)
    reference = as_reference(replace(m, lam=m.lam + EXTRAPOLATED * np.nan_to_num(m.changes), onsets=onsets))
    unsure = UNSURE / EXTRAPOLATED  # of the way from the result to the reference
    errors = errors_of(m, reference)
    own = Errors(*(unsure * e for e in (errors.frequency, errors.growth, errors.onset)))
    return replace(reference, uncertainty=own)


def with_exact(reference: Reference, frequencies: np.ndarray) -> Reference:
    """Return a reference of which the lowest modes, by rank, have exact frequencies, Hz: only the others are unsure."""
    order = np.argsort(reference.lam.imag)[: len(frequencies)]
    lam = reference.lam.astype(complex)
    lam[order] = 2j * np.pi * frequencies[: len(order)]
    limit = COMPARED * float(lam.imag.max(initial=0.0))
    known = bool((np.delete(lam.imag, order) > limit).all())
    own = replace(reference.uncertainty, frequency=0.0) if known else reference.uncertainty
    return replace(reference, lam=lam, uncertainty=own)


def errors_of(m: Measurement, reference: Reference) -> Errors:
    """Return the errors of a result."""
    k, last = (int(np.isfinite(m.lam[i]).sum()) for i in (0, -1))
    same = same_modes(reference.shapes, reference.lam, m.first, m.lam[0, :k])
    limit = COMPARED * float(reference.lam.imag.max(initial=0.0))
    counted = np.flatnonzero((reference.lam.imag > 0) & (reference.lam.imag <= limit))
    frequency = [
        abs(m.lam[0, same[i]].imag - reference.lam[i].imag) / reference.lam[i].imag if i in same else 1.0
        for i in counted.tolist()
    ]
    growth = _growth_error(m, last, reference, limit)
    return Errors(max(frequency, default=np.nan), growth, _onset_error(m, reference, same, limit))


def same_modes(shapes: np.ndarray, lam: np.ndarray, others: np.ndarray, found: np.ndarray) -> dict[int, int]:
    """Return which of other modes is each mode, by the MAC of displacements at the same points, and the eigenvalue."""
    size = np.sqrt(np.outer((np.abs(shapes) ** 2).sum(axis=0), (np.abs(others) ** 2).sum(axis=0)))
    mac = (np.abs(shapes.conj().T @ others) / np.maximum(size, np.finfo(float).tiny)) ** 2
    distance = np.abs(lam[:, None] - found[None, :])
    scale = _FREQUENCY * np.maximum(np.abs(lam[:, None]), np.finfo(float).tiny)
    cost = 1 - mac + distance / (distance + scale)
    rows, columns = linear_sum_assignment(cost)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < _NO_MATCH}


def _growth_error(m: Measurement, k: int, reference: Reference, limit: float) -> float:
    found, true = m.lam[-1, :k], reference.last
    tiny = 1e-9 * limit
    growing = [i for i in np.flatnonzero(true.real > tiny).tolist() if true[i].imag <= limit]
    extra = {j for j in np.flatnonzero(found.real > tiny).tolist() if found[j].imag <= limit}
    largest = max((float(true[i].real) for i in growing), default=0.0)
    if not growing and not extra:
        return np.nan
    if not growing:
        return 1.0
    same = same_modes(reference.last_shapes, true, m.last, found)
    errors = [abs(found[same[i]].real - true[i].real) if i in same else true[i].real for i in growing]
    errors += [found[j].real for j in extra - {same[i] for i in growing if i in same}]  # should not grow
    return float(max(errors) / largest)


def _onset_error(m: Measurement, reference: Reference, same: dict[int, int], limit: float) -> float:
    true, found = (_onsets(o) for o in (reference.onsets, m.onsets))
    paired = pair_onsets(true, found, same, reference.width)
    errors = []
    for onset, j in zip(true, paired, strict=True):
        if 2 * np.pi * onset.frequency_hz > limit:
            continue
        scale = max(abs(onset.value), SMALLEST * reference.width)
        errors.append(abs(found[j].value - onset.value) / scale if j is not None else 1.0)
    return max(errors, default=np.nan)


def _onsets(rows: np.ndarray) -> list[Onset]:
    return [
        Onset("", v, f, "flutter" if flutter else "divergence", "into" if into else "out of", np.nan, int(a),
              None if np.isnan(b) else int(b), 0.0)
        for v, f, flutter, into, a, b in rows.tolist()
    ]  # fmt: skip
