"""Figures of a scatter: probability by band, every unstable mode, and Sobol indices."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from fe_squeal.report.branches import figure_text, title_text
from fe_squeal.report.files import save_figure

_COLOURS = "viridis"
_FIRST, _TOTAL = "#0072b2", "#d55e00"


def short_name(parameter: str) -> str:
    """Return a short name of a parameter, for figures.

    Examples
    --------
    >>> short_name("springs.abutment_1.stiffness, springs.abutment_2.stiffness")
    'abutment_1 stiffness, …'
    >>> short_name("mu")
    'μ'
    """
    first, *more = parameter.split(", ")
    words = "μ" if first == "mu" else " ".join(part.replace("youngs_modulus", "E") for part in first.split(".")[-2:])
    return words + (", …" if more else "")


def driving(indices: pd.DataFrame, output: str) -> str | None:
    """Return the parameter with the largest total index of an output, or else first-order index.

    The largest is known where all are: None where no index has that.
    """
    rows = indices[indices["output"] == output]
    known = [column for column in ("total", "first") if len(rows) and rows[column].notna().all()]
    return str(rows.sort_values(known[0], ascending=False)["parameter"].iloc[0]) if known else None


def without_modes_text(empty: int, count: int) -> str:
    """Return a sentence on samples without modes, which have no growth rate."""
    have = "has" if empty == 1 else "have"
    return f"{empty} of {count} samples {have} no mode in the range; indices and quantiles of growth are of the others"


def _figure(width: float, height: float, title: str) -> Figure:
    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title_text(title, figure.get_figwidth()), fontsize=12)
    return figure


def plot_probability(
    bands: pd.DataFrame, path: str | os.PathLike[str], title: str = "", known_hz: float = np.inf,
    found: tuple[float, float, float] | None = None,
) -> Path:  # fmt: skip
    """Draw the probability of instability in every band and in the whole range, with 95 % intervals.

    All modes are known up to `known_hz`, which the whole range then is called by; where that is infinite they are all
    there are. Where some are found above it, `found` is the probability with these and its interval: a bar of its own.
    """
    figure = _figure(8, 4.4, title)
    axes = figure.subplots()
    labels = [f"{low / 1e3:g} – {high / 1e3:g}" for low, high in bands[["low_hz", "high_hz"]].to_numpy()[:-1]]
    labels.append(f"all up\nto {known_hz / 1e3:.4g}" if np.isfinite(known_hz) else "all")
    p = 100 * bands[["probability", "lower", "upper"]].to_numpy(float)
    if found is not None:
        labels.append("all that\nis found")
        p = np.vstack([p, 100 * np.array(found)])
    x = np.arange(len(p), dtype=float)
    x[len(bands) - 1 :] += 0.4  # apart from the bands
    colours = ["#86a9c8" if i < len(bands) - 1 else "#51606e" for i in range(len(p))]
    axes.bar(x, p[:, 0], 0.62, color=colours, zorder=2)
    gaps = np.maximum(np.stack([p[:, 0] - p[:, 1], p[:, 2] - p[:, 0]]), 0.0)
    axes.errorbar(x, p[:, 0], gaps, fmt="none", ecolor="black", elinewidth=1.3, capsize=5, zorder=3)
    for i, (at, value, top) in enumerate(zip(x, p[:, 0], p[:, 2], strict=True)):
        least = "≥ " if i == len(bands) and value < 100 else ""
        axes.annotate(f"{least}{value:.3g} %", (at, top), (0, 4), textcoords="offset points", ha="center", fontsize=9)
    axes.set_xticks(x, labels)
    axes.set_xlabel("band of frequency (kHz)")
    axes.set_ylabel("probability of instability (%)")
    axes.set_ylim(0, min(max(1.15 * float(p[:, 2].max()), 1.0), 108.0))
    axes.grid(True, axis="y", color="0.92", lw=0.6)
    axes.set_axisbelow(True)
    count = int(bands["samples"].iloc[-1])
    axes.set_title(f"{count} samples, bars with 95 % intervals", fontsize=9, color="0.3", loc="right")
    return save_figure(figure, path)


def plot_scatter(
    samples: pd.DataFrame, modes: pd.DataFrame, parameter: str, path: str | os.PathLike[str], title: str = ""
) -> Path:
    """Draw damping ratio against frequency of every unstable mode, coloured by one parameter."""
    figure = _figure(8.6, 4.8, title)
    axes = figure.subplots()
    if not len(modes):
        axes.text(0.5, 0.5, "no sample is unstable", ha="center", va="center", transform=axes.transAxes, color="0.3")
        axes.set_axis_off()
        return save_figure(figure, path)
    values = samples.set_index("sample")[parameter].loc[modes["sample"]].to_numpy()
    order = np.random.default_rng(0).permutation(len(modes))  # so that no value hides the others
    frame = modes.iloc[order]
    dots = axes.scatter(
        frame["frequency_hz"] / 1e3, 100 * frame["damping_ratio"], c=values[order], cmap=_COLOURS, s=9, alpha=0.75,
        linewidths=0, rasterized=True,
    )  # fmt: skip
    figure.colorbar(dots, ax=axes, label=figure_text(short_name(parameter)))
    axes.axhline(0.0, color="0.3", lw=0.9)
    axes.set_xlabel("frequency (kHz)")
    axes.set_ylabel("damping ratio (%), unstable below 0")
    axes.grid(True, color="0.92", lw=0.6)
    axes.set_axisbelow(True)
    unstable = int((samples["unstable"] > 0).sum())
    axes.set_title(
        f"{len(modes)} unstable modes of {unstable} of {len(samples)} samples", fontsize=9, color="0.3", loc="right"
    )
    return save_figure(figure, path)


def plot_indices(indices: pd.DataFrame, path: str | os.PathLike[str], title: str = "") -> Path:
    """Draw first-order and total Sobol indices of every parameter for every output, with 95 % intervals."""
    known = indices[indices[["first", "total"]].notna().any(axis=1)]
    outputs = list(dict.fromkeys(known["output"]))
    names = list(dict.fromkeys(indices["parameter"]))
    figure = _figure(3.0 + 2.6 * max(len(outputs), 1), 1.6 + 0.5 * len(names), title)
    if not outputs:
        figure.text(0.5, 0.5, "too few samples differ from the others", ha="center", color="0.3")
        return save_figure(figure, path)
    row = np.atleast_1d(figure.subplots(1, len(outputs), sharey=True))
    y = np.arange(len(names), dtype=float)
    for axes, output in zip(row, outputs, strict=True):
        rows = indices[indices["output"] == output].set_index("parameter").loc[names]
        for kind, colour, shift in (("first", _FIRST, -0.14), ("total", _TOTAL, 0.14)):
            known = rows[kind].notna().to_numpy()
            if not indices[kind].notna().any():
                continue
            axes.errorbar(
                rows[kind][known], y[known] + shift, xerr=rows[f"{kind}_error"][known], fmt="o", ms=5, color=colour,
                capsize=3, lw=1.2, label={"first": "alone", "total": "with all others"}[kind],
            )  # fmt: skip
        axes.axvline(0.0, color="0.3", lw=0.9)
        axes.set_xlim(-0.12, 1.12)
        axes.set_title(_output_name(output), fontsize=9)
        axes.set_xlabel("share of variance")
        axes.grid(True, color="0.92", lw=0.6)
    row[0].set_yticks(y, [figure_text(short_name(name)) for name in names])
    row[0].set_ylim(len(names) - 0.5, -0.5)
    handles, labels = row[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=2, frameon=False, fontsize=9)
    return save_figure(figure, path)


def _output_name(output: str) -> str:
    if output == "unstable":
        return "instability at all"
    if output == "worst_re":
        return "largest growth"
    low, high = output.split("_")[1:3]
    return f"instability in {float(low) / 1e3:g} – {float(high) / 1e3:g} kHz"
