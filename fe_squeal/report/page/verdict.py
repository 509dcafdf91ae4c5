"""The answer of a run in sentences: what squeals, from which value on, how sure that is, and what drives it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from fe_squeal.report.branches import covered_text, frequency_text, numbers, parameter_symbol, total_uncertainty
from fe_squeal.report.looks import body_text, diameters_text, way_text
from fe_squeal.report.onsets import mesh_errors, partings, refined_only
from fe_squeal.report.record import covered_range
from fe_squeal.report.results import Results
from fe_squeal.report.tables import (
    UnstableInterval,
    begins_unstable,
    growth_text,
    half_known_growth,
    unstable_intervals,
    window_intervals,
    with_uncertainty,
)
from fe_squeal.report.warnings import told_once

_NAMED = 5  # modes, terms or numbers that a sentence names, at most
_UNDAMPED = ("symmetric", "nonsymmetric")  # classes of problems without damping and loss factors
_UNDECIDED = "It is not decided for"
_TELLING = ("completeness", "onsets_complete", "warnings")  # keys of run.json without which doubts are not known


def answer(results: Results) -> list[str]:
    """Return the sentences of the verdict, the most important first."""
    if not len(results.modes):
        return ["There are no modes to judge."]
    intervals = all_intervals(results)
    said = [_what_squeals(results, intervals), *_first_onset(results)]
    if intervals:
        worst = max(intervals, key=lambda row: row.growth)
        said += [_largest(results, worst), *_feeds(results, worst), *_moves(results, worst)]
    return [sentence for sentence in said if sentence]


def doubts(results: Results) -> list[str]:
    """Return sentences on what is in doubt, the most serious last."""
    record, found = results.record, []
    count = record.get("completeness") or {}
    if count and not count.get("proven"):
        found.append(
            "The number of modes is not proven at the first value"
            + (", but found in two ways." if count.get("expected") is not None else ".")
        )
    if record.get("unstable_above_range"):
        text = str(record["unstable_above_range"])
        found.append(f"{text[:1].upper()}{text[1:]}.")
    onsets = record.get("onsets_complete") or {}
    if onsets and not onsets.get("sure"):
        found.append("The list of onsets is not sure: see the warnings.")
    return [*told_once([str(w) for w in record.get("warnings") or []]), *found, *_unrecorded(record)]


def _unrecorded(record: dict[str, Any]) -> list[str]:
    """Return a sentence where run.json does not tell all of what is in doubt."""
    if not record:
        return ["What is in doubt is not known, as there is no record of the run."]
    status = str(record.get("status") or "not recorded")
    if status != "complete":
        return [f"The status of the run is: {status}. What is in doubt is not known beyond what is said here."]
    missing = [key for key in _TELLING if record.get(key) is None]
    return [f"What is in doubt is not known: run.json does not tell {', '.join(missing)}."] if missing else []


def all_intervals(results: Results) -> list[UnstableInterval]:
    """Return the unstable intervals of all branches, also windows between two values, the fastest growing first."""
    modes = results.modes
    if "branch" not in modes or "damping_ratio" not in modes:
        return []
    noise = modes.assign(noise=modes.get("noise", ""))
    rows = unstable_intervals(noise)
    if modes["value"].nunique() > 1:
        rows += window_intervals(modes, results.onsets)
    return sorted(rows, key=lambda row: -row.growth)


def row_of(results: Results, interval: UnstableInterval) -> dict[str, Any]:
    """Return the row of modes.csv where the mode of an interval grows fastest; empty for a window between values."""
    modes = results.modes
    same = (numbers(modes, "value") == interval.peak_value) & (numbers(modes, "mode") == interval.mode)
    found = modes[same]
    return {str(k): v for k, v in found.iloc[0].to_dict().items()} if len(found) else {}


def peak_hz(results: Results, interval: UnstableInterval) -> float:
    """Return the frequency, Hz, where the mode of an interval grows fastest."""
    return float(row_of(results, interval).get("frequency_hz", interval.highest_hz))


def shares_of(results: Results, row: dict[str, Any]) -> pd.DataFrame:
    """Return the shares of the terms in a mode, the largest in Re λ first."""
    return _own(results.contributions, row, lambda f: f[f["term"] != "sum"], "re_share")


def sensitivities_of(results: Results, row: dict[str, Any]) -> pd.DataFrame:
    """Return by how much one per cent more of each number changes Re λ (`dre_percent`, 1/s) and the frequency (Hz)."""
    found = _own(results.sensitivities, row, lambda f: f, "dre")
    found = found.assign(dre_percent=0.01 * numbers(found, "at") * numbers(found, "dre"),
                         dhz_percent=0.01 * numbers(found, "at") * numbers(found, "dim") / (2 * np.pi))  # fmt: skip
    return found.sort_values("dre_percent", key=abs, ascending=False, kind="stable")


def _own(frame: pd.DataFrame, row: dict[str, Any], chosen: Any, by: str) -> pd.DataFrame:
    if not len(frame) or not row:
        return frame.iloc[:0]
    same = (numbers(frame, "value") == row["value"]) & (numbers(frame, "mode") == row["mode"])
    return chosen(frame[same]).sort_values(by, key=abs, ascending=False, kind="stable")


def _what_squeals(results: Results, intervals: list[UnstableInterval]) -> str:
    symbol, values = parameter_symbol(results.parameter), numbers(results.modes, "value")
    span = f"{symbol} = {values.min():.4g}" if values.min() == values.max() else (
        f"{symbol} from {values.min():.4g} to {values.max():.4g}")  # fmt: skip
    covered = covered_range(results.record)
    where = f" {covered_text(covered)}" if covered else " among the computed modes"
    branches = list({row.branch: row for row in reversed(intervals)}.values())
    if not branches:
        near = _nearest(results, symbol)
        surely = "surely " if any(_UNDECIDED in sentence for sentence in near) else ""
        return " ".join([f"Nothing squeals{where}: no mode is {surely}unstable for {span}.", *near])
    branches.sort(key=lambda row: row.lowest_hz)
    named = "; ".join(
        ", ".join(t for t in (frequency_text(peak_hz(results, row)), diameters_text(row.looks)) if t)
        for row in branches[:_NAMED]
    )
    more = f"; and {len(branches) - _NAMED} more" if len(branches) > _NAMED else ""
    count = "1 mode is" if len(branches) == 1 else f"{len(branches)} modes are"
    noises = {row.noise for row in branches if row.noise}
    word = "It squeals" if not noises or "squeal" in noises else "It is unstable"
    low, high = covered or (0.0, None)
    # A mode may be outside the range that is known at all values, and inside that of its own value.
    if any(not low <= peak_hz(results, row) <= (np.inf if high is None else high) for row in branches):
        return f"{word}: {count} unstable for {span}: {named}{more}. All modes are known{where}."
    return f"{word}: {count} unstable{where} for {span}: {named}{more}."


def _nearest(results: Results, symbol: str) -> list[str]:
    """Return how near to instability the modes come where none is unstable, and of which it is not decided."""
    modes = results.modes
    marginal = np.asarray(modes["stability"] == "marginal", dtype=bool)
    if marginal.all() and results.record.get("problem_class") in _UNDAMPED:
        return ["Without damping their Re λ is zero within its uncertainty."]
    unsure, sure, said = modes[marginal], modes[~marginal], []
    if len(unsure):
        bar = total_uncertainty(unsure)
        worst = int(np.argmax(numbers(unsure, "re") + bar))
        growth = with_uncertainty(float(unsure["re"].iloc[worst]), float(bar[worst])) + " 1/s"
        growth += ", mesh: ?" if half_known_growth(modes)[marginal][worst] else ""
        count = len(np.unique(numbers(unsure, "branch")))
        which = "one mode" if count == 1 else f"{count} modes"
        most = "" if count == 1 else " of the one that may grow most"
        said.append(f"{_UNDECIDED} {which}: Re λ = {growth}{most}, {_place(unsure.iloc[worst], symbol)}.")
    if len(sure):
        nearest = sure.iloc[int(np.argmax(numbers(sure, "re")))]
        which = "surely stable mode" if said else "mode"
        said.append(f"The {which} nearest to it has Re λ = {float(nearest['re']):.3g} 1/s, {_place(nearest, symbol)}.")
    return said


def _place(row: pd.Series, symbol: str) -> str:
    return f"at {frequency_text(float(row['frequency_hz']))} and {symbol} = {float(row['value']):.4g}"


def _first_onset(results: Results) -> list[str]:
    onsets = results.onsets[~partings(results.onsets)]
    if "direction" in onsets:
        onsets = onsets[onsets["direction"] == "into"]
    alone = refined_only(onsets)
    symbol = parameter_symbol(results.parameter)
    return [*_first_of_mesh(results, onsets[~alone], symbol), *_of_refined_mesh(onsets[alone], symbol)]


def _of_refined_mesh(onsets: pd.DataFrame, symbol: str) -> list[str]:
    if not len(onsets):
        return []
    row = onsets.sort_values("value", kind="stable").iloc[0]
    first = f"{symbol} = {float(row['value']):.4g} and {frequency_text(float(row['frequency_hz']))}"
    if len(onsets) == 1:
        return [f"An onset at {first} appears on the refined mesh alone: finer meshes may have it."]
    return [f"{len(onsets)} onsets appear on the refined mesh alone, the first at {first}: finer meshes may have them."]


def _first_of_mesh(results: Results, onsets: pd.DataFrame, symbol: str) -> list[str]:
    if early := begins_unstable(results.modes, results.onsets):
        value = min(early.values())
        many = len(onsets) != 1
        follow = f" {len(onsets)} onset{'s' if many else ''} of other modes follow{'' if many else 's'}."
        return [
            f"The first instability sets in before {symbol} = {value:.6g}, the first value of the sweep."
            f"{follow if len(onsets) else ''}"
        ]
    if not len(onsets):
        return []
    first = onsets.sort_values("value", kind="stable").iloc[:1]
    value, solver, mesh = (float(numbers(first, name)[0]) for name in ("value", "uncertainty", "discretisation"))
    of_solver = f"± {solver:.1e} by the solver" if np.isfinite(solver) else "of the solver's error nothing is known"
    of_mesh = "the error of the mesh was not estimated, see fe-squeal run --estimate"
    if not np.isnan(mesh):
        of_mesh = f"± {mesh:.2g} by the mesh" if np.isfinite(mesh) else "the refined mesh has no such onset"
    elif mesh_errors(results.onsets) is not None:
        of_mesh = "its error by the mesh is not known"
    others = f" {len(onsets) - 1} more follow{'s' if len(onsets) == 2 else ''}." if len(onsets) > 1 else ""
    return [
        f"The first instability sets in at {symbol} = {value:.6g} ({of_solver}; {of_mesh}), at"
        f" {frequency_text(float(first['frequency_hz'].iloc[0]))}.{others}"
    ]


def _largest(results: Results, worst: UnstableInterval) -> str:
    symbol = parameter_symbol(results.parameter)
    looks = ", ".join(t for t in (diameters_text(worst.looks), body_text(worst.looks), way_text(worst.looks)) if t)
    which = ", ".join(t for t in (frequency_text(peak_hz(results, worst)), looks) if t)
    return (
        f"The fastest growing mode is that at {which}: Re λ = {growth_text(worst, ' 1/s')} at {symbol} ="
        f" {worst.peak_value:.4g}, a damping ratio of {100 * worst.damping_ratio:.3g} %."
    )


def _feeds(results: Results, worst: UnstableInterval) -> list[str]:
    shares = shares_of(results, row_of(results, worst))
    if not len(shares):
        return []
    shares = shares[np.isfinite(numbers(shares, "re_share"))]
    share = numbers(shares, "re_share")
    largest = np.abs(share).max(initial=0.0)
    feeding, damping = shares[share > 1e-9 * largest], shares[share < -1e-9 * largest]
    parts = []
    for frame, verb in ((feeding, "It is fed by"), (damping, "it is damped by")):
        if len(frame):
            named = ", ".join(f"{t} ({float(s):+.3g} 1/s)" for t, s in zip(frame["term"].iloc[:_NAMED],
                              frame["re_share"].iloc[:_NAMED], strict=True))  # fmt: skip
            parts.append(f"{verb} {named}")
    return ["; ".join(parts) + "."] if parts else []


def _moves(results: Results, worst: UnstableInterval) -> list[str]:
    moves = sensitivities_of(results, row_of(results, worst))
    moves = moves[np.abs(numbers(moves, "dre_percent")) > 0]
    if not len(moves):
        return []
    named = ", ".join(
        f"{name} by {float(change):+.2g} 1/s"
        for name, change in zip(moves["number"].iloc[:3], moves["dre_percent"].iloc[:3], strict=True)
    )
    return [f"What moves its Re λ most, for 1 % more of each: {named}."]
