"""The manifest of a folder, `manifest.sha256`: the files that this program wrote; no others are replaced or removed.

It has a line for every file that a command wrote, in the format of the program sha256sum: the digest of the content and
the name. The line is added before the file appears, so that a run that is killed at any moment leaves no file of its
own that is not listed. A file is replaced or removed only if it is listed, still has the listed content, and is not
reached through a symbolic link.

This file is longer than others, since every step on a file has to agree with the list.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import stat
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from ..errors import OutputError
from ..version import __version__
from .open_folder import Entry, LinkError, OpenFolder

MANIFEST = "manifest.sha256"
UNFINISHED = ".manifest.{}.partial.sha256"
_HEAD = re.compile(r"# fe-squeal \S+ ([0-9a-f]{32}): .*")
_LINE = re.compile(r"([0-9a-f]{64})  ([^\\:\0]+)")
_MOST_BYTES = 100_000_000
# Windows gives files the rights of the folder that they are made in, and they keep them when they are moved.
_PRIVATE = 0o777 if sys.platform == "win32" else 0o700
MISSING, OURS, CHANGED, FOREIGN = "missing", "ours", "changed", "foreign"


class Manifest:
    """The manifest of a folder, while a command holds the folder.

    Parameters
    ----------
    opened : OpenFolder
    adopted : tuple of str
        Files that a version without a manifest has written; they are listed from now on.

    Attributes
    ----------
    token : str
        A random text in the names of unfinished files: a file with this text in its name was written by this program.

    Raises
    ------
    OutputError
        The manifest cannot be read.
    """

    def __init__(self, opened: OpenFolder, adopted: tuple[str, ...] = ()) -> None:
        self.folder, self._opened = opened.path, opened
        self._path = opened.path / MANIFEST
        self.token = secrets.token_hex(16)
        self._known: dict[str, list[str]] = {}
        self._scratch = self._touched = False
        self._reached: set[str] = set()  # files that were about to be written
        with opened.entry(MANIFEST) as entry:
            self._kept = entry.stat() is not None  # whether the manifest is a file in the folder
            if self._kept:
                self._read(entry)
        for name in adopted:
            with opened.entry(name) as entry:
                self._known.setdefault(name, []).append(entry.digest())

    @staticmethod
    def marks(folder: Path) -> bool:
        """Return whether a folder has a manifest.

        Raises
        ------
        OutputError
            It has one that cannot be read.
        """
        path = folder / MANIFEST
        try:
            text = _text_of(Entry(None, str(path)))
        except PermissionError as error:
            raise OutputError(f"{path}: cannot be read ({error.strerror or error})") from error
        except OSError:
            return False
        return text == "" or _HEAD.fullmatch(text.split("\n", 1)[0]) is not None

    def state(self, name: str) -> str:
        """Return whether a file is missing, this program's, changed since, or somebody else's."""
        try:
            with self._opened.entry(name) as entry:
                return self._state(name, entry)
        except LinkError:
            return FOREIGN
        except (FileNotFoundError, NotADirectoryError):
            return MISSING

    def _state(self, name: str, entry: Entry) -> str:
        found = entry.stat()
        if found is None:
            return MISSING
        if not stat.S_ISREG(found.st_mode) or name not in self._known:
            return FOREIGN
        # A file written just before a power failure may be empty. It then holds nothing that could be lost.
        return OURS if found.st_size == 0 or entry.digest() in self._known[name] else CHANGED

    def names(self, chosen: Callable[[str], bool]) -> list[str]:
        """Return the listed names for which `chosen` is true."""
        return [name for name in self._known if chosen(name)]

    def check(self, chosen: Callable[[str], bool]) -> None:
        """Check that the chosen files are still as this program wrote them.

        Raises
        ------
        OutputError
            One of them was changed.
        """
        for name in self.names(chosen):
            if self.state(name) in (CHANGED, FOREIGN):
                raise OutputError(
                    f"{self.folder / name}: was changed after fe-squeal had written it; expected it as it was: move or"
                    " remove it, or give another folder by -o"
                )

    def remove(self, chosen: Callable[[str], bool], first: str = "") -> None:
        """Remove the chosen files that are as they were written, and folders that this leaves empty.

        Parameters
        ----------
        chosen : callable of str
            Says of a name whether it is to be removed.
        first : str
            The name of the file that is removed before all others.

        Raises
        ------
        OutputError
            A file cannot be removed.
        """
        names = sorted(self.names(chosen), key=lambda name: (name != first, name))
        if not names:
            return
        name = MANIFEST
        try:
            self._keep()
            for name in names:  # all or nothing
                with suppress(LinkError, FileNotFoundError, NotADirectoryError), self._opened.entry(name) as entry:
                    if entry.stat() is not None and not entry.may_be_removed():
                        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
            for name in names:
                self._remove(name)
        except OSError as error:
            raise OutputError(f"{self.folder / name}: cannot be removed ({error.strerror or error})") from error
        self._remove_empty_folders(names)

    def temporary(self, path: Path) -> Path:
        """Return where a file is written until `place` gives it its name.

        The names in there are random, so that even a link in the place of the scratch folder makes nobody lose a file.
        """
        return self.scratch() / f"{secrets.token_hex(8)}{path.suffix}"

    def place(self, temporary: Path, path: Path) -> None:
        """List a file, and give the temporary one its name.

        Raises
        ------
        OutputError
            There is a file of that name that this program did not write, or that was changed since.
        OSError
            Also where the way to it is through a link.
        """
        self._keep()
        name = self._name(path)
        self._reached.add(name)
        with (
            self._opened.entry(self._name(temporary)) as written,
            self._opened.entry(name, make=True) as entry,
        ):
            if self._state(name, entry) in (CHANGED, FOREIGN):
                raise OutputError(
                    f"{path}: is no file that fe-squeal wrote, or was changed since; it is not replaced: move it, or"
                    " give another folder by -o"
                )
            digest = written.digest()
            self._known.setdefault(name, []).append(digest)
            self._append(f"{digest}  {name}\n")
            written.replace(entry)

    def scratch(self) -> Path:
        """Return a folder inside for files that are not whole yet, where nobody else may look; `close` removes it."""
        self._keep()
        name = self._scratch_name
        if not self._scratch:
            with self._opened.entry(name) as entry:
                entry.make_folder(_PRIVATE)
            self._scratch = True
        return self.folder / name

    def remove_partial(self) -> None:
        """Remove the unfinished files that a killed command left."""
        for name in self._opened.names():
            if f".{self.token}.partial" in name:  # ours: nobody else knows the token
                with self._opened.entry(name) as entry:
                    entry.remove_tree()

    def close(self) -> None:
        """Remove the scratch folder, and shorten the manifest to one line for each file; remove it if there is none."""
        if self._scratch:
            with self._opened.entry(self._scratch_name) as entry:
                entry.remove_tree()
        if not (self._kept and self._touched):  # what was refused stays as it is
            return
        self._remove_empty_folders(self._reached)  # made for files that were not written any more
        left = {}
        for name, digests in self._known.items():
            try:
                with self._opened.entry(name) as entry:
                    if entry.stat() is not None and (len(digests) == 1 or self._state(name, entry) == OURS):
                        left[name] = digests if len(digests) == 1 else [entry.digest()]
            except (FileNotFoundError, NotADirectoryError):
                pass
            except OSError:
                left[name] = digests
        with suppress(OSError), self._opened.entry(MANIFEST) as entry:  # as it stands it is right as well, only longer
            if not left:
                entry.remove()
            elif left != self._known or _text_of(entry).count("\n") - 1 != len(left):
                self._write(left)

    def _remove_empty_folders(self, names: Iterable[str]) -> None:
        """Remove the folders of files where nothing else is in them."""
        for parent in sorted({p.as_posix() for name in names for p in Path(name).parents if p.parts}, reverse=True):
            with suppress(OSError), self._opened.entry(parent) as entry:
                entry.remove_empty_folder()

    @property
    def _scratch_name(self) -> str:
        return f".{self.token}.partial"

    def _remove(self, name: str) -> None:
        """Remove a file if it is as it was written."""
        with suppress(LinkError, FileNotFoundError, NotADirectoryError), self._opened.entry(name) as entry:
            if self._state(name, entry) == OURS:
                self._touched = True
                entry.remove()

    def _read(self, entry: Entry) -> None:
        try:
            text = _text_of(entry)
        except OSError as error:
            raise OutputError(f"{self._path}: cannot be read ({error.strerror or error})") from error
        head, *lines = text.split("\n")[:-1] or [""]  # a last line without an end was cut off, and does not count
        found = _HEAD.fullmatch(head)
        self._kept = found is not None and text.endswith("\n")  # if not, the manifest is written anew
        if found:
            self.token = found[1]
        for line in lines:
            parts = _LINE.fullmatch(line)
            if parts and not {"", ".", ".."}.intersection(parts[2].split("/")):  # a name inside of the folder
                self._known.setdefault(parts[2], []).append(parts[1])

    def _keep(self) -> None:
        """Write the manifest if the folder has none yet.

        Raises
        ------
        OutputError
            It has been removed meanwhile, or the folder was moved away.
        """
        with self._opened.entry(MANIFEST) as entry:
            if not self._opened.is_at_its_path or (self._kept and entry.stat() is None):
                raise OutputError(f"{self._path}: is gone; expected the folder of results to stay until the end")
        if not self._kept:
            self._write(self._known)
            self._kept = True

    def _write(self, known: dict[str, list[str]]) -> None:
        self._touched = True
        with self._opened.entry(UNFINISHED.format(self.token)) as draft, self._opened.entry(MANIFEST) as entry:
            try:
                handle = draft.open(os.O_WRONLY | os.O_CREAT | os.O_EXCL)
                with open(handle, "w", encoding="utf-8", newline="\n") as file:
                    file.write(self._text(known))
                draft.replace(entry)
            finally:
                draft.remove()

    def _append(self, line: str) -> None:
        data = line.encode()
        self._touched = True
        self._kept = False  # until the line is whole: nothing may be added after a line that was cut off
        with self._opened.entry(MANIFEST) as entry:
            handle = entry.open(os.O_WRONLY | os.O_APPEND)
        try:
            self._kept = os.write(handle, data) == len(data)
        finally:
            os.close(handle)
        if not self._kept:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _text(self, known: dict[str, list[str]]) -> str:
        head = f"# fe-squeal {__version__} {self.token}: the files that it wrote here, and no others, it may replace\n"
        return head + "".join(f"{digest}  {name}\n" for name, digests in known.items() for digest in digests)

    def _name(self, path: Path) -> str:
        return Path(os.path.abspath(path)).relative_to(os.path.abspath(self.folder)).as_posix()


def _text_of(entry: Entry) -> str:
    """Return the text of a regular file of reasonable size; no link and no pipe is opened."""
    with open(entry.open_regular(), encoding="utf-8", errors="replace", newline="\n") as file:
        if os.fstat(file.fileno()).st_size > _MOST_BYTES:
            raise OSError(0, "it is no file that fe-squeal wrote")
        return file.read()
