"""Run the command on damaged inputs of every format, each in a process of its own with limits of memory and time."""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from trust_kinds import Kind, kinds, list_again
from undrawn import without_figures

from fe_squeal.cli import main

MEMORY, SECONDS = 2**30, 10  # bytes beyond those of the program itself, and s of the processor
_PEAK = "\0peak "  # behind it stands the peak of the memory, after all that the command said
_WALL = 120.0  # s until a process that neither computes nor ends is ended: it waits for something


@dataclass
class Outcome:
    """What happened with the damaged inputs of a format.

    Attributes
    ----------
    codes : Counter
        How often each exit code occurred.
    faults : list of str
        Promises that were broken, each with the input, which is kept.
    slowest : float, s
        CPU time of the slowest input.
    largest : float, MiB
        Largest peak of memory, without that of the program itself.
    """

    codes: Counter[int] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest: float = 0.0
    largest: float = 0.0


def search(folder: Path, count: int, seed: int, tell: Callable[[str], None] = lambda text: None) -> dict[str, Outcome]:
    """Run the command on so many spoilt inputs in all, and hold each to its promises."""
    with without_figures():
        return _search(folder, count, seed, tell)


def _search(folder: Path, count: int, seed: int, tell: Callable[[str], None]) -> dict[str, Outcome]:
    every = kinds(folder / "good")
    # A short search spoils every so manyth of them only, since each has to be seen to be good before.
    chosen = [k * len(every) // count for k in range(count)] if count < len(every) else range(len(every))
    different = {(every[i].command[0], every[i].target.suffix): every[i] for i in chosen}
    for kind in different.values():  # what the program imports for them is there before the processes part
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
            main(_prepared(kind, folder))
    outcomes = {}
    for n, i in enumerate(chosen):
        kind = every[i]
        outcome = outcomes[kind.name] = Outcome()
        base, rng = kind.base(), np.random.default_rng([seed, i])
        try:
            if _checked(kind, base, outcome, folder) != 0:
                said = (folder / "stderr").read_text()
                raise AssertionError(f"{kind.name}: the file is bad before it is spoilt: {said}")
            outcome.codes.clear()
            for number in range(count // len(chosen) + (n < count % len(chosen))):
                data, before = kind.spoil(base, rng), len(outcome.faults)
                _checked(kind, data, outcome, folder, bool(rng.integers(2)))
                if len(outcome.faults) > before:
                    kept = folder / f"fault_{i}_{number}_{kind.target.name}"
                    kept.write_bytes(data)
                    outcome.faults[-1] += f" ({kept})"
        finally:
            if kind.results is None:
                kind.target.write_bytes(base)
        tell(f"{kind.name}: {dict(sorted(outcome.codes.items()))} {outcome.faults or ''}")
    return outcomes


def _prepared(kind: Kind, folder: Path) -> list[str]:
    """Put a folder of results where the command looks for it, and return its arguments."""
    out, more = folder / "out", folder / "more"
    for made in (out, more):
        shutil.rmtree(made, ignore_errors=True)
        made.unlink(missing_ok=True)
    if kind.results is not None:
        shutil.copytree(kind.results, out)
    return [part.replace("{out}", str(out)).replace("{more}", str(more)) for part in kind.command]


def _checked(kind: Kind, data: bytes, outcome: Outcome, folder: Path, listed: bool = False) -> int:
    """Run the command in a process of its own; note what it did and what it broke.

    Of a file in a folder of results, `listed` is whether the manifest says that it was written so.
    """
    arguments, said = _prepared(kind, folder), folder / "stderr"
    out, more = folder / "out", folder / "more"
    target = kind.target if kind.results is None else out / kind.target
    target.write_bytes(data)
    if kind.results is not None and listed and kind.target.name != "manifest.sha256":
        list_again(out, kind.target.as_posix())
    before, results = _content(kind.folder), _content(out)
    begun = time.monotonic()
    child = os.fork()
    if not child:
        _child(arguments, said)
    late = False
    while not (ended := os.wait4(child, os.WNOHANG))[0]:
        if time.monotonic() - begun > _WALL:
            late = True
            os.kill(child, signal.SIGKILL)
        time.sleep(0.002)
    code = os.waitstatus_to_exitcode(ended[1])
    used = ended[2]
    outcome.codes[code] += 1
    outcome.slowest = max(outcome.slowest, used.ru_utime + used.ru_stime)
    text = said.read_text("utf-8", "replace")
    message, _, peak = text.partition(_PEAK)
    outcome.largest = max(outcome.largest, float(peak or 0))
    faults = []
    if late:
        faults.append(f"waits for ever behind {_WALL:g} s")
    elif code not in (0, 2, 3):
        faults.append(f"exit code {code}: {message[-200:]!r}")
    elif message.count("\n") != (code != 0) or "Traceback" in message or not message.replace("\n", "").isprintable():
        faults.append(f"exit code {code} with the message {message[-200:]!r}")
    if code == 2 and (_content(out) != results or more.exists()):
        faults.append("a refused command has left or changed a file")
    if _content(kind.folder) != before:
        faults.append("a file beside the results was changed")
    outcome.faults += faults[:1]
    return code


def _child(arguments: list[str], said: Path) -> None:
    """Run the command and end this process; stderr is written to a file, followed by the peak of memory."""
    code = 1
    try:
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.stderr, sys.stdout = open(2, "w", closefd=False), open(1, "w", closefd=False)  # noqa: SIM115
        # The limit is in addition to the memory that the program has mapped, which is far more than it uses.
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
        start = _resident()
        warnings.simplefilter("always")
        code = main(arguments)
        sys.stderr.flush()
        os.write(2, f"{_PEAK}{_resident() - start:.1f}".encode())
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _resident() -> float:
    status = Path("/proc/self/status").read_text()
    return float(status.split("VmHWM:")[1].split()[0]) / 1024


def _content(folder: Path) -> dict[str, tuple[int, int]]:
    """Return when each file was written, and its size."""
    files = [p for p in folder.rglob("*") if not p.is_dir()] if folder.is_dir() else [folder] if folder.exists() else []
    return {str(p): (p.lstat().st_mtime_ns, p.lstat().st_size) for p in files}
