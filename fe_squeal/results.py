"""What a run writes: tables, figures, shapes and the record of the run."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from .eigen.linear_solvers import solver_name
from .onset import Onset
from .preload_results import model_grid, preload_dataframe, preload_record
from .problem import Problem
from .report import export_shapes as _export
from .report import (
    plot_contributions,
    plot_root_locus,
    plot_stability,
    replace_atomically,
    shape_name,
    write_csv,
    write_json,
)
from .scene import MatrixScene, Scene
from .sweep import sweep
from .sweep_result import Sweep, SweepPoint


def find_onsets(problem: Problem, values: np.ndarray, parameter: str = "mu", modes: int = 20) -> tuple[Onset, ...]:
    """Return the critical values of a parameter between the first and the last of the given values, to full precision.

    Parameters
    ----------
    values : (m,) float, increasing
        Where modes are solved for; critical values are refined between them.
    """
    return sweep(problem, values, parameter, modes=modes, precise=True).onsets


def export_shapes(result: Sweep, folder: str | Path, which: str = "unstable") -> list[Path]:
    """Write complex mode shapes for ParaView, with a picture each; those of matrices from files as arrays (.npz).

    Parameters
    ----------
    which : "unstable" or "all"
        Every branch that becomes unstable, at the value where it grows fastest; or also every mode at the last value,
        for which the sweep has to be made with keep_shapes=True.

    Returns
    -------
    list of Path
    """
    model = result.problem.model
    chosen = _fastest_growing(result)
    if which == "all":
        last = result.points[-1]
        chosen += [(last, i) for i in last.shapes if not any(p is last and i == j for p, j in chosen)]
    if not chosen:
        return []
    if model is None:
        return [_write_array(result, point, i, Path(folder)) for point, i in chosen]
    shapes = [_shape(result, point, i) for point, i in chosen]
    axis = next((tuple(c.normals.mean(axis=0)) for c in model.contacts.values()), (0.0, 0.0, 1.0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RuntimeWarning)
        files = _export(model_grid(model), shapes, folder, axis=axis)
    for warning in caught:
        print(f"pictures: {warning.message}", file=sys.stderr)
    return files


def write_tables(result: Sweep, out: Path) -> None:
    """Write modes.csv, onsets.csv, contributions.csv and sensitivities.csv."""
    write_modes(result, out)
    write_csv(result.contributions_dataframe(), out / "contributions.csv")
    write_csv(result.sensitivities_dataframe(), out / "sensitivities.csv")
    pressed = preload_dataframe(result)
    if pressed is not None:
        write_csv(pressed, out / "preload.csv")


def write_modes(result: Sweep, out: Path) -> None:
    """Write modes.csv and onsets.csv alone, which ask for no shapes."""
    write_csv(result.to_dataframe(), out / "modes.csv")
    write_csv(result.onsets_dataframe(), out / "onsets.csv")


def write_figures(result: Sweep, out: Path, title: str) -> list[Path]:
    """Draw stability.png, root_locus.png and contributions.png."""
    modes, onsets = result.to_dataframe(), result.onsets_dataframe()
    return [
        plot_stability(modes, onsets, out / "stability.png", title),
        plot_root_locus(modes, onsets, out / "root_locus.png", title),
        plot_contributions(result.contributions_dataframe(), modes, out / "contributions.png", title),
    ]


def write_record(
    scene: Scene | MatrixScene, problem: Problem, result: Sweep | None, seconds: dict[str, float], status: str,
    inputs: Mapping[str, Any], out: Path,
) -> None:  # fmt: skip
    """Write run.json; whence the growth comes is left out of that of a run that goes on.

    Parameters
    ----------
    status : "running", "complete", "interrupted" or "not converged"
    inputs : mapping
        See `run_inputs`.
    """
    model = problem.model
    record: dict[str, Any] = {
        "version": inputs["version"],
        "title": scene.title,
        "scene": str(scene.source) if scene.source is not None else None,
        "status": status,
        "unknowns": problem.unknowns,
        "problem_class": problem.problem_class,
        "effects": list(scene.effect_names),
        "terms": [{"name": t.name, "slot": t.slot, "powers": dict(t.powers)} for t in problem.terms],
        "method": result.method if result is not None else None,
        "linear_solver": solver_name(),
        "seconds": seconds,
        "peak_memory_mib": peak_memory_mib(),
        "completeness": result.completeness if result is not None else None,
        "completeness_at": result.points[0].value if result is not None else None,
        "rigid_motions": int(np.count_nonzero(result.points[0].modes.lam == 0)) if result is not None else None,
        "values": [p.value for p in result.points] if result is not None else [],
        "contacts": {
            name: {"area_m2": c.area, "coverage": c.coverage, "largest_gap_m": float(np.abs(c.separation).max())}
            for name, c in (model.contacts if model is not None else {}).items()
        },
        "preload": preload_record(scene, problem),
        "unstable": _attribution(result) if result is not None and status != "running" else [],
        "notes": list(model.notes) if model is not None else [],
        "warnings": (list(model.warnings) if model is not None else []) + (list(result.doubts) if result else []),
        "inputs": inputs,
    }
    write_json(record, out / "run.json")


def peak_memory_mib() -> float | None:
    """Return the largest resident memory of this process so far, MiB; None where the system does not tell."""
    with suppress(OSError, ValueError, IndexError):
        # What getrusage tells on Linux begins with the memory of the process that started this one.
        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
        return float(status.split("VmHWM:")[1].split()[0]) / 1024
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak) / (1024**2 if sys.platform == "darwin" else 1024)


def _fastest_growing(result: Sweep) -> list[tuple[SweepPoint, int]]:
    best: dict[int, tuple[SweepPoint, int]] = {}
    for point in result.points:
        for i in np.flatnonzero(point.modes.stability == "unstable"):
            branch, growth = int(point.branches[i]), point.modes.lam[i].real
            if branch not in best or growth > best[branch][0].modes.lam[best[branch][1]].real:
                best[branch] = (point, int(i))
    return [best[b] for b in sorted(best)]


def _attribution(result: Sweep) -> list[dict[str, Any]]:
    """Return for each unstable branch, where it grows fastest, whence its growth comes and what moves it."""
    found = []
    for point, i in _fastest_growing(result):
        shares = result.balance(point, i)
        moves = point.sensitivities.get(i, {})
        found.append({
            **_info(result, point, i),
            "re_shares": {name: s.growth for name, s in shares.items() if s.growth},
            "energy_shares": {name: s.energy for name, s in shares.items() if np.isfinite(s.energy)},
            "sensitivities": {path: {"at": at, "dre": d.real, "dim": d.imag} for path, (at, d) in moves.items()},
        })  # fmt: skip
    return found


def _info(result: Sweep, point: SweepPoint, i: int) -> dict[str, Any]:
    lam = point.modes.lam[i]
    return {
        "parameter": result.parameter, "value": point.value, "mode": i + 1, "branch": int(point.branches[i]),
        "re": lam.real, "im": lam.imag, "frequency_hz": point.modes.frequency_hz[i],
    }  # fmt: skip


def _shape(result: Sweep, point: SweepPoint, i: int) -> tuple[str, np.ndarray, dict[str, Any]]:
    assert result.problem.model is not None
    info = _info(result, point, i)
    return shape_name(info), result.problem.model.space.expand(point.shapes[i]), info


def _write_array(result: Sweep, point: SweepPoint, i: int, folder: Path) -> Path:
    """Write a shape (n,) complex as the array `u` of an .npz file, with what it belongs to beside it."""
    info = _info(result, point, i)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{shape_name(info)}.npz"
    with replace_atomically(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, u=point.shapes[i], **info)
    return path
