"""The figure and the text about error against time, from the table of a study of accuracy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from .advice import QUANTITIES, advice, charted, fitted, lines_of, lost, pareto, size_head, size_text, units_of
from .branches import title_text
from .files import save_figure

_FLOOR = 1e-12  # smaller errors are left out of the chart
_TITLES = {"error_frequency": "frequency", "error_growth": "growth rate", "error_onset": "critical value"}


def plot_accuracy(frame: pd.DataFrame, own: Mapping[str, float], path: Path, title: str) -> None:
    """Draw error against seconds, both logarithmic: a line for each thing that is varied, and the Pareto front.

    Parameters
    ----------
    frame : DataFrame
        As in `accuracy.csv`.
    own : mapping of str to float
        The uncertainty of the reference itself, by the columns in `QUANTITIES`; it is drawn as a horizontal line.
    path : Path
        The file to write; its suffix chooses the format (png, pdf, svg).
    title : str
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    shown = [q for q in QUANTITIES if (np.nan_to_num(charted(frame, q)) > _FLOOR).any()]
    figure = Figure(figsize=(4.6 * max(1, len(shown)), 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, quantity in zip(np.atleast_1d(figure.subplots(1, max(1, len(shown)))), shown, strict=False):
        for line, rows in lines_of(frame[charted(frame, quantity) > _FLOOR]):
            rows = rows.sort_values(["size", "modes", "tolerance"])
            axes.loglog(rows["seconds"], charted(rows, quantity), marker=line.mark, ms=5, lw=1, label=line.label)
        front = frame[pareto(frame, quantity) & (charted(frame, quantity) > _FLOOR)].sort_values("seconds")
        axes.loglog(
            front["seconds"], charted(front, quantity), ls="none", marker="o", ms=12, mfc="none", mec="0.3",
            label="Pareto front",
        )  # fmt: skip
        if own[quantity] > 0:
            axes.axhline(own[quantity], color="0.5", ls=":", lw=1, label="uncertainty of the reference")
        axes.set_xlabel("seconds")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_title(f"relative error of the {_TITLES[quantity]}", fontsize=10)
        axes.grid(True, which="major", alpha=0.3)
    if shown:
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.suptitle(title_text(title or "error against time", figure.get_figwidth()), fontsize=11)
    save_figure(figure, path, dpi=130)


def accuracy_page(
    frame: pd.DataFrame, own: Mapping[str, float], finest: str, exact: bool, left_out: Sequence[str], title: str
) -> str:
    """Return what was measured, and which setting to choose, as Markdown.

    Parameters
    ----------
    frame, own
        As for `plot_accuracy`.
    finest : str
        Order and size of the result that the reference was extrapolated from.
    exact : bool
        Whether the frequencies of the reference are known exactly.
    left_out : sequence of str
        Settings that were not measured, with the reason.
    title : str
    """
    bars = {q: f"{100 * own[q]:.2g} %" if np.isfinite(own[q]) else lost(frame, q) for q in QUANTITIES}
    known = (f"{words} {bars[q]}" for q, words in QUANTITIES.items() if np.isfinite(own[q]))
    unknown = (f"{words}: not known: {bars[q]}" for q, words in QUANTITIES.items() if bars[q] and np.isnan(own[q]))
    unsure = "; ".join(filter(None, [", ".join(known), *unknown]))
    lines = [f"# What accuracy costs: {title or 'this scene'}", "", "![error against time](accuracy.png)", ""]
    reference = "the exact frequencies, and else to the extrapolation" if exact else "the extrapolation"
    lines += [
        f"Errors are relative to {reference} of the finest result ({finest}), which is itself uncertain by"
        f" {unsure or 'what is not known: its mesh was not refined'}. The largest error counts: of the frequencies"
        " at the first value of the sweep (modes up to 0.8 of the highest), of the growth rates at the last (relative"
        " to the largest one), of all critical values. Modes are paired by shape; one that is not found has the error"
        " 1. *Algebraic* errors are those against the best solution on the same mesh, the largest over all values of"
        " the sweep. The chart shows the larger of both: where the error of a projection cancels that of the mesh, that"
        " is an accident.",
        "", "## What to choose", "",
    ]  # fmt: skip
    for quantity in QUANTITIES:
        lines += [f"- {sentence}" for sentence in advice(frame, quantity)]
    lines += ["", "## Rates", ""]
    lines += ["| quantity | order | error ~ size to the |", "|---|---|---|"]
    for quantity, words in QUANTITIES.items():
        for order in (1, 2, 3):
            fit = fitted(frame, order, quantity)
            if fit is not None:
                lines.append(f"| {words} | {order} | {fit:.2f} |")
    higher = "orders 2 and 3" if (frame["order"] == 3).any() else "order 2"
    lines += ["", f"Smooth modes give twice the order; edges of contacts, clamped edges and re-entrant corners, where"
              f" stresses are singular, take {higher} down to between 1 and 3.", ""]  # fmt: skip
    lines += ["## Measured", "", _table(frame), ""]
    if (frame["knob"] == "adapted").any():
        lines += [
            "Where elements are adapted, their size is that of equal ones on as many unknowns, and seconds are those of"
            " the adapted mesh alone; to find it took the estimate on the mesh before.", "",
        ]  # fmt: skip
    if left_out:
        lines += ["## Left out", "", *(f"- {text}" for text in left_out), ""]
    return "\n".join(lines)


def _table(frame: pd.DataFrame) -> str:
    units = units_of(frame)
    heads = ["order", size_head(units), "modes", "method", "tolerance", "unknowns", "seconds", "MiB", "frequency",
             "growth", "onset", "algebraic: frequency", "growth", "onset"]  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for row in frame.sort_values(["order", "size", "method", "modes", "tolerance"], ascending=False).itertuples():
        numbers = (row.error_frequency, row.error_growth, row.error_onset, row.algebraic_frequency,
                   row.algebraic_growth, row.algebraic_onset)  # fmt: skip
        adapted = " adapted" if row.knob == "adapted" else ""
        size = size_text(float(str(row.size)), units, False)
        cells = [str(row.order), f"{size}{adapted}", str(row.modes), str(row.method),
                 f"{row.tolerance:.0e}", str(row.unknowns), f"{row.seconds:.1f}",
                 f"{row.peak_memory_mib:.0f}"]  # fmt: skip
        cells += ["" if not np.isfinite(float(str(x))) else f"{float(str(x)):.1e}" for x in numbers]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
