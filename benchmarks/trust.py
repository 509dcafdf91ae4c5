"""Search for broken promises of docs/trust.md: python benchmarks/trust.py [--inputs 2000] [--signals 200] [--write]

It tries damaged inputs of every format, signals at random moments to every command, and every pair of commands at the
same time in one folder. The exit code is 1 if a promise was broken; --write puts the numbers into docs/trust.md.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Before NumPy is imported, and whatever the environment says: the search parts from itself (os.fork) after it has
# computed, and the threads of MKL and OpenBLAS do not come along. A copy that waits for them waits for ever.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "fuzz")]

import trust_inputs  # noqa: E402
import trust_signals  # noqa: E402

PAGE = Path(__file__).parents[1] / "docs" / "trust.md"
BEGIN, END = "<!-- {}: python benchmarks/trust.py --write -->\n", "<!-- end of {} -->\n"


def inputs_table(outcomes: dict[str, trust_inputs.Outcome]) -> str:
    """Return a row per format."""
    lines = ["| file | inputs | results | refused | not converged | broken promises |", "|---|---|---|---|---|---|"]
    for name, o in outcomes.items():
        lines.append(f"| {name} | {o.codes.total()} | {o.codes[0]} | {o.codes[2]} | {o.codes[3]} | {len(o.faults)} |")
    total = sum(o.codes.total() for o in outcomes.values())
    slowest, largest = (max(getattr(o, n) for o in outcomes.values()) for n in ("slowest", "largest"))
    said = (
        f"{total} inputs, each in a process of its own with {trust_inputs.MEMORY // 2**20} MiB beyond the program and"
        f" {trust_inputs.SECONDS} s of the processor; the slowest took {slowest:.1f} s, the largest {largest:.0f} MiB"
        ".\n\n"
    )
    return said + "\n".join(lines) + "\n"


def signals_table(outcomes: dict[str, trust_signals.Outcome]) -> str:
    """Return a row per command."""
    names = [number.name for number in trust_signals.SIGNALS]
    lines = [
        f"| command | {' | '.join(names)} | past the imports | had ended before | broken promises |",
        "|---|" + "---|" * (len(names) + 3),
    ]
    for name, o in outcomes.items():
        counts = " | ".join(str(o.signals[n]) for n in names)
        lines.append(f"| {name} | {counts} | {o.past} | {o.ended} | {len(o.faults)} |")
    total, past = (sum(x) for x in zip(*((o.signals.total(), o.past) for o in outcomes.values()), strict=True))
    return f"{total} signals, {past} of them past the imports.\n\n" + "\n".join(lines) + "\n"


def pairs_text(pairs: dict[str, str]) -> str:
    """Return a sentence with the number of pairs, and of those where something went wrong."""
    return f"{len(pairs)} pairs of commands at once in one folder; broken promises: {sum(map(bool, pairs.values()))}.\n"


def main() -> int:
    """Run the searches; return 1 if a promise was broken."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=2000)
    parser.add_argument("--signals", type=int, default=200)
    parser.add_argument("--pairs-step", type=int, default=1, help="every so manyth pair of commands; 0: none")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="fe_squeal_trust_"))  # not removed: it has the inputs that break promises

    def tell(text: str) -> None:
        print(text, flush=True)

    searches: dict[str, Callable[[Path], tuple[str, dict[str, list[str]]]]] = {}
    if given.inputs:
        searches["inputs"] = lambda place: _with_faults(
            trust_inputs.search(place, given.inputs, given.seed, tell), inputs_table
        )
    if given.signals:
        searches["signals"] = lambda place: _with_faults(
            trust_signals.search(place, given.signals, given.seed, tell), signals_table
        )
    if given.pairs_step:
        searches["pairs"] = lambda place: _of_pairs(trust_signals.both_at_once(place, given.pairs_step, given.seed))
    failed = False
    for name, search in searches.items():
        (folder / name).mkdir()
        begun = time.perf_counter()
        text, faults = search(folder / name)
        minutes = (time.perf_counter() - begun) / 60
        where = f"{platform.system()}, Python {platform.python_version()}"
        text += f"\nSeed {given.seed}; {minutes:.0f} minutes on {where}.\n"
        print(text)
        broken = [f"{key}: {fault}" for key, found in faults.items() for fault in found]
        print("\n".join(broken) or f"no promise was broken ({folder / name})", flush=True)
        failed |= bool(broken)
        if given.write:
            page = PAGE.read_text("utf-8")
            begin, end = BEGIN.format(name), END.format(name)
            head, tail = page[: page.index(begin) + len(begin)], page[page.index(end) :]
            PAGE.write_text(f"{head}\n{text}\n{tail}", encoding="utf-8")
    return int(failed)


def _with_faults(outcomes: dict[str, Any], table: Callable[[dict[str, Any]], str]) -> tuple[str, dict[str, list[str]]]:
    return table(outcomes), {name: o.faults for name, o in outcomes.items()}


def _of_pairs(pairs: dict[str, str]) -> tuple[str, dict[str, list[str]]]:
    return pairs_text(pairs), {name: [fault] for name, fault in pairs.items() if fault}


if __name__ == "__main__":
    sys.exit(main())
