"""Read a mesh file and the files that it includes, which have to lie in allowed folders."""

from __future__ import annotations

import codecs
import stat
from dataclasses import dataclass, field
from pathlib import Path

from fe_squeal.errors import MeshError, suggest

_DEPTH, _MOST_FILES, _MOST_BYTES = 20, 1000, 8_000_000_000  # of includes: nesting, files and bytes, at most


@dataclass
class Sources:
    """Reads a file and what it includes.

    Attributes
    ----------
    path : Path
        The mesh file. Files in its folder, and below, may be included.
    folders : tuple of Path
        Further folders from which files may be included, such as that of the scene.
    allow_outside : bool
        Whether included files may lie anywhere.
    """

    path: Path
    folders: tuple[Path, ...] = ()
    allow_outside: bool = False
    _files: int = field(default=0, init=False)
    _bytes: int = field(default=0, init=False)

    def find(self, name: str, includer: Path, where: str, of_job: bool = False) -> Path:
        """Return the path of a file that another one includes, relative to that one or to the mesh file.

        Parameters
        ----------
        name : str
            The file as it is named there.
        includer : Path
            The file that names it.
        where : str
            The line that names it, for messages.
        of_job : bool
            Whether the folder of the mesh file is tried first, as by Abaqus, which takes that of the job.

        Raises
        ------
        MeshError
            The file does not exist, is no regular file, or lies outside of the allowed folders.
        """
        source = self.path.name
        own, job = (folder / name.replace("\\", "/") for folder in (includer.parent, self.path.parent))
        try:
            places = [p for p in ((job, own) if of_job else (own, job)) if self._is_inside(p)]
        except (OSError, ValueError, RuntimeError) as error:
            raise MeshError(f'{source}: {where}: the included file "{name}" has no place ({error})') from None
        if not places:
            raise MeshError(
                f'{source}: {where}: the included file "{name}" lies outside of the folders of the mesh and of the'
                " scene; copy it there, or set allow_outside = true in [mesh]"
            )
        target = next((p for p in places if p.exists()), places[0])
        if not target.exists():
            near = [p.name for p in target.parent.iterdir()] if target.parent.is_dir() else []
            raise MeshError(f'{source}: {where}: the included file "{name}" does not exist{suggest(target.name, near)}')
        if not target.is_file():
            raise MeshError(f'{source}: {where}: the included file "{name}" is no regular file')
        return target

    def _is_inside(self, target: Path) -> bool:
        real, inside = target.resolve(), (self.path.parent, *self.folders)
        return self.allow_outside or any(real.is_relative_to(folder.resolve()) for folder in inside)

    def lines(self, path: Path, depth: int, kind: str) -> list[str]:
        """Return the lines of a text file.

        Parameters
        ----------
        path : Path
        depth : int
            How deep its include is nested; 0 for the mesh file itself.
        kind : str
            What is expected, such as "an Abaqus input file", for messages.

        Raises
        ------
        MeshError
            The file is no text, or includes are nested too deeply, too many or too large.
        """
        source = self.path.name
        if depth > _DEPTH:
            raise MeshError(f"{source}: INCLUDE is nested more than {_DEPTH} deep; does {path.name} include itself?")
        self._files += 1
        status = path.stat()
        self._bytes += status.st_size
        if self._files > _MOST_FILES or self._bytes > _MOST_BYTES:
            raise MeshError(
                f"{source}: includes more than {_MOST_FILES} files or {_MOST_BYTES // 10**9} GB; does a file include"
                " itself, or another one again and again?"
            )
        if not stat.S_ISREG(status.st_mode):
            raise MeshError(f"{source}: {path.name} is no regular file; expected {kind}")
        data = path.read_bytes()
        if b"\0" in data:
            raise MeshError(f"{source}: {path.name} is not a text file; expected {kind}")
        return text_lines(data)


def text_lines(data: bytes) -> list[str]:
    """Return the lines of a text in UTF-8, with or without a byte order mark, or else in a code page of one byte.

    What is no UTF-8 is taken as code page 1252, of Windows in western Europe. Names in another code page look wrong
    then, but different ones stay different. Lines end with a line feed, a carriage return or both.

    Examples
    --------
    >>> text_lines("ä\\r\\nö".encode()) == text_lines("ä\\nö\\n".encode("cp1252"))
    True
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = codecs.charmap_decode(data, "strict", _WINDOWS)[0]
    return text.replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n").split("\n")


def _character(byte: int) -> str:
    """Return the character of a byte in code page 1252; where it has none that is seen, a letter of no other byte."""
    text = bytes([byte]).decode("cp1252", "ignore")
    return text if byte < 128 or (text and text.isprintable()) else chr(256 + byte)


_WINDOWS = "".join(map(_character, range(256)))
