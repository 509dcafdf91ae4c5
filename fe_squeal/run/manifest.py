"""The manifest of a folder, `manifest.sha256`: the files that this program wrote; no others are replaced or removed.

It has a line for every file that a command wrote, in the format of the program sha256sum: the digest of the content and
the name. The line is added before the file appears, so that a run that is killed at any moment leaves no file of its
own that is not listed. A file is replaced or removed only if it is listed, still has the listed content, and is not
reached through a symbolic link.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from ..errors import OutputError
from ..version import __version__

MANIFEST = "manifest.sha256"
UNFINISHED = ".manifest.{}.partial.sha256"
_HEAD = re.compile(r"# fe-squeal \S+ ([0-9a-f]{32}): .*")
_LINE = re.compile(r"([0-9a-f]{64})  ([^\\:\0]+)")
_MOST_BYTES = 100_000_000  # of a manifest: a larger file is none
_NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)  # Windows has none
MISSING, OURS, CHANGED, FOREIGN = "missing", "ours", "changed", "foreign"  # states of a file, see `Manifest.state`


class Manifest:
    """The manifest of a folder, while a command holds the folder.

    Parameters
    ----------
    folder : Path
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

    def __init__(self, folder: Path, adopted: tuple[str, ...] = ()) -> None:
        self.folder, self._path = folder, folder / MANIFEST
        self.token = secrets.token_hex(16)
        self._known: dict[str, list[str]] = {}
        self._kept = os.path.lexists(self._path)  # whether the folder has a complete manifest file
        if self._kept:
            self._read()
        for name in adopted:
            self._known.setdefault(name, []).append(digest_of(folder / name))

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
            text = _open_regular(path)
        except PermissionError as error:
            raise OutputError(f"{path}: cannot be read ({error.strerror or error})") from error
        except OSError:
            return False
        return text == "" or _HEAD.fullmatch(text.split("\n", 1)[0]) is not None

    def state(self, name: str) -> str:
        """Return the state of a file: missing, ours (as this program wrote it), changed since, or foreign."""
        path = self.folder / name
        try:
            found = path.lstat()
        except OSError:
            return MISSING
        if not stat.S_ISREG(found.st_mode) or name not in self._known or not self._reached(path):
            return FOREIGN
        # A file that was written just before a power failure may be empty. Nothing is lost if it is replaced.
        return OURS if found.st_size == 0 or digest_of(path) in self._known[name] else CHANGED

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
        try:
            self._keep()
            ours = [name for name in names if self.state(name) == OURS]
            for place in sorted({(self.folder / name).parent for name in ours}):
                if not os.access(place, os.W_OK | os.X_OK, effective_ids=os.access in os.supports_effective_ids):
                    # Checked for all files first, so that either all are removed or none.
                    raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(place))
            for name in ours:
                (self.folder / name).unlink(missing_ok=True)
            for parent in sorted({p for name in names for p in Path(name).parents if p.parts}, reverse=True):
                if self._reached(self.folder / parent / MANIFEST):
                    with suppress(OSError):  # the folder is not empty
                        (self.folder / parent).rmdir()
        except OSError as error:
            raise OutputError(f"{error.filename}: cannot be removed ({error.strerror or error})") from error

    def prepare(self, path: Path) -> None:
        """Make the folder of a file that is about to be written.

        Raises
        ------
        OutputError
            The folder is reached through a link.
        """
        self._keep()
        path.parent.mkdir(parents=True, exist_ok=True)
        if not self._reached(path):
            raise OutputError(f"{path.parent}: is a link; expected a folder, since nothing is written through links")

    def admit(self, path: Path, temporary: Path) -> None:
        """List a file, with the digest of the temporary file that is about to be renamed to it.

        Raises
        ------
        OutputError
            There is a file of this name that this program did not write, or that was changed since.
        """
        name = self._name(path)
        if self.state(name) in (CHANGED, FOREIGN):
            raise OutputError(
                f"{path}: is no file that fe-squeal wrote, or was changed since; it is not replaced: move it, or give"
                " another folder by -o"
            )
        digest = digest_of(temporary)
        self._known.setdefault(name, []).append(digest)
        self._append(f"{digest}  {name}\n")

    def scratch(self) -> Path:
        """Make a folder inside for files that are not complete yet; the caller removes it, or `remove_partial` does."""
        self._keep()
        path = self.folder / f".{self.token}.partial"
        path.mkdir()
        return path

    def remove_partial(self, folders: tuple[str, ...]) -> None:
        """Remove the unfinished files that a killed command has left in this folder and in some folders inside."""
        places = {Path(), *map(Path, folders), *(Path(name).parent for name in self._known)}
        for place in [*places, *(p for p in map(Path, folders) for p in self._folders_in(p))]:
            if self._reached(self.folder / place / MANIFEST) and (self.folder / place).is_dir():
                for entry in list(os.scandir(self.folder / place)):
                    if f".{self.token}.partial" in entry.name:  # only this program knows the token
                        if entry.is_dir(follow_symlinks=False):
                            shutil.rmtree(entry.path, ignore_errors=True)
                        else:
                            with suppress(OSError):
                                os.unlink(entry.path)

    def close(self) -> None:
        """Rewrite the manifest with one line for each listed file that exists; remove it if there is none."""
        if not self._kept:
            return
        left = {}
        for name, digests in self._known.items():
            path = self.folder / name
            if len(digests) == 1 and os.path.lexists(path):
                left[name] = digests
            elif len(digests) > 1 and self.state(name) == OURS:
                left[name] = [digest_of(path)]
        with suppress(OSError):  # the old manifest is right too, only longer
            if not left:
                self._path.unlink()
            elif left != self._known or self._lines() != len(left):
                self._write(left)

    def _read(self) -> None:
        try:
            text = _open_regular(self._path)
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
            Somebody has removed it in the meantime, perhaps with the folder.
        """
        if self._kept:
            if not os.path.lexists(self._path):
                raise OutputError(f"{self._path}: is gone; expected the folder of results to stay until the end")
            return
        self._write(self._known)
        self._kept = True

    def _write(self, known: dict[str, list[str]]) -> None:
        temporary = self.folder / UNFINISHED.format(self.token)
        try:
            with open(temporary, "x", encoding="utf-8", newline="\n") as file:
                file.write(self._text(known))
            os.replace(temporary, self._path)
        finally:
            temporary.unlink(missing_ok=True)

    def _append(self, line: str) -> None:
        data = line.encode()
        self._kept = False  # until the line is complete: no line may follow one that was cut off
        handle = os.open(self._path, os.O_WRONLY | os.O_APPEND | _NO_FOLLOW)
        try:
            self._kept = os.write(handle, data) == len(data)
        finally:
            os.close(handle)
        if not self._kept:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _text(self, known: dict[str, list[str]]) -> str:
        head = f"# fe-squeal {__version__} {self.token}: the files that it wrote here, and no others, it may replace\n"
        return head + "".join(f"{digest}  {name}\n" for name, digests in known.items() for digest in digests)

    def _lines(self) -> int:
        return _open_regular(self._path).count("\n") - 1

    def _name(self, path: Path) -> str:
        return Path(os.path.abspath(path)).relative_to(os.path.abspath(self.folder)).as_posix()

    def _reached(self, path: Path) -> bool:
        """Return whether all folders between the folder and a path exist and are no links."""
        parents = [self.folder / p for p in Path(self._name(path)).parents if p.parts]
        return all(not p.is_symlink() and (p.is_dir() or not os.path.lexists(p)) for p in parents)

    def _folders_in(self, place: Path) -> Iterator[Path]:
        if self._reached(self.folder / place / MANIFEST) and (self.folder / place).is_dir():
            for entry in os.scandir(self.folder / place):
                if entry.is_dir(follow_symlinks=False):
                    yield place / entry.name


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal."""
    handle = os.open(path, os.O_RDONLY | _NO_FOLLOW | getattr(os, "O_BINARY", 0))
    with open(handle, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _open_regular(path: Path) -> str:
    """Return the text of a regular file of reasonable size; OSError for a link, a pipe or a larger file."""
    if not stat.S_ISREG(path.lstat().st_mode) or path.lstat().st_size > _MOST_BYTES:
        raise OSError(0, "it is no file that fe-squeal wrote")
    handle = os.open(path, os.O_RDONLY | _NO_FOLLOW)
    with open(handle, encoding="utf-8", errors="replace", newline="\n") as file:
        return file.read()
