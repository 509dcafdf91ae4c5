"""Write files so that they are either complete or absent: an interrupted run never leaves half a table behind."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import pandas as pd

from fe_squeal.errors import OutputError, one_line
from fe_squeal.process.signals import signals_deferred

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Owner(Protocol):
    """Decides which files of a folder may be replaced; the manifest of a folder of results does."""

    folder: Path

    def temporary(self, path: Path) -> Path:
        """Return where a file is written until it is whole."""

    def place(self, temporary: Path, path: Path) -> None:
        """Have a whole file take the place of `path`, or raise OutputError."""


_owners: list[Owner] = []  # of the blocks of `owned_by`, the innermost last


@contextmanager
def owned_by(owner: Owner) -> Iterator[None]:
    """During the block, ask an owner about every file before it is written into the owner's folder."""
    _owners.append(owner)
    try:
        yield
    finally:
        _owners.remove(owner)


def _owner_of(path: Path) -> Owner | None:
    place = Path(os.path.abspath(path))
    return next((o for o in reversed(_owners) if place.is_relative_to(os.path.abspath(o.folder))), None)


def temporary_path(path: Path) -> Path:
    """Return where a file is written until it is whole, with its suffix: beside it, or where its owner says."""
    owner = _owner_of(path)
    if owner is not None:
        return owner.temporary(path)
    return path.with_name(f".{path.stem}.{secrets.token_hex(8)}.partial{path.suffix}")


@contextmanager
def replace_atomically(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path; it takes the place of `path` when the block ends well.

    The temporary name has the same suffix, since Matplotlib and VTK choose the format by it. If the block raises, the
    temporary file is removed, and an older file at `path` stays as it was.

    Raises
    ------
    OutputError
        The folder cannot be made or written to, the disk is full, or the owner of the folder does not allow it.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with replace_atomically(Path(folder) / "a.txt") as temporary:
    ...         _ = temporary.write_text("whole")
    ...     [p.name for p in Path(folder).iterdir()]
    ['a.txt']
    """
    path = Path(path)
    owner, temporary = _owner_of(path), None
    try:
        temporary = temporary_path(path)
        if owner is None:
            path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        if owner is None:
            os.replace(temporary, path)
        else:
            owner.place(temporary, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        if temporary is not None:
            with suppress(OSError):  # it may not have been made
                temporary.unlink(missing_ok=True)


def write_new(text: str, path: Path) -> None:
    """Write a text file in UTF-8 where there is none yet, whole or not at all.

    Raises
    ------
    OutputError
        There is a file, it cannot be written, or the text has what UTF-8 has no characters for.
    """
    temporary = temporary_path(path)
    try:
        temporary.write_bytes(text.encode())
        try:
            os.link(temporary, path)  # which replaces nothing, unlike a renaming
        except OSError:
            if os.path.lexists(path):
                raise
            os.replace(temporary, path)  # on file systems without links
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    except UnicodeEncodeError as error:
        raise OutputError(f"{path}: cannot be written ({error}): a name is not in UTF-8") from error
    finally:
        with suppress(OSError):  # it may not have been made
            temporary.unlink(missing_ok=True)


def write_csv(frame: pd.DataFrame, path: str | os.PathLike[str]) -> Path:
    """Write a table as UTF-8 CSV without an index; floats keep every digit, missing values are empty.

    Control characters in names are spelled out, so that they have no effect on a terminal that shows the file.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = write_csv(pd.DataFrame({"mu": [0.1 + 0.2, np.nan]}), Path(folder) / "a.csv")
    ...     file.read_text().split()
    ['mu', '0.30000000000000004', '""']
    """
    path = Path(path)
    words = [name for name in frame.columns if frame[name].dtype.kind not in "fiubc"]
    frame = frame.assign(**{name: frame[name].map(_printable) for name in words}).rename(columns=_printable)
    with replace_atomically(path) as temporary:
        # pandas writes the shortest decimal that is read as the same float, and quotes a line that is all empty.
        frame.to_csv(temporary, index=False, encoding="utf-8", lineterminator="\n")
    return path


def _printable(value: Any) -> Any:
    return one_line(value) if isinstance(value, str) else value


def encodable(text: str) -> str:
    r"""Return a text with what UTF-8 has no characters for spelled out: bytes in the names of files and folders.

    Examples
    --------
    >>> print(encodable(b"caf\xe9, \xce\xbc".decode("utf-8", "surrogateescape")))
    caf\udce9, μ
    """
    return text.encode("utf-8", "backslashreplace").decode()


def write_json(data: Any, path: str | os.PathLike[str]) -> Path:
    """Write `data` as indented UTF-8 JSON.

    NumPy numbers and arrays, complex numbers (as `[re, im]`), dataclasses, paths and sets are turned into JSON's own
    kinds; infinite and undefined numbers become `null`, since JSON has none of them. Bytes of file names that are not
    UTF-8 are spelled out.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = write_json({"n": np.int64(3), "lam": 1 + 2j, "rate": float("nan")}, Path(folder) / "a.json")
    ...     json.loads(file.read_text())
    {'n': 3, 'lam': [1.0, 2.0], 'rate': None}
    """
    path = Path(path)
    text = json.dumps(_plain(data), indent=2, ensure_ascii=False, allow_nan=False)
    with replace_atomically(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8", newline="\n")
    return path


def _plain(data: Any) -> Any:
    if data is None or data is pd.NA or isinstance(data, bool):
        return None if data is pd.NA else data
    if isinstance(data, str):
        return encodable(data)
    if dataclasses.is_dataclass(data) and not isinstance(data, type):
        return {f.name: _plain(getattr(data, f.name)) for f in dataclasses.fields(data)}
    if isinstance(data, Mapping):
        return {encodable(str(key)): _plain(value) for key, value in data.items()}
    if isinstance(data, np.ndarray | np.generic):
        return _plain(data.tolist())
    if isinstance(data, set | frozenset):
        return [_plain(value) for value in sorted(data, key=str)]
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    if isinstance(data, complex):
        return [_plain(data.real), _plain(data.imag)]
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, int):
        return data
    if isinstance(data, os.PathLike):
        return _plain(os.fspath(data))
    raise TypeError(f"cannot be written as JSON: {type(data).__name__} {data!r}")


def save_figure(figure: Figure, path: str | os.PathLike[str], dpi: float | None = None) -> Path:
    """Write a figure by `replace_atomically`, signals deferred; return its path, whose suffix chooses the format."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    path = Path(path)
    with signals_deferred(), replace_atomically(path) as temporary:
        if dpi is not None:
            figure.savefig(temporary, dpi=dpi)
        elif path.suffix == ".png" and isinstance(figure.canvas, FigureCanvasAgg):
            figure.canvas.print_png(temporary)  # the same picture; savefig would draw everything twice to lay it out
        else:
            figure.savefig(temporary)
    return path
