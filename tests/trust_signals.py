"""Send signals to every command at random moments, and check what is in the folder afterwards.

This file is longer than others, since it has what each command promises, beside what all of them do.
"""

from __future__ import annotations

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
from interrupted import assert_same_results, assert_valid, sweep_text
from scene_texts import environment, write_scene
from trust_kinds import COARSE, brake

from fe_squeal.cli import main

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL)
STUDY = """
[study]
samples = 128
indices = false
[study.parameters]
mu = { uniform = { low = 0.1, high = 0.5 } }
"springs.across.stiffness" = { uniform = { low = 1e7, high = 2e7 } }
"""
MAP = """
[study.x]
parameter = "mu"
from = 0.1
to = 0.5
points = 3
[study.y]
parameter = "springs.across.stiffness"
from = 1e7
to = 2e7
points = 3
"""
TARGET = ("--accuracy", "0.05")
_PAST = 0.75  # share of the signals that come when all is imported
_IMPORTS = 1.5  # s that these take
# Where the search runs in the background, signals may be ignored, which the command respects.
_PLAIN = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
    "signal.signal(signal.SIGHUP, signal.SIG_DFL); import sys, fe_squeal_start; sys.exit(fe_squeal_start.main())"
)


@dataclass(frozen=True)
class Task:
    """A command, the folder that it writes, and how this is compared with that of an uninterrupted command."""

    name: str
    arguments: tuple[str, ...]
    same: Callable[[Path, Path], None]  # of two folders
    again: tuple[str, ...] = ()  # options that finish what a signal has ended
    share: int = 1  # of all signals
    ends: tuple[int, ...] = (0,)  # exit codes of one that comes to its end: a budget may be too short on a busy machine
    of: str = ""  # the task whose results it is about
    once: bool = False  # it replaces nothing: what is there is whole
    forks: bool = True  # it may begin as a copy of this process; not with what starts threads that a copy lacks


@dataclass
class Outcome:
    """What happened with a command.

    Attributes
    ----------
    past : int
        Number of signals that came after everything was imported.
    ended : int
        Number of commands that had ended before the signal.
    """

    signals: Counter[str] = field(default_factory=Counter)
    past: int = 0
    ended: int = 0
    faults: list[str] = field(default_factory=list)


def same_run(found: Path, whole: Path) -> None:
    assert_same_results(found / "out", whole / "out")


def same_search(found: Path, whole: Path) -> None:
    """A search that was interrupted has chosen the mesh of an unbroken one, whose modes are the same."""
    assert (found / "out/mesh.msh").read_bytes() == (whole / "out/mesh.msh").read_bytes()
    a, b = (pd.read_csv(folder / "out/modes.csv") for folder in (found, whole))
    np.testing.assert_allclose(a[["value", "re", "im"]], b[["value", "re", "im"]], rtol=1e-9, atol=1e-9 * b["im"].max())
    assert not (found / "out/checkpoint").exists()
    assert json.loads((found / "out/run.json").read_text("utf-8"))["status"] == "complete"


def same_files(found: Path, whole: Path) -> None:
    names = [{p.relative_to(f).as_posix() for p in f.rglob("*")} for f in (found, whole)]
    assert names[0] == names[1], names
    for path in (p for p in whole.rglob("*") if p.suffix in (".csv", ".msh", ".toml")):
        assert (found / path.relative_to(whole)).read_bytes() == path.read_bytes(), path.name


def same_difference(found: Path, whole: Path) -> None:
    """But for the names of the folders."""
    a, b = (pd.read_csv(folder / "diff/diff.csv").drop(columns=["a", "b"]) for folder in (found, whole))
    pd.testing.assert_frame_equal(a, b)
    names = [{p.name for p in (f / "diff").iterdir()} for f in (found, whole)]
    assert names[0] == names[1], names


def same_study(found: Path, whole: Path) -> None:
    """Settings that both have measured have the same unknowns; how many there are depends on the time."""
    if not all((folder / "out" / "accuracy.csv").exists() for folder in (found, whole)):
        return  # the machine was too busy for a table within the budget
    settings = ["order", "size", "modes", "method", "tolerance", "knob"]
    a, b = (pd.read_csv(folder / "out" / "accuracy.csv").set_index(settings) for folder in (found, whole))
    common = a.index.intersection(b.index)
    assert len(common) and (a.loc[common, "unknowns"] == b.loc[common, "unknowns"]).all()


def nothing_to_compare(found: Path, whole: Path) -> None:
    assert not list(found.iterdir())


def tasks(place: Path) -> list[Task]:
    """Return all commands, with their scenes written."""
    for method in ("direct", "reduced"):
        write_scene(place, sweep_text(12, method), f"{method}.toml")
    shown = sweep_text(4).replace('shapes = "none"\nreport = false', 'shapes = "unstable"')
    write_scene(place, shown, "shapes.toml")
    write_scene(place, sweep_text(4) + STUDY, "study.toml")
    write_scene(place, sweep_text(4) + MAP, "map.toml")
    (place / "coarse.toml").write_text(COARSE)
    (place / "brake.cdb").write_text(brake())
    return [
        Task("run, direct", ("run", "direct.toml", "-o", "{}/out"), same_run, ("--resume",), 5),
        Task("run, reduced", ("run", "reduced.toml", "-o", "{}/out"), same_run, ("--resume",), 5),
        Task("run, shapes", ("run", "shapes.toml", "-o", "{}/out"), same_run, ("--resume",), 4),
        Task("run, accuracy", ("run", "coarse.toml", "-o", "{}/out", *TARGET), same_search, ("--resume",), 3),
        Task("check", ("check", "direct.toml"), nothing_to_compare),
        Task("onset", ("onset", "direct.toml"), nothing_to_compare, (), 2),
        Task("new", ("new", "brake.cdb", "-o", "{}/scene.toml"), same_files, once=True),
        Task("mesh", ("mesh", "direct.toml", "-o", "{}/out.msh"), same_files),
        Task("compare", ("compare", "minimal"), nothing_to_compare),
        Task("lumped", ("lumped", "oscillator", "--study", "all", "-o", "{}/out"), same_files, (), 2),
        Task("study", ("study", "study.toml", "-o", "{}/out"), same_files, ("--resume",), 2),
        Task("study, map", ("study", "map.toml", "-o", "{}/out"), same_files, ("--resume",), 2),
        Task("study, workers", ("study", "study.toml", "-o", "{}/out", "--workers", "2"), same_files, ("--resume",),
             forks=False),
        Task("accuracy", ("accuracy", "shapes.toml", "-o", "{}/out", "--budget", "10"), same_study, (), 1, (0, 3)),
        Task("report", ("report", "{}/out"), same_files, of="run, shapes"),
        Task("diff", ("diff", "{}/out", "{}/out", "-o", "{}/diff"), same_difference, of="run, shapes"),
        Task("animate", ("animate", "{}/out"), same_files, of="run, shapes"),
    ]


class Process:
    """A running command: started as a new program, or forked from this process, which has imported everything."""

    def __init__(self, arguments: list[str], place: Path, forked: bool) -> None:
        self._said, self._told = place / "stderr", place / "stdout"
        (place / "tmp").mkdir(exist_ok=True)
        if forked:
            self.pid = os.fork()
            if not self.pid:
                self._run(arguments, place)
        else:
            with self._said.open("w") as said, self._told.open("w") as told:
                # Nobody waits for it but `poll`: the module need not know that it has ended.
                self.pid = subprocess.Popen(
                    [sys.executable, "-P", "-c", _PLAIN, *arguments], cwd=place, stdout=told, stderr=said,
                    env=environment(TMPDIR=str(place / "tmp")),
                ).pid  # fmt: skip
        self.code: int | None = None

    def _run(self, arguments: list[str], place: Path) -> None:
        code = 1
        try:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            signal.signal(signal.SIGHUP, signal.SIG_DFL)
            os.dup2(os.open(self._said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            sys.stderr, sys.stdout = open(2, "w", closefd=False), open(1, "w", closefd=False)  # noqa: SIM115
            os.chdir(place)
            os.environ["TMPDIR"] = tempfile.tempdir = str(place / "tmp")
            code = main(arguments)
            sys.stderr.flush()
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
        finally:
            os._exit(code)

    def poll(self) -> int | None:
        """Return the exit code, or None while it runs."""
        if self.code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.code = os.waitstatus_to_exitcode(status) if pid else None
        return self.code

    def wait(self, seconds: float) -> bool:
        """Return whether it ends within some seconds."""
        end = time.monotonic() + seconds
        while self.poll() is None and time.monotonic() < end:
            time.sleep(0.005)
        return self.code is not None

    def wait_for_words(self, seconds: float) -> None:
        """Wait until it has said something, which it does when all is imported; for so long at most."""
        end = time.monotonic() + seconds
        while self.poll() is None and not self._told.stat().st_size and time.monotonic() < end:
            time.sleep(0.01)

    @property
    def said(self) -> str:
        """The text that it wrote on stderr."""
        return self._said.read_text("utf-8", "replace")


def search(
    place: Path, count: int, seed: int, tell: Callable[[str], None] = lambda text: None, only: str = ""
) -> dict[str, Outcome]:
    """Send `count` signals in all, and check after each whether the promises of docs/trust.md were kept."""
    rng = np.random.default_rng(seed)
    chosen = [task for task in tasks(place) if only in task.name]
    outcomes = {task.name: Outcome() for task in chosen}
    each = [task for task in chosen for _ in range(task.share)]
    order = [each[i] for i in rng.permutation(len(each))]  # random, so that a short search has commands of all kinds
    used = [task for task in chosen if task in order[:count]]
    # Those first that others need, and one before all others: these then tell their own time, without the imports.
    needed = {task.of for task in used} - {""}
    first = [task for task in tasks(place) if task.name in needed]
    for task in [task for task in (*first, *used) if task.forks][:1]:
        _unbroken(replace(task, name="imports"), place)
    seconds = {task.name: _unbroken(task, place) for task in (*first, *(t for t in used if t not in first))}
    for number in range(count):
        task, signal_ = order[number % len(order)], SIGNALS[(number // len(order) + number) % len(SIGNALS)]
        outcome = outcomes[task.name]
        past = bool(rng.random() < _PAST)
        outcome.past += past
        outcome.signals[signal_.name] += 1
        moment = rng.random() * (seconds[task.name] if past else _IMPORTS)
        fault = _interrupted(task, place, signal_, moment, past, outcome)
        if fault:
            outcome.faults.append(f"{signal_.name} {moment:.2f} s behind the {'imports' if past else 'start'}: {fault}")
        tell(f"{number + 1}: {task.name}, {signal_.name}: {fault or 'as promised'}")
    return outcomes


def _arguments(task: Task, folder: Path, more: tuple[str, ...] = ()) -> list[str]:
    return [a.format(folder) for a in (*task.arguments, *more)]


def _unbroken(task: Task, place: Path) -> float:
    """Run a command to its end in this process, which imports everything; return its seconds, with `_IMPORTS`."""
    folder, before = place / f"whole {task.name}", os.getcwd()
    _begin(task, folder, place)
    os.chdir(place)
    begun = time.perf_counter()
    try:
        if task.forks:
            with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
                code = main(_arguments(task, folder))
        else:
            process = Process(_arguments(task, folder), place, False)
            assert process.wait(120), task.name
            code = process.code
    finally:
        os.chdir(before)
    assert code in task.ends, task.name
    return time.perf_counter() - begun


def _begin(task: Task, folder: Path, place: Path) -> None:
    """Make the folder that a command is given."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    if task.of:
        shutil.copytree(place / f"whole {task.of}" / "out", folder / "out")


def _interrupted(
    task: Task, place: Path, number: signal.Signals, moment: float, past: bool, outcome: Outcome
) -> str:
    """Start a command, send it a signal, and return which promise was broken, if any."""
    folder, whole = place / "found", place / f"whole {task.name}"
    _begin(task, folder, place)
    process = Process(_arguments(task, folder), place, past and task.forks)
    if past and not task.forks:
        process.wait_for_words(60)
    time.sleep(moment)
    family = []
    if process.poll() is None:
        with suppress(psutil.NoSuchProcess):
            family = psutil.Process(process.pid).children(recursive=True)
        os.kill(process.pid, number)
    if not process.wait(120):
        os.kill(process.pid, signal.SIGKILL)
        return "it went on for 120 s"
    killed, code, said = number == signal.SIGKILL, process.code, process.said
    if code in task.ends:
        outcome.ended += 1
    elif not past and code == -number:
        pass  # the signal came before Python could handle signals
    elif code != (-number if killed else 130):
        return f"exit code {code}: {said[-300:]!r}"
    elif not killed and past and not (said.startswith("interrupted") and said.count("\n") == 1):
        return f"said {said[-300:]!r}"
    if psutil.wait_procs(family, timeout=30)[1]:
        return "a child process went on"
    if not killed and (left := [p.name for p in folder.rglob("*") if ".partial" in p.name or p.name == ".lock"]):
        return f"left {left}"
    if found := list((place / "tmp").iterdir()):
        shutil.rmtree(place / "tmp")
        return f"left {found} in TMPDIR"
    try:
        if task.same is same_run and (folder / "out").exists():
            assert_valid(folder / "out", whole / "out")
        if task.once and list(folder.iterdir()):
            task.same(folder, whole)
            return ""
        process = Process(_arguments(task, folder, task.again), place, task.forks)
        if process.wait(600) and process.code in task.ends[1:]:
            return ""
        if process.code:
            return f"the next command ended with {process.code}: {process.said[-300:]!r}"
        task.same(folder, whole)
    except AssertionError as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f"results differ: {where.line} {' '.join(str(error).split())[:300]}"
    return ""


def both_at_once(place: Path, step: int = 1, first: int = 0) -> dict[str, str]:
    """Start every pair of commands at the same time with the same folder; return what went wrong.

    One of them gets the folder. The other one is refused, or comes later and finds the results of the first.

    Parameters
    ----------
    place : Path
    step, first : int
        Of the list of all pairs, those from `first` on in steps of `step` are started.
    """
    write_scene(place, sweep_text(6, "direct"), "direct.toml")
    write_scene(place, sweep_text(6, "reduced"), "reduced.toml")
    write_scene(place, sweep_text(4) + STUDY, "study.toml")
    (place / "coarse.toml").write_text(COARSE)
    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        assert main(["run", str(place / "direct.toml"), "-o", str(place / "results")]) == 0
    commands = {
        "run": ("run", "direct.toml"), "run of another scene": ("run", "reduced.toml"),
        "run --resume": ("run", "direct.toml", "--resume"), "run --accuracy": ("run", "coarse.toml", *TARGET),
        "lumped": ("lumped", "oscillator", "--study", "noise-map"), "study": ("study", "study.toml"),
        "accuracy": ("accuracy", "direct.toml", "--budget", "5"), "diff": ("diff", "results", "results"),
    }  # fmt: skip
    found = {}
    pairs = list(itertools.combinations_with_replacement(commands, 2))
    for a, b in pairs[first % step :: step]:
        out = place / f"{a} and {b}"
        children = [
            subprocess.Popen(
                [sys.executable, "-P", "-m", "fe_squeal", *commands[name], "-o", str(out)], cwd=place,
                env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, encoding="utf-8",
            )
            for name in (a, b)
        ]  # fmt: skip
        said = [child.communicate(timeout=300)[1] for child in children]
        codes = [child.returncode for child in children]
        one = any(code in (0, 3) for code in codes)  # 3 if the budget of a study was too short on a busy machine
        refusals = all(
            code == 0 or (code == 2 and text.count("\n") == 1 and text.startswith(f"error: {out}"))
            or (code == 3 and "not converged" in text)
            for code, text in zip(codes, said, strict=True)
        )  # fmt: skip
        left = [p.name for p in out.rglob(".*")]
        wrong = not one or not refusals or bool(left)
        found[f"{a} and {b}"] = f"{codes} {said} {left}" if wrong else ""
    return found


