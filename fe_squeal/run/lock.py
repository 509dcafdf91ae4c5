"""A lock that lets one command at a time write into a folder."""

from __future__ import annotations

import errno
import os
import re
import stat
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import OutputError

LOCK = ".lock"
_TEXT = re.compile(rb"(process \d+ since [-\d]+ [:\d]+\n?)?")  # the file is empty for a moment after it was made
_TAKEN = {errno.EACCES, errno.EAGAIN, errno.EWOULDBLOCK, errno.EDEADLK}


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other commands from writing into a folder during the block.

    The operating system locks the file `.lock` in the folder, and releases it when the process ends, however that
    happens.

    Raises
    ------
    OutputError
        Another command holds the folder.
    OSError
        Nothing can be written there.
    """
    path = folder / LOCK
    handle = _locked(path)
    if handle is None:
        raise OutputError(
            f"{folder}: is held by another run{_holder(path)}; expected a folder of its own for every run at a"
            " time, given by -o"
        )
    try:
        os.ftruncate(handle, 0)
        os.write(handle, f"process {os.getpid()} since {time.strftime('%Y-%m-%d %H:%M:%S')}\n".encode())
        yield
    finally:
        _release(handle, path)


def is_lock(path: Path) -> bool:
    """Return whether a file is the lock of a command that is running, or was killed."""
    try:
        if not stat.S_ISREG(path.lstat().st_mode) or path.stat().st_size > 200:
            return False
        return _TEXT.fullmatch(path.read_bytes()) is not None
    except OSError:
        return False


def _locked(path: Path) -> int | None:
    """Return the handle of the file after locking it, or None if another process has locked it."""
    while True:
        if os.path.lexists(path) and not is_lock(path):
            raise OutputError(
                f"{path}: is no file that fe-squeal wrote; move it, or give another folder by -o"
            )
        handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        try:
            _lock(handle)
        except OSError as error:
            if error.errno in _TAKEN:
                os.close(handle)
                return None
            warnings.warn(f"{path.parent}: this file system knows no locks ({error.strerror})", stacklevel=2)
        # The process that held it before may have removed the file between opening and locking.
        with suppress(OSError):
            if os.path.samestat(os.fstat(handle), os.stat(path)):
                return handle
        os.close(handle)


def _release(handle: int, path: Path) -> None:
    """Remove the file while it is locked; after unlocking, where the system does not allow that (Windows)."""
    with suppress(OSError):
        path.unlink()
    os.close(handle)
    if sys.platform == "win32":
        with suppress(OSError):
            path.unlink()


def _holder(path: Path) -> str:
    with suppress(OSError, UnicodeDecodeError):
        text = path.read_text("utf-8").strip()
        return f" ({text})" if text else ""
    return ""


def _lock(handle: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        # A byte far behind the end is locked, since Windows does not let others read locked bytes.
        os.lseek(handle, 1 << 30, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        os.lseek(handle, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
