"""Files that are either complete or absent: an interrupted run never leaves half a table behind."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from fe_squeal.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def replace_atomically(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`; it takes the place of `path` when the block ends well.

    The temporary name keeps the suffix, by which Matplotlib and VTK choose the format. Where the block raises,
    nothing is left behind and an older `path` stays as it was.

    Raises
    ------
    OutputError
        The folder cannot be made or written to, or the disk is full.

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
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with suppress(OSError):  # it may never have come to be
            temporary.unlink(missing_ok=True)


def remove_partial(folder: str | os.PathLike[str]) -> None:
    """Remove the temporary files that killed runs have left in a folder of results; nobody may be writing there.

    Raises
    ------
    OutputError
    """
    try:
        for place in ("", "checkpoint/", "shapes/", "shapes/*_frames/"):
            for path in Path(folder).glob(f"{place}.*.partial.*"):
                path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{error.filename}: cannot be removed ({error.strerror or error})") from error


def write_csv(frame: pd.DataFrame, path: str | os.PathLike[str]) -> Path:
    """Write a table as UTF-8 CSV without an index; floats keep every digit, missing values are empty.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = write_csv(pd.DataFrame({"mu": [0.1 + 0.2, np.nan]}), Path(folder) / "a.csv")
    ...     file.read_text().split()
    ['mu', '0.30000000000000004', '""']
    """
    path = Path(path)
    with replace_atomically(path) as temporary:
        # pandas writes the shortest decimal that reads back as the same float; it quotes a line that is all empty
        frame.to_csv(temporary, index=False, encoding="utf-8", lineterminator="\n")
    return path


def write_json(data: Any, path: str | os.PathLike[str]) -> Path:
    """Write `data` as indented UTF-8 JSON.

    NumPy numbers and arrays, complex numbers (as `[re, im]`), dataclasses, paths and sets are turned into JSON's own
    kinds; infinite and undefined numbers become `null`, since JSON has no word for them.

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
    if data is None or data is pd.NA or isinstance(data, str | bool):
        return None if data is pd.NA else data
    if dataclasses.is_dataclass(data) and not isinstance(data, type):
        return {f.name: _plain(getattr(data, f.name)) for f in dataclasses.fields(data)}
    if isinstance(data, Mapping):
        return {str(key): _plain(value) for key, value in data.items()}
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
        return os.fspath(data)
    raise TypeError(f"cannot be written as JSON: {type(data).__name__} {data!r}")


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write a figure atomically and return its path; the suffix chooses the format."""
    path = Path(path)
    with replace_atomically(path) as temporary:
        figure.savefig(temporary)
    return path
