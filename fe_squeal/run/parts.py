"""Keep the finished parts of a study in the folder of its results, so that it can resume after any interruption.

The folder `parts` has `inputs.json`, written first, and the finished chunks of each stage: `samples_00000.npz` and so
on. Every file is complete or absent, and contains plain arrays. The folder is removed when the study is complete.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
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
    """The finished parts of a study in a folder of results; `results` is the manifest of the folder."""

    def __init__(self, results: Manifest) -> None:
        self.results, self.folder = results, results.folder / PARTS

    @property
    def exists(self) -> bool:
        """Whether there are parts that a study could resume from."""
        return (self.results.folder / PARTS_INPUTS).exists()

    @property
    def has_chunks(self) -> bool:
        """Whether anything is finished."""
        return any(self.folder.glob("*.npz"))

    def check(self, inputs: Mapping[str, Any]) -> None:
        """Refuse to go on from parts of another study, or damaged ones.

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

    def begin(self, inputs: Mapping[str, Any]) -> None:
        """Begin a new study with these inputs, and remove the parts of an earlier one."""
        self.remove()
        write_json(inputs, self.results.folder / PARTS_INPUTS)

    def remove(self) -> None:
        """Remove the parts, `inputs.json` first: without this file a study does not resume from the others."""
        self.results.remove(is_part, first=PARTS_INPUTS)

    def stage(self, name: str) -> StageParts:
        """Return the parts of one stage."""
        return StageParts(self.folder, name)


class StageParts:
    """The finished chunks of one stage, see `fe_squeal.study.engine.Parts`."""

    def __init__(self, folder: Path, stage: str) -> None:
        self._folder, self._stage = folder, stage

    def load(self) -> dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return places and tables of each finished chunk, by its number.

        Raises
        ------
        OutputError
            A file is damaged.
        """
        found = {}
        for path in sorted(self._folder.glob(f"{self._stage}_*.npz")):
            match = re.fullmatch(rf"{self._stage}_(\d+)\.npz", path.name)
            if match is None:
                continue
            found[int(match[1])] = _read(path)
        return found

    def save(self, chunk: int, places: np.ndarray, rows: np.ndarray, modes: np.ndarray) -> None:
        """Keep the places and tables of a finished chunk under its number."""
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
