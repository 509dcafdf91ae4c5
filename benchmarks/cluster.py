"""Memory of factors by MUMPS' own analysis: python benchmarks/cluster.py [--write]

For the matrix of examples/disc_pad.toml on finer meshes, without computing the factors: megabytes that the process with
most and all together need for LDLᵀ and LU, on 1, 2 and 4 processes of .venv-mpi, and what these say of larger models.
And the largest memory that each process had in a reduced sweep of 50 modes, measured on a smaller mesh. --write puts
the tables into docs/cluster.md. Under mpiexec it prints what one matrix (--matrix) or one mesh (--mesh) tells.
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
import psutil
import scipy.sparse as sp

import fe_squeal
from fe_squeal.eigen.linear.mumps import told_of
from fe_squeal.eigen.linear.processes import dismiss, help_out, prepare
from fe_squeal.problem.problem import Problem
from fe_squeal.process.ranks import is_helper, process_count

ROOT = Path(__file__).parents[1]
EXAMPLE, PAGE = ROOT / "examples/disc_pad.toml", ROOT / "docs/cluster.md"
BEGIN, END = "<!-- forecast: python benchmarks/cluster.py --write -->\n", "<!-- end of forecast -->\n"
MPIEXEC = ["mpiexec", "-q", "--oversubscribe", "--allow-run-as-root", "--mca", "mpi_yield_when_idle", "1", "-n"]
SIZES, COUNTS = (0.014, 0.006, 0.0045, 0.0034), (1, 2, 4)  # m
SWEPT, MODES, VALUES = (0.0055, 0.0045), 50, 21  # m
LARGE = (1_000_000, 3_000_000, 10_000_000)  # unknowns
NODES = (64, 256, 1024)  # GiB
# What is held at the peak of a reduced sweep besides factors, counted from the program and not measured. By their rows
# on all processes: copies of K, 12 bytes for each entry (terms by body, with M, 2; the matrix to be factorised and what
# PETSc is handed, 3.3), and of the vectors for 50 modes basis and corrections, 455. On process 0 alone: samples 48,
# search 40, blocks 200.
COPIES, VECTORS, SPREAD = 5.3, 290, 455
GIB, MB = 2**30, 10**6
PEAKS = f"""### Memory of a sweep, measured

The largest resident memory that each process had in a reduced sweep of {MODES} modes and {VALUES} values. Of that of
processes other than the first some 120 MB are the program; the rest is their part of factors, matrices and vectors.
"""
NOTE = """### How many nodes for my brake

A reduced sweep for 50 modes holds LDLᵀ factors while its model is made, and where friction or damping is strong LU
factors after these, for which the table allows; the matrices and the vectors of its basis are spread as the factors
are, and process 0 holds the other vectors besides. The factors are extrapolated from the analyses above on one process,
of more than 50 000 unknowns, by powers of the number of unknowns n that fit them in the least-squares sense; nothing of
this size was factorised. Nine tenths of a node's memory are used.
"The first of" says how much process 0's node needs where the others' is not enough.
Seconds are those of one LU factorisation. The exponents are those of this brake, a thin disc with pads; of solids as
thick as wide they tend to 4/3 for bytes and 2 for operations, with larger constants. Found:
"""


def assembled(size: float) -> Problem:
    """Return the example on a mesh of this size, in m."""
    data = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    data["mesh"].pop("file", None)
    data["mesh"]["disc_pad"]["size"] = size
    return fe_squeal.assemble(fe_squeal.parse_scene(data))


def started(count: int, *options: str) -> dict:
    """Return what this script prints on so many processes."""
    command = [*MPIEXEC, str(count), str(ROOT / ".venv-mpi/bin/python"), __file__, *options]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    row: dict = json.loads(done.stdout.strip().splitlines()[-1])
    print(json.dumps(row), file=sys.stderr, flush=True)
    return row


def measured(size: float, counts: tuple[int, ...] = COUNTS) -> list[dict]:
    """Return what the analyses of one mesh tell, by other processes under mpiexec."""
    pencil = assembled(size).pencil()
    A = sp.csr_array(pencil.K - 1e8 * pencil.M)
    A.sum_duplicates()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "matrix.npz"
        sp.save_npz(file, A, compressed=False)
        del pencil, A
        rows = [started(count, "--matrix", str(file)) for count in counts]
    return rows


def analysed(file: Path) -> dict:
    """Return what the analyses of a matrix tell, on the processes that mpiexec has started."""
    A = sp.csr_array(sp.load_npz(file))
    row: dict = {"unknowns": A.shape[0], "entries": A.nnz, "processes": process_count()}
    for name, symmetric in (("LDLᵀ", True), ("LU", False)):
        told = told_of(A, symmetric, False)
        row |= {f"{name} one": told.largest, f"{name} all": told.total, f"{name} disk": told.largest_on_disk,
                f"{name} operations": told.operations}  # fmt: skip
    return row


def swept(size: float) -> dict:
    """Return the largest memory that each process had in a reduced sweep on the processes that mpiexec has started."""
    begun = time.perf_counter()
    problem, values = assembled(size), np.linspace(0.0, 0.7, VALUES)
    found = fe_squeal.sweep(problem, values, modes=MODES, method="reduced", linear_solver="mumps")
    assert found.reduced_model is not None
    own = psutil.Process()
    ranks = {own.pid: 0}
    for child in psutil.Process(os.getppid()).children(recursive=True):
        if (rank := child.environ().get("OMPI_COMM_WORLD_RANK")) is not None:
            ranks[child.pid] = int(rank)
    peaks = {}
    for pid, rank in ranks.items():
        status = Path(f"/proc/{pid}/status").read_text("ascii")
        peaks[rank] = int(status.split("VmHWM:")[1].split()[0]) * 1024
    return {"unknowns": problem.unknowns, "processes": process_count(), "vectors": len(found.reduced_model.basis),
            "onsets": len(found.onsets), "seconds": time.perf_counter() - begun,
            "peaks": [peaks[rank] for rank in sorted(peaks)]}  # fmt: skip


def peaks(rows: list[dict]) -> str:
    """Return a table of the memory that was measured, with what others than process 0 have besides the program."""
    lines = ["| unknowns | processes | vectors | s | process 0, MB | largest of the others, MB |", "|---" * 6 + "|"]
    for r in rows:
        first, *others = r["peaks"]
        cells = [r["unknowns"], r["processes"], r["vectors"], f"{r['seconds']:.0f}", first // MB,
                 max(others) // MB if others else ""]  # fmt: skip
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return f"{PEAKS}\n" + "\n".join(lines)


def table(rows: list[dict]) -> str:
    """Return the analyses as Markdown, in MB; shares are of one process."""
    head = ["unknowns", "entries", "processes", *(f"{f}, {w}" for f in ("LDLᵀ", "LU") for w in
            ("MB on one", "of one process", "on all", "on one, out of core"))]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for r in rows:
        alone = next(o for o in rows if o["unknowns"] == r["unknowns"] and o["processes"] == 1)
        cells = [r["unknowns"], r["entries"], r["processes"]]
        for f in ("LDLᵀ", "LU"):
            cells += [r[f"{f} one"] // MB, f"{r[f'{f} one'] / alone[f'{f} one']:.2f}", r[f"{f} all"] // MB,
                      r[f"{f} disk"] // MB]  # fmt: skip
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


def law(rows: list[dict], key: str) -> tuple[float, float]:
    """Return c and α of key = c nᵅ by least squares in logarithms, from the analyses on one process of 50 000 on."""
    alone = [r for r in rows if r["processes"] == 1 and r["unknowns"] > 50_000]
    n, y = (np.log([r[k] for r in alone]) for k in ("unknowns", key))
    alpha, c = np.polyfit(n, y, 1)
    return float(np.exp(c)), float(alpha)


def nodes(rows: list[dict]) -> str:
    """Return a table of nodes for larger models, with the laws that it rests on."""
    laws = {key: law(rows, key) for key in ("entries", "LDLᵀ all", "LU all", "LDLᵀ operations", "LU operations")}
    said = ", ".join(f"{key}: n^{alpha:.2f}" for key, (_, alpha) in laws.items())
    last = [r for r in rows if r["unknowns"] == max(o["unknowns"] for o in rows)]
    more = max(r["LU all"] for r in last) / min(r["LU all"] for r in last)
    head = ["unknowns", "LU, GiB on all", "matrices and basis, GiB on all", "process 0 besides, GiB",
            *(f"nodes of {g} GiB" for g in NODES), "LU, 10¹² operations", "s at 100 GFlop/s"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for n in LARGE:
        at = {key: c * n**alpha for key, (c, alpha) in laws.items()}
        factors, spread = more * at["LU all"], COPIES * 12 * at["entries"] + 8 * SPREAD * n
        first = 8 * VECTORS * n
        cells = [f"{n}", f"{factors / GIB:.0f}", f"{spread / GIB:.0f}", f"{first / GIB:.0f}"]
        for g in NODES:
            room = 0.9 * g * GIB
            count = int(np.ceil((factors + spread + first) / room))
            largest = first + (factors + spread) / count
            cells.append(str(count) if largest <= room else f"{count}, the first of {largest / 0.9 / GIB:.0f}")
        cells += [f"{at['LU operations'] / 1e12:.0f}", f"{at['LU operations'] / 1e11:.0f}"]
        lines.append(f"| {' | '.join(cells)} |")
    return f"{NOTE}{said}; bytes on {max(COUNTS)} processes are {more:.2f} times those of one.\n\n" + "\n".join(lines)


def put_between(begin: str, end: str, text: str) -> None:
    """Put a text into the page, between two of its lines."""
    page = PAGE.read_text(encoding="utf-8")
    before, after = page.split(begin)[0], page.split(end)[1]
    PAGE.write_text(f"{before}{begin}\n{text}\n\n{end}{after}", encoding="utf-8", newline="\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--matrix", type=Path, help="print what the analyses of this one tell")
    parser.add_argument("--mesh", type=float, metavar="SIZE", help="print what a sweep on this one takes")
    parser.add_argument("--rows", type=Path, help="of an earlier run, one a line, instead of measuring")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/cluster.md")
    options = parser.parse_args()
    if options.matrix is not None:
        print(json.dumps(analysed(options.matrix)), flush=True)
        return
    if options.mesh is not None:
        print(json.dumps(swept(options.mesh)), flush=True)
        return
    if options.rows is None:
        every = [row for size in SIZES for row in measured(size)]
        every += [started(count, "--mesh", str(size)) for size in SWEPT for count in COUNTS]
    else:
        every = [json.loads(line) for line in options.rows.read_text("utf-8").splitlines()]
    rows, runs = [r for r in every if "peaks" not in r], [r for r in every if "peaks" in r]
    text = f"{table(rows)}\n\n{peaks(runs)}\n\n{nodes(rows)}"
    print(text)
    if options.write:
        put_between(BEGIN, END, text)


if __name__ == "__main__":
    if is_helper():
        sys.exit(help_out())
    if process_count() > 1 or {"--matrix", "--mesh"} & set(sys.argv):
        prepare()
    code = 1
    try:
        main()
        code = 0
    finally:
        dismiss(code)
