"""The page that shows two or more designs side by side."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fe_squeal.errors import one_line
from fe_squeal.report.branches import frequency_text
from fe_squeal.report.differences import COLUMNS, GONE, LATER, UNPAIRED
from fe_squeal.report.page.build import write_page
from fe_squeal.report.page.markup import bullets, paragraph, table, text
from fe_squeal.report.record import DifferenceRecord, left_out, readable
from fe_squeal.report.table_files import read_checked


def read_and_write_page(table_file: Path, record_file: Path, path: Path) -> tuple[str, ...]:
    """Write the page from the table and the record of `fe-squeal diff`; return sentences on what could not be shown.

    Raises
    ------
    OutputError
        The table cannot be read.
    """
    record: dict[str, Any] = {"title": "Designs side by side", "symbol": "parameter", "answers": [], "lacks": []}
    lacks: list[str] = []
    differences = read_checked(table_file, "fe-squeal diff", there=[name for name in COLUMNS if name not in LATER])
    try:
        said = json.loads(record_file.read_text(encoding="utf-8"))
        if not isinstance(said, dict):
            raise ValueError("it is no table")
        said, wrong = readable(said, DifferenceRecord)
        lacks += left_out(record_file.name, wrong)
        record |= said
    except (OSError, RecursionError, ValueError) as error:
        why = one_line(str(error))
        lacks.append(f"{record_file.name}: it cannot be read ({why}); the answer in words is left out.")
    notes = [str(s) for s in record["lacks"]] + lacks
    differences["look"] = differences["look"].fillna("")
    answers = [str(sentence) for sentence in record["answers"]]
    write_difference_page(differences, answers, notes, str(record["symbol"]), path, str(record["title"]))
    return tuple(lacks)


def write_difference_page(
    differences: pd.DataFrame, answers: list[str], lacks: list[str], symbol: str, path: Path, title: str
) -> Path:
    """Write the page of a table of differences."""
    parts = "".join(f'<p class="answer">{text(sentence)}</p>' for sentence in answers)
    notes = paragraph(UNPAIRED, "A change exceeds its bar where it is larger than the errors of both numbers together.",
                      "A question mark in the charts stands where an error is not known.")  # fmt: skip
    unsure = "<h3>What could not be compared</h3>" + bullets(lacks) if lacks else ""
    charts = "".join(
        f'<h3>{text(heading)}</h3><div class="chart" id="{name}" role="img" aria-label="{text(heading)} of each mode'
        ' before and after; the table below has the numbers"></div>'
        for name, heading in (("onset", f"{symbol} at onset"), ("re", "Largest growth rate"))
    )
    sections = [
        ("answer", "The answer", parts + unsure),
        ("charts", "Before and after", charts if len(differences) else "<p>No mode is unstable in any of them.</p>"),
        ("modes", "Mode by mode", notes + _table(differences, symbol)),
    ]
    plots = [_plot(differences, n, label) for n, label in (("onset", f"{symbol} at onset"), ("re", "Re λ (1/s)"))]
    return write_page(title, sections, path, {"plots": plots if len(differences) else []})


def _table(differences: pd.DataFrame, symbol: str) -> str:
    rows = [
        (r["b"], r["state"], r["look"], _number(r["mac"], ".2f"), _change(r, "frequency", "_hz") + _where(r, symbol),
         _change(r, "onset"), _change(r, "re") + _where(r, symbol),
         " → ".join(_number(100 * r[f"damping_ratio_{side}"], ".3g") for side in "ab") + _where(r, symbol))
        for r in differences.to_dict("records")
    ]  # fmt: skip
    heads = ("variant", "mode is", "shape", "MAC", "frequency, Hz", f"{symbol} at onset", "largest Re λ, 1/s",
             "damping ratio, %")  # fmt: skip
    return table("Modes of both designs", heads, rows, 3)


def _change(row: dict[Any, Any], name: str, unit: str = "") -> str:
    before, after = row[f"{name}_a{unit}"], row[f"{name}_b{unit}"]
    words = f"{_number(before, '.5g')} → {_number(after, '.5g')}"
    exceeds, bar = row[f"{name}_exceeds"], row[f"{name}_bar{unit}"]
    if not np.isfinite(row[f"{name}_change{unit}"]):
        return words
    if bar == np.inf:
        return f"{words}; its bar is not known"
    if exceeds not in (True, False) or not np.isfinite(bar):  # not decided, which a table of text holds as NaN
        return words
    return f"{words}; {'exceeds' if exceeds else 'is within'} its bar of {bar:.1g}"


def _where(row: dict[Any, Any], symbol: str) -> str:
    """Return at which values of the parameter the modes of a pair grow fastest, if these are two."""
    a, b = row["value_a"], row["value_b"]
    if not np.isfinite([a, b]).all() or np.isclose(a, b, rtol=1e-9, atol=0.0):
        return ""
    return f" (at {symbol} = {a:.4g} → {b:.4g})"


def _number(value: Any, form: str) -> str:
    return "–" if value is None or not np.isfinite(value) else format(float(value), form)


def _plot(differences: pd.DataFrame, name: str, label: str) -> dict[str, Any]:
    names = []
    for i, r in enumerate(differences.to_dict("records"), 1):
        hz = frequency_text(r["frequency_a_hz"] if r["state"] == GONE else r["frequency_b_hz"])
        names.append(f"{r['b']}: {hz}, {r['state']} ({i})")
    before, after = (differences[f"{name}_{side}"].astype(float).tolist() for side in "ab")
    bars = differences[f"{name}_bar"].astype(float).tolist()
    doubt = ["?" if np.isinf(bar) else "" for bar in bars]
    lone = ["" if np.isfinite(y) else mark for y, mark in zip(after, doubt, strict=True)]
    data = [
        {"mode": "markers+text", "name": "before", "x": before, "y": names, "text": lone,
         "textposition": "middle right",
         "marker": {"size": 11, "symbol": "circle-open", "color": "#51606e", "line": {"width": 2}}},
        {"mode": "markers+text", "name": "after", "x": after, "y": names, "marker": {"size": 10, "color": "#d55e00"},
         "text": doubt, "textposition": "middle right",
         "error_x": {"type": "data", "array": bars, "visible": True}},
    ]  # fmt: skip
    layout = {
        "xaxis": {"title": {"text": label}, "gridcolor": "#e6eaee"}, "plot_bgcolor": "#fff",
        "yaxis": {"automargin": True, "autorange": "reversed", "gridcolor": "#e6eaee"},
        "margin": {"l": 60, "r": 12, "t": 30, "b": 50}, "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom"},
        "height": 160 + 34 * len(names),
    }  # fmt: skip
    return {"id": name, "data": data, "layout": layout}
