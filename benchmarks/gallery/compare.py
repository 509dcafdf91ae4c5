"""The gallery by every way: python benchmarks/gallery/compare.py [--models NAME ...] [--largest N] [--values 2 21]
[--direct-values 2] [--ways ...] [--limit SECONDS] [--at-once 2] [--log FILE] [--known] [--write]

Every model of `gallery_models.py` whose size is at most N unknowns is swept by `method = "auto"`, "direct" and
"reduced", each in a process of its own, with right and left modes, tracking, onsets and the count. SciPy, and SLEPc
with MUMPS where the system's Python has it, solve one value for right modes alone, which is scaled to all.
`--direct-values` says at which numbers of values `direct` takes part, where not at all; what it finds at the last value
is the reference at every number. A line per measurement is appended to the file of `--log`, and what is there already
is not measured again; with `--known` nothing is measured, and the table has what is there. `--write` puts the table
into docs/performance.md, where rows of other models stay as they are.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
from gallery_kept import earlier_rows, in_order  # noqa: E402
from gallery_models import MODELS, Model  # noqa: E402
from gallery_table import HEAD, PEERS, section, table_line  # noqa: E402
from mesh_bars import with_section_of  # noqa: E402
from peers import scipy_modes  # noqa: E402
from sweep_cost import slepc  # noqa: E402

PAGE = Path(__file__).parents[2] / "docs" / "performance.md"
OWN = "auto", "direct", "reduced"
RUNGS = 8_000, 30_000, 130_000  # the largest numbers of unknowns of the two or three sizes of a model
NO_SLEPC = "SLEPc is not there, or the problem has dampers, for which it is not asked"
FOUND = 1e-6  # relative distance: an eigenvalue closer than this to one of the direct solve is the same


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
            "damped": problem.problem_class not in ("symmetric", "nonsymmetric"),
            "warnings": len(found.warnings), "method": found.method, "complete": bool(c.proven), "counted": c.found,
        }  # fmt: skip
    else:
        pencil = problem.pencil({model.parameter: model.stop})
        if way == "scipy":
            seconds, lam = scipy_modes(pencil, model.modes, band)
        elif pencil.C is None and not pencil.is_complex:
            try:
                seconds, lam = slepc(pencil.K, pencil.M, model.modes, 1)[1], np.zeros(0)
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
    threads["NUMPY_MADVISE_HUGEPAGE"] = "0"  # as fe_squeal does where it is imported before NumPy; for peers, too
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


@dataclass
class Log:
    """What was measured, in a file of JSON lines if there is one.

    Attributes
    ----------
    path : Path or None
    limit : float
        Seconds after which a measurement is given up.
    only_known : bool
        Whether nothing is measured.
    """

    path: Path | None
    limit: float
    only_known: bool = False
    _known: dict[str, dict] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        if self.path is not None and self.path.exists():
            for line in self.path.read_text(encoding="utf-8").splitlines():
                key, row = json.loads(line)
                self._known[key] = row

    def measured(self, way: str, model: Model, rung: int, values: int, band: float = 0.0) -> dict:
        """Return what `run` does, or what is known of it; empty where nothing is, and only that is wanted."""
        key = f"{way}, {model.name}, {rung}, {values}"
        if key not in self._known:
            if self.only_known:
                return {}
            row = run(way, model, rung, values, band, self.limit)
            with self._lock:
                self._known[key] = row
                if self.path is not None:
                    with self.path.open("a", encoding="utf-8") as file:
                        file.write(json.dumps([key, row]) + "\n")
        return self._known[key]


def compare(
    models: list[Model], largest: int, values: list[int], direct: list[int], ways: list[str], log: Log, at_once: int
) -> list[dict]:
    """Return a row for each model, size, number of values and way.

    Parameters
    ----------
    models : list of Model
    largest : int
        Unknowns.
    values : list of int
        Numbers of values of the sweeps.
    direct : list of int
        Those at which the way "direct" takes part.
    ways : list of str
        Some of `OWN` and `PEERS`.
    log : Log
    at_once : int
        Models that are measured at the same time.
    """
    sizes = sizes_of(models, largest)
    with ThreadPoolExecutor(at_once) as pool:
        groups = list(pool.map(lambda one: _group(*one, values, direct, ways, log), sizes))
    return [row for group in groups for row in group]


def sizes_of(models: list[Model], largest: int) -> list[tuple[Model, int]]:
    """Return each model with the number of each of its sizes that has at most so many unknowns; the smallest always."""
    return [(m, r) for m in models for r in range(len(m.sizes)) if RUNGS[r] <= max(largest, RUNGS[0])]


def _group(model: Model, rung: int, values: list[int], direct: list[int], ways: list[str], log: Log) -> list[dict]:
    """Return the rows of one model and size."""
    own = [
        log.measured(way, model, rung, count)
        for count in values for way in OWN if way in ways and (way != "direct" or count in direct)
    ]  # fmt: skip
    own = [r for r in own if r]
    known = {r["way"]: _lam(r) for r in own if "lam" in r}
    exact = known.get("direct", next(iter(known.values()), np.zeros(0)))
    band = float(exact.imag.max(initial=0.0))
    peers = [r for way in PEERS if way in ways and band and (r := log.measured(way, model, rung, 1, band))]
    rows = []
    for count in values:
        group = [r for r in own if r["values"] == count]
        group += [_scaled(r, count) for r in peers if group and r.get("failed") != NO_SLEPC]
        rows += judged(group, exact)
    print(*(table_line(r) for r in rows), sep="\n", flush=True)
    return rows


def _scaled(row: dict, values: int) -> dict:
    """Return the row of one value as that of several."""
    return row | {"values": values} | ({"seconds": row["seconds"] * values} if "seconds" in row else {})


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


def main() -> None:
    """Print the table, or write it into docs/performance.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [m.name for m in MODELS]
    parser.add_argument("--models", nargs="+", choices=names, default=names)
    parser.add_argument("--largest", type=int, default=RUNGS[0], help="unknowns")
    parser.add_argument("--values", nargs="+", type=int, default=[2, 21])
    parser.add_argument("--direct-values", nargs="+", type=int, help="those at which `direct` takes part (all)")
    parser.add_argument("--ways", nargs="+", choices=[*OWN, *PEERS], default=[*OWN, *PEERS])
    parser.add_argument("--limit", type=float, default=900.0, help="seconds for each way")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="models measured at the same time (1)")
    parser.add_argument("--log", type=Path, metavar="FILE", help="JSON lines; what is there is not measured again")
    parser.add_argument("--known", action="store_true", help="measure nothing: the table of what the log has")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--one", nargs=5, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        way, name, rung, values, band = given.one
        model = next(m for m in MODELS if m.name == name)
        print(json.dumps(measure(way, model, model.sizes[int(rung)], int(values), float(band))))
        return
    models = [m for m in MODELS if m.name in given.models]
    if given.known and given.log is None:
        parser.error("--known needs --log")
    direct = given.values if given.direct_values is None else given.direct_values
    log = Log(given.log, given.limit, given.known)
    rows = compare(models, given.largest, given.values, direct, given.ways, log, given.at_once)
    if given.write:
        text = PAGE.read_text(encoding="utf-8")
        rows = in_order(rows + earlier_rows(text.partition(HEAD)[2].partition("\n## ")[0], rows))
        PAGE.write_text(with_section_of(HEAD, text, section(rows, models, given.limit)), encoding="utf-8")


if __name__ == "__main__":
    main()
