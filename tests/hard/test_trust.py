"""The searches of docs/trust.md, a small part of each; in full by `make trust`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from scene_texts import environment
from varied_imports import SHUFFLE

TRUST = Path(__file__).parents[2] / "benchmarks" / "trust.py"


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="looks for the memory of processes in /proc")
@pytest.mark.parametrize("options", [
    ("--inputs", "24", "--signals", "0", "--pairs-step", "0"),
    ("--inputs", "0", "--signals", "2", "--pairs-step", "0"),
    ("--inputs", "0", "--signals", "0", "--pairs-step", "36"),
])  # fmt: skip
def test_no_promise_is_broken(options: tuple[str, ...], other_seed: int) -> None:
    """In a process of its own, whose copies are under limits of memory and time.

    Nodes keep their numbers, by which decks name them.
    """
    command = [sys.executable, str(TRUST), *options, "--seed", str(other_seed)]
    plain = environment(**{SHUFFLE: ""})
    done = subprocess.run(command, env=plain, capture_output=True, encoding="utf-8", timeout=3600)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    if options[-1] == "36":  # of 36 pairs
        assert "\n1 pairs" in f"\n{done.stdout}"
    if "24" in options:  # else everything may have been refused at once, or nothing
        lines = [line for line in done.stdout.splitlines() if line.startswith("| ") and "broken" not in line]
        rows = [line.split("|")[2:5] for line in lines]
        total, good, refused = (sum(int(row[i]) for row in rows) for i in range(3))
        assert total == 24 and good > 1 and refused > 12
