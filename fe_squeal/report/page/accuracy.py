"""The page of a study of accuracy: which setting to choose, and error against time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fe_squeal.errors import OutputError
from fe_squeal.report.advice import LINES, QUANTITIES, advice, lines_of, size_head, size_text, units_of
from fe_squeal.report.page.build import write_page
from fe_squeal.report.page.markup import bullets, table
from fe_squeal.report.table_files import read_checked

_NEEDED = ("order", "size", "modes", "method", "tolerance", "unknowns", "seconds", "knob")


def write_accuracy_page(path: Path, page: Path) -> tuple[str, ...]:
    """Write the page from accuracy.csv; return sentences on what could not be shown.

    Raises
    ------
    OutputError
        The table cannot be read.
    """
    frame = read_checked(path, "fe-squeal accuracy", _NEEDED)
    varied = sorted({line.knob for line in LINES})
    if not frame["knob"].isin(varied).any():
        given = frame["knob"].iloc[0] if len(frame) else "nothing"
        raise OutputError(f'{path}: knob: given "{given}"; expected {", ".join(varied)}, as fe-squeal accuracy writes')
    known = [q for q in QUANTITIES if q in frame and frame[q].notna().any()]
    unknown = [words for q, words in QUANTITIES.items() if q not in known]
    lacks = tuple(f"The error of the {words} is not known, so it is not shown." for words in unknown)
    sentences = [sentence for q in QUANTITIES if q in frame for sentence in advice(frame, q)]
    plots = [_plot(frame, q) for q in known]
    places = "".join(
        f'<h3>{QUANTITIES[q].capitalize()}</h3><div class="chart" id="{q}" role="img" aria-label="Relative error of the'
        f' {QUANTITIES[q]} against seconds; the table below has the numbers"></div>'
        for q in known
    )
    units = units_of(frame)
    rows = [
        (f"{r['order']}", size_text(r["size"], units, False), r["modes"], r["method"], f"{r['tolerance']:.0e}",
         r["unknowns"], f"{r['seconds']:.1f}", *(f"{r[q]:.1e}" if np.isfinite(r[q]) else "–" for q in known))
        for r in frame.sort_values("seconds").to_dict("records")
    ]  # fmt: skip
    heads = ["order", size_head(units), "modes", "method", "tolerance", "unknowns", "seconds"]
    heads += [QUANTITIES[q] for q in known]
    sections = [
        ("answer", "What to choose", bullets(sentences) + bullets(lacks)),
        ("charts", "Error against time", places),
        ("table", "Measured", table("Relative errors", heads, rows)),
    ]
    write_page("What accuracy costs", sections, page, {"plots": plots})
    return lacks


def _plot(frame: pd.DataFrame, quantity: str) -> dict[str, Any]:
    traces, units = [], units_of(frame)
    for line, rows in lines_of(frame[frame[quantity].notna() & (frame[quantity] > 0)]):
        ordered = rows.sort_values("seconds")
        label = [
            f"{size_text(r['size'], units)}, {r['modes']} modes, {r['method']}" for r in ordered.to_dict("records")
        ]
        traces.append({
            "mode": "markers+lines" if line.colour else "markers", "name": line.label,
            "x": ordered["seconds"].tolist(), "y": ordered[quantity].tolist(), "text": label,
            "marker": {"size": 8}, "line": {"width": 1},
            **({"marker": {"size": 8, "color": line.colour}} if line.colour else {}),
        })  # fmt: skip
    axis = {"type": "log", "gridcolor": "#e6eaee", "linecolor": "#51606e", "mirror": True}
    layout = {
        "xaxis": {**axis, "title": {"text": "seconds"}},
        "yaxis": {**axis, "title": {"text": "relative error"}, "exponentformat": "power"},
        "margin": {"l": 70, "r": 12, "t": 20, "b": 50}, "hovermode": "closest", "plot_bgcolor": "#fff",
        "legend": {"orientation": "h", "y": -0.2},
    }  # fmt: skip
    return {"id": quantity, "data": traces, "layout": layout}
