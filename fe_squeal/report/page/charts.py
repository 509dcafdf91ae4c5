"""The data of the page's charts, as plain lists for JSON."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from fe_squeal.report.axes import growth_limits
from fe_squeal.report.branches import (
    PARAMETER_LABELS,
    Bools,
    collect_branches,
    covered_text,
    frequency_text,
    numbers,
    parameter_symbol,
    total_uncertainty,
    value_text,
)
from fe_squeal.report.growth import growth_curves, onset_laws
from fe_squeal.report.looks import body_text, diameters_text, look_text, plane_text, way_text
from fe_squeal.report.onsets import mesh_states
from fe_squeal.report.record import covered_range
from fe_squeal.report.results import Results
from fe_squeal.report.tables import half_known_growth, with_uncertainty


def chart_data(results: Results) -> dict[str, Any]:
    """Return the branches with all their modes and curves of growth, the onsets, and measured frequencies."""
    modes = results.modes
    name = results.parameter
    values = np.unique(numbers(modes, "value"))
    growth, notes = growth_limits(modes)
    covered = covered_range(results.record) or (0.0, None)
    return {
        "parameter": name,
        "symbol": parameter_symbol(name),
        "label": PARAMETER_LABELS.get(name, name),
        "logarithmic": bool(len(values) > 1 and values[0] > 0 and values[-1] / values[0] > 50),
        "values": values.tolist(),
        "texts": [value_text(v) for v in values],
        "rangeEnds": [end for end in covered if end],  # Hz; lines are drawn there
        "rangeText": f"all modes {covered_text(covered)}",
        "growthRange": growth,  # of the root locus, with sentences on what lies outside of it
        "growthNotes": notes,
        "branches": _branches(results),
        "onsets": _onsets(results),
        "measured": [m for m in results.record.get("measured") or [] if m.get("frequency_hz")],
    }


def _branches(results: Results) -> list[dict[str, Any]]:
    modes, found = results.modes, []
    if "branch" not in modes:
        return []
    branch, value = numbers(modes, "branch"), numbers(modes, "value")
    uncertainty, ratio = total_uncertainty(modes), numbers(modes, "damping_ratio")
    known = np.where(half_known_growth(modes), np.nan, uncertainty)
    for b in collect_branches(modes, results.onsets):
        rows = np.flatnonzero(branch == b.number)
        rows = rows[np.argsort(value[rows], kind="stable")]
        table = [modes.iloc[i].to_dict() for i in rows]
        peak = max(table, key=lambda row: float(row["re"]) if row["stability"] == "unstable" else -math.inf)
        inside, drawn = b.unstable_segments(), b.joined & b.swings[:-1] & b.swings[1:]
        curves = growth_curves(b)
        found.append({
            "number": b.number,
            "grows": b.grows,
            "name": f"branch {b.number}, {look_text(peak)}",
            "value": [float(row["value"]) for row in table],
            "hz": [float(row["frequency_hz"]) for row in table],
            "re": [float(row["re"]) for row in table],
            "ratio": _finite(ratio[rows]),
            # As texts; the uncertainty is null where that by the mesh is not known, and the bar where none is drawn.
            "rate": [_rate(*pair) for pair in zip(numbers(modes, "re")[rows], uncertainty[rows], strict=True)],
            "uncertainty": _finite(known[rows]),
            "bar": _finite(np.where(_tells(modes)[rows], known[rows], np.nan)),
            "stability": [str(row["stability"]) for row in table],
            "diameters": [diameters_text(row) for row in table],
            "way": [way_text(row) for row in table],
            "body": [body_text(row) for row in table],
            "plane": [plane_text(row) for row in table],
            # Lines are interrupted where the branch is missing at a value or does not swing, and thick where unstable.
            "line": _polyline([b.value, b.frequency_hz], drawn),
            "thick": _polyline([b.value, b.frequency_hz], inside),
            "growth": _joined(curves, b.joined),
            "thickGrowth": _joined(curves, inside),
        })  # fmt: skip
    return found


def _rate(re: float, uncertainty: float) -> str:
    return with_uncertainty(float(re), float(uncertainty)) if math.isfinite(re) else "–"


def _tells(modes: pd.DataFrame) -> Bools:
    """Return (n,) bool, where the uncertainty of Re λ is one.

    That of what decays faster than it swings is set to |λ| where loss factors say nothing of it: that is no bar.
    """
    re, omega, bar = numbers(modes, "re"), 2 * np.pi * numbers(modes, "frequency_hz"), total_uncertainty(modes)
    size = np.hypot(re, omega)
    return np.asarray(~((re <= -omega) & (np.abs(bar - size) <= 1e-6 * size)))


def _onsets(results: Results) -> list[dict[str, Any]]:
    symbol, found = parameter_symbol(results.parameter), []
    onsets = results.onsets.assign(law=onset_laws(results.modes, results.onsets))
    for row, state in zip(onsets.to_dict("records"), mesh_states(onsets), strict=True):
        if not np.isfinite([row["value"], row["frequency_hz"]]).all():
            continue
        pair = [int(row[k]) for k in ("branch_a", "branch_b") if row.get(k) == row.get(k) and row.get(k)]
        found.append({
            "value": float(row["value"]), "hz": float(row["frequency_hz"]), "branches": pair,
            "into": row.get("direction") != "out of", "kind": str(row.get("kind", "flutter")),
            "text": f"{symbol} = {row['value']:.6g}, {frequency_text(row['frequency_hz'])}",
            "law": law_text(row, symbol), "parting": row["law"] == "parting", "mesh": state,
        })  # fmt: skip
    return found


def law_text(row: dict[Any, Any], symbol: str) -> str:
    """Return the law of growth near an onset, with its `law`, as a formula.

    Examples
    --------
    >>> law_text({"value": 0.25, "crossing_speed": 900.0, "law": "root", "direction": "into"}, "μ")
    'Re λ ≈ 900 √(μ − 0.25) 1/s'
    """
    is_out, law = row.get("direction") == "out of", row.get("law")
    if law == "parting":
        return "two growing modes become one that swings" if is_out else "a growing mode becomes two that do not swing"
    speed = float(row.get("crossing_speed", math.nan))
    if not math.isfinite(speed):
        return "no threshold: it grows from the start of the interval on"
    at = f"{float(row['value']):.4g}"
    distance = f"{at} − {symbol}" if is_out else f"{symbol} − {at}"
    if law not in ("root", "linear"):
        return "its law is not known"
    return f"Re λ ≈ {abs(speed):.4g} {'√' if law == 'root' else ''}({distance}) 1/s"


def _finite(values: Any) -> list[float | None]:
    return [float(v) if math.isfinite(v) else None for v in values]


def _polyline(columns: list[Any], shown: Any) -> list[list[float | None]]:
    """Return x and y of the segments that are shown, with None between segments that are not neighbours."""
    points = np.column_stack(columns)
    return _joined([points[i : i + 2] for i in range(len(points) - 1)], shown)


def _joined(curves: list[Any], shown: Any) -> list[list[float | None]]:
    x: list[float | None] = []
    y: list[float | None] = []
    last = -2
    for i in np.flatnonzero(shown).tolist():
        if x and i != last + 1:
            x.append(None)
            y.append(None)
        start = 1 if x and x[-1] is not None else 0
        x += [float(v) for v in curves[i][start:, 0]]
        y += [float(v) if math.isfinite(v) else None for v in curves[i][start:, 1]]
        last = i
    return [x, y]
