"""Files in a folder, reached by descriptors: no link is followed on the way to them, even one put there meanwhile.

A path that was checked may lead elsewhere when it is used: somebody may have put a link in the place of a folder. So
every folder on the way is opened from the one before it, and files are read, removed and renamed relative to the last
one (openat(2) and its kin). Windows has no such calls; there the way is checked just before each use.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

_BY_DESCRIPTOR = {os.access, os.mkdir, os.open, os.rename, os.rmdir, os.stat, os.unlink} <= os.supports_dir_fd
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0)
_NO_FOLLOW, _BINARY = getattr(os, "O_NOFOLLOW", 0), getattr(os, "O_BINARY", 0)
_AT_ONCE = getattr(os, "O_NONBLOCK", 0)  # opening a pipe would wait for its other end


class LinkError(OSError):
    """A folder on the way to a file is a link."""


@dataclass(frozen=True)
class Entry:
    """A name in an open folder; there need not be such a file.

    Attributes
    ----------
    folder : int or None
        Descriptor; None where the system has no calls that take one.
    name : str
        Relative to that folder; the whole path without a descriptor.
    """

    folder: int | None
    name: str

    def stat(self) -> os.stat_result | None:
        """Return what is there, of a link the link itself; None where there is nothing."""
        try:
            return os.stat(self.name, dir_fd=self.folder, follow_symlinks=False)
        except (FileNotFoundError, NotADirectoryError):
            return None

    def open(self, flags: int, mode: int = 0o666) -> int:
        """Return the descriptor of the opened file; a link is not followed."""
        return os.open(self.name, flags | _NO_FOLLOW | _BINARY, mode, dir_fd=self.folder)

    def open_regular(self) -> int:
        """Return the descriptor of a regular file, to read it.

        Raises
        ------
        OSError
            Also where it is no regular file.
        """
        handle = self.open(os.O_RDONLY | _AT_ONCE)
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            os.close(handle)
            raise OSError(errno.EINVAL, "it is no regular file", self.name)
        return handle

    def digest(self) -> str:
        """Return the SHA-256 of the content, in hexadecimal."""
        with open(self.open_regular(), "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def may_be_removed(self) -> bool:
        """Return whether names in the folder may be changed."""
        folder = os.path.dirname(self.name) or "."
        ids = os.access in os.supports_effective_ids
        return os.access(folder, os.W_OK | os.X_OK, dir_fd=self.folder, effective_ids=ids)

    def make_folder(self, mode: int = 0o777) -> None:
        """Make a folder of that name."""
        os.mkdir(self.name, mode, dir_fd=self.folder)

    def remove(self) -> None:
        """Remove the file, or the link, if there is one."""
        with suppress(FileNotFoundError):
            os.unlink(self.name, dir_fd=self.folder)

    def remove_empty_folder(self) -> None:
        """Remove the folder unless it holds something."""
        with suppress(OSError):
            os.rmdir(self.name, dir_fd=self.folder)

    def remove_tree(self) -> None:
        """Remove the file, or the folder with all that is in it, as far as that is possible."""
        found = self.stat()
        if found is not None and stat.S_ISDIR(found.st_mode):
            shutil.rmtree(self.name, ignore_errors=True, dir_fd=self.folder)
        else:
            with suppress(OSError):
                self.remove()

    def replace(self, other: Entry) -> None:
        """Take the name and the place of another one."""
        os.replace(self.name, other.name, src_dir_fd=self.folder, dst_dir_fd=other.folder)


class OpenFolder:
    """A folder that stays the same one whatever happens to its path.

    Parameters
    ----------
    path : Path
        It may be a link.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._handle = os.open(path, _FOLDER) if _BY_DESCRIPTOR else None

    def __enter__(self) -> OpenFolder:
        return self

    def __exit__(self, *_: object) -> None:
        if self._handle is not None:
            os.close(self._handle)

    @property
    def is_at_its_path(self) -> bool:
        """Whether the path still leads to this folder."""
        try:
            found = os.stat(self.path)
        except OSError:
            return False
        return self._handle is None or os.path.samestat(found, os.fstat(self._handle))

    def names(self) -> list[str]:
        """Return the names in it."""
        return os.listdir(self.path if self._handle is None else self._handle)

    @contextmanager
    def entry(self, name: str, make: bool = False) -> Iterator[Entry]:
        """Yield the entry of a name with slashes, whose folders stay open inside the block.

        Parameters
        ----------
        make : bool
            Make those of its folders that are missing.

        Raises
        ------
        LinkError
            One of these folders is a link.
        OSError
        """
        *folders, last = name.split("/")
        with ExitStack() as opened:
            handle, way = self._handle, "" if self._handle is not None else f"{self.path}{os.sep}"
            for folder in folders:
                place = Entry(handle, way + folder)
                if make:
                    with suppress(FileExistsError):
                        place.make_folder()
                if (found := place.stat()) is not None and stat.S_ISLNK(found.st_mode):
                    raise LinkError(errno.ELOOP, f"{folder} is a link, and nothing is written through links", name)
                if handle is None:
                    way += folder + os.sep
                else:
                    handle = place.open(_FOLDER)
                    opened.callback(os.close, handle)
            yield Entry(handle, way + last)
