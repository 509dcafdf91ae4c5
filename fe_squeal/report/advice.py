"""Advice from a study of accuracy: fitted orders of convergence, and the fastest setting that meets a target."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from fe_squeal.report.units import behind_comma, drawn_length, with_unit

QUANTITIES = {"error_frequency": "frequencies", "error_growth": "growth rates", "error_onset": "critical values"}
TARGETS = (0.05, 0.02, 0.01)  # relative errors that advice is given for


@dataclass(frozen=True)
class ChartLine:
    """A line of the charts: the settings of a study that differ only in the knob, and for the size have one order.

    Attributes
    ----------
    knob : str
        What is varied, as in the column `knob` of accuracy.csv.
    order : int or None
        Order of the elements; None if the line is not for one order alone.
    label : str
        Name in the legend.
    mark : str
        Matplotlib's marker.
    colour : str or None
    """

    knob: str
    order: int | None
    label: str
    mark: str
    colour: str | None = None


LINES = (
    ChartLine("size", 1, "size, order 1", "o", "#0072b2"), ChartLine("size", 2, "size, order 2", "s", "#d55e00"),
    ChartLine("size", 3, "size, order 3", "P", "#cc79a7"),
    ChartLine("adapted", 2, "adapted to the error, order 2", "*", "#009e73"),
    ChartLine("adapted", 3, "adapted to the error, order 3", "X", "#56b4e9"),
    ChartLine("method", None, "direct", "D"), ChartLine("modes", None, "modes, modal projection", "^"),
    ChartLine("tolerance", None, "tolerance, reduced", "v"),
)  # fmt: skip
_FITTED = 3  # sizes, the finest ones, that a rate is fitted to


def units_of(frame: pd.DataFrame) -> str:
    """Return the units of the sizes in a table: "SI", or "any" where the scene has others."""
    return "any" if "units" in frame and (frame["units"] == "any").any() else "SI"


def size_head(units: str) -> str:
    """Return the head of a column of sizes, in which they stand without their unit."""
    return behind_comma("size", "mm", units)


def size_text(size: float, units: str, unit: bool = True) -> str:
    """Return the size of elements in words: in mm, or in units that are not known as the scene has it.

    Parameters
    ----------
    size : float
        In m, or in the scene's unit of length.
    units : "SI" or "any"
    unit : bool
        Whether the text names the unit.
    """
    number = f"{drawn_length(units) * size:.3g}"
    return with_unit(number, "mm", units) if unit else number


def fitted(frame: pd.DataFrame, order: int, quantity: str) -> float | None:
    """Return r of error = a · size^r, fitted to the finest sizes of one order; None if fewer than two are known."""
    rows = frame[(frame["knob"] == "size") & (frame["order"] == order)].sort_values("size")
    rows = rows[np.isfinite(rows[quantity]) & (rows[quantity] > 0) & (rows[quantity] < 1)]  # 1 means: not found
    fine = rows.iloc[:_FITTED]
    if len(fine) < 2:
        return None
    rate, _ = np.polyfit(np.log(fine["size"].to_numpy(float)), np.log(fine[quantity].to_numpy(float)), 1)
    return float(rate)


def lost(frame: pd.DataFrame, quantity: str) -> str:
    """Return in words how many of what a quantity is of only one of the finest and the refined mesh has; "" if none.

    Examples
    --------
    >>> lost(pd.DataFrame({"lost_growth": [1, 1]}), "error_growth")
    '1 of them vanishes when the finest mesh is refined'
    >>> lost(pd.DataFrame({"lost_onset": [2, 2]}), "error_onset")
    '2 of them vanish or appear when the finest mesh is refined'
    """
    name = quantity.replace("error", "lost")
    count = float(frame[name].max()) if name in frame else 0.0
    verbs = ["vanishes", "appears"] if count == 1 else ["vanish", "appear"]
    verb = " or ".join(verbs if quantity == "error_onset" else verbs[:1])
    return f"{count:g} of them {verb} when the finest mesh is refined" if count > 0 else ""


def lines_of(frame: pd.DataFrame) -> Iterator[tuple[ChartLine, pd.DataFrame]]:
    """Yield each line of the charts with its rows of the table."""
    for line in LINES:
        rows = frame[frame["knob"] == line.knob]
        rows = rows if line.order is None else rows[rows["order"] == line.order]
        if len(rows):
            yield line, rows


def charted(frame: pd.DataFrame, quantity: str) -> np.ndarray:
    """Return the errors (n,) that the chart shows: those of a quantity, or those by the projection alone if larger.

    Where the error of a projection happens to cancel that of the mesh, the row is good by accident, on this mesh alone.
    """
    alone = quantity.replace("error", "algebraic")
    return np.asarray(np.maximum(frame[quantity], frame[alone].fillna(0.0)), float)


def pareto(frame: pd.DataFrame, quantity: str) -> np.ndarray:
    """Return (n,) bool, which rows are on the Pareto front: no other row has both less time and less error."""
    seconds, error = frame["seconds"].to_numpy(float), charted(frame, quantity)
    beaten = (seconds[None, :] <= seconds[:, None]) & (error[None, :] <= error[:, None])
    beaten &= (seconds[None, :] < seconds[:, None]) | (error[None, :] < error[:, None])
    return np.asarray(np.isfinite(error) & ~beaten.any(axis=1))


def advice(frame: pd.DataFrame, quantity: str) -> list[str]:
    """Return a sentence for each target: the fastest order and size that met it, and the fastest of the others.

    Nothing is extrapolated: if no row of the table meets a target, the row with the smallest error is named. A sentence
    says what is not known since the refined mesh does not have it. There is none where the table has no errors.
    """
    vanished, what = lost(frame, quantity), QUANTITIES[quantity].capitalize()
    if not frame[quantity].notna().any():
        return [f"{what}: not known: {vanished}."] if vanished else []
    rows = frame[frame["knob"].isin(["size", "adapted"]) & np.isfinite(frame[quantity])]
    told = [_advised(rows, target, quantity) for target in TARGETS]
    if vanished:
        told.append(f"{what}: {vanished}, so that what does has no known error: it is not compared.")
    return told


def _advised(rows: pd.DataFrame, target: float, quantity: str) -> str:
    what = f"{100 * target:g} % on {QUANTITIES[quantity]}"
    if not len(rows):
        return f"{what}: no mesh was measured."
    found = {order: own[own[quantity] <= target] for order, own in rows.groupby("order")}
    cheapest = [own.sort_values("seconds").iloc[0] for own in found.values() if len(own)]
    met = sorted(cheapest, key=lambda row: float(row["seconds"]))
    missed = [str(order) for order, own in found.items() if not len(own)]
    if not met:
        nearest = rows.sort_values([quantity, "seconds"]).iloc[0]
        return f"{what}: no mesh that was measured has it; nearest is {_told(nearest, quantity)}."
    parts = [_told(met[0], quantity), *(f"{_told(row, quantity)} has it as well" for row in met[1:])]
    parts += [f"order {order} does not have it on any mesh that was measured" for order in missed]
    return f"{what}: {'; '.join(parts)}."


def _told(row: pd.Series, quantity: str) -> str:
    error = f"{100 * float(row[quantity]):.2g} %"
    size = size_text(float(row["size"]), str(row.get("units", "SI"))) + (" adapted" if row["knob"] == "adapted" else "")
    return f"order {int(row['order'])}, {size}, {_seconds(float(row['seconds']))} ({error})"


def _seconds(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 100 else f"{seconds:.0f} s"
