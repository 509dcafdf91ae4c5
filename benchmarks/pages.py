"""Pages of 2 MB and of 4 kB under NumPy's arrays: python benchmarks/pages.py [--repeat 3] [COMMAND ...]

The command, `fe-squeal run examples/disc_pad.toml --accuracy 0.02` unless another is given, runs in turns with both.
Printed are the medians of seconds: elapsed, of the processors in the program, and of them in the system, which fills a
page with zeros, or gets it from the host of a virtual machine, when it is first written to.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

EXAMPLE = Path(__file__).parents[1] / "examples" / "disc_pad.toml"
PAGES = {"4 kB": "0", "2 MB": "1"}


def seconds(command: list[str], huge: str) -> tuple[float, float, float]:
    """Return the seconds of a command: elapsed, in the program, and in the system."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = {**os.environ, "NUMPY_MADVISE_HUGEPAGE": huge}
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    elapsed, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return elapsed, after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", nargs="*")
    parser.add_argument("--repeat", type=int, default=3, metavar="N")
    given = parser.parse_args()
    found: dict[str, list[tuple[float, float, float]]] = {pages: [] for pages in PAGES}
    with tempfile.TemporaryDirectory() as folder:
        run = [sys.executable, "-m", "fe_squeal", "run", str(EXAMPLE), "--accuracy", "0.02", "-o", f"{folder}/results"]
        for _ in range(given.repeat):
            for pages, huge in PAGES.items():
                found[pages].append(seconds(given.command or run, huge))
    print("| pages | s | s in the program | s in the system |", "|---|---|---|---|", sep="\n")
    for pages, times in found.items():
        print(f"| {pages} | " + " | ".join(f"{statistics.median(one):.1f}" for one in zip(*times, strict=True)) + " |")


if __name__ == "__main__":
    main()
