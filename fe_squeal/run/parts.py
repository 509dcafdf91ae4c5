"""Keep the finished parts of a study in the folder of its results, so that it can resume after any interruption.

The folder `parts` has `inputs.json`, written first, and the finished chunks of each stage: `samples_00000.npz` and so
on. Every file is complete or absent, and contains plain arrays. The folder is removed when the study is complete.
Parts that an earlier study left there stay until this one begins.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import OutputError, SceneError
from ..report.files import replace_atomically, write_json
from ..study.outcome import COLUMNS, MODE_COLUMNS
from .checkpoint import read_json
from .folder import PARTS, PARTS_INPUTS, is_part
from .inputs import differences, joined_differences
from .manifest import Manifest


class StudyParts:
    """The finished parts of a study in a folder of results.

    Attributes
    ----------
    results : Manifest
        The manifest of the folder.
    folder : Path
        Where the parts are.
    begun : bool
        Whether the parts there are those of this study, by `begin` or `go_on`.
    """

    def __init__(self, results: Manifest) -> None:
        self.results, self.folder, self.begun = results, results.folder / PARTS, False

    @property
    def exists(self) -> bool:
        """Whether there are parts that a study could resume from."""
        return (self.results.folder / PARTS_INPUTS).exists()

    @property
    def has_chunks(self) -> bool:
        """Whether anything of this study is finished."""
        return self.begun and any(self.folder.glob("*.npz"))

    def go_on(self, inputs: Mapping[str, Any]) -> None:
        """Take the parts that are there for those of this study; refuse parts of another one, or damaged ones.

        Raises
        ------
        SceneError, OutputError
        """
        found = differences(read_json(self.results.folder / PARTS_INPUTS), inputs)
        if found:
            raise SceneError(
                f"{self.results.folder}: the interrupted study was another one: {joined_differences(found)}; expected"
                " the same one: start anew without --resume, or give another folder by -o"
            )
        for path in self.folder.glob("*.npz"):
            _read(path)
        self.begun = True

    def begin(self, inputs: Mapping[str, Any]) -> None:
        """Begin a new study with these inputs, and remove the parts of an earlier one."""
        self.remove()
        write_json(inputs, self.results.folder / PARTS_INPUTS)
        self.begun = True

    def remove(self) -> None:
        """Remove the parts, `inputs.json` first: without this file a study does not resume from the others."""
        self.results.remove(is_part, first=PARTS_INPUTS)

    def stage(self, name: str, begin: Callable[[], None]) -> StageParts:
        """Return the parts of one stage; `begin` is called before the first one is kept of a study not yet begun."""
        return StageParts(self, name, begin)


class StageParts:
    """The finished chunks of one stage, see `fe_squeal.study.engine.Parts`."""

    def __init__(self, study: StudyParts, stage: str, begin: Callable[[], None]) -> None:
        self._study, self._folder, self._stage, self._begin = study, study.folder, stage, begin

    def load(self) -> dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return places and tables of each finished chunk, by its number.

        Raises
        ------
        OutputError
            A file is damaged.
        """
        found: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        if not self._study.begun:
            return found
        for path in sorted(self._folder.glob(f"{self._stage}_*.npz")):
            match = re.fullmatch(rf"{self._stage}_(\d+)\.npz", path.name)
            if match is None:
                continue
            found[int(match[1])] = _read(path)
        return found

    def save(self, chunk: int, places: np.ndarray, rows: np.ndarray, modes: np.ndarray) -> None:
        """Keep the places and tables of a finished chunk under its number."""
        if not self._study.begun:
            self._begin()
        with replace_atomically(self._folder / f"{self._stage}_{chunk:05d}.npz") as temporary:
            np.savez(temporary, places=places, rows=rows, modes=modes)


def _read(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (m, d), rows (m, columns) and unstable modes (k, 1 + columns) of a chunk."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as data:
            places, rows, modes = (np.asarray(data[name], float) for name in ("places", "rows", "modes"))
        if rows.shape[1:] != (len(COLUMNS),) or modes.shape[1:] != (1 + len(MODE_COLUMNS),):
            raise ValueError("its tables have other columns")
    except Exception as error:  # the reader stops at damaged files with almost any exception
        raise OutputError(f"{path}: is damaged ({error}); start anew without --resume") from error
    return places, rows, modes
