"""Folders for the files of factors on disk: made when they are first needed, removed at the end."""

from __future__ import annotations

import atexit
import contextlib
import functools
import os
import shutil
import socket
import tempfile
from pathlib import Path

import psutil

_BEGIN = "fe_squeal_factors_"
_made: list[Path] = []


@functools.cache
def scratch_folder(parent: str) -> Path:
    """Return this run's own folder inside another one, "" for the system's folder of temporary files.

    Folders of runs on this machine that did not live to remove theirs are removed here.

    Raises
    ------
    OSError
        It cannot be made.
    """
    inside = Path(parent or tempfile.gettempdir())
    begin = f"{_BEGIN}{socket.gethostname()}_"
    for other in inside.glob(f"{begin}*"):
        number = other.name.removeprefix(begin).partition("_")[0]
        if number.isdigit() and not psutil.pid_exists(int(number)):
            shutil.rmtree(other, ignore_errors=True)
    made = Path(tempfile.mkdtemp(prefix=f"{begin}{os.getpid()}_", dir=inside)).absolute()
    _made.append(made)
    return made


def own_folder(whole: str, rank: int) -> Path:
    """Return the folder of one process: in the run's folder or, on another machine, in one of that machine's own.

    Only there is it known which processes still live, and its disk may be another one.
    """
    run = Path(whole)
    if not run.name.startswith(f"{_BEGIN}{socket.gethostname()}_"):
        run.parent.mkdir(parents=True, exist_ok=True)
        run = scratch_folder(str(run.parent))
    own = run / str(rank)
    if not own.is_dir():
        own.mkdir(parents=True, exist_ok=True)
        _made.append(own)
    return own


def remove_scratch() -> None:
    """Remove what this process has made; called at its end, whichever that is."""
    for folder in _made:
        shutil.rmtree(folder, ignore_errors=True)
        if folder.parent.name.startswith(_BEGIN):
            with contextlib.suppress(OSError):  # other processes may have files beside it
                folder.parent.rmdir()


def remove_scratch_at_exit() -> None:
    """Have it called at the end, after what is registered later: PETSc removes MUMPS' files itself, and wants them."""
    atexit.register(remove_scratch)
