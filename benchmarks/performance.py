"""How a sweep grows with the problem: python benchmarks/performance.py [mesh ...] [--modes 50] [--values 21]
[--log FILE] [--write]

The disc with two pads of examples/disc_pad.toml, meshed with quadratic elements of the given sizes in m ("0.014", or
"tet 0.02" for tetrahedra), is swept over the friction coefficient with `method = "reduced"`, each mesh in a process of
its own: seconds of every stage, the largest memory of the process and what `fe-squeal check` would have predicted, and
where seconds and bytes go. The largest mesh has 1 003 086 unknowns and takes 18 GiB and a quarter of an hour. A line
per mesh is appended to the file of `--log`, and what is there already is not measured again. `--write` replaces the
rows of these meshes in docs/performance.md, and leaves those of others.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from contextlib import ExitStack
from functools import wraps
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "performance.md"
STOP = 0.6  # the last friction coefficient
PARTS = {"_begin": "first modes", "_add_modes": "modes at values", "_search": "search for missing ones"}
BYTES = ("program and model", "matrices", "factors", "vectors")
INSIDE = """Where the seconds of the reduced model go, and the bytes by the forecast. The first modes are those without
friction, by block Lanczos iteration with factors of P = K − σM; modes at further values are made exact by corrections
with the same factors, or, where these are slow because friction or damping is strong, with those of Q(iω). From 30
million entries of K on, factors are in single precision, and the terms of single bodies lie in files.
"""
MESHES = ["0.014", "0.0095", "0.0055", "0.0034", "0.0025", "tet 0.02", "tet 0.0105", "tet 0.0058", "tet 0.0034",
          "tet 0.0023"]  # fmt: skip
STAGES = {"assembly": "assembly", "reduction": "reduced model", "onsets": "onsets", "completeness": "count"}
NOTE = """The disc with two pads of `examples/disc_pad.toml` on finer and finer meshes of 27-node hexahedra ("hex") or
quadratic tetrahedra ("tet"), swept over the friction coefficient with right and left modes, tracking, onsets and the
count of modes. The reduced model is made once; each value of the sweep then costs a small dense eigenproblem. The
predicted memory is that of `fe-squeal check`, with 62 MiB for pictures, which are not drawn here.
Made by `python benchmarks/performance.py --write`, each mesh by itself; """


def build(size: float, element: str = "hex"):
    """Return the assembled problem of the disc meshed with elements of a size, m, hexahedra or tetrahedra ("tet")."""
    from fe_squeal import assemble, parse_scene

    raw = tomllib.loads((ROOT / "examples" / "disc_pad.toml").read_text("utf-8"))
    del raw["mesh"]["file"], raw["solve"]
    raw["mesh"]["disc_pad"] |= {"size": size, "element": element}
    return assemble(parse_scene(raw))


def measure(mesh: str, modes: int, values: int) -> dict:
    """Sweep one problem in this process."""
    from fe_squeal import sweep
    from fe_squeal.eigen.memory import peak_memory_mib
    from fe_squeal.reduced.model import ReducedModel
    from fe_squeal.sweep.forecast import predict_memory

    within: dict[str, float] = {}
    start = time.perf_counter()
    size, element = size_of(mesh)
    problem = build(size, element)
    assembly = time.perf_counter() - start
    predicted = predict_memory(problem, "mu", values, modes, "reduced")
    start = time.perf_counter()
    with ExitStack() as stack:
        for name in PARTS:
            same = timed(getattr(ReducedModel, name), within)
            stack.enter_context(mock.patch.object(ReducedModel, name, same))
        found = sweep(problem, np.linspace(0.0, STOP, values), modes=modes, method="reduced")
    return {
        "mesh": mesh, "element": element, "unknowns": problem.unknowns, "total": assembly + time.perf_counter() - start,
        "stages": {"assembly": assembly, **found.seconds}, "method": found.method, "onsets": len(found.onsets),
        "warnings": len(found.warnings), "proven": found.completeness.proven, "MiB": peak_memory_mib(),
        "predicted": predicted.total / 2**20, "factors": predicted.factors / 2**20, "within": within,
        "parts": {name: size / 2**20 for name, size in predicted.parts.items()}, "date": time.strftime("%Y-%m-%d"),
    }  # fmt: skip


def size_of(mesh: str) -> tuple[float, str]:
    """Return the size of elements, m, and their kind, from the words for a mesh."""
    element, _, size = f"hex {mesh}".rpartition(" ")
    return float(size), element.split()[-1]


def timed(function: Callable[..., Any], seconds: dict[str, float]) -> Callable[..., Any]:
    """Return a function that does the same and adds the seconds that it takes under its name."""

    @wraps(function)
    def same(*given: Any, **named: Any) -> Any:
        start = time.perf_counter()
        found = function(*given, **named)
        seconds[function.__name__] = seconds.get(function.__name__, 0.0) + time.perf_counter() - start
        return found

    return same


def table(rows: list[dict]) -> str:
    """Return the rows as Markdown."""
    head = ["unknowns", "elements", *(f"{name}, s" for name in STAGES.values()), "in all, s", "vectors", "onsets",
            "memory, MiB", "predicted, MiB", "of it factors", "measured"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for r in rows:
        cells = [f"{r['stages'][s]:.1f}" for s in STAGES]
        cells += [f"{r['total']:.1f}", r["method"].split()[3], str(r["onsets"])]
        cells += [*(f"{r[key]:.0f}" for key in ("MiB", "predicted", "factors")), r["date"]]
        lines.append(f"| {r['unknowns']} | {r['element']} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def inside(rows: list[dict]) -> str:
    """Return as Markdown where the seconds of the reduced models and the predicted bytes go."""
    head = ["unknowns", "elements", *(f"{name}, s" for name in PARTS.values())]
    head += [f"{name}, MiB" for name in (*BYTES, "others")]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for r in rows:
        cells = [f"{r['within'].get(name, 0.0):.1f}" for name in PARTS]
        cells += [f"{r['parts'].get(name, 0.0):.0f}" for name in BYTES]
        others = sum(size for name, size in r["parts"].items() if name not in BYTES)
        lines.append(f"| {r['unknowns']} | {r['element']} | " + " | ".join(cells) + f" | {others:.0f} |")
    return "\n".join(lines)


def merged(lines: str, page: str) -> str:
    """Return a table with the rows that the table of the same head on a page has besides, smaller ones first.

    Rows are the same where their first two cells are, the unknowns and the elements.
    """
    head, rule, *rows = lines.splitlines()
    before = page.partition(head)[2].partition("\n\n")[0].splitlines()[2:]
    every = {tuple(row.split("|")[1:3]): row for row in [*before, *rows]}
    return "\n".join([head, rule, *(every[key] for key in sorted(every, key=lambda key: (key[1], int(key[0]))))])


def main() -> None:
    """Print the table, or write it into docs/performance.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="*", default=MESHES)
    parser.add_argument("--modes", type=int, default=50)
    parser.add_argument("--values", type=int, default=21)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(measure(given.meshes[0], given.modes, given.values)))
        return
    log = given.log.read_text("utf-8").splitlines() if given.log is not None and given.log.exists() else []
    known = {row["mesh"]: row for row in map(json.loads, log)}
    for mesh in given.meshes:
        if mesh in known:
            continue
        command = [sys.executable, __file__, "--one", mesh, "--modes", str(given.modes)]
        pages = {**os.environ, "NUMPY_MADVISE_HUGEPAGE": "0"}  # as fe_squeal does where it is imported before NumPy
        done = subprocess.run([*command, "--values", str(given.values)], stdout=subprocess.PIPE, text=True, env=pages)
        if done.returncode:
            sys.exit(done.returncode)
        known[mesh] = json.loads(done.stdout.splitlines()[-1])
        print(known[mesh], file=sys.stderr)
        if given.log is not None:
            with given.log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(known[mesh]) + "\n")
    rows = [known[mesh] for mesh in given.meshes]
    print(table(rows), inside(rows), sep="\n\n")
    if given.write:
        when = f"{given.modes} modes, {given.values} values; {os.cpu_count()} cores, shared with other work."
        # Behind it are the sections of other files (Makefile).
        page, *others = PAGE.read_text(encoding="utf-8").partition("\n## ")
        first, second = (merged(lines, page) for lines in (table(rows), inside(rows)))
        text = f"# How a sweep grows with the problem\n\n{NOTE}{when}\n\n{first}\n\n{INSIDE}\n{second}\n"
        PAGE.write_text(text + "".join(others), encoding="utf-8")


if __name__ == "__main__":
    main()
