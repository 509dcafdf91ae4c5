"""Memory of factors by MUMPS' own analysis: python benchmarks/cluster.py [--write]

For the matrix of examples/disc_pad.toml on finer meshes, without computing the factors: megabytes that the process with
most and all together need for LDLᵀ and LU, on 1, 2 and 4 processes of .venv-mpi. --write puts the table into
docs/cluster.md. Under mpiexec it prints the row of one mesh (--size).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tomllib
from pathlib import Path

import fe_squeal
from fe_squeal.eigen.linear.mumps import told_of
from fe_squeal.eigen.linear.processes import dismiss, help_out, prepare
from fe_squeal.process.ranks import is_helper, process_count

ROOT = Path(__file__).parents[1]
EXAMPLE, PAGE = ROOT / "examples/disc_pad.toml", ROOT / "docs/cluster.md"
BEGIN, END = "<!-- forecast: python benchmarks/cluster.py --write -->\n", "<!-- end of forecast -->\n"
SIZES, COUNTS = (0.014, 0.006), (1, 2, 4)  # m; finer ones take more memory on process 0 than this page is worth
HEAD = "| unknowns | processes | LDLᵀ, MB on one | on all | LU, MB on one | on all |\n|---|---|---|---|---|---|\n"


def measure(size: float, count: int) -> str:
    """Return the row of a mesh, by another process under mpiexec."""
    python = str(ROOT / ".venv-mpi/bin/python")
    command = ["mpiexec", "-q", "--oversubscribe", "--allow-run-as-root", "-n", str(count), python,
               __file__, "--size", str(size)]  # fmt: skip
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.replace("\r", "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=float, help="of the elements, m: print the row of this mesh")
    parser.add_argument("--write", action="store_true", help="put the table into docs/cluster.md")
    options = parser.parse_args()
    if options.size is None:
        table = HEAD + "".join(measure(size, count) for size in SIZES for count in COUNTS)
        print(table)
        if options.write:
            text = PAGE.read_text(encoding="utf-8")
            before, after = text.split(BEGIN)[0], text.split(END)[1]
            PAGE.write_text(f"{before}{BEGIN}\n{table}\n{END}{after}", encoding="utf-8", newline="\n")
        return
    data = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    data["mesh"].pop("file", None)
    data["mesh"]["disc_pad"]["size"] = options.size
    pencil = fe_squeal.assemble(fe_squeal.parse_scene(data)).pencil()
    A = (pencil.K - 1e8 * pencil.M).tocsr()
    A.sum_duplicates()
    told = [told_of(A, symmetric, False) for symmetric in (True, False)]
    cells = [A.shape[0], process_count(), *(size // 10**6 for t in told for size in (t.largest, t.total))]
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    if is_helper():
        sys.exit(help_out())
    prepare()
    code = 1
    try:
        main()
        code = 0
    finally:
        dismiss(code)
