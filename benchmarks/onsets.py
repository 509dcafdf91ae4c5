"""Onsets of random sweeps against dense scans: python benchmarks/onsets.py [--sweeps 5000] [--processes 2] [--write]

The kinds of sweeps are those of tests/families.py and tests/structures.py, with other seeds than in the tests. Finished
sweeps are kept in results/onsets.jsonl, and a run that was stopped continues from there, unless the code has changed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
from datetime import date
from multiprocessing import Pool
from pathlib import Path

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):  # the matrices are small
    os.environ.setdefault(threads, "1")
ROOT = Path(__file__).parents[1]
PAGE, KEPT = ROOT / "docs" / "onsets.md", ROOT / "results" / "onsets.jsonl"
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import families  # noqa: E402
import structures  # noqa: E402
from families import FAMILIES, judge  # noqa: E402

from fe_squeal import sweep  # noqa: E402
from fe_squeal.errors import SquealError  # noqa: E402

_TOLD = 2  # warnings of one sweep that the page shows
FIRST_SEED = 10_000  # tests use smaller ones
# Without `large`: the judge counts all eigenvalues, and a sweep of a few of many modes does not have all.
KINDS = (*(kind for kind in FAMILIES if kind is not families.large), *structures.KINDS)
NOTE = """# Onsets of random sweeps

Random problems of several kinds (`tests/families.py`, `tests/structures.py`), each swept with all its modes. The judge
knows the matrices alone: it counts unstable eigenvalues by LAPACK at 1201 values and around what is known to be narrow,
and bisects where the count changes. An onset of the judge must be in the list of the sweep, with its direction, within
its uncertainty and 5e-6 of a step; one that is left over in that list is invented. "Silent" are sweeps with an onset
missed or invented and no warning, "warned" those with a warning, whether their list is wrong or not, "no result" those
that ended with an error. Seconds are those of one sweep, without the judge.

Made by `python benchmarks/onsets.py --write`; """

CAUSES = """
## What was found wrong before, and why

Each is a test of `tests/hard/test_every_onset.py` or `tests/hard/test_onsets_in_rounding.py` now.

- Four modes meeting, lightly damped: two changes of one group were refined to the same root. Bisection begins next to
  the change now, and modes are counted on both sides of every onset.
- Damping that falls with speed: the place where two real eigenvalues become a pair was sought between two samples
  alone; and real eigenvalues faster than every mode that swings were left out.
- Rotors: a gyroscopic doublet at the start seemed to grow by the error of the interpolation, which does not keep the
  symmetry of the spectrum; a pair that becomes two real eigenvalues within 1e-8 of a step was counted several times.
- Follower loads: near a double real eigenvalue shapes are like many others, and a mode seemed to be missing.
- Rings: doublets split by less than 1e-6 of a step, and a pair that is stable at one value alone.
- A pair with almost no damping that meets at λ = 0: the real eigenvalue that grows from there was taken for the mirror
  image of another.
- Bodies that are nearly rigid: two modes that are one within rounding had an onset in every step.
- Modes that pass the rim of the range in a step were told as an imbalance although all modes were known.
- Two ill-conditioned modes that pass each other within a step were not followed together, since a slope of an
  ill-conditioned eigenvalue was taken for ten times too small.
- Springs that are negative for a while, within one step (`tests/hard/test_windows_within_steps.py`): a θ was sampled
  closely where it meets another one, not where it turns below zero. And a symmetric K that is positive definite at both
  ends of a step was taken to be so between, which holds if it is linear in the parameter.
"""


def fingerprint() -> str:
    """Return a hash of the code that results depend on."""
    code = (ROOT / "fe_squeal" / room for room in ("eigen", "problem", "reduced", "sweep"))
    files = [*(f for room in code for f in sorted(room.rglob("*.py"))), Path(__file__)]
    files += [ROOT / "tests" / name for name in ("families.py", "structures.py")]
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()[:16]


def measure(number: int) -> dict:
    """Solve and judge one sweep."""
    kind, seed = KINDS[number % len(KINDS)], FIRST_SEED + number // len(KINDS)
    family = (families if kind in FAMILIES else structures).make(kind, seed)
    row: dict = {"number": number, "kind": kind.__name__, "seed": seed, "name": family.name, "error": ""}
    start = time.process_time()
    try:
        result = sweep(family.problem(), family.values, "p", modes=family.parts[0][1].shape[0])
    except SquealError as error:
        return row | {"error": str(error), "seconds": time.process_time() - start}
    row["seconds"] = time.process_time() - start
    verdict = judge(family, [(o.value, o.direction, o.uncertainty) for o in result.onsets])
    found = {"missed": verdict.missed, "invented": verdict.invented, "warnings": list(result.unsettled)}
    return row | {"onsets": len(result.onsets), **found}


def measure_all(count: int, processes: int) -> list[dict]:
    """Return the rows of `count` sweeps, including those that were kept."""
    code = fingerprint()
    known = [json.loads(line) for line in KEPT.read_text("utf-8").splitlines()] if KEPT.exists() else []
    rows = {row["number"]: row for row in known if row["code"] == code and row["number"] < count}
    KEPT.parent.mkdir(exist_ok=True)
    with KEPT.open("w", encoding="utf-8") as file, Pool(processes) as pool:
        file.writelines(json.dumps(row | {"code": code}) + "\n" for row in rows.values())
        file.flush()
        for row in pool.imap_unordered(measure, [i for i in range(count) if i not in rows]):
            rows[row["number"]] = row
            file.write(json.dumps(row | {"code": code}) + "\n")
            file.flush()
            if len(rows) % 100 == 0:
                print(f"{len(rows)} of {count} sweeps", file=sys.stderr)
    return [rows[i] for i in sorted(rows)]


def is_wrong(row: dict) -> bool:
    """Return whether an onset is missing, or one was found that does not exist."""
    return bool(row.get("missed") or row.get("invented"))


def page(rows: list[dict]) -> str:
    """Return the page: a table by kind, and a list of all sweeps with a wrong onset or a warning."""
    lines = ["| kind | sweeps | onsets | silent | warned | no result | seconds |", "|---|---|---|---|---|---|---|"]
    by_kind = {kind.__name__: [r for r in rows if r["kind"] == kind.__name__] for kind in KINDS}
    for name, own in [*by_kind.items(), ("all", rows)]:
        silent = sum(is_wrong(r) and not r["warnings"] for r in own)
        counts = [sum(r.get("onsets", 0) for r in own), silent]
        counts += [sum(bool(r.get("warnings")) for r in own), sum(bool(r["error"]) for r in own)]
        seconds = sum(r["seconds"] for r in own) / max(len(own), 1)
        lines.append(f"| {name.replace('_', ' ')} | {len(own)} | {' | '.join(map(str, counts))} | {seconds:.2f} |")
    told = [r for r in rows if is_wrong(r) or r["error"] or r.get("warnings")]
    lines += ["", f"Sweeps that were wrong, warned or ended with an error ({len(told)}):", ""] if told else []
    for r in told:
        what = [f"missed {v:.8g}" for v in r.get("missed", [])] + [f"invented {v:.8g}" for v in r.get("invented", [])]
        warnings = r.get("warnings", [])
        what += [f"warned: {w}" for w in warnings[:_TOLD]] + ([f"no result: {r['error']}"] if r["error"] else [])
        what += [f"{len(warnings) - _TOLD} more warnings of this kind"] if len(warnings) > _TOLD else []
        lines.append(f"- {r['kind']}, seed {r['seed']} ({r['name']}): {'; '.join(what)}")
    return "\n".join([f"{NOTE}{len(rows)} sweeps, {date.today()}.", "", *lines, CAUSES])


def main() -> int:
    """Measure, and print or write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sweeps", type=int, default=5000, help="how many in all (default: 5000)")
    parser.add_argument("--processes", type=int, default=os.cpu_count(), help="default: one for each core")
    parser.add_argument("--write", action="store_true", help="write docs/onsets.md instead of printing it")
    arguments = parser.parse_args()
    text = page(measure_all(arguments.sweeps, arguments.processes))
    if arguments.write:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
