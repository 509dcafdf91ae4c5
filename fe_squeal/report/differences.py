"""Compare two designs: modes are paired by shape, and changes are held against their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from fe_squeal.report.branches import frequency_text, numbers, parameter_symbol
from fe_squeal.report.looks import look_text
from fe_squeal.report.onsets import partings
from fe_squeal.report.pairing import ALIKE, common_points, mac_matrix, pair_shapes
from fe_squeal.report.record import covered_range
from fe_squeal.report.results import Results
from fe_squeal.report.tables import begins_unstable

COLUMNS = (
    "a", "b", "state", "branch_a", "branch_b", "mac", "look", "frequency_a_hz", "frequency_b_hz", "frequency_change_hz",
    "frequency_bar_hz", "frequency_exceeds", "onset_a", "onset_b", "onset_change", "onset_bar", "onset_exceeds",
    "value_a", "re_a", "value_b", "re_b", "re_change", "re_bar", "re_exceeds", "damping_ratio_a", "damping_ratio_b",
    "damping_ratio_change", "onset_bar_a", "onset_bar_b",
)  # fmt: skip
LATER = ("onset_bar_a", "onset_bar_b")  # columns that tables of earlier versions lack
PAIRED, GONE, NEW, UNKNOWN = "paired", "gone", "new", "not paired"
_ELSEWHERE = "is unstable only where the other sweep has no values"
_BEYOND = "may have its partner"  # above or below the range of both designs
_RIM = 0.95  # of the range of both designs: an unpaired mode above this may have its partner above the other's range


def compare_designs(a: Results, b: Results, names: tuple[str, str]) -> tuple[pd.DataFrame, list[str]]:
    """Return a table with a row for each unstable mode of two designs, and sentences on what could not be compared.

    Pairs come first, then modes that only one design has. A change "exceeds" if it is larger than the errors of both
    numbers together, by the solver and, where it was estimated, by the mesh. None says that this is not decided: an
    error is not known, which makes the bar of an estimated design infinite; growth has no values in common; or
    frequencies are those at two values of the parameter.

    Parameters
    ----------
    a, b : Results
        The two designs, before and after.
    names : (str, str)
        What they are called.

    Returns
    -------
    DataFrame
        With the columns `COLUMNS`.
    list of str
    """
    span, shared = _common(a, b)
    first, second = unstable_branches(a, span, shared), unstable_branches(b, span, shared)
    pairs, said = _pairs(a, b, names, list(first), list(second))
    blind = pairs is None  # nothing is known of what is gone or new
    pairs = pairs or []
    ends = [_ends(r) for r in (a, b) if len(r.modes)]
    if len(set(ends)) > 1 or (len(ends) == 2 and not len(shared)):
        where = f"growth is compared from {shared.min():.4g} to {shared.max():.4g}" if len(shared) else (
            "they have no value in common, and growth is not compared")  # fmt: skip
        said.append(f"The sweeps of {names[0]} and {names[1]} have other ends or values: {where}.")
    rows = [_row(names, PAIRED, first[i], second[j], mac) for i, j, mac in pairs]
    covered = [covered_range(r.record) or (0.0, None) for r in (a, b)]
    lowest = max(low for low, _ in covered)
    highest = min(np.inf if high is None else high for _, high in covered)
    rest = [(GONE, row) for i, row in first.items() if i not in {i for i, _, _ in pairs}]
    rest += [(NEW, row) for j, row in second.items() if j not in {j for _, j, _ in pairs}]
    for state, row in rest:
        if not row["inside"]:
            said.append(f"{_named(names, state, row)} {_ELSEWHERE}.")
        elif row["frequency_hz"] > _RIM * highest:
            said.append(f"{_named(names, state, row)} {_BEYOND} above the range of both, {frequency_text(highest)}.")
        elif row["frequency_hz"] < lowest / _RIM:
            said.append(f"{_named(names, state, row)} {_BEYOND} below the range of both, {frequency_text(lowest)}.")
        else:
            told = UNKNOWN if blind else state
            one, other = (row, None) if state == GONE else (None, row)
            rows.append(_row(names, told, one, other, np.nan))
    for results, name in ((a, names[0]), (b, names[1])):
        if len(results.modes) and not is_estimated(results):
            said.append(f"Of {name} the error of the mesh is not known (run --estimate): its bars are the solver's.")
    half = sum(np.isinf([row[f"{q}_bar"] for q in ("onset", "re")]).any() for row in rows)
    if half:
        many = f"{half} modes" if half > 1 else "one mode"
        said.append(f"The error of the onset or the growth of {many} is not known: whether it changed is not decided.")
    frame = pd.DataFrame(rows, columns=list(COLUMNS))
    return frame.astype({"branch_a": "Int64", "branch_b": "Int64"}), said


def is_estimated(results: Results) -> bool:
    """Return whether the error of the mesh was estimated, of the modes or of the onsets."""
    bars = numbers(results.modes, "re_discretisation"), numbers(results.onsets, "discretisation")
    return any(bool((~np.isnan(bar)).any()) for bar in bars)


def _ends(results: Results) -> tuple[float, float]:
    values = numbers(results.modes, "value")
    return float(values.min()), float(values.max())


def _named(names: tuple[str, str], state: str, row: Mapping[str, Any]) -> str:
    return f"The mode of {frequency_text(float(row['frequency_hz']))} of {names[state == NEW]}"


def _common(a: Results, b: Results) -> tuple[tuple[float, float], np.ndarray]:
    """Return the first and the last value that both sweeps go through, and the values (m,) that both have.

    All values where there are none.
    """
    ends = [_ends(r) for r in (a, b) if len(r.modes)]
    low, high = max((low for low, _ in ends), default=-np.inf), min((high for _, high in ends), default=np.inf)
    span = (float(low), float(high)) if low <= high else (-np.inf, np.inf)
    if len(ends) < 2:
        return span, np.zeros(0)
    own, other = (np.unique(numbers(r.modes, "value")) for r in (a, b))
    return span, own[np.isclose(own[:, None], other[None, :], rtol=1e-9, atol=0.0).any(axis=1)]


def unstable_branches(
    results: Results, span: tuple[float, float] = (-np.inf, np.inf), shared: np.ndarray | None = None
) -> dict[int, dict[str, Any]]:  # fmt: skip
    """Return, by branch, the row of modes.csv where it grows fastest, with the errors and the first onset added.

    `shared` (m,) are the values that another sweep has as well. Other values count only for branches that are unstable
    at none of these, which "shared" says, and values outside a span only for those that are unstable nowhere inside,
    see "inside". Onsets count up to the end of the span. That of a branch that is unstable at the first value is not
    known. Errors that are not known are infinite; that of the mesh where it was not estimated is left out of the bars
    of growth and onset, and makes that of the frequency NaN.
    """
    modes, onsets = results.modes, results.onsets
    if "branch" not in modes:
        return {}
    estimated = is_estimated(results)
    hz_bar = np.abs(numbers(modes, "im_discretisation")) / (2 * np.pi)
    frame = modes.assign(
        re_bar=_bar(modes, "re_uncertainty", "re_discretisation", estimated),
        hz_bar=np.where(np.isnan(hz_bar), np.inf, hz_bar) if estimated else np.nan,
    )
    unstable = frame[(frame["stability"] == "unstable") & frame["branch"].notna()]
    at = numbers(onsets, "value") if len(onsets) else np.zeros(0)
    onsets = onsets[at <= span[1]] if len(onsets) else onsets
    found, begun = {}, begins_unstable(results.modes, results.onsets)
    for number, every in unstable.groupby("branch"):
        values = numbers(every, "value")
        inside = every[(values >= span[0]) & (values <= span[1])]
        also = every if shared is None else every[np.isclose(values[:, None], shared, rtol=1e-9, atol=0).any(axis=1)]
        own = also if len(also) else inside if len(inside) else every
        row = {str(k): v for k, v in own.iloc[int(np.argmax(numbers(own, "re")))].to_dict().items()}
        row |= {"onset": np.nan, "onset_bar": np.nan, "shared": len(also) > 0, "inside": len(inside) > 0}
        if int(float(str(number))) not in begun:
            row["onset"], row["onset_bar"] = _first_onset(onsets, float(str(number)), estimated)
        found[int(float(str(number)))] = row
    return found


def _bar(frame: pd.DataFrame, solver: str, mesh: str, estimated: bool) -> np.ndarray:
    """Return the errors (n,) by the solver and, where it was estimated, by the mesh; infinite where one is unknown."""
    errors = np.abs(numbers(frame, solver)) + (np.abs(numbers(frame, mesh)) if estimated else 0.0)
    return np.where(np.isnan(errors), np.inf, errors)


def _first_onset(onsets: pd.DataFrame, branch: float, estimated: bool) -> tuple[float, float]:
    pair = np.column_stack([numbers(onsets, "branch_a"), numbers(onsets, "branch_b")])
    own = onsets[(pair == branch).any(axis=1)]
    own = own[~partings(own)]
    own = own[own["direction"] == "into"] if "direction" in own else own
    if not len(own):
        return np.nan, np.nan
    i = int(np.argmin(numbers(own, "value")))
    return float(numbers(own, "value")[i]), float(_bar(own, "uncertainty", "discretisation", estimated)[i])


def _pairs(
    a: Results, b: Results, names: tuple[str, str], first: list[int], second: list[int]
) -> tuple[list[tuple[int, int, float]] | None, list[str]]:
    """Return pairs of branches with their MAC, of those branches whose shapes were written; None if none can be."""
    said = list[str]()
    if not first or not second:
        return [], said
    for results, name in ((a, names[0]), (b, names[1])):
        if results.grid is None or not results.shapes:
            said.append(f"{name} has no shapes on a mesh, so its modes cannot be paired with others.")
    if a.grid is None or b.grid is None or said:
        return None, said
    points, alone = common_points(a.grid, b.grid)
    if alone:
        said.append(f"{names[0]} and {names[1]} do not both have the bodies {', '.join(alone)}; they are not compared.")
    if points is None:
        return None, [*said, f"{names[0]} and {names[1]} have no body of the same name, so no mode can be paired."]
    far = float(points.distance.max()) / max(a.grid.size, 1e-300)
    if far > 0.05:
        said.append(
            f"The surfaces of {names[0]} and {names[1]} lie apart by up to {100 * far:.0f} % of the model's size: are"
            " they in the same place, and in the same unit?"
        )
    of_a, of_b = _written(a, first), _written(b, second)
    values = mac_matrix([a.shapes[k].u for k in of_a.values()], [b.shapes[k].u for k in of_b.values()], points)
    if not values.size:
        return [], said
    ia, ib = list(of_a), list(of_b)
    return [(ia[i], ib[j], value) for i, j, value in pair_shapes(values)], said


def _written(results: Results, branches: list[int]) -> dict[int, int]:
    """Return, by branch, the position in `results.shapes` of its shape where it grows fastest."""
    found: dict[int, int] = {}
    for k, shape in enumerate(results.shapes):
        branch = shape.info.get("branch")
        if branch is None or int(branch) not in branches:
            continue
        known = found.get(int(branch))
        if known is None or shape.info.get("re", 0.0) > results.shapes[known].info.get("re", 0.0):
            found[int(branch)] = k
    return found


def _row(
    names: tuple[str, str], state: str, a: dict[str, Any] | None, b: dict[str, Any] | None, mac: float
) -> dict[str, Any]:
    def both(name: str) -> tuple[float, float]:
        x, y = (float(row.get(name, np.nan)) if row is not None else np.nan for row in (a, b))
        return x, y

    row: dict[str, Any] = {"a": names[0], "b": names[1], "state": state, "mac": mac}
    row["branch_a"], row["branch_b"] = (None if r is None else int(r["branch"]) for r in (a, b))
    row["look"] = look_text(b if b is not None else a or {})
    for name, column, bar in (("frequency", "frequency_hz", "hz_bar"), ("onset", "onset", "onset_bar"),
                              ("re", "re", "re_bar")):  # fmt: skip
        unit = "_hz" if name == "frequency" else ""
        (x, y), bars = both(column), both(bar)
        errors = [error for value, error in zip((x, y), bars, strict=True) if np.isfinite(value)]
        error = float(sum(errors)) if errors else np.nan
        row[f"{name}_a{unit}"], row[f"{name}_b{unit}"] = x, y
        row[f"{name}_change{unit}"], row[f"{name}_bar{unit}"] = y - x, error
        row[f"{name}_exceeds"] = bool(abs(y - x) > error) if np.isfinite([y - x, error]).all() else None
    row["onset_bar_a"], row["onset_bar_b"] = both("onset_bar")
    row["value_a"], row["value_b"] = both("value")
    if not all(r is not None and r["shared"] for r in (a, b)):
        row["re_exceeds"] = None  # growth at other values is another growth
    if not np.isclose(row["value_a"], row["value_b"], rtol=1e-9, atol=0.0):
        row["frequency_exceeds"] = None  # the parameter alone moves frequencies
    row["damping_ratio_a"], row["damping_ratio_b"] = both("damping_ratio")
    row["damping_ratio_change"] = row["damping_ratio_b"] - row["damping_ratio_a"]
    return row


def sentences(
    table: pd.DataFrame, names: Sequence[str], symbol: str, begun: Mapping[str, float] | None = None,
    lacks: Sequence[str] = (),
) -> list[str]:  # fmt: skip
    """Return the answer for each variant: `Slot: onset 0.24 → 0.31 ± 0.02, 4.63 kHz gone, new at 5.1 kHz.`

    `begun` has the first values of those designs that are unstable there: the first onset is then not known. `lacks`
    are the sentences of `compare_designs`.
    """
    said, begun = [], begun or {}
    for name in names:
        own = table[table["b"] == name]
        early = [n for n in (*own["a"].unique(), name) if n in begun]
        parts = [f"{n} is unstable from its first value on, {symbol} = {begun[n]:.4g}, so that the first onset is not"
                 f" known" for n in early]  # fmt: skip
        if np.isfinite(own[["onset_a", "onset_b"]].to_numpy(float)).any() and not early:
            parts = [_onset_words(own, symbol)]
        parts += [f"{frequency_text(f)} gone" for f in own.loc[own["state"] == GONE, "frequency_a_hz"]]
        new = [frequency_text(f) for f in own.loc[own["state"] == NEW, "frequency_b_hz"]]
        parts += [f"new at {', '.join(new)}"] if new else []
        paired = own[own["state"] == PAIRED]
        worse = paired[(paired["re_exceeds"] == True) & (paired["re_change"] > 0)]  # noqa: E712  it may be None
        better = paired[(paired["re_exceeds"] == True) & (paired["re_change"] < 0)]  # noqa: E712
        for frame, word in ((worse, "grows faster"), (better, "grows more slowly")):
            parts += [f"{frequency_text(f)} {word} (Re λ {x:.3g} → {y:.3g} 1/s)" for f, x, y in
                      zip(frame["frequency_b_hz"], frame["re_a"], frame["re_b"], strict=True)]  # fmt: skip
        if (own["state"] == UNKNOWN).any():
            parts.append("which modes are the same is not known")
        if not len(own):
            unseen = any(_ELSEWHERE in s or _BEYOND in s for s in lacks)
            parts = ["nothing that can be compared is unstable" if unseen else "nothing is unstable in either"]
        same = "no change beyond the bars" + ("" if paired["re_exceeds"].notna().all() else " that are known")
        said.append(f"{name}: {', '.join(parts) or same}.")
    return said


def _onset_words(own: pd.DataFrame, symbol: str) -> str:
    """Return the first onset of each design, which may be those of two modes, with the errors of both together."""
    (x, bar_x), (y, bar_y) = (_earliest(own, side) for side in "ab")
    if not np.isfinite(y):
        return f"no onset any more (was {symbol} = {x:.4g})"
    if not np.isfinite(x):
        return f"an onset at {symbol} = {y:.4g} where there was none"
    words, bar = f"onset {symbol} {x:.4g} → {y:.4g}", bar_x + bar_y
    if not np.isfinite(bar):
        return f"{words}, bar not known"
    return f"{words} ± {bar:.1g}{'' if abs(y - x) > bar else ', within the bar'}"


def _earliest(own: pd.DataFrame, side: str) -> tuple[float, float]:
    """Return the first onset of design a or b and its bar, NaN where there is none."""
    values = numbers(own, f"onset_{side}")
    if not np.isfinite(values).any():
        return np.nan, np.nan
    i = int(np.nanargmin(values))
    return float(values[i]), float(numbers(own, f"onset_bar_{side}")[i])


def symbol_of(results: Results) -> str:
    """Return the short name of the parameter."""
    return parameter_symbol(results.parameter)


UNPAIRED = f"Modes are paired where the MAC of their shapes is {ALIKE:g} or more; others are gone or new."
