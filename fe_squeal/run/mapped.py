"""Make a map of stability, and write its tables and its figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console

from ..problem.problem import Problem
from ..report.branches import frequency_text
from ..report.files import write_csv
from ..report.map import plot_map
from ..scene import MatrixScene, Scene
from ..scene.study import StudySection
from ..study.map import stability_map
from .folder import BOUNDARIES_TABLE, MAP_FIGURE, MAP_TABLE


def mapped(
    scene: Scene | MatrixScene, section: StudySection, problem: Problem, options: dict[str, Any], out: Path,
    console: Console,
) -> dict[str, Any]:  # fmt: skip
    """Make a map and write its tables and its figure; return the entries that study.json has about it."""
    assert section.x is not None and section.y is not None
    result = stability_map(problem, section.x, section.y, **options)
    grid, boundaries = result.grid, result.boundaries
    write_csv(grid, out / MAP_TABLE)
    write_csv(boundaries, out / BOUNDARIES_TABLE)
    logs = section.x.scale == "log", section.y.scale == "log"
    plot_map(grid, boundaries, section.names, logs, out / MAP_FIGURE, scene.title)
    share = float((grid["unstable"] > 0).mean())
    console.print(f"{100 * share:.3g} % of {len(grid)} places are unstable", markup=False)
    for number, rows in boundaries.groupby("curve"):
        low, high = (frequency_text(hz) for hz in (rows["frequency_hz"].min(), rows["frequency_hz"].max()))
        console.print(
            f"  boundary {number}: {rows['kind'].iloc[0]}, {low} to {high}, {len(rows)} points, each sure to"
            f" {rows['uncertainty'].max():.0e} of the map's width",
            markup=False,
        )
    for sentence in (result.solver.why, *(f"note: {t}" for t in result.told)):
        console.print(sentence, markup=False)
    return {
        "parameters": list(section.names), "scales": [section.x.scale, section.y.scale], "method": result.solver.why,
        "tolerance": section.tolerance, "largest_error": float(grid["error"].max()), "unstable_share": share,
        "curves": [
            {"points": len(c.points), "closed": c.closed, "ends": list(c.ends)} for c in result.curves
        ],
        "not_followed": result.told,
    }  # fmt: skip
