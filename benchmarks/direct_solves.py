"""One direct solve by this program and by SLEPc, both on MUMPS: python benchmarks/direct_solves.py [--write]

The matrices of examples/disc_pad.toml on finer meshes at one friction coefficient: right and left modes with their
errors by this program, and SLEPc's Krylov-Schur method for right modes alone and for both sides (two-sided), on one and
on two processes of mpiexec. SLEPc is that of the system's Python (Debian: apt-get install python3-slepc4py), this
program that of .venv-mpi. --write puts the table into docs/cluster.md.
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
from cluster import MPIEXEC, ROOT, assembled, put_between

from fe_squeal.eigen.linear.processes import dismiss, help_out, prepare
from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.process.ranks import is_helper, process_count

SLEPC = Path(__file__).with_name("slepc_solve.py")
BEGIN, END = "<!-- direct solves: python benchmarks/direct_solves.py --write -->\n", "<!-- end of direct solves -->\n"
SIZES, COUNTS, MODES, MU = (0.014, 0.0095, 0.0055), (1, 2), 50, 0.35
WAYS = {"pardiso": "own, PARDISO", "mumps": "own, MUMPS", "1": "SLEPc, right modes", "2": "SLEPc, both sides"}
NOTE = f"""Seconds of one solve for {MODES} modes at µ = {MU}, factors included. Of this program they are those of
right and left modes with backward errors, conditions and uncertainties; SLEPc gives eigenvalues and vectors of one side
or both, to a tolerance of 1e-8. The last column is the largest relative difference of an eigenvalue of SLEPc (right
modes) from that of this program. Two processes share two cores, so that they show what spreading costs, not what it
gains.
"""


def solved(folder: Path, way: str) -> dict:
    """Return the seconds of a solve by this program, and λ², of the matrices in a folder."""
    M, K = (sp.csr_array(sp.load_npz(folder / f"{name}.csr.npz")) for name in "MK")
    start = time.perf_counter()
    modes = solve_modes(Pencil(M, K), Request(count=MODES), linear_solver=way)
    seconds = time.perf_counter() - start
    theta = -(modes.lam**2)
    return {"seconds": seconds, "theta": [[float(v.real), float(v.imag)] for v in theta]}


def started(command: list[str], count: int) -> str:
    """Return what a command prints, on so many processes."""
    whole = command if count == 1 else [*MPIEXEC, str(count), *command]
    environment = {**os.environ, "PYTHONPATH": "", "OMP_NUM_THREADS": "1"}
    return subprocess.run(whole, check=True, stdout=subprocess.PIPE, text=True, env=environment).stdout


def measured(size: float) -> list[dict]:
    """Return a row for each number of processes."""
    problem = assembled(size)
    pencil = problem.pencil({"mu": MU})
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for which, A in (("K", pencil.K), ("M", pencil.M)):
            sp.save_npz(folder / f"{which}.csr.npz", sp.csr_array(A), compressed=False)
            np.savez(folder / f"{which}.npz", data=A.data, indices=A.indices, indptr=A.indptr)
        for count in COUNTS:
            row: dict = {"unknowns": pencil.n, "processes": count}
            for way in WAYS:
                if way == "pardiso" and count > 1:
                    continue
                if way in ("1", "2"):
                    told = started(["/usr/bin/python3", str(SLEPC), name, str(MODES), way], count).split()
                    row[way] = float(told[-2])
                    if way == "1":
                        row["error"] = difference(row["theta"], np.load(folder / "theta.npy"))
                else:
                    python = sys.executable if way == "pardiso" else str(ROOT / ".venv-mpi/bin/python")
                    found = json.loads(started([python, __file__, "--solve", name, way], count).splitlines()[-1])
                    row[way], row["theta"] = found["seconds"], found["theta"]
            del row["theta"]
            print(json.dumps(row), file=sys.stderr, flush=True)
            rows.append(row)
    return rows


def difference(theta: list[list[float]], others: np.ndarray) -> float:
    """Return the largest relative distance of one of the θ found here from the nearest one of others (k,)."""
    own = np.array([complex(*v) for v in theta])
    # Of a pair at the end of the list SLEPc may have one more or one fewer.
    own = own[np.abs(own) <= 0.999 * np.abs(others).max()]
    return float((np.abs(own[:, None] - others[None, :]).min(axis=1) / np.abs(own)).max())


def table(rows: list[dict]) -> str:
    """Return the rows as Markdown."""
    lines = ["| unknowns | processes | " + " | ".join(f"{w}, s" for w in WAYS.values()) + " | difference |",
             "|---" * (len(WAYS) + 3) + "|"]  # fmt: skip
    for r in rows:
        cells = [f"{r[way]:.1f}" if way in r else "" for way in WAYS]
        lines.append(f"| {r['unknowns']} | {r['processes']} | {' | '.join(cells)} | {r['error']:.0e} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table, or write it into docs/cluster.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--solve", nargs=2, metavar=("FOLDER", "SOLVER"), help=argparse.SUPPRESS)
    parser.add_argument("--sizes", nargs="*", type=float, default=SIZES)
    parser.add_argument("--write", action="store_true", help="put the table into docs/cluster.md")
    options = parser.parse_args()
    if options.solve is not None:
        print(json.dumps(solved(Path(options.solve[0]), options.solve[1])), flush=True)
        return
    text = f"{NOTE}\n{table([row for size in options.sizes for row in measured(size)])}"
    print(text)
    if options.write:
        put_between(BEGIN, END, text)


if __name__ == "__main__":
    if is_helper():
        sys.exit(help_out())
    if process_count() > 1:
        prepare()
    code = 1
    try:
        main()
        code = 0
    finally:
        dismiss(code)
