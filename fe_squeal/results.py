"""What a run writes: tables, figures, shapes and the record of the run."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import skfem

from .eigen.linear_solvers import solver_name
from .onset import Onset
from .problem import Problem
from .report import ShapeGrid, plot_root_locus, plot_stability, shape_grid, shape_name, write_csv, write_json
from .report import export_shapes as _export
from .scene import Scene
from .sweep import sweep
from .sweep_result import Sweep, SweepPoint


def find_onsets(problem: Problem, values: np.ndarray, parameter: str = "mu", modes: int = 20) -> tuple[Onset, ...]:
    """Return the critical values of a parameter between the first and the last of the given values.

    Parameters
    ----------
    values : (m,) float, increasing
        Where modes are solved for; critical values are refined between them.
    """
    return sweep(problem, values, parameter, modes=modes).onsets


def export_shapes(result: Sweep, folder: str | Path, which: str = "unstable") -> list[Path]:
    """Write complex mode shapes for ParaView, with a picture each.

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
    if model is None:
        raise ValueError("the problem has no mesh to draw shapes on")
    chosen = _fastest_growing(result)
    if which == "all":
        last = result.points[-1]
        chosen += [(last, i) for i in last.shapes if not any(p is last and i == j for p, j in chosen)]
    shapes = [_shape(result, point, i) for point, i in chosen]
    if not shapes:
        return []
    axis = next((tuple(c.normals.mean(axis=0)) for c in model.contacts.values()), (0.0, 0.0, 1.0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RuntimeWarning)
        files = _export(_grid(result.problem), shapes, folder, axis=axis)
    for warning in caught:
        print(f"pictures: {warning.message}", file=sys.stderr)
    return files


def write_tables(result: Sweep, out: Path) -> None:
    """Write modes.csv, onsets.csv and contributions.csv."""
    write_csv(result.to_dataframe(), out / "modes.csv")
    write_csv(result.onsets_dataframe(), out / "onsets.csv")
    write_csv(result.contributions_dataframe(), out / "contributions.csv")


def write_figures(result: Sweep, out: Path, title: str) -> list[Path]:
    """Draw stability.png and root_locus.png."""
    modes, onsets = result.to_dataframe(), result.onsets_dataframe()
    return [
        plot_stability(modes, onsets, out / "stability.png", title),
        plot_root_locus(modes, onsets, out / "root_locus.png", title),
    ]


def write_record(
    scene: Scene, problem: Problem, result: Sweep | None, seconds: dict[str, float], status: str, out: Path, version:
    str
) -> None:
    """Write run.json."""
    model = problem.model
    record: dict[str, Any] = {
        "version": version,
        "title": scene.title,
        "scene": str(scene.source) if scene.source is not None else None,
        "status": status,
        "unknowns": problem.unknowns,
        "problem_class": problem.problem_class,
        "effects": list(scene.effects.names),
        "terms": [{"name": t.name, "slot": t.slot, "powers": dict(t.powers)} for t in problem.terms],
        "method": result.method if result is not None else None,
        "linear_solver": solver_name(),
        "seconds": seconds,
        "peak_memory_mib": peak_memory_mib(),
        "completeness": result.completeness if result is not None else None,
        "completeness_at": result.points[0].value if result is not None else None,
        "values": [p.value for p in result.points] if result is not None else [],
        "contacts": {
            name: {"area_m2": c.area, "coverage": c.coverage, "largest_gap_m": float(np.abs(c.separation).max())}
            for name, c in (model.contacts if model is not None else {}).items()
        },
        "notes": list(model.notes) if model is not None else [],
        "warnings": (list(model.warnings) if model is not None else []) + (list(result.doubts) if result else []),
    }
    write_json(record, out / "run.json")


def peak_memory_mib() -> float | None:
    """Return the largest resident memory of this process so far, MiB; None where the system does not tell."""
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


def _shape(result: Sweep, point: SweepPoint, i: int) -> tuple[str, np.ndarray, dict[str, Any]]:
    lam = point.modes.lam[i]
    info = {
        "parameter": result.parameter, "value": point.value, "mode": i + 1, "branch": int(point.branches[i]),
        "re": lam.real, "im": lam.imag, "frequency_hz": point.modes.frequency_hz[i],
    }  # fmt: skip
    assert result.problem.model is not None
    return shape_name(info), result.problem.model.space.expand(point.shapes[i]), info


def _grid(problem: Problem) -> ShapeGrid:
    assert problem.model is not None
    space, bodies = problem.model.space, problem.model.bodies
    basis = skfem.CellBasis(space.mesh, space.element, intorder=1, dofs=space.dofs)
    owner = np.zeros(space.mesh.nelements, int)
    for number, elements in enumerate(bodies.values()):
        owner[elements] = number
    return shape_grid(basis, owner, tuple(bodies))
