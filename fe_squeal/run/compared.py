"""Compare measured squeal with computed modes: the unstable mode nearest to each frequency, and the MAC of shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..assembly.discretisation import discretisation_of
from ..report.advice import size_text
from ..report.branches import frequency_text, parameter_symbol
from ..report.mac import mac, nearest_nodes
from ..report.shapes import boundary_triangles
from ..sweep.result import Sweep
from .measured import Frequency, Measurements, TestShape
from .preload import grid_of

_FEWEST = 3  # measured points of a shape: with fewer a MAC means nothing
MAC_COLUMNS = ("measured", "measured_hz", "parameter", "value", "mode", "branch", "frequency_hz", "stability", "mac",
               "points")  # fmt: skip


def nearest_unstable(frequency: Frequency, modes: pd.DataFrame) -> dict[str, Any] | None:
    """Return the row of modes.csv of the unstable mode nearest to a measured frequency; None if no mode is unstable."""
    unstable = modes[(modes["stability"] == "unstable") & (modes["frequency_hz"] > 0)]
    if not len(unstable):
        return None
    row = unstable.iloc[int(np.argmin(np.abs(unstable["frequency_hz"].to_numpy(float) - frequency.hz)))]
    return {str(k): v for k, v in row.to_dict().items()}


def measured_record(
    measured: Measurements, result: Sweep, covered: tuple[float, float | None]
) -> list[dict[str, Any]]:  # fmt: skip
    """Return each measured frequency with its nearest unstable mode and a sentence, for run.json and the page.

    `covered` is the range, Hz, in which all modes are known, see `frequency_range`.
    """
    if not measured.frequencies:
        return []
    modes, found = result.to_dataframe(), []
    for frequency in measured.frequencies:
        row = nearest_unstable(frequency, modes)
        entry: dict[str, Any] = {
            "frequency_hz": frequency.hz, "level_db": frequency.level_db, "label": frequency.label, "nearest": None,
        }  # fmt: skip
        name = f"Measured {frequency_text(frequency.hz)}"
        known = [frequency.label, f"{frequency.level_db:g} dB" if frequency.level_db is not None else ""]
        name += f" ({', '.join(t for t in known if t)})" if any(known) else ""
        if row is None:
            entry["sentence"] = f"{name}: no mode is unstable in this sweep."
        else:
            percent = 100 * (row["frequency_hz"] / frequency.hz - 1)
            entry["nearest"] = {"branch": int(row["branch"]), "value": row["value"], "mode": int(row["mode"]),
                                "frequency_hz": row["frequency_hz"], "distance_percent": percent}  # fmt: skip
            side = "above" if percent > 0 else "below"
            entry["sentence"] = (
                f"{name}: the nearest unstable mode is branch {int(row['branch'])} at"
                f" {frequency_text(row['frequency_hz'])}, {abs(percent):.2g} % {side}"
                f" ({parameter_symbol(result.parameter)} = {row['value']:.4g})."
            )
        if frequency.hz < covered[0]:
            entry["sentence"] += (
                f" It lies below {frequency_text(covered[0])}, from which on modes are known: strong dampers let direct"
                " solves see no farther down."
            )
        if covered[1] is not None and frequency.hz > covered[1]:
            entry["sentence"] += (
                f" It lies above {frequency_text(covered[1])}, up to which modes are known: ask for more modes, or for"
                " a higher solve.max_frequency."
            )
        found.append(entry)
    return found


def mac_table(measured: Measurements, result: Sweep) -> tuple[pd.DataFrame | None, list[str]]:
    """Return a table of the MAC of every measured shape with every known shape, and sentences on points left out.

    The shapes of all modes at the last value are known, and those of unstable modes at all values. The table has the
    columns `MAC_COLUMNS`; it is None if no shape was measured.
    """
    model = discretisation_of(result.problem)
    if not measured.shapes or model is None:
        return None, []
    grid = grid_of(model)
    surface = np.unique(boundary_triangles(grid)[0])
    said: list[str] = []
    near = [_matched(shape, grid.points[surface], measured.units, said) for shape in measured.shapes]
    rows = []
    for point in result.points:
        for i in sorted(point.shapes):
            u = model.space.expand(point.shapes[i])[surface]
            for shape, (points, nodes) in zip(measured.shapes, near, strict=True):
                if len(points) < _FEWEST:
                    continue
                along = np.einsum("pij,pj->pi", shape.axes[points], u[nodes])
                value = mac(shape.u[points], along)
                rows.append((
                    shape.label, shape.hz, result.parameter, point.value, i + 1, int(point.branches[i]),
                    point.modes.frequency_hz[i], point.modes.stability[i], value, len(points),
                ))  # fmt: skip
    return pd.DataFrame(rows, columns=list(MAC_COLUMNS)), said


def _matched(shape: TestShape, nodes: np.ndarray, units: str, said: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of a shape that are compared and the node of each; say which are not, and why it has no MAC."""
    own = np.flatnonzero(np.isfinite(shape.u).any(axis=1))
    near, found = nearest_nodes(shape.points[own], nodes, shape.distance)
    points, lost = own[near], len(own) - len(near)
    few, name = len(points) < _FEWEST, f"measured shape {shape.label}"
    if lost:
        said.append(
            f"{name}: {lost} of {len(own)} points have no node of the surface within {size_text(shape.distance, units)}"
            + ("; that leaves too few for a MAC: check axes, origin and length_unit" if few else " and are left out")
        )
    elif few:
        said.append(
            f"{name}: displacements at {len(own)} points are too few for a MAC; expected {_FEWEST} points or more"
        )
    if not few and not np.nan_to_num(shape.u[points]).any():
        said.append(f"{name}: all displacements are zero, so it has no MAC")
    return points, found
