"""What a study teaches: fitted orders, and which setting meets a target for the least time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import nnls

QUANTITIES = {"error_frequency": "frequencies", "error_growth": "growth rates", "error_onset": "critical values"}
TARGETS = (0.05, 0.02, 0.01)
_FITTED = 3  # finest sizes that a rate is fitted to
# Times of small problems are those of what is done once; with the size they grow like unknowns^1.17 in the end.
_GROWTH = 3.5
_BEYOND = 4.0  # times the range of sizes: how far a fit is trusted


@dataclass(frozen=True)
class Fit:
    """error = a · size^rate and seconds = fixed + work · size^−3.5, of one order.

    Attributes
    ----------
    rate : float
    error : float
        At the size 1 m.
    fixed, work : float, s
    low, high : float, m
        Sizes that were measured.
    """

    order: int
    rate: float
    error: float
    fixed: float
    work: float
    low: float
    high: float

    def size_for(self, target: float) -> float:
        """Return the size at which the error is a target; NaN where it does not fall, or far beyond what is known."""
        if not self.rate > 0.2:
            return np.nan
        size = float((target / self.error) ** (1 / self.rate))
        return size if size >= self.low / _BEYOND else np.nan

    def seconds_for(self, size: float) -> float:
        """Return the time at a size."""
        return float(self.fixed + self.work * min(size, self.high) ** -_GROWTH)


def fitted(frame: pd.DataFrame, order: int, quantity: str) -> Fit | None:
    """Return the fit of errors and times of one order to its finest sizes; None where fewer than two tell anything."""
    rows = frame[frame["knob"].astype(str).eq(f"size, order {order}")].sort_values("size")
    growth = rows["size"].to_numpy(float) ** -_GROWTH
    times = rows["seconds"].to_numpy(float)
    rows = rows[np.isfinite(rows[quantity]) & (rows[quantity] > 0) & (rows[quantity] < 1)]  # 1: what is not found
    fine = rows.iloc[:_FITTED]
    if len(fine) < 2:
        return None
    size = np.log(fine["size"].to_numpy(float))
    rate, error = np.polyfit(size, np.log(fine[quantity].to_numpy(float)), 1)
    (fixed, work), _ = nnls(np.column_stack([1 / times, growth / growth.max() / times]), np.ones(len(times)))
    low, high = float(rows["size"].min()), float(rows["size"].max())
    return Fit(order, float(rate), float(np.exp(error)), float(fixed), float(work / growth.max()), low, high)


def pareto(frame: pd.DataFrame, quantity: str) -> np.ndarray:
    """Return which rows (n,) bool no other row beats in both time and error."""
    seconds, error = frame["seconds"].to_numpy(float), frame[quantity].to_numpy(float)
    beaten = (seconds[None, :] <= seconds[:, None]) & (error[None, :] <= error[:, None])
    beaten &= (seconds[None, :] < seconds[:, None]) | (error[None, :] < error[:, None])
    return np.asarray(np.isfinite(error) & ~beaten.any(axis=1))


def advice(frame: pd.DataFrame, quantity: str) -> list[str]:
    """Return a sentence per target: the cheapest order and size, and what the other order would take."""
    fits = [f for f in (fitted(frame, order, quantity) for order in (1, 2)) if f is not None]
    sentences = []
    for target in TARGETS:
        options = []
        for fit in fits:
            size = fit.size_for(target)
            if np.isfinite(size):
                options.append((fit.seconds_for(size), min(size, fit.high), fit, size < fit.low))
        if not options:
            sentences.append(f"{100 * target:g} % on {QUANTITIES[quantity]}: nothing that was measured leads there.")
            continue
        options.sort(key=lambda o: o[0])
        parts = [
            f"order {fit.order}, {_millimetres(size)}, {'about ' if beyond else ''}{_seconds(seconds)}"
            + (" (extrapolated)" if beyond else "")
            for seconds, size, fit, beyond in options
        ]
        other = f"; {parts[1].replace(',', ' would need', 1)}" if len(parts) > 1 else ""
        missing = [f.order for f in fits if not np.isfinite(f.size_for(target))]
        other += "".join(f"; order {order} shows no rate that leads there" for order in missing)
        rough = [order for order in (1, 2) if order in set(frame["order"]) and order not in [f.order for f in fits]]
        other += "".join(f"; order {order} is too far off on all these meshes" for order in rough)
        sentences.append(f"{100 * target:g} % on {QUANTITIES[quantity]}: {parts[0]}{other}.")
    return sentences


def _millimetres(size: float) -> str:
    return f"{1e3 * size:.3g} mm"


def _seconds(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 100 else f"{seconds:.0f} s"
