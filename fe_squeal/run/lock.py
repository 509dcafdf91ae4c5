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
from ..process.signals import signals_deferred
from .open_folder import Entry, OpenFolder

LOCK = ".lock"
_TEXT = re.compile(rb"(process \d+ since [-\d]+ [:\d]+\n?)?")  # empty before it is written
_MOST_BYTES = 200  # of a file that may be a lock
_TAKEN = {errno.EACCES, errno.EAGAIN, errno.EWOULDBLOCK, errno.EDEADLK}


@contextmanager
def locked(folder: OpenFolder) -> Iterator[None]:
    """Keep other commands out of a folder inside the block.

    The operating system locks the file `.lock` in the folder, and releases it when the process ends, however that
    happens.

    Raises
    ------
    OutputError
        Another command holds the folder.
    OSError
        Nothing can be written there.
    """
    path, handle = folder.path / LOCK, None
    with folder.entry(LOCK) as entry:
        try:
            with signals_deferred():  # until it is known which file has to be removed again
                handle = _locked(entry, path)
            if handle is None:
                raise OutputError(
                    f"{folder.path}: is held by another run{_holder(path)}; expected a folder of its own for every run"
                    " at a time, given by -o"
                )
            os.ftruncate(handle, 0)
            os.write(handle, f"process {os.getpid()} since {time.strftime('%Y-%m-%d %H:%M:%S')}\n".encode())
            yield
        finally:
            if handle is not None:
                with signals_deferred():
                    _release(handle, entry)


def is_lock(path: Path) -> bool:
    """Return whether a file is the lock of a command that is running, or was killed."""
    try:
        handle = Entry(None, str(path)).open_regular()
    except OSError:
        return False
    try:
        return _holds_lock(handle)
    finally:
        os.close(handle)


def _holds_lock(handle: int) -> bool:
    """Return whether an opened file has the content of a lock, and stand at its beginning again."""
    try:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            return False
        text = os.read(handle, _MOST_BYTES)
        os.lseek(handle, 0, os.SEEK_SET)
    except OSError:
        return False
    return _TEXT.fullmatch(text) is not None


def _locked(entry: Entry, path: Path) -> int | None:
    """Return the handle of the file, locked, or None if it is locked by another process."""
    foreign = OutputError(f"{path}: is no file that fe-squeal wrote; move it, or give another folder by -o")
    while True:
        try:
            handle = entry.open(os.O_RDWR | os.O_CREAT)
        except OSError as error:
            if not is_lock(path) and os.path.lexists(path):
                raise foreign from error
            raise
        # Of the opened file, not of the path: another one may have come there since.
        if not _holds_lock(handle):
            os.close(handle)
            raise foreign
        try:
            _lock(handle)
        except OSError as error:
            if error.errno in _TAKEN:
                os.close(handle)
                return None
            warnings.warn(f"{path.parent}: this file system knows no locks ({error.strerror})", stacklevel=2)
        if _is_still(handle, entry):  # else its last holder has removed the file between the two steps
            return handle
        os.close(handle)


def _is_still(handle: int, entry: Entry) -> bool:
    """Return whether an entry is the opened file."""
    with suppress(OSError):
        found = entry.stat()
        return found is not None and os.path.samestat(os.fstat(handle), found)
    return False


def _release(handle: int, entry: Entry) -> None:
    """Remove the file while it is locked, or after that where the system does not allow it (Windows)."""
    ours = _is_still(handle, entry)
    with suppress(OSError):
        if ours:
            entry.remove()
    os.close(handle)
    if sys.platform == "win32" and ours:
        with suppress(OSError):
            entry.remove()


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
