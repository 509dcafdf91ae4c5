"""Tables for the terminal: unstable modes, and onsets."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from fe_squeal.report.branches import (
    Bools,
    collect_branches,
    covered_text,
    distinct_texts,
    numbers,
    parameter_name,
    parameter_symbol,
    total_uncertainty,
)
from fe_squeal.report.growth import growth_curves
from fe_squeal.report.looks import body_text, entry, short_diameters
from fe_squeal.report.onsets import change_words, mesh_errors, partings
from fe_squeal.report.terminal import print_table

MAX_ROWS = 20


def print_unstable(modes: pd.DataFrame, console: Console, onsets: pd.DataFrame | None = None) -> None:
    """Print the unstable modes, the fastest growing first.

    For a single value of the sweep there is a row for each mode. For several values there is a row for each unstable
    interval of a branch, with its values, its range of frequencies, and its largest growth rate with the damping ratio
    there. A window of instability between two values has a row too; its growth is estimated from its crossing speeds.

    Parameters
    ----------
    modes : DataFrame
        As in `modes.csv`.
    onsets : DataFrame, optional
        As in `onsets.csv`.
    console : rich.console.Console
    """
    symbol = parameter_symbol(parameter_name(modes))
    single = modes["value"].nunique() == 1
    rows = unstable_intervals(modes)
    if onsets is not None and not single:
        rows = sorted([*rows, *window_intervals(modes, onsets)], key=lambda row: -row.growth)
    if not rows:
        values = numbers(modes, "value")
        where = "" if not len(values) else f" at {symbol} = {_span(values.min(), values.max(), '.4g')}"
        console.print(Text(f"No unstable mode{where}."))
        return
    branches = len({row.branch for row in rows})
    head = f"Unstable modes at {symbol} = {rows[0].first:.6g}" if single else f"{branches} unstable branches"
    table = _table(head if single or branches > 1 else "1 unstable branch")
    heads = ["mode", "frequency\nHz", "growth rate\n1/s"] if single else [
        "branch", f"unstable at\n{symbol}", "frequency\nHz", "largest growth\nrate, 1/s", f"at\n{symbol}"]
    for text in (*heads, "damping\n%"):
        table.add_column(text, justify="right")
    table.add_column("noise")
    described = any(row.looks for row in rows)
    if described:
        table.add_column("nodal\ndiameters", justify="right")
        table.add_column("moves most")
    for row in rows[:MAX_ROWS]:
        cells = [_span(row.lowest_hz, row.highest_hz, ".0f" if row.highest_hz >= 1000 else ".4g"), growth_text(row)]
        if single:
            cells.insert(0, str(row.mode))
        else:
            first, last = distinct_texts(np.array([row.first, row.last]), "g")
            span = first if first == last else f"{first} … {last}"
            cells = [_name(row.branch), span, *cells, f"{row.peak_value:.4g}"]
        looks = (short_diameters(row.looks), body_text(row.looks)) if described else ()
        table.add_row(*cells, f"{100 * row.damping_ratio:.3g}", row.noise, *looks)
    print_table(table, console, ("noise", "moves most", "nodal\ndiameters"))
    if len(rows) > MAX_ROWS:
        console.print(Text(f"... {len(rows) - MAX_ROWS} more in modes.csv"))


def print_onsets(
    onsets: pd.DataFrame, console: Console, covered: tuple[float, float | None] | None = None, is_open: bool = False,
    values: int = 2,
) -> None:  # fmt: skip
    """Print where modes turn unstable or stable again, in the order of the parameter.

    The column beside the value is what the two modes of the pair at the first value of the sweep predict without all
    others: if it agrees, two modes suffice to explain the onset. If the error of the mesh was estimated, the error and
    the likely value for an infinitely fine mesh are shown instead.

    Parameters
    ----------
    onsets : DataFrame
        As in `onsets.csv`.
    console : rich.console.Console
    covered : (float, float or None), optional
        The range of frequencies, Hz, in which all modes are known; no end where that is all of them.
    is_open : bool
        Whether there are intervals in which an onset may be missing.
    values : int
        Of the sweep, which were solved for.
    """
    if not len(onsets) and values < 2:
        return  # one value says nothing of where modes become unstable
    if not len(onsets):
        where = f"{covered_text(covered)} in this sweep" if covered else "in this sweep"
        but = ", but where there may be one is not settled everywhere: see the warnings" if is_open else ""
        console.print(Text(f"No onset of instability {where}{but}."))
        return
    symbol = parameter_symbol(parameter_name(onsets))
    ordered = onsets.sort_values("value", kind="stable")
    table = _table(_onsets_title(ordered, covered))
    mesh = mesh_errors(ordered)
    beside = "two modes" if mesh is None else "mesh"
    beyond = likely_values(ordered)
    more = () if beyond is None else ("extrapolated",)
    for head in (f"{symbol} at onset", "uncertainty", beside, *more, "frequency, Hz", "kind", "direction", "branches"):
        table.add_column(head, justify="left" if head in ("kind", "direction") else "right")
    value, uncertainty = numbers(ordered, "value"), numbers(ordered, "uncertainty")
    frequency, two_modes = numbers(ordered, "frequency_hz"), numbers(ordered, "two_mode_value")
    partners = np.column_stack([numbers(ordered, "branch_a"), numbers(ordered, "branch_b")])
    words = change_words(ordered)
    for i in range(min(len(ordered), MAX_ROWS)):
        pair = " + ".join(_name(b) for b in partners[i] if b > 0) or "–"
        known = "" if np.isnan(uncertainty[i]) else f"{uncertainty[i]:.1e}"
        guess = mesh[i] if mesh is not None else "" if np.isnan(two_modes[i]) else f"{two_modes[i]:.4g}"
        tends = () if beyond is None else (beyond[i],)
        table.add_row(_as_sure(value[i], uncertainty[i]), known, guess, *tends, f"{frequency[i]:.6g}", *words[i], pair)
    print_table(table, console)
    if len(ordered) > MAX_ROWS:
        console.print(Text(f"... {len(ordered) - MAX_ROWS} more in onsets.csv"))


def _onsets_title(onsets: pd.DataFrame, covered: tuple[float, float | None] | None) -> str:
    if covered is None:
        return "Onsets"
    title, hz = f"Onsets {covered_text(covered)}", numbers(onsets, "frequency_hz")
    # The modes of some values reach farther than those of others, and there onsets are found that may not be all.
    sides = ["below"] if (hz < covered[0]).any() else []
    sides += ["above"] if covered[1] is not None and (hz > covered[1]).any() else []
    return f"{title}, and those found {' and '.join(sides)}" if sides else title


def _as_sure(value: float, uncertainty: float) -> str:
    """Return a value with one digit more than its uncertainty allows, 3 to 8 in all.

    Examples
    --------
    >>> _as_sure(0.123456789, 2e-4), _as_sure(0.123456789, 1e-12), _as_sure(0.0, 1e-9)
    ('0.12346', '0.12345679', '0')
    """
    if not uncertainty > 0 or not np.isfinite(uncertainty) or not value:
        return f"{value:.8g}"
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(uncertainty)) + 2
    return f"{value:.{min(max(digits, 3), 8)}g}"


def likely_values(onsets: pd.DataFrame) -> list[str] | None:
    """Return the likely values for an infinitely fine mesh with their bars, as texts; None where they are not known."""
    if "value_extrapolated" not in onsets:
        return None
    value = numbers(onsets, "value_extrapolated")
    # A folder of an earlier version has no bars of these values.
    bar = numbers(onsets, "extrapolated_discretisation") if "extrapolated_discretisation" in onsets else 0 * value
    return [
        "" if np.isnan(v) else with_uncertainty(v, b) if np.isfinite(b) and b > 0 else f"{v:.4g}"
        for v, b in zip(value.tolist(), bar.tolist(), strict=True)
    ]


class UnstableInterval(NamedTuple):
    """A run of neighbouring values of the sweep at which a branch is unstable, or a window between two values.

    `growth` is the largest Re λ, 1/s, and `peak_value` the value at which the branch has it; `uncertainty` (1/s),
    `damping_ratio`, `mode`, `noise` and `looks` (the descriptors) are those at this value. A window between two values
    has no mode in the table; its `mode` is 0. `half_known` says that other modes have an error of the mesh, and this
    one's is not known.
    """

    branch: float
    first: float
    last: float
    lowest_hz: float
    highest_hz: float
    growth: float
    uncertainty: float
    peak_value: float
    damping_ratio: float
    mode: int
    noise: str
    looks: dict[str, Any]
    half_known: bool = False


def unstable_intervals(modes: pd.DataFrame) -> list[UnstableInterval]:
    """Return the unstable intervals of all branches, the fastest growing first.

    A mode without a branch number is a branch of its own.
    """
    sweep, place = np.unique(numbers(modes, "value"), return_inverse=True)
    unstable = np.asarray(modes["stability"] == "unstable", dtype=bool)
    branch, re, frequency = numbers(modes, "branch"), numbers(modes, "re"), numbers(modes, "frequency_hz")
    ratio, uncertainty, mode = numbers(modes, "damping_ratio"), total_uncertainty(modes), numbers(modes, "mode")
    half_known = half_known_growth(modes)
    runs = [np.array([i]) for i in np.flatnonzero(unstable & np.isnan(branch))]
    for number in np.unique(branch[unstable & np.isfinite(branch)]):
        rows = np.flatnonzero(unstable & (branch == number))
        rows = rows[np.argsort(place[rows], kind="stable")]
        runs += np.split(rows, np.flatnonzero(np.diff(place[rows]) > 1) + 1)
    result = []
    for rows in runs:
        top = rows[np.argmax(re[rows])]
        result.append(UnstableInterval(
            branch[top], sweep[place[rows[0]]], sweep[place[rows[-1]]], frequency[rows].min(), frequency[rows].max(),
            re[top], uncertainty[top], sweep[place[top]], ratio[top], int(mode[top]), str(modes["noise"].iloc[top]),
            _looks(modes.iloc[top].to_dict()), bool(half_known[top])))
    return sorted(result, key=lambda row: -row.growth)


def half_known_growth(modes: pd.DataFrame) -> Bools:
    """Return (n,) bool, of which modes the error of Re λ by the mesh is not known while it is known of others."""
    mesh = numbers(modes, "re_discretisation")
    return np.asarray(np.isfinite(mesh).any() & np.isnan(mesh))


def growth_text(row: UnstableInterval, unit: str = "") -> str:
    """Return the largest growth rate of an interval with its uncertainty and, behind it, the unit.

    That of a window between two values is estimated, and called so. An error of the mesh that is not known, while it is
    of other modes, gets a question mark, since the uncertainty is that of the solver alone.
    """
    growth = with_uncertainty(row.growth, row.uncertainty) if row.mode else f"about {row.growth:.2g}"
    return growth + unit + (", mesh: ?" if row.half_known else "")


def window_intervals(modes: pd.DataFrame, onsets: pd.DataFrame) -> list[UnstableInterval]:
    """Return the windows of instability that begin and end between two neighbouring values of the sweep."""
    result = []
    for branch in collect_branches(modes, onsets):
        curves = growth_curves(branch)
        for i in np.flatnonzero(branch.windows).tolist():
            top = int(np.argmax(curves[i][:, 1]))
            value, growth = curves[i][top].tolist()
            hz = branch.frequency_hz[i : i + 2]
            size = np.hypot(growth, 2 * np.pi * hz.mean()) or 1.0
            ends = branch.value[i : i + 2]
            result.append(UnstableInterval(
                branch.number, ends[0], ends[1], hz.min(), hz.max(), growth, np.nan, value, -growth / size, 0, "", {}))
    return result


def _looks(row: dict[Any, Any]) -> dict[str, Any]:
    """Return the descriptors of a mode that its row has."""
    return {str(k): v for k, v in row.items() if entry(row, str(k)) is not None} if entry(row, "body") else {}


def _table(title: str) -> Table:
    # Without vertical rules seven columns fit into the 80 characters of a narrow terminal or a log.
    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))


def _name(branch: float) -> str:
    return "–" if math.isnan(branch) else f"{branch:.0f}"


def _span(low: float, high: float, form: str) -> str:
    """Return `low … high`, or a single number if both are equal when rounded."""
    first, last = format(low, form), format(high, form)
    return first if first == last else f"{first} … {last}"


def with_uncertainty(value: float, uncertainty: float) -> str:
    """Return a value with as many digits as its uncertainty allows, at most six, and the uncertainty with one digit.

    Examples
    --------
    >>> with_uncertainty(0.0000861, 2e-6)
    '8.61e-05 ± 2e-06'
    >>> with_uncertainty(123.4567, 0.02), with_uncertainty(123.4567, 0.0), with_uncertainty(123.4567, 1e-9)
    ('123.46 ± 0.02', '123.457', '123.457 ± 1e-09')
    >>> with_uncertainty(123.4567, math.inf)
    '123 ± ∞'
    """
    if uncertainty == math.inf:
        return f"{value:.3g} ± ∞"
    if not uncertainty > 0 or value == 0:
        return f"{value:.6g}"
    places = -math.floor(math.log10(uncertainty))
    if abs(value) < 0.01:
        return f"{value:.4g} ± {uncertainty:.0e}"
    if uncertainty < 1e-5 * abs(value):
        return f"{value:.6g} ± {uncertainty:.0e}"
    if places < 0:
        return f"{value:.0f} ± {uncertainty:.0f}"
    return f"{value:.{places}f} ± {uncertainty:.{places}f}"


def begins_unstable(modes: pd.DataFrame, onsets: pd.DataFrame) -> dict[int, float]:
    """Return the branches that are unstable at the first value of a sweep, with that value.

    Their onset lies before it, unless one is listed there.
    """
    if "branch" not in modes or not len(modes):
        return {}
    first = float(numbers(modes, "value").min())
    there = modes[(numbers(modes, "value") == first) & (modes["stability"] == "unstable") & modes["branch"].notna()]
    known = onsets[(numbers(onsets, "value") <= first) & ~partings(onsets)] if len(onsets) else onsets
    listed = {*numbers(known, "branch_a").tolist(), *numbers(known, "branch_b").tolist()}
    return {int(b): first for b in numbers(there, "branch").tolist() if b not in listed}
