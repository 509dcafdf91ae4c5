"""The gallery by every way: python benchmarks/gallery/compare.py [--models NAME ...] [--largest N] [--values 2 21]
[--ways ...] [--limit SECONDS] [--write]

Every model of `gallery_models.py` whose size is at most N unknowns is swept by `method = "auto"`, "direct" and
"reduced", each in a process of its own, with right and left modes, tracking, onsets and the count. SciPy, and SLEPc
with MUMPS where the system's Python has it, solve one value for right modes alone, which is scaled to all. `--write`
puts the table into docs/performance.md.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
from gallery_models import MODELS, Model  # noqa: E402
from mesh_bars import with_section_of  # noqa: E402
from peers import scipy_modes  # noqa: E402
from sweep_cost import slepc  # noqa: E402

PAGE = Path(__file__).parents[2] / "docs" / "performance.md"
OWN = "auto", "direct", "reduced"
PEERS = {"scipy": "SciPy, right modes", "slepc": "SLEPc + MUMPS, right modes"}
RUNGS = 8_000, 30_000, 130_000  # the largest numbers of unknowns of the two or three sizes of a model
NO_SLEPC = "SLEPc is not there, or the problem has dampers, for which it is not asked"
FOUND = 1e-6  # relative distance: an eigenvalue closer than this to one of the direct solve is the same
HEAD = "## The gallery: models that the program is not tuned to"
NOTE = """Models of `benchmarks/gallery/gallery_models.py`, which differ in kind; none is an example of the program. Its
own ways sweep over all values with right and left modes, tracking, onsets and the count of modes; peers solve
the last value for right modes alone, whose seconds are scaled to all values; SLEPc is among them where the
machine has it, and for problems without dampers. With dampers or complex stiffness SciPy takes three complex
shifts inside the band, which it is told. The ratio is the fastest peer's seconds over these: above 1 is
faster. Found and error compare the modes at the last value with those of the direct solve. Vectors are those
of the reduced model. A way that took longer than the limit of seconds says so. Each process has one thread,
and its CPU seconds count, since the machine is shared with other work; of SLEPc the seconds on the clock."""


def measure(way: str, model: Model, size: float, values: int, band: float) -> dict:
    """Sweep one model in one way, in this process; `band` is the highest frequency, rad/s, for SciPy and SLEPc."""
    from fe_squeal import sweep
    from fe_squeal.eigen.memory import peak_memory_mib

    problem = model.build(size)
    start = time.process_time()
    if way in OWN:
        grid = np.linspace(model.start, model.stop, values)
        found = sweep(problem, grid, parameter=model.parameter, modes=model.modes, method=way)
        lam, c = found.points[-1].modes.lam, found.completeness
        own = {
            "seconds": time.process_time() - start, "stages": dict(found.seconds), "onsets": len(found.onsets),
            "warnings": len(found.warnings), "method": found.method, "complete": bool(c.proven), "counted": c.found,
        }  # fmt: skip
    else:
        pencil = problem.pencil({model.parameter: model.stop})
        if way == "scipy":
            seconds, lam = scipy_modes(pencil, model.modes, band)
        elif pencil.C is None and not pencil.is_complex:
            try:
                seconds, lam = slepc(pencil.K, pencil.M, model.modes, 1), np.zeros(0)
            except (OSError, subprocess.CalledProcessError) as error:
                raise SystemExit(NO_SLEPC) from error
        else:
            raise SystemExit(NO_SLEPC)
        own = {"seconds": seconds * values}
    parts = [[x.real, x.imag] for x in lam]
    return {"unknowns": problem.unknowns, "MiB": peak_memory_mib(), "lam": parts, **own}


def run(way: str, model: Model, rung: int, values: int, band: float, limit: float) -> dict:
    """Do what `measure` does in another process, which is ended after `limit` seconds."""
    command = [sys.executable, __file__, "--one", way, model.name, str(rung), str(values), str(band)]
    threads = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    row = {"model": model.name, "way": way, "values": values}
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, env={**os.environ, **threads})
    except subprocess.TimeoutExpired:
        return row | {"failed": f"over {limit:g} s"}
    if done.returncode:
        return row | {"failed": (done.stderr.strip().splitlines() or ["failed"])[-1][-120:]}
    return row | json.loads(done.stdout.splitlines()[-1])


def agreement(lam: np.ndarray, exact: np.ndarray) -> tuple[int, float]:
    """Return how many of some exact λ with Im λ > 0 are among others, and the largest relative error of these.

    Examples
    --------
    >>> agreement(np.array([1.0000000001j, 3j]), np.array([1j, 2j]))[0]
    1
    """
    exact = exact[exact.imag > 0]
    if not len(lam) or not len(exact):
        return 0, np.nan
    distance = np.abs(exact[:, None] - lam[None, :]).min(axis=1) / np.abs(exact)
    same = distance <= FOUND
    return int(same.sum()), float(distance[same].max(initial=0.0))


def compare(models: list[Model], largest: int, values: list[int], ways: list[str], limit: float) -> list[dict]:
    """Return a row for each model, size, number of values and way."""
    rows = []
    for model in models:
        for rung in range(len(model.sizes)):
            if RUNGS[rung] > max(largest, RUNGS[0]):
                continue
            for count in values:
                group = [run(way, model, rung, count, 0.0, limit) for way in OWN if way in ways]
                known = {r["way"]: _lam(r) for r in group if "lam" in r}
                exact = known.get("direct", next(iter(known.values()), np.zeros(0)))
                band = float(exact.imag.max(initial=0.0))
                if band:
                    others = [run(way, model, rung, count, band, limit) for way in PEERS if way in ways]
                    group += [r for r in others if r.get("failed") != NO_SLEPC]
                rows += judged(group, exact)
                print(*(_line(r) for r in rows[-len(group) :]), sep="\n", flush=True)
    return rows


def judged(group: list[dict], exact: np.ndarray) -> list[dict]:
    """Return the rows of a model and size with the number of exact λ found, and the ratio to the fastest peer."""
    peers = [r["seconds"] for r in group if r["way"] in PEERS and "seconds" in r]
    unknowns = next((r["unknowns"] for r in group if "unknowns" in r), 0)
    rows = []
    for r in group:
        more: dict = {"unknowns": unknowns, "wanted": int((exact.imag > 0).sum())}
        if "seconds" in r:
            more["ratio"] = min(peers) / r["seconds"] if peers else np.nan
            if r["lam"]:
                more["found"], more["error"] = agreement(_lam(r), exact)
        rows.append(r | more)
    return rows


def _lam(row: dict) -> np.ndarray:
    return np.array([complex(*x) for x in row["lam"]])


def _line(r: dict) -> str:
    start = f"| {r['model']} | {r['unknowns']} | {r['values']} | {PEERS.get(r['way'], r['way'])} |"
    if "failed" in r:
        return f"{start} {r['failed'].replace('|', '/')} | | | | | | | | |"
    found = f"{r['found']} of {r['wanted']}" if "found" in r else ""
    error = f"{r['error']:.0e}" if "error" in r and r["way"] != "direct" else ""
    method = r.get("method", "").split()
    vectors = method[3] if method[:2] == ["reduced", "model"] else ""
    told = [str(r[k]) if k in r else "" for k in ("onsets", "warnings")]
    complete = ("yes" if r["complete"] else "not proven") if "complete" in r else ""
    cells = [f"{r['seconds']:.1f}", f"{r['ratio']:.2g}", found, error, vectors, *told, f"{r['MiB']:.0f}", complete]
    return f"{start} " + " | ".join(cells) + " |"


def table(rows: list[dict]) -> str:
    """Return the rows as Markdown."""
    head = ["model", "unknowns", "values", "way", "CPU, s", "ratio to the fastest peer", "found", "worst error of λ",
            "vectors", "onsets", "warnings", "memory, MiB", "count proven"]  # fmt: skip
    return "\n".join(["| " + " | ".join(head) + " |", "|---" * len(head) + "|", *map(_line, rows)])


def section(rows: list[dict], models: list[Model], limit: float) -> str:
    """Return the section of the page."""
    about = "\n".join(f"- {m.name}: {m.about}" for m in models)
    when = f"{models[0].modes} modes, limit {limit:g} s; {os.cpu_count()} cores; {time.strftime('%Y-%m-%d')}."
    made = f"Made by `python benchmarks/gallery/compare.py --write`; {when}"
    rest = ", ".join(m.name for m in MODELS if m not in models)
    rest = f"\nNot measured in this run: {rest}.\n" if rest else ""
    return f"{HEAD}\n\n{NOTE}\n{made}\n\n{about}\n{rest}\n{table(rows)}\n"


def main() -> None:
    """Print the table, or write it into docs/performance.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [m.name for m in MODELS]
    parser.add_argument("--models", nargs="+", choices=names, default=names)
    parser.add_argument("--largest", type=int, default=RUNGS[0], help="unknowns")
    parser.add_argument("--values", nargs="+", type=int, default=[2, 21])
    parser.add_argument("--ways", nargs="+", choices=[*OWN, *PEERS], default=[*OWN, *PEERS])
    parser.add_argument("--limit", type=float, default=900.0, help="seconds for each way")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--one", nargs=5, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        way, name, rung, values, band = given.one
        model = next(m for m in MODELS if m.name == name)
        print(json.dumps(measure(way, model, model.sizes[int(rung)], int(values), float(band))))
        return
    models = [m for m in MODELS if m.name in given.models]
    rows = compare(models, given.largest, given.values, given.ways, given.limit)
    if given.write:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(with_section_of(HEAD, text, section(rows, models, given.limit)), encoding="utf-8")


if __name__ == "__main__":
    main()
