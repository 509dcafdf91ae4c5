"""Signals at random moments to every command, and what is there afterwards."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
from interrupted import assert_same_results, assert_valid, sweep_text
from scene_texts import environment, write_scene

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL)
_PAST = 0.75  # share of the signals that come when all is imported
# Where the search runs in the background, the shell has SIGINT ignored, which the command respects.
_HEARS = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); import sys, fe_squeal_start; "
_PLAIN = f"{_HEARS}sys.exit(fe_squeal_start.main())"
_IMPORTED = (
    f"{_HEARS}import fe_squeal.cli, fe_squeal.run.run, fe_squeal.scene.file, fe_squeal.assembly.assembly;"
    "print('imported', file=sys.__stdout__, flush=True); sys.exit(fe_squeal_start.main())"
)


@dataclass(frozen=True)
class Task:
    """A command, what it writes, and how that is held against an unbroken one's."""

    name: str
    arguments: tuple[str, ...]
    same: Callable[[Path, Path], None]  # of two folders
    again: tuple[str, ...] = ()  # options that finish what a signal has ended
    share: int = 1  # of all signals


@dataclass
class Outcome:
    """What happened to a command.

    Attributes
    ----------
    past : int
        Signals that came when all was imported.
    ended : int
        Commands that had ended before.
    """

    signals: Counter[str] = field(default_factory=Counter)
    past: int = 0
    ended: int = 0
    faults: list[str] = field(default_factory=list)


def same_run(found: Path, whole: Path) -> None:
    assert_same_results(found / "out", whole / "out")


def same_files(found: Path, whole: Path) -> None:
    names = [{p.relative_to(f).as_posix() for p in f.rglob("*")} for f in (found, whole)]
    assert names[0] == names[1], names
    for path in (whole / "out").rglob("*.csv"):
        assert (found / path.relative_to(whole)).read_bytes() == path.read_bytes(), path.name


def same_mesh(found: Path, whole: Path) -> None:
    assert (found / "out.msh").read_bytes() == (whole / "out.msh").read_bytes()


def same_study(found: Path, whole: Path) -> None:
    """Settings that both have measured have the same unknowns; how many there are depends on the time."""
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
    shown = sweep_text(6).replace('shapes = "none"', 'shapes = "unstable"')
    write_scene(place, shown, "shapes.toml")
    return [
        Task("run, direct", ("run", "direct.toml", "-o", "{}/out"), same_run, ("--resume",), 5),
        Task("run, reduced", ("run", "reduced.toml", "-o", "{}/out"), same_run, ("--resume",), 5),
        Task("run, shapes", ("run", "shapes.toml", "-o", "{}/out"), same_run, ("--resume",), 4),
        Task("check", ("check", "direct.toml"), nothing_to_compare),
        Task("onset", ("onset", "direct.toml"), nothing_to_compare, (), 2),
        Task("mesh", ("mesh", "direct.toml", "-o", "{}/out.msh"), same_mesh),
        Task("compare", ("compare",), nothing_to_compare),
        Task("lumped", ("lumped", "oscillator", "--study", "all", "-o", "{}/out"), same_files, (), 2),
        Task("accuracy", ("accuracy", "shapes.toml", "-o", "{}/out", "--budget", "20"), same_study),
    ]


def search(
    place: Path, count: int, seed: int, tell: Callable[[str], None] = lambda text: None, only: str = ""
) -> dict[str, Outcome]:
    """Send so many signals in all, and hold what is left to the promises."""
    rng = np.random.default_rng(seed)
    chosen = [task for task in tasks(place) if only in task.name]
    seconds = {task.name: _unbroken(task, place) for task in chosen}
    outcomes = {task.name: Outcome() for task in chosen}
    order = [task for task in chosen for _ in range(task.share)]
    for number in range(count):
        task, signal_ = order[number % len(order)], SIGNALS[(number // len(order) + number) % len(SIGNALS)]
        outcome = outcomes[task.name]
        past = bool(rng.random() < _PAST)
        outcome.past += past
        outcome.signals[signal_.name] += 1
        imports, work = seconds[task.name]
        moment = rng.random() * (work if past else imports)
        fault = _interrupted(task, place, signal_, moment, past, outcome)
        if fault:
            outcome.faults.append(f"{signal_.name} {moment:.2f} s behind the {'imports' if past else 'start'}: {fault}")
        tell(f"{number + 1}: {task.name}, {signal_.name}: {fault or 'as promised'}")
    return outcomes


def _start(task: Task, folder: Path, place: Path, past: bool, more: tuple[str, ...] = ()) -> subprocess.Popen[str]:
    arguments = [a.format(folder) for a in (*task.arguments, *more)]
    (place / "tmp").mkdir(exist_ok=True)
    child = subprocess.Popen(
        [sys.executable, "-P", "-c", _IMPORTED if past else _PLAIN, *arguments], cwd=place,
        env=environment(TMPDIR=str(place / "tmp")), stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8",
    )  # fmt: skip
    if past:
        assert child.stdout is not None and child.stdout.readline() == "imported\n"
    return child


def _unbroken(task: Task, place: Path) -> tuple[float, float]:
    """Run a command to its end; return the seconds of its imports, and of its work behind them."""
    folder = place / f"whole {task.name}"
    folder.mkdir()
    begun = time.perf_counter()
    child = _start(task, folder, place, True)
    imported = time.perf_counter()
    _, said = child.communicate(timeout=600)
    assert child.returncode == 0, said
    return imported - begun, time.perf_counter() - imported


def _interrupted(
    task: Task, place: Path, number: signal.Signals, moment: float, past: bool, outcome: Outcome
) -> str:
    """Send a signal and return which promise it broke, if any."""
    folder, whole = place / "found", place / f"whole {task.name}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    child = _start(task, folder, place, past)
    time.sleep(moment)
    family = []
    if child.poll() is None:
        with suppress(psutil.NoSuchProcess):
            family = psutil.Process(child.pid).children(recursive=True)
        child.send_signal(number)
    try:
        _, said = child.communicate(timeout=120)
    except subprocess.TimeoutExpired:
        child.kill()
        return "it went on for 120 s"
    killed = number == signal.SIGKILL
    expected = -number if killed else 130
    if child.returncode == 0:
        outcome.ended += 1
    elif not past and child.returncode == -number:
        return ""  # Python itself was not yet there to hear it
    elif child.returncode != expected:
        return f"exit code {child.returncode}: {said[-300:]!r}"
    elif not killed and past and not (said.startswith("interrupted") and said.count("\n") == 1):
        return f"said {said[-300:]!r}"
    if psutil.wait_procs(family, timeout=20)[1]:
        return "a child process went on"
    if not killed and (left := [p.name for p in folder.rglob("*") if ".partial" in p.name or p.name == ".lock"]):
        return f"left {left}"
    if left := list((place / "tmp").iterdir()):
        shutil.rmtree(place / "tmp")
        return f"left {left} in TMPDIR"
    try:
        if task.again and (folder / "out").exists():
            assert_valid(folder / "out", whole / "out")
        child = _start(task, folder, place, True, task.again)
        _, said = child.communicate(timeout=600)
        if child.returncode:
            return f"the next command ended with {child.returncode}: {said[-300:]!r}"
        task.same(folder, whole)
    except AssertionError as error:
        return f"results differ: {' '.join(str(error).split())[:300]}"
    return ""


def both_at_once(place: Path) -> dict[str, str]:
    """Start every pair of commands that write into one folder at the same time; return what went wrong.

    One of them has the folder, the other one is refused, or comes later and finds the results of the first.
    """
    write_scene(place, sweep_text(6, "direct"), "direct.toml")
    write_scene(place, sweep_text(6, "reduced"), "reduced.toml")
    commands = {
        "run": ("run", "direct.toml"), "run of another scene": ("run", "reduced.toml"),
        "run --resume": ("run", "direct.toml", "--resume"), "lumped": ("lumped", "oscillator", "--study", "noise-map"),
        "accuracy": ("accuracy", "direct.toml", "--budget", "5"),
    }  # fmt: skip
    found = {}
    names = list(commands)
    for i, a in enumerate(names):
        for b in names[i:]:
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
            one = any(code == 0 for code in codes)
            refusals = all(
                code == 0 or (code == 2 and text.count("\n") == 1 and text.startswith(f"error: {out}"))
                or (code == 3 and "not converged" in text)
                for code, text in zip(codes, said, strict=True)
            )  # fmt: skip
            left = [p.name for p in out.rglob(".*")]
            right = not one or not refusals or bool(left)
            found[f"{a} and {b}"] = f"{codes} {said} {left}" if right else ""
    return found


