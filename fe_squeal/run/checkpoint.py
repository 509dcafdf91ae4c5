"""The checkpoint of a running sweep: files in the folder of results from which it can resume after any interruption.

The folder `checkpoint` has `inputs.json`, written first: what the run depends on, and the number of the layout of the
other files. `model.npz` is the reduced model, if there is one; `first.npz` has the modes at the first value,
`point_00000.npz` and so on what is reported of each value. `state.npz`, written last, says how many of these points are
valid. Every file is complete or absent, so the checkpoint is consistent at any moment. Files contain plain arrays and
JSON; nothing is pickled.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..eigen.pencil import Modes
from ..errors import OutputError
from ..report.files import replace_atomically, write_json
from ..sweep.state import (
    Record,
    SweepState,
    modes_of_record,
    point_of_record,
    record_of_modes,
    record_of_point,
    record_of_state,
    state_of_record,
)
from .folder import CHECKPOINT, CHECKPOINT_INPUTS, is_kept
from .manifest import Manifest

_SHARE = 0.03  # of the time: writing takes no more, so that values that are solved quickly are written several at once
_JSON = "json"  # name of the array that contains, as JSON text, everything that is not an array
# Number of the layout of these files. A checkpoint with another number is refused, so raise it whenever a name, a unit
# or a meaning in the files changes.
LAYOUT = 11


class Checkpoint:
    """The checkpoint in a folder of results, which a sweep uses as its `Store`.

    Parameters
    ----------
    results : Manifest
        The manifest of the folder of results. `begin` makes the folder of the checkpoint in it.
        What an earlier run left there counts as this run's, unless `postpone` is called.

    Attributes
    ----------
    report : callable of SweepState
        Called after a state was written; its time counts as time of writing.
    """

    def __init__(self, results: Manifest) -> None:
        self.results = results
        self.folder = folder = results.folder / CHECKPOINT
        self.report: Callable[[SweepState], None] = lambda state: None
        self._due: Callable[[], None] | None = None  # what `postpone` was given, until it is called
        self._inputs = folder / "inputs.json"
        self._model, self._first, self._state = (folder / f"{name}.npz" for name in ("model", "first", "state"))
        self._written = 0  # number of points that are written
        self._pending: SweepState | None = None
        self._kept_first: Modes | None = None  # the modes that its file has
        self._cost, self._idle_since = 0.0, -np.inf

    @property
    def exists(self) -> bool:
        """Whether there is a checkpoint that a run could resume from."""
        return self._inputs.exists()

    @property
    def begun(self) -> bool:
        """Whether what the folder has is of this run: not while a postponed beginning is due."""
        return self._due is None

    @property
    def is_empty(self) -> bool:
        """Whether no value was finished yet."""
        return not self._model.exists() and not self._state.exists()

    @property
    def inputs(self) -> Any:
        """The inputs of the run that wrote this checkpoint, see `run_inputs`; None if they cannot be read.

        Raises
        ------
        OutputError
            The checkpoint has another layout.
        """
        found = read_json(self._inputs)
        if isinstance(found, dict) and found.pop("layout", 1) != LAYOUT:
            raise _foreign(self.folder, "what it kept is laid out in another way")
        return found

    def progress(self) -> tuple[int, float]:
        """Return the number of finished values, and the seconds that they took.

        Raises
        ------
        OutputError
            A file is damaged, or another version of the program wrote it.
        """
        if not self._state.exists():
            return 0, 0.0
        data = _read(self._state, _JSON).data
        try:
            return int(data["values"]), float(sum(data["seconds"].values()))
        except (AttributeError, TypeError, ValueError) as error:
            raise _damaged(self._state, error) from error

    def begin(self, inputs: Mapping[str, Any]) -> None:
        """Start a new checkpoint for a run with some inputs, in place of any other."""
        self.remove()
        write_json({**inputs, "layout": LAYOUT}, self._inputs)
        self._due = None

    def postpone(self, begin: Callable[[], None]) -> None:
        """Leave what is in the folder as it is until the first file is written; `begin` is called right before."""
        self._due = begin

    def remove(self) -> None:
        """Remove the checkpoint, `inputs.json` first: without this file the others do not count as a checkpoint.

        Raises
        ------
        OutputError
            A file cannot be removed.
        """
        self.results.remove(is_kept, first=CHECKPOINT_INPUTS)
        self._written, self._pending, self._kept_first = 0, None, None

    def load(self) -> SweepState | None:
        """Return the last state that was written; None if no value was finished.

        Raises
        ------
        OutputError
            A file is damaged, or another version of the program wrote it.
        """
        if not self.begun or not self._state.exists():
            return None
        record = _read(self._state)
        try:
            points = tuple(point_of_record(_read(self._point(i))) for i in range(record.data["points"]))
            state = state_of_record(record, modes_of_record(_read(self._first)), points)
        except (KeyError, TypeError, ValueError) as error:
            raise _damaged(self._state, error) from error
        if state.reduced and not self._model.exists():
            raise _damaged(self._model, "it is missing")
        self._written, self._kept_first = len(points), state.first
        return state

    def load_model(self) -> Record | None:
        """Return the reduced model that was kept, or None."""
        return _read(self._model) if self.begun and self._model.exists() else None

    def save_model(self, model: Record) -> None:
        """Keep the reduced model."""
        self._begin_if_due()
        _write(self._model, model)

    def save(self, state: SweepState) -> None:
        """Write a state now, unless writing would take more than `_SHARE` of the time; then a later call writes it."""
        self._pending = state
        if time.perf_counter() - self._idle_since >= self._cost * (1 / _SHARE - 1):
            self.flush()

    def flush(self) -> None:
        """Write the last state, if that has not been done yet."""
        state = self._pending
        if state is None:
            return
        start = time.perf_counter()
        self._begin_if_due()
        if state.first is not self._kept_first:  # the sweep may follow its modes from another value on
            _write(self._first, record_of_modes(state.first))
            self._kept_first = state.first
        for i in range(self._written, len(state.points)):
            _write(self._point(i), record_of_point(state.points[i]))
            self._written = i + 1
        _write(self._state, record_of_state(state))
        self._pending = None
        self.report(state)
        self._idle_since = time.perf_counter()
        self._cost = self._idle_since - start

    def _begin_if_due(self) -> None:
        if self._due is not None:
            self._due()

    def _point(self, i: int) -> Path:
        return self.folder / f"point_{i:05d}.npz"


def read_json(path: Path) -> Any:
    """Return the content of a JSON file; None if it does not exist or cannot be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None


class _Kept(dict[str, Any]):
    """The entries of a file by name; a missing name raises OutputError, since another version has written the file."""

    def __init__(self, path: Path, found: Mapping[str, Any]) -> None:
        super().__init__(found)
        self._path = path

    def __missing__(self, name: str) -> Any:
        raise _foreign(self._path, f'it has no "{name}"')


def _write(path: Path, record: Record) -> None:
    text = json.dumps(record.data)  # Python's JSON has NaN, and writes floats so that they are read back exactly
    with replace_atomically(path) as temporary:
        np.savez(temporary, **{_JSON: np.array(text)}, **record.arrays)  # type: ignore[arg-type]


def _read(path: Path, *names: str) -> Record:
    """Return all arrays of a file, or those with some names."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in names or file.files}
        data = json.loads(str(arrays.pop(_JSON)), object_hook=lambda found: _Kept(path, found))
        return Record(_Kept(path, arrays), data)
    except Exception as error:  # NumPy raises almost any exception at damaged files
        raise _damaged(path, error) from error


def _damaged(path: Path, why: object) -> OutputError:
    return OutputError(
        f"{path}: the checkpoint is damaged ({why}); remove {path.parent} and run without --resume to start anew"
    )


def _foreign(path: Path, why: str) -> OutputError:
    return OutputError(
        f"{path}: another version of the program left this checkpoint ({why}); run without --resume to start anew"
    )
