"""Memory that is forecast and memory that is taken: python benchmarks/memory.py [case ...] [--write]

Each case is one of the gallery's scenes, meshed, solved and written as `fe-squeal run` does it, in a process of its
own; another process forecasts its memory as `fe-squeal check` does. --write puts the table into docs/performance.md.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "gallery"))

from gallery_models import Scene, blocks, disc, lossy, mixed, pressed, strong, with_effects
from mesh_bars import with_section_of

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "performance.md"
HEAD = "## Memory: forecast and taken"
NOTE = """What a whole run takes at its peak, with page and shapes, beside what `fe-squeal check` forecasts from the
unknowns, the entries, the modes, and the analysis of the factors. The peak of a reduced sweep is where modes are made
exact by factors of the problem at one value, or later, where shapes, page and tables are written; the larger one
counts. Where friction and damping are weak, factors of the problem without them suffice. The forecast takes the
others; for large problems (30 million entries of K and more, whose factors are in single precision) it takes the
first, and says what the others would take more. Its parts: program and model (measured: the interpreter, its
libraries, the assembled terms); libraries that are loaded later (Matplotlib, pandas, the solver's kernels); sums of
matrices and what the solver copies; factors; vectors (basis, samples, corrections, Krylov spaces); what lifted shapes
take beyond that; projections of all terms; LAPACK's workspaces; in direct sweeps the sizes of entries that backward
errors are relative to; and what the C library keeps of freed memory (glibc's own count: 76 of 459 MiB at 6 558
unknowns). Meshing and assembly take less than that (at 129 066 unknowns 2.5 of 6.7 GiB), pictures are drawn by a
process of their own. How many vectors a basis needs is not known before: 5 for each mode without damping, 8 with it,
17 with complex stiffness are taken, where 12 to 23 were found; with complex stiffness the forecast may therefore miss
by a fifth (17 was chosen with the row of loss factors in sight, the others' numbers with six of the rows). SuperLU
has no analysis, so that its factors are known to a factor of three only. With more threads PARDISO's analysis tells
more (two: 7 % of the second row's whole)."""


@dataclass(frozen=True)
class Case:
    """A scene with its size of elements, and how it is solved."""

    name: str
    build: Callable[[], Scene]
    method: str = "reduced"
    modes: int = 50
    points: int = 21
    linear_solver: str = "auto"

    def scene(self) -> Scene:
        """Return the scene as its file would have it."""
        scene = copy.deepcopy(self.build())
        scene["title"] = self.name
        scene["sweep"] = {"parameter": "mu", "from": 0.0, "to": 0.6, "points": self.points}
        scene["solve"] = {"modes": self.modes, "method": self.method, "linear_solver": self.linear_solver}
        return scene


def damped(size: float) -> Scene:
    """Return the strongly coupled brake, in hexahedra, with damping."""
    return with_effects(strong(size, "hex"), rayleigh={"alpha": 15.0, "beta": 1.5e-7})


CASES = (
    Case("hexahedra, reduced", lambda: disc(0.0165)),
    Case("hexahedra, direct", lambda: disc(0.0165), "direct", 20, 3),
    Case("tetrahedra, reduced", lambda: strong(0.016)),
    Case("tetrahedra, direct", lambda: strong(0.0115), "direct", 20, 2),
    Case("damped, reduced", lambda: damped(0.0165), modes=30, points=5),
    Case("damped, direct", lambda: damped(0.0165), "direct", 20, 2),
    Case("loss factors, reduced", lambda: lossy(0.0165), modes=15, points=5),
    Case("loss factors, direct", lambda: lossy(0.0165), "direct", 20, 2),
    Case("preload, direct", lambda: pressed(0.0165), "direct", 20, 2),
    Case("preload, reduced", lambda: pressed(0.0165), points=5),
    Case("mixed linings, reduced", lambda: mixed(0.0165), points=5),
    Case("larger hexahedra, reduced", lambda: disc(0.0085), points=5),
    Case("larger tetrahedra, reduced", lambda: strong(0.0085), points=5),
    Case("hexahedra, SuperLU, reduced", lambda: disc(0.0165), points=5, linear_solver="superlu"),
    Case("blocks, SuperLU, direct", lambda: blocks(0.008, count=6, belt=0.012), "direct", 20, 2, "superlu"),
)


def forecast(case: Case) -> dict:
    """Return the unknowns of a case and the bytes of its forecast, MiB."""
    import fe_squeal.cli  # noqa: F401, as `fe-squeal check` has loaded it
    from fe_squeal import assemble, parse_scene
    from fe_squeal.assembly.swept import swept
    from fe_squeal.run import check  # noqa: F401
    from fe_squeal.scene.solver import solver_of
    from fe_squeal.sweep.forecast import predict_memory

    scene = parse_scene(case.scene())
    problem = assemble(scene)
    parameter, values = swept(scene, problem)
    found = predict_memory(problem, parameter, len(values), case.modes, case.method, solver_of(scene))
    return {"unknowns": problem.unknowns, "forecast": found.total / 2**20, "parts": str(found)}


def run(case: Case) -> dict:
    """Run a case into a folder that is thrown away, and return what its record says."""
    from rich.console import Console

    from fe_squeal import parse_scene
    from fe_squeal.run.run import run_scene

    with tempfile.TemporaryDirectory() as folder, open(os.devnull, "w") as nowhere:
        code = run_scene(parse_scene(case.scene()), Path(folder) / "out", Console(file=nowhere))
        record = json.loads((Path(folder) / "out" / "run.json").read_text("utf-8"))
    return {"code": code, "taken": record["peak_memory_mib"], "seconds": record["seconds"]["total"],
            "class": record["problem_class"], "way": record["method"]}  # fmt: skip


def measured(case: Case) -> dict:
    """Return forecast and truth, each by a process of its own."""
    found: dict = {"name": case.name}
    for what in ("forecast", "run"):
        done = subprocess.run(
            [sys.executable, __file__, case.name, "--one", what], stdout=subprocess.PIPE, text=True, check=True,
            env={**os.environ, "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "1")},
        )  # fmt: skip
        found |= json.loads(done.stdout.splitlines()[-1])
    return found


def table(rows: list[dict]) -> str:
    """Return the rows as Markdown."""
    head = ["model", "unknowns", "class", "taken, MiB", "forecast, MiB", "forecast / taken"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for r in rows:
        ratio = r["forecast"] / r["taken"]
        mib = (f"{r[key]:.0f}" for key in ("taken", "forecast"))
        cells = [r["name"].strip(), r["unknowns"], r["class"], *mib, f"{ratio:.2f}"]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table, or write it into docs/performance.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="case", help="default: all")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--one", choices=["forecast", "run"], help=argparse.SUPPRESS)
    given = parser.parse_args()
    cases = [c for c in CASES if not given.cases or c.name in given.cases]
    if given.one:
        print(json.dumps({"forecast": forecast, "run": run}[given.one](cases[0])))
        return
    rows = []
    for case in cases:
        rows.append(measured(case))
        print(rows[-1], file=sys.stderr, flush=True)
    print(table(rows))
    if given.write:
        made = f"Made by `python benchmarks/memory.py --write`; {os.cpu_count()} cores, {time.strftime('%Y-%m-%d')}."
        text = PAGE.read_text(encoding="utf-8")
        rest = "; ".join(c.name for c in CASES if c not in cases)
        rest = f"\nNot measured in this run: {rest}.\n" if rest else ""
        section = f"{HEAD}\n\n{NOTE}\n{made}\n{rest}\n{table(rows)}\n"
        PAGE.write_text(with_section_of(HEAD, text, section), encoding="utf-8")


if __name__ == "__main__":
    main()
