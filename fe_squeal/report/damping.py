"""Damping ratio against frequency: the usual picture of the modes of a brake at one value of the parameter."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from fe_squeal.process.signals import signals_deferred
from fe_squeal.report.branches import frequency_text, numbers, parameter_name, parameter_symbol, title_text, value_text
from fe_squeal.report.labels import place_labels
from fe_squeal.report.notebook import NotebookFigure

_LABELLED = 12  # unstable modes with a label, at most


@signals_deferred()  # it is laid out here, by which text is measured
def damping_figure(modes: pd.DataFrame, value: float | None = None, title: str = "") -> Figure:
    """Return a figure of the damping ratios in per cent, negative where a mode is unstable.

    Parameters
    ----------
    modes : DataFrame
        As in `modes.csv`.
    value : float, optional
        The value of the sweep nearest to this one is drawn (default: the last).

    Raises
    ------
    ValueError
        There are no modes.
    """
    if not len(modes):
        raise ValueError("no modes to draw")
    values = numbers(modes, "value")
    at = values.max() if value is None else values[int(np.argmin(np.abs(values - value)))]
    here = modes[values == at]
    hz, ratio = numbers(here, "frequency_hz"), 100 * numbers(here, "damping_ratio")
    unstable = np.asarray(here["stability"] == "unstable", dtype=bool)
    per, unit = (1000.0, "kHz") if hz.max(initial=0.0) >= 2000 else (1.0, "Hz")
    layout = ConstrainedLayoutEngine()
    figure = NotebookFigure(figsize=(9, 5), dpi=150, layout=layout)
    canvas = FigureCanvasAgg(figure)
    axes = figure.subplots()
    heads = [title, f"{parameter_symbol(parameter_name(modes))} = {value_text(float(at))}"]
    figure.suptitle(title_text(", ".join(t for t in heads if t), figure.get_figwidth()), fontsize=12)
    axes.plot(hz[~unstable] / per, ratio[~unstable], "o", color="0.4", ms=6, label="stable or marginal")
    axes.plot(hz[unstable] / per, ratio[unstable], "D", color="tab:red", ms=7, label="unstable")
    reach = max(float(np.abs(ratio).max(initial=0.0)), 1e-3)
    axes.set_ylim(min(1.25 * float(ratio.min(initial=0.0)), -0.15 * reach), max(1.25 * float(ratio.max(initial=0.0)),
                                                                                0.15 * reach))  # fmt: skip
    axes.axhspan(axes.get_ylim()[0], 0.0, color="tab:red", alpha=0.05, lw=0)
    axes.axhline(0.0, color="0.3", lw=0.9)
    axes.set_xlim(left=0.0)
    axes.set_xlabel(f"frequency ({unit})")
    axes.set_ylabel("damping ratio (%)")
    axes.grid(True, color="0.92", lw=0.6)
    axes.set_axisbelow(True)
    axes.legend(fontsize=8)
    layout.execute(figure)
    figure.set_layout_engine("none")
    if 0 < unstable.sum() <= _LABELLED:
        points = list(zip((hz[unstable] / per).tolist(), ratio[unstable].tolist(), strict=True))
        texts = [f"{frequency_text(f)}, {r:.2g} %" for f, r in zip(hz[unstable], ratio[unstable], strict=True)]
        place_labels(axes, canvas, points, texts, np.column_stack([hz / per, ratio]))
    return figure
