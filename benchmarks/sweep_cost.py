"""The time of a sweep: python benchmarks/sweep_cost.py [--models weak strong] [--rungs 1] [--values 21 101] [--write]

Undamped models of `gallery/gallery_models.py` are swept over the friction coefficient by four ways, on the same
matrices and in one run:

- SciPy's `eigs` with its own `splu`, one value timed and scaled;
- this program at every value by itself, `method = "direct"` on PARDISO, two values timed and scaled;
- SLEPc's Krylov-Schur on MUMPS, one value timed and scaled, where the system's Python has slepc4py
  (Debian: apt-get install python3-slepc4py), right modes alone and both;
- `method = "reduced"`, the whole sweep with right and left modes, tracking and onsets.

Every way runs in a process of its own. The error is that of the reduced sweep against a direct solve at a value that is
not among those which made its basis.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import scipy.sparse as sp

sys.path.insert(0, str(Path(__file__).parent / "gallery"))
from gallery_models import MODELS, Model

PAGE = Path(__file__).parents[1] / "docs" / "sweep_cost.md"
PROBE = 0.37  # of the interval: the value at which single solves are timed and compared
NAMES = {
    "scipy": "SciPy eigs + splu, right modes", "direct": "direct, PARDISO",
    "slepc": "SLEPc + MUMPS, right modes", "slepc both": "SLEPc + MUMPS",
}  # fmt: skip
NOTE = """Two undamped models of the [gallery](performance.md), swept over the friction coefficient from 0 to 1: a
disc with one pad, where few modes couple, and one with two long pads, where many do. SciPy, `method = "direct"` and
SLEPc solve at every value: one or two values are timed and scaled to all. All give right and left modes, which
sensitivities and the uncertainty of growth rates need, unless the table says otherwise; the reduced sweep's seconds
hold the count of modes, tracking and onsets as well. The tolerance is 1e-8 everywhere, SciPy's own 1e-16 apart.
Errors are those of the reduced sweep against a direct solve at one value, relative to |λ| and, of unstable modes, to
Re λ. MiB is the largest memory of the Python process, for SLEPc without SLEPc's own. All ways ran one after the other
in one run. Made by `python benchmarks/sweep_cost.py --write`; """
SLEPC = Path(__file__).with_name("slepc_solve.py")


def measure(way: str, model: Model, size: float, values: int) -> dict:
    """Time one way in this process."""
    from fe_squeal import sweep
    from fe_squeal.eigen.memory import peak_memory_mib
    from fe_squeal.eigen.request import Request
    from fe_squeal.eigen.solve import solve_modes

    problem, modes = model.build(size), model.modes
    grid = np.linspace(model.start, model.stop, values)
    probe = model.start + PROBE * (model.stop - model.start)
    result: dict = {"model": model.name, "unknowns": problem.unknowns}
    start = time.perf_counter()
    if way == "reduced":
        found = sweep(problem, grid, modes=modes, method="reduced")
        result |= {"seconds": time.perf_counter() - start, "onsets": len(found.onsets), "stages": dict(found.seconds)}
        result |= {"basis": found.method, "MiB": peak_memory_mib() or np.nan}
        at = round(PROBE * (values - 1))
        exact = solve_modes(problem.pencil(mu=grid[at]), Request(count=modes)).lam
        lam = next(p for p in found.points if p.value == grid[at]).modes.lam  # windows between values are points, too
        result["error"] = float((np.abs(lam[:, None] - exact).min(axis=1) / np.abs(lam)).max())
        growing = lam.real > 1e-6 * np.abs(lam)
        away = exact[np.abs(lam[growing, None] - exact).argmin(axis=1)].real
        result["growth_error"] = float((np.abs(lam.real[growing] - away) / away).max(initial=0.0))
    elif way == "direct":
        for mu in (probe, model.stop):
            solve_modes(problem.pencil(mu=mu), Request(count=modes))
        result["seconds"] = (time.perf_counter() - start) / 2 * values
    else:
        pencil = problem.pencil(mu=probe)
        start = time.perf_counter()
        if way == "scipy":
            from scipy.sparse.linalg import eigs

            band = 2 * np.pi * 1e3
            eigs(sp.csc_array(pencil.K), modes, sp.csc_array(pencil.M), sigma=-(band**2) / 100)
            result["seconds"] = (time.perf_counter() - start) * values
        else:
            result["seconds"] = slepc(pencil.K, pencil.M, modes, 2 if way == "slepc both" else 1)[0] * values
    return {"MiB": peak_memory_mib() or np.nan, **result}


def slepc(K: sp.csr_array, M: sp.csr_array, modes: int, sides: int) -> tuple[float, float]:
    """Return the seconds of one solve by SLEPc in the system's Python, on the clock and of the processor."""
    with tempfile.TemporaryDirectory() as folder:
        for name, A in (("K", K), ("M", M)):
            np.savez(Path(folder, name), data=A.data, indices=A.indices, indptr=A.indptr)
        done = subprocess.run(
            ["/usr/bin/python3", SLEPC, folder, str(modes), str(sides)], capture_output=True, text=True, check=True,
            env={**os.environ, "PYTHONPATH": ""},
        )  # fmt: skip
    clock, processor = map(float, done.stdout.split()[-2:])
    return clock, processor


def run(way: str, model: Model, rung: int, values: int) -> dict | None:
    """Time one way in a process of its own; None if it is not installed."""
    command = [sys.executable, __file__, "--one", way, model.name, str(rung), str(values)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        print(f"{way}: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
        return None
    return dict(json.loads(done.stdout.splitlines()[-1]))


def compare(models: list[Model], rungs: list[int], values: list[int], ways: list[str]) -> list[dict]:
    """Return a row per model, size, number of values and way, the reduced sweep last in each group."""
    rows: list[dict] = []
    for model, rung in ((m, r) for m in models for r in rungs):
        single = {way: run(way, model, rung, 1) for way in ways if way != "reduced"}
        for count in values:
            own = run("reduced", model, rung, count)
            if own is None:
                continue
            for way, found in single.items():
                if found is not None:
                    seconds = found["seconds"] * count
                    rows.append({"way": NAMES[way], "values": count, "times": seconds / own["seconds"], **found})
                    rows[-1]["seconds"] = seconds
            rows.append({"way": own["basis"], "values": count, "times": 1.0, **own})
            print(rows[-1], file=sys.stderr)
    return rows


def table(rows: list[dict]) -> str:
    """Return the rows as Markdown."""
    head = "model", "unknowns", "values of μ", "way", "seconds", "times the reduced", "MiB", "error of λ", "of growth"
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in rows:
        errors = [f"{row[key]:.1e}" if key in row else "" for key in ("error", "growth_error")]
        lines.append(
            f"| {row['model']} | {row['unknowns']} | {row['values']} | {row['way']} | {row['seconds']:.1f} |"
            f" {row['times']:.1f} | {row['MiB']:.0f} | {' | '.join(errors)} |"
        )
    return "\n".join(lines)


def draw(rows: list[dict], path: Path) -> None:
    """Draw the seconds as bars, a group for each model, size and number of values."""
    from matplotlib.figure import Figure

    groups = list(dict.fromkeys((r["model"], r["unknowns"], r["values"]) for r in rows))
    figure = Figure(figsize=(8, 1 + 0.32 * len(rows) + 0.35 * len(groups)), layout="constrained")
    ax = figure.subplots()
    place, ticks, labels = 0.0, [], []
    for group in groups:
        for row in (r for r in rows if (r["model"], r["unknowns"], r["values"]) == group):
            reduced = row["way"].startswith("reduced")
            ax.barh(place, row["seconds"], color="#1b6ca8" if reduced else "#b5b5b5")
            seconds = f"{row['seconds']:.{0 if row['seconds'] >= 10 else 1}f} s"
            ax.text(row["seconds"] * 1.1, place, seconds, va="center", fontsize=8)
            ticks.append(place)
            labels.append(f"{row['way']}, {group[0]} {group[1]}, {group[2]} values")
            place -= 1
        place -= 0.6
    ax.set_yticks(ticks, labels, fontsize=8)
    ax.set_xscale("log")
    ax.set_xlim(0.5 * min(1.0, *(r["seconds"] for r in rows)), 4 * max(r["seconds"] for r in rows))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_xlabel("seconds of the whole sweep")
    ax.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=120)


def main() -> None:
    """Print the table, or write it into docs/sweep_cost.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [m.name for m in MODELS if m.parameter == "mu"]
    parser.add_argument("--models", nargs="+", choices=names, default=["weak", "strong"])
    parser.add_argument("--rungs", nargs="+", type=int, default=[1], help="which sizes of each model, from 0")
    parser.add_argument("--values", type=int, nargs="+", default=[21, 101])
    parser.add_argument("--ways", nargs="+", default=[*NAMES, "reduced"])
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--one", nargs=4, help=argparse.SUPPRESS)
    given = parser.parse_args()
    models = {m.name: m for m in MODELS}
    if given.one:
        way, name, rung, values = given.one
        print(json.dumps(measure(way, models[name], models[name].sizes[int(rung)], int(values))))
        return
    rows = compare([models[name] for name in given.models], given.rungs, given.values, given.ways)
    print(table(rows))
    if given.write:
        picture = PAGE.parent / "images" / "sweep_cost.png"
        draw(rows, picture)
        modes = models[given.models[0]].modes
        when = f"{modes} modes; {os.cpu_count()} cores, shared with other work, {time.strftime('%Y-%m-%d')}."
        PAGE.write_text(
            f"# What a sweep costs\n\n![Seconds of a sweep](images/{picture.name})\n\n{NOTE}{when}\n\n{table(rows)}\n",
            encoding="utf-8",
        )


if __name__ == "__main__":
    main()
