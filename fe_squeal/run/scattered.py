"""Make a scatter, and write its tables and figures, and its fastest growing samples as scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from ..problem.parameters import paths_of
from ..problem.problem import Problem
from ..report.files import encodable, replace_atomically, write_csv
from ..report.study import driving, plot_indices, plot_probability, plot_scatter, without_modes_text
from ..scene import MatrixScene, Scene, with_numbers
from ..scene.numbers import GEOMETRY
from ..scene.study import StudySection
from ..scene.writing import scene_text
from ..study.models import without_file
from ..study.scatter import SAMPLES, scatter
from ..study.scatter_result import ScatterResult
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
    driver = driving(indices, "unstable") or driving(indices, "worst_re")
    known, lower, upper = (float(bands[name].iloc[-1]) for name in ("probability", "lower", "upper"))
    found = result.found
    beyond = found if found[0] > known else None  # with what is found where not all modes are known
    plot_probability(bands, out / PROBABILITY_FIGURE, scene.title, result.known_hz, beyond)
    plot_scatter(samples, modes, driver or result.names[0], out / SCATTER_FIGURE, scene.title)
    plot_indices(indices, out / INDICES_FIGURE, scene.title)
    dangerous = _write_dangerous(scene, result, out, console)
    unstable = int(samples["unstable"].sum())
    for sentence in _told(result, known, lower, upper, unstable):
        console.print(sentence, markup=False)
    for row in bands.iloc[:-1].to_dict("records"):
        if row["probability"] > 0:
            console.print(
                f"  {row['low_hz']:g} to {row['high_hz']:g} Hz: {100 * row['probability']:.3g} %"
                f" ({100 * row['lower']:.3g} to {100 * row['upper']:.3g} %)",
                markup=False,
            )
    if driver is not None and 0 < result.probability < 1:
        console.print(f"driven most by {driver}", markup=False)
    console.print(result.solver.why, markup=False)
    empty = int(samples["worst_re"].isna().sum())
    if empty:
        console.print(without_modes_text(empty, len(samples)), markup=False)
    worst = [samples[name].quantile([0.05, 0.5, 0.95]).tolist() for name in ("worst_re", "worst_damping_ratio")]
    return {
        "samples": len(samples), "parameters": list(result.names), "method": result.solver.why,
        "solved_directly": int((samples["method"] == "direct").sum()), "tolerance": section.tolerance,
        "largest_error": float(samples["error"].max()), "unstable_samples": unstable,
        "probability": result.probability, "probability_interval": list(found[1:]),
        "known_hz": result.known_hz if np.isfinite(result.known_hz) else None,
        "known_probability": known, "known_probability_interval": [lower, upper], "driver": driver,
        "samples_without_modes": empty,
        "worst_re_quantiles": worst[0], "worst_damping_ratio_quantiles": worst[1], "dangerous": dangerous,
    }  # fmt: skip


def _told(result: ScatterResult, known: float, lower: float, upper: float, unstable: int) -> list[str]:
    """Return sentences on the probability of instability, given that of the whole range, and the unstable samples."""
    count, (found, *interval), ends = len(result.rows), result.found, _percent(lower, upper)
    if not np.isfinite(result.known_hz):
        return [f"unstable with a probability of {100 * known:.3g} % ({ends}), by {count} samples"]
    above = f"above {result.known_hz:.4g} Hz not all modes were solved for"
    if found == known:
        said = f"unstable with a probability of {100 * known:.3g} % ({ends}), by {count} samples"
        return [f"{said}, up to {result.known_hz:.4g} Hz", above]
    least = "at least " if found < 1 else ""
    return [
        f"unstable with a probability of {least}{100 * found:.3g} % ({_percent(*interval)}): {unstable} of"
        f" {count} samples have an unstable mode among those solved for",
        f"up to {result.known_hz:.4g} Hz, where all modes are known, the probability is {100 * known:.3g} % ({ends})",
        above,
    ]


def _percent(lower: float, upper: float) -> str:
    return f"95 %: {100 * lower:.3g} to {100 * upper:.3g} %"


def _write_dangerous(scene: Scene | MatrixScene, result: ScatterResult, out: Path, console: Console) -> list[str]:
    """Write the samples that grow fastest as scene files, and return the names of these."""
    names = []
    for i in result.dangerous(_DANGEROUS):
        moved = {p: float(v) for n, v in zip(result.names, result.points[i], strict=True) for p in paths_of(n)}
        name = f"{DANGEROUS}/sample_{i + 1:05d}.toml"
        sample = with_numbers(scene, moved)
        if isinstance(sample, Scene) and any(path.startswith(GEOMETRY) for path in moved):
            sample = without_file(sample)
        text = scene_text(sample, out / DANGEROUS)
        if encodable(text) != text:
            console.print("note: no sample is written as a scene: a folder on the way has a name not in UTF-8")
            break
        with replace_atomically(out / name) as temporary:
            temporary.write_text(f"# sample {i + 1}: Re λ = {result.rows[i, 1]:.4g} 1/s\n{text}", encoding="utf-8")
        names.append(name)
    return names
