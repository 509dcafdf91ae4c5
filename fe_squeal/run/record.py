"""The record of a run, run.json: what was run, how, and with which results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..assembly.discretisation import discretisation_of
from ..assembly.forces import balance_record, force_balance
from ..eigen.linear.factor import LinearSolver
from ..eigen.memory import peak_memory_mib
from ..problem.problem import Problem
from ..report.files import write_json
from ..scene import MatrixScene, Scene
from ..sweep.point import SweepPoint
from ..sweep.result import Sweep
from .checkpoint import read_json
from .compared import measured_record
from .covered import above_text, frequency_range, unstable_above
from .folder import RECORD
from .forces import scene_warnings
from .measured import NOTHING_MEASURED, Measurements
from .preload import preload_record
from .view import view_axis


def write_record(
    scene: Scene | MatrixScene, problem: Problem, result: Sweep | None, seconds: dict[str, float], status: str,
    inputs: Mapping[str, Any], solver: LinearSolver, out: Path, measured: Measurements = NOTHING_MEASURED,
    more_warnings: Sequence[str] = (), search: Mapping[str, Any] | None = None,
) -> None:  # fmt: skip
    """Write run.json.

    While a run is going on, the shares of terms in the growth rates are left out, since they take time.

    Parameters
    ----------
    scene : Scene or MatrixScene
    problem : Problem
    result : Sweep or None
        What was solved so far, if anything.
    seconds : dict of str to float, s
        Time by stage.
    status : "running", "complete", "interrupted" or "not converged"
    inputs : mapping
        What the results depend on, see `run_inputs`.
    solver : LinearSolver
        The solver that factorised the matrices.
    out : Path
        The folder.
    measured : Measurements
    more_warnings : sequence of str
        Warnings in addition to those of the scene and of the sweep.
    search : mapping, optional
        Where the mesh was searched for: the target, the trials, and what the search depends on.
    """
    discretisation, parts = discretisation_of(problem), force_balance(problem)
    swept = problem if result is None else result.problem  # which has the terms that are zero in the scene itself
    above = unstable_above(result) if result is not None else None
    record: dict[str, Any] = {
        "version": inputs["version"],
        "title": scene.title,
        "scene": str(scene.source) if scene.source is not None else None,
        "units": scene.units,
        "status": status,
        "unknowns": problem.unknowns,
        "problem_class": swept.problem_class,
        "effects": list(scene.effect_names),
        "terms": [{"name": t.name, "slot": t.slot, "powers": dict(t.powers)} for t in swept.terms],
        "method": result.method if result is not None else None,
        "linear_solver": solver.name,
        "seconds": seconds,
        "peak_memory_mib": peak_memory_mib(),
        "completeness": result.completeness if result is not None else None,
        "completeness_at": result.points[0].value if result is not None else None,
        "onsets_complete": result.onsets_complete if result is not None else None,
        "frequency_range_hz": frequency_range(scene, result) if result is not None else None,
        "unstable_above_range": above_text(above, result.parameter) if result and above else None,
        "rigid_motions": int(np.count_nonzero(result.points[0].modes.lam == 0)) if result is not None else None,
        "values": list(result.values) if result is not None else [],
        "contacts": {
            name: {"area_m2": c.area, "coverage": c.coverage, "largest_gap_m": float(np.abs(c.separation).max())}
            for name, c in (discretisation.contacts if discretisation is not None else {}).items()
        },
        "axis": {"direction": view_axis(discretisation)} if discretisation is not None else None,
        "preload": preload_record(scene, problem),
        "forces": balance_record(parts) if parts else None,
        "unstable": _unstable(result) if result is not None and status != "running" else [],
        "notes": [*(discretisation.notes if discretisation is not None else ()), *measured.notes],
        "warnings": [
            *scene_warnings(problem, parts), *(result.warnings if result is not None else ()), *more_warnings,
        ],
        "measured": [] if result is None else measured_record(measured, result, frequency_range(scene, result)),
        "inputs": inputs,
        **({} if search is None else {"search": search}),
    }
    write_json(record, out / RECORD)


def record_end(out: Path, status: str) -> None:
    """Let the run.json that a run has left in a folder say how the one ended that should have resumed it.

    Parameters
    ----------
    out : Path
        The folder.
    status : "interrupted" or "not converged"

    Raises
    ------
    OutputError
        It cannot be written.
    """
    record = read_json(out / RECORD)
    if isinstance(record, dict):
        write_json({**record, "status": status}, out / RECORD)


def fastest_growing(result: Sweep) -> list[tuple[SweepPoint, int]]:
    """Return for each unstable branch the point of the sweep where it grows fastest, and the position of its mode."""
    best: dict[int, tuple[SweepPoint, int]] = {}
    for point in result.points:
        for i in np.flatnonzero(point.modes.stability == "unstable"):
            branch, growth = int(point.branches[i]), point.modes.lam[i].real
            if branch not in best or growth > best[branch][0].modes.lam[best[branch][1]].real:
                best[branch] = (point, int(i))
    return [best[b] for b in sorted(best)]


def _unstable(result: Sweep) -> list[dict[str, Any]]:
    """Return shares and sensitivities of each unstable branch at the value where it grows fastest."""
    found = []
    for point, i in fastest_growing(result):
        shares = result.balance(point, i)
        moves = point.sensitivities.get(i, {})
        found.append({
            **mode_info(result, point, i),
            "re_shares": {name: s.growth for name, s in shares.items() if s.growth},
            "energy_shares": {name: s.energy for name, s in shares.items() if np.isfinite(s.energy)},
            "sensitivities": {path: {"at": at, "dre": d.real, "dim": d.imag} for path, (at, d) in moves.items()},
        })  # fmt: skip
    return found


def mode_info(result: Sweep, point: SweepPoint, i: int) -> dict[str, Any]:
    """Return the entries that describe mode i of a point: its branch, eigenvalue, and its shape as far as known."""
    lam = point.modes.lam[i]
    looks = {name: entries[i] for name, entries in point.description.items() if entries[i] is not None}
    return {
        "parameter": result.parameter, "value": point.value, "mode": i + 1, "branch": int(point.branches[i]),
        "re": lam.real, "im": lam.imag, "frequency_hz": point.modes.frequency_hz[i], **looks,
    }  # fmt: skip
