"""Finished parts of a study in the folder of its results, so that it can go on after any interruption.

The folder `parts` holds `inputs.json`, written first, and for each stage its finished chunks, `samples_00000.npz` and
so on. Every file is complete or absent, and holds plain arrays; they are removed when the study is complete.
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
from .inputs import differences, listed
from .manifest import Manifest


class StudyParts:
    """The folder of finished parts."""

    def __init__(self, results: Manifest) -> None:
        self.results, self.folder = results, results.folder / PARTS

    @property
    def exists(self) -> bool:
        """Whether there is something to go on from."""
        return (self.results.folder / PARTS_INPUTS).exists()

    def check(self, inputs: Mapping[str, Any]) -> None:
        """Refuse to go on from parts of another study, or damaged ones.

        Raises
        ------
        SceneError, OutputError
        """
        found = differences(read_json(self.results.folder / PARTS_INPUTS), inputs)
        if found:
            raise SceneError(
                f"{self.results.folder}: the interrupted study was another one: {listed(found)}; expected the same one:"
                " start anew without --resume, or give another folder by -o"
            )
        for path in self.folder.glob("*.npz"):
            _read(path)

    def begin(self, inputs: Mapping[str, Any]) -> None:
        """Begin anew, in place of what an earlier study left."""
        self.remove()
        write_json(inputs, self.results.folder / PARTS_INPUTS)

    def remove(self) -> None:
        """Remove them, `inputs.json` first: without that the rest is nothing to go on from."""
        self.results.remove(is_part, first=PARTS_INPUTS)

    def stage(self, name: str) -> StageParts:
        """Return the parts of one stage."""
        return StageParts(self.folder, name)


class StageParts:
    """Finished chunks of one stage; see `fe_squeal.study.engine.Parts`."""

    def __init__(self, folder: Path, stage: str) -> None:
        self._folder, self._stage = folder, stage

    def load(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """Return rows and unstable modes by chunk.

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

    def save(self, chunk: int, rows: np.ndarray, modes: np.ndarray) -> None:
        """Keep a finished chunk."""
        with replace_atomically(self._folder / f"{self._stage}_{chunk:05d}.npz") as temporary:
            np.savez(temporary, rows=rows, modes=modes)


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (m, columns) and unstable modes (k, 1 + columns) of a chunk."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as data:
            rows, modes = np.asarray(data["rows"], float), np.asarray(data["modes"], float)
        if rows.shape[1:] != (len(COLUMNS),) or modes.shape[1:] != (1 + len(MODE_COLUMNS),):
            raise ValueError("its tables have other columns")
    except Exception as error:  # the reader stops at damaged files with almost any exception
        raise OutputError(f"{path}: is damaged ({error}); start anew without --resume") from error
    return rows, modes
