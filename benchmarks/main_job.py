"""Seconds and memory of the main job: python benchmarks/main_job.py [SCENE.toml] [runs]

Each run of the command is a process of its own; the seconds of the stages of every run and their median are printed.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

DEFAULT = Path(__file__).parents[1] / "examples" / "disc_pad.toml"


def measure(scene: Path) -> dict[str, float]:
    """Return seconds by stage, and MiB, of one run."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "fe_squeal", "run", str(scene), "-o", out]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        record = json.loads(Path(out, "run.json").read_text())
    return {**record["seconds"], "MiB": record["peak_memory_mib"], "unknowns": record["unknowns"]}


def main() -> None:
    """Print a table: a row per run and the median."""
    scene = Path(sys.argv[1]) if len(sys.argv) > 1 else DEFAULT
    runs = [measure(scene) for _ in range(int(sys.argv[2]) if len(sys.argv) > 2 else 3)]
    print(f"{scene.name}, {runs[0]['unknowns']} unknowns")
    keys = [k for k in runs[0] if k != "unknowns"]
    print("run     " + "".join(f"{k:>14}" for k in keys))
    for number, run in enumerate(runs, 1):
        print(f"{number:<8}" + "".join(f"{run[k]:14.2f}" for k in keys))
    print("median  " + "".join(f"{statistics.median(r[k] for r in runs):14.2f}" for k in keys))


if __name__ == "__main__":
    main()
