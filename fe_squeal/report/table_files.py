"""What the tables in a folder of results hold: files there may have been changed by anybody."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fe_squeal.errors import OutputError, one_line
from fe_squeal.report.shapes import Floats

_WORDS = {  # columns that hold words; every other one holds numbers
    "parameter", "stability", "noise", "body", "term", "number", "kind", "direction", "measured", "quantity", "output",
    "method", "place", "knob", "a", "b", "state", "look", "frequency_exceeds", "onset_exceeds", "re_exceeds",
    "units", "law", "energy",
}  # fmt: skip
_YES_OR_NO = {name for name in _WORDS if name.endswith("_exceeds")}
_COUNTS = {"mode", "branch", "branch_a", "branch_b", "nodal_diameters", "other_nodal_diameters", "nodal_circles"}
_LARGEST = 1e150  # number in a table that is believed


def read_table(path: Path, words: Collection[str] = _WORDS - _YES_OR_NO, **options: Any) -> pd.DataFrame:
    """Return a table in CSV in which the columns of words hold the texts as they stand there.

    pandas makes a number of a body named "3", and of one named "NA" a hole; here only what is empty is one.

    Parameters
    ----------
    path : Path
    words : collection of str
        Names of the columns of words, without spaces around them.
    options
        Of `pandas.read_csv`.

    Raises
    ------
    OSError, OverflowError, ValueError
        It cannot be read.
    """
    frame: pd.DataFrame = pd.read_csv(path, **options)
    named = [name for name in frame.columns if str(name).strip() in words]
    if not named:
        return frame
    texts = pd.read_csv(path, usecols=named, dtype=str, keep_default_na=False, na_values=[""], **options)
    return frame.assign(**{name: texts[name].to_numpy() for name in named})


def read_checked(path: Path, command: str, needed: Sequence[str] = (), there: Sequence[str] = ()) -> pd.DataFrame:
    """Return a table that a command has written.

    Parameters
    ----------
    path : Path
    command : str
        Its name, for the message.
    needed, there : sequence of str
        As in `check_table`.

    Raises
    ------
    OutputError
        The file cannot be read, or its table is another one.
    """
    try:
        frame = read_table(path)
        check_table(frame, needed, there)
    except (OSError, OverflowError, ValueError) as error:
        why = one_line(str(error))
        raise OutputError(f"{path}: cannot be read ({why}); expected the table that {command} writes") from error
    return frame


def check_table(frame: pd.DataFrame, needed: Sequence[str] = (), there: Sequence[str] = ()) -> None:
    """Raise ValueError where a table is not one that this program writes.

    Columns that are needed are there and have no holes, those in `there` may have some. All columns but those of words
    hold numbers whose squares are finite, or infinite ones, as an uncertainty may be. What is counted is whole or
    unknown.
    """
    missing = [name for name in (*needed, *there) if name not in frame.columns]
    if missing:
        raise ValueError(f"it has no column {', '.join(missing)}")
    for name in frame.columns:
        column = frame[name]
        if name in _WORDS:
            good = name not in needed or bool(column.notna().all())
        else:
            good = column.dtype.kind in "fiub" and _plausible(column.to_numpy(float), name in needed, name in _COUNTS)
            good = good and bool(name != "branch" or column.notna().all())
        if len(column) and not good:
            raise ValueError(f"column {name} does not hold what it should")


def _plausible(numbers: Floats, needed: bool, counted: bool) -> bool:
    """Return whether numbers (k,) may stand in a column."""
    finite = numbers[np.isfinite(numbers)]
    if (np.abs(finite) > _LARGEST).any() or (needed and len(finite) < len(numbers)):
        return False
    return not counted or bool((finite % 1 == 0).all() and not np.isinf(numbers).any())
