"""Where the gallery's seconds go: python benchmarks/gallery/profiles.py [--models NAME ...] [--largest N] [--values V]
[--at-once N] [--write]

Every model of at most N unknowns is swept by `method = "auto"` under Python's profiler, in a process and a thread of
its own. CPU seconds are those of the functions themselves, without those that they call, and are summed by what bounds
them: eigenvalues and other decompositions of small dense matrices by LAPACK, factorisations, solves with the factors,
products of sparse matrices, products of blocks of vectors by the BLAS. The rest is Python and NumPy. `--write` puts the
table into docs/performance.md.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import pstats
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
from compare import PAGE, RUNGS, sizes_of  # noqa: E402
from gallery_models import MODELS, Model  # noqa: E402
from mesh_bars import with_section_of  # noqa: E402

HEAD = "## The gallery: where the seconds go"
PARTS = "LAPACK", "factorisations", "solves", "sparse products", "products of vectors", "Python and NumPy"
_FACTORISING = "__init__"  # of PARDISO's factors: what calls for a factorisation, while others call for solves
NOTE = """CPU seconds of a sweep by `auto` in one thread, under Python's profiler, which adds to
the last column, and what they are spent on: decompositions of the small matrices of reduced models and of steps by
LAPACK, factorisations, solves, products of sparse matrices with vectors, products of blocks of vectors by the BLAS.
What is left is Python's and NumPy's."""

Function = tuple[str, int, str]  # file, line, name


def part_of(function: Function, callers: Counter[str]) -> dict[str, float]:
    """Return by part which share of a function's own seconds belongs there.

    Parameters
    ----------
    function : (str, int, str)
        File, line and name, as in the tables of pstats.
    callers : Counter
        Its own seconds by the names of its callers.

    Examples
    --------
    >>> part_of(("scipy/linalg/_decomp.py", 114, "eig"), Counter())
    {'LAPACK': 1.0}
    """
    file, _, name = function
    if file.endswith("linear/pardiso.py") and name == "_call":
        total = sum(callers.values()) or 1.0
        made = callers[_FACTORISING] / total
        return {"factorisations": made, "solves": 1 - made}
    if "gstrf" in name:  # SuperLU
        return {"factorisations": 1.0}
    if "scipy/linalg" in file or "numpy/linalg" in file or "_batched_linalg" in name:
        return {"LAPACK": 1.0}
    if "_sparsetools" in name or file.endswith("eigen/mkl.py"):
        return {"sparse products": 1.0}
    if file.endswith("eigen/blocks.py"):
        return {"products of vectors": 1.0}
    return {"Python and NumPy": 1.0}


def profile(model: Model, size: float, values: int) -> dict:
    """Sweep one model in this process, and return its seconds by part."""
    from fe_squeal import sweep

    problem, grid = model.build(size), np.linspace(model.start, model.stop, values)
    profiler = cProfile.Profile(time.process_time)
    found = profiler.runcall(sweep, problem, grid, parameter=model.parameter, modes=model.modes)
    seconds: Counter[str] = Counter()
    for function, (_, _, own, _, callers) in pstats.Stats(profiler).stats.items():  # type: ignore[attr-defined]
        by_name: Counter[str] = Counter()
        for (_, _, name), (*_, spent, _) in callers.items():
            by_name[name] += spent
        for part, share in part_of(function, by_name).items():
            seconds[part] += share * own
    told = {"values": values, "date": time.strftime("%Y-%m-%d")}
    return told | {"model": model.name, "unknowns": problem.unknowns, "method": found.method, "seconds": dict(seconds)}


def run(model: Model, rung: int, values: int) -> dict:
    """Do what `profile` does in another process, with one thread."""
    threads = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--one", model.name, str(rung), str(values)]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **threads}, check=True)
    row = json.loads(done.stdout.splitlines()[-1])
    print(line(row), flush=True)
    return row


def line(row: dict) -> str:
    """Return a row of the table as Markdown."""
    total = sum(row["seconds"].values())
    shares = [f"{100 * row['seconds'].get(part, 0.0) / total:.0f} %" for part in PARTS]
    way = "reduced" if row["method"].startswith("reduced") else "direct"
    cells = [row["model"], str(row["unknowns"]), way, f"{total:.1f}", *shares, str(row["values"]), row["date"]]
    return "| " + " | ".join(cells) + " |"


def with_earlier(lines: list[str], page: str) -> list[str]:
    """Return rows with those of other models and sizes that the page has, in the order of the gallery.

    Examples
    --------
    >>> with_earlier(["| strong | 20 | new |"], "| weak | 9 | old |\\n| strong | 20 | old |")
    ['| weak | 9 | old |', '| strong | 20 | new |']
    """
    names = [m.name for m in MODELS]
    known = {tuple(cell.strip() for cell in row.split("|")[1:3]): row for row in [*page.splitlines(), *lines]}
    columns = lines[0].count("|")
    own = {key: row for key, row in known.items() if len(key) == 2 and key[0] in names and row.count("|") == columns}
    return [own[key] for key in sorted(own, key=lambda key: (names.index(key[0]), int(key[1])))]


def section(rows: list[dict], page: str) -> str:
    """Return the section of the page, with what its table has of other models and sizes."""
    head = ("model", "unknowns", "way", "CPU, s", *PARTS, "values", "measured")
    made = f"Made by `python benchmarks/gallery/profiles.py --write`; {os.cpu_count()} cores, shared with other work."
    before = page.partition(HEAD)[2].partition("\n## ")[0]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|", *with_earlier(list(map(line, rows)), before)]
    return f"{HEAD}\n\n{NOTE}\n{made}\n\n" + "\n".join(lines) + "\n"


def main() -> None:
    """Print the table, or write it into docs/performance.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [m.name for m in MODELS]
    parser.add_argument("--models", nargs="+", choices=names, default=names)
    parser.add_argument("--largest", type=int, default=RUNGS[0], help="unknowns")
    parser.add_argument("--values", type=int, default=21)
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="models at the same time (1)")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        name, rung, values = given.one
        model = next(m for m in MODELS if m.name == name)
        print(json.dumps(profile(model, model.sizes[int(rung)], int(values))))
        return
    sizes = sizes_of([m for m in MODELS if m.name in given.models], given.largest)
    with ThreadPoolExecutor(given.at_once) as pool:
        rows = list(pool.map(lambda size: run(*size, given.values), sizes))
    if given.write:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(with_section_of(HEAD, text, section(rows, text)), encoding="utf-8")


if __name__ == "__main__":
    main()
