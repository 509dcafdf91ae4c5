"""Repeat tests in settings that must not change a verdict: python tests/again.py --repeat 20

A run of pytest has one setting of each of several kinds at once (threads, kernels, solver) and random examples, start
vectors and numbers of nodes of its own. Runs are so many that each setting has the repetitions asked for, and any two
settings of different kinds meet. --apart runs each setting by itself instead, to find the one that makes a test fail.
A line per run is appended to runs.jsonl in a new folder under results/. If a test fails, the output of pytest is kept
there too. The table at the end, or at Ctrl-C, is made from these lines; --resume continues in the newest folder. The
exit code is 1 if a test failed. Two runs at once, each in one process, take less time than one after the other in two
processes: what only one process can do, such as collecting the tests, is done beside the other run.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path

import variations

ROOT = Path(__file__).parents[1]
LOG = "runs.jsonl"
FOLDERS = ("tests/hard", "tests/analytic", "tests/convergence")
DEPENDS = "fe_squeal", "fe_squeal_start.py", "lumped", "meshes", "examples", "tests", "benchmarks/closed_forms.py"
THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
_PATIENCE = 30.0  # s: pytest has to end within this time after an interruption


@dataclass(frozen=True)
class Setting:
    """The environment and options that pytest is run with; "{k}" in a value is replaced by the repetition's number."""

    environment: dict[str, str] = field(default_factory=dict)
    marks: str = ""  # pytest's option -m, which selects tests
    paths: tuple[str, ...] = ()  # files of tests, instead of those on the command line
    needs: str = ""  # a flag that the processor has to have


def _threads(count: int) -> Setting:
    # The three variables of THREADS are for subprocesses of tests. MKL takes no more threads than there are cores
    # unless MKL_DYNAMIC is set. Waiting threads sleep at once: spinning threads of two processes on the same cores
    # would make a test take minutes.
    waiting = {"OPENBLAS_THREAD_TIMEOUT": "4", "KMP_BLOCKTIME": "0"}
    numbers = dict.fromkeys((*THREADS, variations.THREADS), str(count))
    return Setting({**numbers, **waiting, "MKL_DYNAMIC": "FALSE"})


SETTINGS = {
    "threads-1": _threads(1),
    "threads-2": _threads(2),
    "threads-4": _threads(4),
    "haswell": Setting({"OPENBLAS_CORETYPE": "Haswell", "MKL_ENABLE_INSTRUCTIONS": "AVX2"}, needs="avx2"),
    "skylakex": Setting({"OPENBLAS_CORETYPE": "SkylakeX", "MKL_ENABLE_INSTRUCTIONS": "AVX512"}, needs="avx512f"),
    "superlu": Setting({variations.SOLVER: "superlu"}),
    "start-vectors": Setting({variations.SEED: "{k}"}),
    "node-numbers": Setting({variations.SHUFFLE: "{k}"}),
    "hypothesis": Setting(marks="hypothesis", paths=("tests",)),
    "fuzz": Setting({variations.SEED: "{k}"}, paths=("tests/fuzz",)),
}
# A run has one setting of each of these kinds; "" is how it is on any machine. Every run has start vectors of its own.
THREAD_SETTINGS = "threads-1", "threads-2", "threads-4"
KERNELS = "", "haswell", "skylakex"
SOLVERS = "", "", "superlu"
NUMBERS = "", "node-numbers", "node-numbers"
ALONE = "hypothesis", "fuzz"  # other tests than those on the command line
# What Python compiles is kept: else every repetition would compile all that it imports again.
_CLEARED = {"PYTHONDONTWRITEBYTECODE", *THREADS, *(name for s in SETTINGS.values() for name in s.environment)}


@dataclass(frozen=True)
class Run:
    """The result of one run of pytest; `setting` joins the names of its settings by +."""

    setting: str
    repetition: int
    state: str  # hash of what the tests depend on, and whether it had changes
    selection: list[str]
    tests: int
    skipped: int
    failed: list[str]
    seconds: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the repetitions that the command line asks for, and print the table."""
    asked = _parser().parse_args(arguments)
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as a shell lets its background jobs
        signal.signal(signal.SIGINT, signal.default_int_handler)
    selection = [*asked.paths, *(["--fast"] if asked.fast else []), *(["--slow"] if asked.slow else [])]
    state = _state()
    folder, done = _folder(asked.resume)
    done = [r for r in done if r.state == state and r.selection == selection]
    known = {(r.setting, r.repetition) for r in done}
    print(f"{folder}: {len(known)} runs are there", flush=True)
    flags = _processor_flags()
    absent = [name for name in asked.settings if SETTINGS[name].needs not in {"", *flags}]
    for name in absent:
        print(f"{name}: left out, this processor has no {SETTINGS[name].needs}", flush=True)
    settings = [name for name in asked.settings if name not in absent]
    numbers = range(asked.first, asked.first + asked.repeat)
    wanted = apart(settings, numbers) if asked.apart else crossed(settings, numbers)
    todo = [(name, k) for k, name in wanted if (name, k) not in known]
    try:
        for run in _runs(todo, asked, folder, state, selection):
            done.append(run)
            with (folder / LOG).open("a", encoding="utf-8") as log:
                log.write(json.dumps(asdict(run)) + "\n")
            told = f"{run.setting} {run.repetition}: {run.tests} tests"
            print(f"{told}, {len(run.failed)} failed, {run.seconds:.0f} s", flush=True)
            for failure in run.failed:
                print(f"    {failure}", flush=True)
    except KeyboardInterrupt:
        print("\ninterrupted; --resume goes on from here")
        print(*table(done, asked.settings), sep="\n")
        return 130
    print(*table(done, asked.settings), sep="\n")
    return int(any(r.failed for r in done))


def apart(settings: Sequence[str], numbers: Sequence[int]) -> list[tuple[int, str]]:
    """Return the number and the setting of each run, where every run has one setting."""
    return [(k, name) for k in numbers for name in settings]


def crossed(settings: Sequence[str], numbers: Sequence[int]) -> list[tuple[int, str]]:
    """Return the number and the joined settings of each run, where a run has one setting of each kind.

    In nine runs in a row any two settings of different kinds meet once (a Latin square and the one orthogonal to it).
    In three runs each setting of threads, kernels and solver has its turn.

    Examples
    --------
    >>> [name for _, name in crossed(("threads-1", "threads-2", "superlu"), [1])]
    ['threads-1+superlu', 'threads-2']
    """
    found = []
    for k in numbers:
        for t in range(3):
            kinds = THREAD_SETTINGS[t], KERNELS[(t + k) % 3], SOLVERS[(t + 2 * k) % 3], NUMBERS[k % 3], "start-vectors"
            if joined := "+".join(name for name in kinds if name in settings):
                found.append((3 * k - 2 + t, joined))
        found += [(k, name) for name in ALONE if name in settings]
    return found


def table(runs: Sequence[Run], settings: Sequence[str]) -> Iterator[str]:
    """Return the lines of a table in Markdown: what failed in each setting, and how often."""
    yield "| setting | repetitions | tests of each | skipped | failures | tests that failed |"
    yield "|---|---|---|---|---|---|"
    for name in settings:
        own = [r for r in runs if name in r.setting.split("+")]
        failed = Counter(f for r in own for f in r.failed)
        which = ", ".join(f"{test} ({count})" for test, count in sorted(failed.items())) or "–"
        tests, skipped = (max((getattr(r, what) for r in own), default=0) for what in ("tests", "skipped"))
        yield f"| {name} | {len(own)} | {tests} | {skipped} | {sum(failed.values())} | {which} |"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=20, metavar="N", help="repetitions in each setting (20)")
    parser.add_argument("--first", type=int, default=1, metavar="K", help="number of the first repetition (1)")
    parser.add_argument("--settings", nargs="+", default=list(SETTINGS), choices=list(SETTINGS), metavar="NAME",
                        help=f"some of {', '.join(SETTINGS)} (all)")  # fmt: skip
    parser.add_argument("--paths", nargs="+", default=list(FOLDERS), metavar="PATH",
                        help=f"what the settings but the last two run ({' '.join(FOLDERS)})")  # fmt: skip
    parser.add_argument("--at-once", type=int, default=2, metavar="N", help="runs at once (2)")
    parser.add_argument("--workers", default="0", metavar="N", help="processes of a run beside pytest's own (0)")
    parser.add_argument("--apart", action="store_true", help="a run has one setting, not one of each kind")
    part = parser.add_mutually_exclusive_group()
    part.add_argument("--fast", action="store_true", help="only those tests that `make test` runs")
    part.add_argument("--slow", action="store_true", help="only the others")
    parser.add_argument("--minutes", type=float, default=120.0, help="after which a run counts as hung (120)")
    parser.add_argument("--resume", action="store_true", help="go on with the newest folder under results/")
    return parser


def _folder(resume: bool) -> tuple[Path, list[Run]]:
    """Return the folder of the log, and the runs that its log has already."""
    if resume and (found := sorted((ROOT / "results").glob(f"again-*/{LOG}"))):
        return found[-1].parent, [Run(**json.loads(line)) for line in found[-1].read_text("utf-8").splitlines()]
    folder = ROOT / "results" / time.strftime("again-%Y%m%d-%H%M%S")
    folder.mkdir(parents=True)
    return folder, []


def _runs(
    todo: Sequence[tuple[str, int]], asked: argparse.Namespace, folder: Path, state: str, selection: list[str]
) -> Iterator[Run]:  # fmt: skip
    """Yield the runs as they end; those that still run at an interruption are ended."""
    processes = Processes()
    with ThreadPoolExecutor(asked.at_once) as pool:
        futures = [pool.submit(_run, name, k, asked, folder, state, selection, processes) for name, k in todo]
        try:
            yield from (future.result() for future in as_completed(futures))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            processes.end()
            raise


def _run(
    name: str, k: int, asked: argparse.Namespace, folder: Path, state: str, selection: list[str], processes: Processes
) -> Run:  # fmt: skip
    settings = [SETTINGS[part] for part in name.split("+")]
    marks = [s.marks for s in settings if s.marks] + ["not slow"] * asked.fast + ["slow"] * asked.slow
    paths = [path for s in settings for path in s.paths] or asked.paths
    environment = {key: value for key, value in os.environ.items() if key not in _CLEARED}
    environment |= {key: value.format(k=k) for s in settings for key, value in s.environment.items()}
    with tempfile.TemporaryDirectory() as temporary:
        report = Path(temporary) / "report.xml"
        command = [
            sys.executable, "-m", "pytest", *paths, *(["-m", " and ".join(marks)] if marks else []),
            "-n", asked.workers, "--dist", "worksteal", f"--hypothesis-seed={k}", f"--junitxml={report}",
            "-p", "no:cacheprovider",
        ]  # fmt: skip
        start = time.monotonic()
        said, code = processes.output(command, environment, 60 * asked.minutes)
        seconds = time.monotonic() - start
        tests, skipped, failed = _read(report)
        if code != 0 and not failed:
            reason = "hung" if code is None else f"ended with code {code}"
            failed = [f"pytest {reason}: {said.strip().splitlines()[-1] if said.strip() else 'no output'}"]
        if failed:
            (folder / f"{name}-{k}.txt").write_text(said, encoding="utf-8")
    return Run(name, k, state, selection, tests, skipped, failed, round(seconds, 1))


class Processes:
    """The processes of pytest that run now."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._ended = False

    def output(self, command: list[str], environment: dict[str, str], seconds: float) -> tuple[str, int | None]:
        """Return the output of pytest and its exit code, None if it was ended because it took too long.

        Raises
        ------
        CancelledError
            `end` has been called.
        """
        with self._lock:
            if self._ended:
                raise CancelledError
            process = subprocess.Popen(
                command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8",
                errors="replace", start_new_session=True,
            )  # fmt: skip
            self._running.add(process)
        try:
            said = process.communicate(timeout=seconds)[0]
            code: int | None = process.returncode
        except subprocess.TimeoutExpired:
            said, code = _end(process), None
        with self._lock:
            self._running.discard(process)
            if self._ended:
                raise CancelledError
        return said, code

    def end(self) -> None:
        """Interrupt them all; those that do not end in time are killed. No others start."""
        with self._lock:
            self._ended = True
            running = list(self._running)
        for process in running:
            _signal(process, signal.SIGINT)
        limit = time.monotonic() + _PATIENCE
        while self._running and time.monotonic() < limit:
            time.sleep(0.1)
        for process in list(self._running):
            _signal(process, signal.SIGKILL)


def _end(process: subprocess.Popen[str]) -> str:
    """End pytest and its workers; return its output."""
    _signal(process, signal.SIGINT)
    try:
        return process.communicate(timeout=_PATIENCE)[0]
    except subprocess.TimeoutExpired:
        _signal(process, signal.SIGKILL)
        return process.communicate()[0]


def _signal(process: subprocess.Popen[str], number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):  # it has just ended
        os.killpg(process.pid, number)


def _read(report: Path) -> tuple[int, int, list[str]]:
    """Return how many tests there are in a JUnit report, how many were skipped, and the names of those that failed."""
    if not report.exists():
        return 0, 0, []
    cases = list(ET.parse(report).getroot().iter("testcase"))
    failed = [
        f"{case.get('classname', '').removeprefix('tests.').replace('.', '/')}::{case.get('name')}"
        for case in cases
        if case.find("failure") is not None or case.find("error") is not None
    ]
    return len(cases), sum(case.find("skipped") is not None for case in cases), failed


def _state() -> str:
    """Return what tells whether a verdict may differ: not the commit, which also changes with a page of docs/."""
    trees = _git("rev-parse", *(f"HEAD:{place}" for place in DEPENDS))
    if not trees:
        return "unknown"
    changed = "-dirty" if _git("status", "--porcelain", "--", *DEPENDS) else ""
    return hashlib.sha256(trees.encode()).hexdigest()[:12] + changed


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout if done.returncode == 0 else ""


def _processor_flags() -> set[str]:
    information = Path("/proc/cpuinfo")
    text = information.read_text("utf-8") if information.exists() else ""
    return {flag for line in text.splitlines() if line.startswith("flags") for flag in line.split(":")[1].split()}


if __name__ == "__main__":
    sys.exit(main())
