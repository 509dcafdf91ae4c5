"""The time of a sweep: python benchmarks/sweep_cost.py [size ...] [--modes 50] [--values 21 101] [--write]

The disc with two pads of examples/disc_pad.toml, meshed with elements of the given size in m, is swept over the
friction coefficient by four ways, on the same matrices and in one run:

- SciPy's `eigs` with its own `splu`, one value timed and scaled;
- ARPACK on PARDISO, `method = "direct"`, two values timed and scaled;
- SLEPc's Krylov-Schur on MUMPS, one value timed and scaled, where the system's Python has slepc4py
  (Debian: apt-get install python3-slepc4py), right modes alone and both;
- `method = "reduced"`, the whole sweep with right and left modes, tracking and onsets.

Every way runs in a process of its own. The error is that of the reduced sweep against ARPACK on PARDISO at values that
are not among those which made its basis.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

import numpy as np
import scipy.sparse as sp

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "sweep_cost.md"
STOP = 0.6
PROBE = 0.37  # of the interval: the value at which single solves are timed and compared
NAMES = {
    "scipy": "SciPy eigs + splu, right modes", "direct": "ARPACK + PARDISO",
    "slepc": "SLEPc + MUMPS, right modes", "slepc both": "SLEPc + MUMPS",
}  # fmt: skip
NOTE = """The disc with two pads of `examples/disc_pad.toml` on finer meshes, swept over the friction coefficient.
SciPy, ARPACK on PARDISO and SLEPc solve at every value: one or two values are timed and scaled to all. All give right
and left modes, which sensitivities and the uncertainty of growth rates need, unless the table says otherwise; the
reduced sweep's seconds hold the count of modes, tracking and onsets as well. The tolerance is 1e-8 everywhere, SciPy's
own 1e-16 apart. Errors are those of the reduced sweep against ARPACK on PARDISO at one value, relative
to |λ| and, of unstable modes, to Re λ. MiB is the largest memory of the Python process, for SLEPc without SLEPc's own.
All ways ran one after the other in one run. Made by `python benchmarks/sweep_cost.py --write`; """
SLEPC = Path(__file__).with_name("slepc_solve.py")


def build(size: float, element: str = "hex"):
    """Return the assembled problem of the disc meshed with elements of a size, m, hexahedra or tetrahedra ("tet")."""
    from fe_squeal import assemble, parse_scene

    raw = tomllib.loads((ROOT / "examples" / "disc_pad.toml").read_text("utf-8"))
    del raw["mesh"]["file"], raw["solve"]
    raw["mesh"]["disc_pad"] |= {"size": size, "element": element}
    return assemble(parse_scene(raw))


def measure(way: str, size: float, modes: int, values: int) -> dict[str, float]:
    """Time one way in this process."""
    from fe_squeal import sweep
    from fe_squeal.eigen.memory import peak_memory_mib
    from fe_squeal.eigen.request import Request
    from fe_squeal.eigen.solve import solve_modes

    problem = build(size)
    grid = np.linspace(0.0, STOP, values)
    result: dict = {"unknowns": problem.unknowns}
    start = time.perf_counter()
    if way == "reduced":
        found = sweep(problem, grid, modes=modes, method="reduced")
        result |= {"seconds": time.perf_counter() - start, "onsets": len(found.onsets), "stages": dict(found.seconds)}
        result |= {"basis": found.method, "MiB": peak_memory_mib() or np.nan}
        at = round(PROBE * (values - 1))
        exact = solve_modes(problem.pencil(mu=grid[at]), Request(count=modes)).lam
        lam = found.points[at].modes.lam
        result["error"] = float((np.abs(lam[:, None] - exact).min(axis=1) / np.abs(lam)).max())
        growing = lam.real > 1e-6 * np.abs(lam)
        away = exact[np.abs(lam[growing, None] - exact).argmin(axis=1)].real
        result["growth_error"] = float((np.abs(lam.real[growing] - away) / away).max(initial=0.0))
    elif way == "direct":
        for mu in (PROBE * STOP, STOP):
            solve_modes(problem.pencil(mu=mu), Request(count=modes))
        result["seconds"] = (time.perf_counter() - start) / 2 * values
    else:
        pencil = problem.pencil(mu=PROBE * STOP)
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


def run(way: str, size: float, modes: int, values: int) -> dict | None:
    """Time one way in a process of its own; None if it is not installed."""
    command = [sys.executable, __file__, "--one", way, str(size), "--modes", str(modes), "--values", str(values)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        print(f"{way}: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
        return None
    return dict(json.loads(done.stdout.splitlines()[-1]))


def compare(sizes: list[float], modes: int, values: list[int], ways: list[str]) -> list[dict]:
    """Return a row per problem, number of values and way, the reduced sweep last in each group."""
    rows: list[dict] = []
    for size in sizes:
        single = {way: run(way, size, modes, 1) for way in ways if way != "reduced"}
        for count in values:
            own = run("reduced", size, modes, count)
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
    lines = ["| unknowns | values of μ | way | seconds | times the reduced | MiB | error of λ | of growth |",
             "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for row in rows:
        errors = [f"{row[key]:.1e}" if key in row else "" for key in ("error", "growth_error")]
        lines.append(
            f"| {row['unknowns']} | {row['values']} | {row['way']} | {row['seconds']:.1f} | {row['times']:.1f} |"
            f" {row['MiB']:.0f} | {' | '.join(errors)} |"
        )
    return "\n".join(lines)


def draw(rows: list[dict], path: Path) -> None:
    """Draw the seconds as bars, a group for each problem and number of values."""
    from matplotlib.figure import Figure

    groups = list(dict.fromkeys((r["unknowns"], r["values"]) for r in rows))
    figure = Figure(figsize=(8, 1 + 0.32 * len(rows) + 0.35 * len(groups)), layout="constrained")
    ax = figure.subplots()
    place, ticks, labels = 0.0, [], []
    for unknowns, values in groups:
        for row in (r for r in rows if (r["unknowns"], r["values"]) == (unknowns, values)):
            reduced = row["way"].startswith("reduced")
            ax.barh(place, row["seconds"], color="#1b6ca8" if reduced else "#b5b5b5")
            seconds = f"{row['seconds']:.{0 if row['seconds'] >= 10 else 1}f} s"
            ax.text(row["seconds"] * 1.1, place, seconds, va="center", fontsize=8)
            ticks.append(place)
            labels.append(f"{row['way']}, {unknowns} unknowns, {values} values")
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
    parser.add_argument("sizes", nargs="*", type=float, default=[0.0095, 0.0055])
    parser.add_argument("--modes", type=int, default=50)
    parser.add_argument("--values", type=int, nargs="+", default=[21, 101])
    parser.add_argument("--ways", nargs="+", default=[*NAMES, "reduced"])
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(measure(given.one, given.sizes[0], given.modes, given.values[0])))
        return
    rows = compare(given.sizes, given.modes, given.values, given.ways)
    print(table(rows))
    if given.write:
        picture = PAGE.parent / "images" / "sweep_cost.png"
        draw(rows, picture)
        when = f"{given.modes} modes; {os.cpu_count()} cores, shared with other work, {time.strftime('%Y-%m-%d')}."
        PAGE.write_text(
            f"# What a sweep costs\n\n![Seconds of a sweep](images/{picture.name})\n\n{NOTE}{when}\n\n{table(rows)}\n",
            encoding="utf-8",
        )


if __name__ == "__main__":
    main()
