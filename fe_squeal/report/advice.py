"""Advice from a study: fitted orders, and which setting meets a target in the least time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

QUANTITIES = {"error_frequency": "frequencies", "error_growth": "growth rates", "error_onset": "critical values"}
TARGETS = (0.05, 0.02, 0.01)
@dataclass(frozen=True)
class Line:
    """What a line of the charts joins: the settings of a study that differ in one thing, the order apart."""

    knob: str
    order: int | None
    label: str
    mark: str
    colour: str | None = None


LINES = (
    Line("size", 1, "size, order 1", "o", "#0072b2"), Line("size", 2, "size, order 2", "s", "#d55e00"),
    Line("method", None, "direct", "D"), Line("modes", None, "modes, modal projection", "^"),
    Line("tolerance", None, "tolerance, reduced", "v"),
)  # fmt: skip
_FITTED = 3  # finest sizes that a rate is fitted to


def fitted(frame: pd.DataFrame, order: int, quantity: str) -> float | None:
    """Return r of error = a · size^r, fitted to the finest sizes of one order; None where fewer than two are known."""
    rows = frame[(frame["knob"] == "size") & (frame["order"] == order)].sort_values("size")
    rows = rows[np.isfinite(rows[quantity]) & (rows[quantity] > 0) & (rows[quantity] < 1)]  # 1: not found
    fine = rows.iloc[:_FITTED]
    if len(fine) < 2:
        return None
    rate, _ = np.polyfit(np.log(fine["size"].to_numpy(float)), np.log(fine[quantity].to_numpy(float)), 1)
    return float(rate)


def lines_of(frame: pd.DataFrame) -> Iterator[tuple[Line, pd.DataFrame]]:
    """Yield each line of the charts with its rows: what the study varies, in each order where that is the size."""
    for line in LINES:
        rows = frame[frame["knob"] == line.knob]
        rows = rows if line.order is None else rows[rows["order"] == line.order]
        if len(rows):
            yield line, rows


def pareto(frame: pd.DataFrame, quantity: str) -> np.ndarray:
    """Return which rows (n,) bool no other row beats in both time and error."""
    seconds, error = frame["seconds"].to_numpy(float), frame[quantity].to_numpy(float)
    beaten = (seconds[None, :] <= seconds[:, None]) & (error[None, :] <= error[:, None])
    beaten &= (seconds[None, :] < seconds[:, None]) | (error[None, :] < error[:, None])
    return np.asarray(np.isfinite(error) & ~beaten.any(axis=1))


def advice(frame: pd.DataFrame, quantity: str) -> list[str]:
    """Return a sentence per target: the cheapest order and size that was measured to meet it, and the other order's.

    Nothing is extrapolated: where no row of the table meets a target, the nearest one is named.
    """
    rows = frame[(frame["knob"] == "size") & np.isfinite(frame[quantity])]
    return [_advised(rows, target, quantity) for target in TARGETS]


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
    return f"order {int(row['order'])}, {_millimetres(float(row['size']))}, {_seconds(float(row['seconds']))} ({error})"


def _millimetres(size: float) -> str:
    return f"{1e3 * size:.3g} mm"


def _seconds(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 100 else f"{seconds:.0f} s"
