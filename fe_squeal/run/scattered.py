"""Make a scatter, and write its tables and figures, and its fastest growing samples as scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from ..problem.parameters import paths_of
from ..problem.problem import Problem
from ..report.files import replace_atomically, write_csv
from ..report.study import driving, plot_indices, plot_probability, plot_scatter
from ..scene import MatrixScene, Scene, with_numbers
from ..scene.numbers import GEOMETRY
from ..scene.study import StudySection
from ..scene.writing import scene_text
from ..study.models import without_file
from ..study.scatter import SAMPLES, ScatterResult, scatter
from .folder import (
    BANDS_TABLE,
    DANGEROUS,
    INDICES_FIGURE,
    INDICES_TABLE,
    PROBABILITY_FIGURE,
    SAMPLES_TABLE,
    SCATTER_FIGURE,
    UNSTABLE_TABLE,
)

_DANGEROUS = 5  # samples that are written as scenes


def scattered(
    scene: Scene | MatrixScene, section: StudySection, problem: Problem, options: dict[str, Any], out: Path,
    console: Console,
) -> dict[str, Any]:  # fmt: skip
    """Make a scatter and write its tables, figures and scenes; return the entries that study.json has about it."""
    result = scatter(
        problem, section.parameters, section.samples or SAMPLES, section.seed, section.correlation, section.bands,
        indices=section.indices, **options,
    )  # fmt: skip
    samples, modes, bands, indices = result.samples, result.unstable_modes, result.bands, result.indices
    names = (SAMPLES_TABLE, UNSTABLE_TABLE, BANDS_TABLE, INDICES_TABLE)
    for frame, name in zip((samples, modes, bands, indices), names, strict=True):
        write_csv(frame, out / name)
    driver = driving(indices, "unstable") or driving(indices, "worst_re") or result.names[0]
    plot_probability(bands, out / PROBABILITY_FIGURE, scene.title, result.known_hz)
    plot_scatter(samples, modes, driver, out / SCATTER_FIGURE, scene.title)
    plot_indices(indices, out / INDICES_FIGURE, scene.title)
    dangerous = _write_dangerous(scene, result, out)
    whole = bands.iloc[-1]
    known = f", up to {result.known_hz:.4g} Hz" if np.isfinite(result.known_hz) else ""
    console.print(
        f"unstable with a probability of {100 * whole['probability']:.3g} % (95 %: {100 * whole['lower']:.3g} to"
        f" {100 * whole['upper']:.3g} %), by {len(samples)} samples{known}",
        markup=False,
    )
    if known:
        console.print(f"above {result.known_hz:.4g} Hz not all modes were solved for", markup=False)
    for row in bands.iloc[:-1].to_dict("records"):
        if row["probability"] > 0:
            console.print(
                f"  {row['low_hz']:g} to {row['high_hz']:g} Hz: {100 * row['probability']:.3g} %"
                f" ({100 * row['lower']:.3g} to {100 * row['upper']:.3g} %)",
                markup=False,
            )
    if 0 < whole["probability"] < 1:
        console.print(f"driven most by {driver}", markup=False)
    console.print(result.solver.why, markup=False)
    worst = [samples[name].quantile([0.05, 0.5, 0.95]).tolist() for name in ("worst_re", "worst_damping_ratio")]
    return {
        "samples": len(samples), "parameters": list(result.names), "method": result.solver.why,
        "solved_directly": int((samples["method"] == "direct").sum()), "tolerance": section.tolerance,
        "largest_error": float(samples["error"].max()), "probability": result.probability, "driver": driver,
        "known_hz": result.known_hz if np.isfinite(result.known_hz) else None,
        "worst_re_quantiles": worst[0], "worst_damping_ratio_quantiles": worst[1], "dangerous": dangerous,
    }  # fmt: skip


def _write_dangerous(scene: Scene | MatrixScene, result: ScatterResult, out: Path) -> list[str]:
    """Write the samples that grow fastest as scene files, and return the names of these."""
    names = []
    for i in result.dangerous(_DANGEROUS):
        moved = {p: float(v) for n, v in zip(result.names, result.points[i], strict=True) for p in paths_of(n)}
        name = f"{DANGEROUS}/sample_{i + 1:05d}.toml"
        sample = with_numbers(scene, moved)
        if isinstance(sample, Scene) and any(path.startswith(GEOMETRY) for path in moved):
            sample = without_file(sample)
        text = scene_text(sample, out / DANGEROUS)
        with replace_atomically(out / name) as temporary:
            temporary.write_text(f"# sample {i + 1}: Re λ = {result.rows[i, 1]:.4g} 1/s\n{text}", encoding="utf-8")
        names.append(name)
    return names
