"""Keep the measurements of a study of accuracy in a folder, each in a file."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from ..accuracy.measure import Measurement
from ..errors import OutputError
from ..report.files import replace_atomically

_OLDER = "changes"  # an array that measurements of older programs have, instead of the likely values


class MeasurementFolder:
    """A folder of measurements, which a study of accuracy uses as its `MeasurementStore`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def load(self, key: str) -> Measurement | None:
        """Return the measurement that was kept under a key, or None; one of an older program that has less is none.

        Raises
        ------
        OutputError
            The file is damaged.
        """
        path = self._path(key)
        if not path.exists():
            return None
        try:
            with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                if _OLDER in file:
                    return None
                found = {f.name: file[f.name] for f in fields(Measurement)}
                seconds = dict(zip(file["stages"].tolist(), file["seconds"].tolist(), strict=True))
            found |= {"unknowns": int(found["unknowns"]), "peak_memory_mib": float(found["peak_memory_mib"])}
            return Measurement(**{**found, "seconds": seconds, "finer": str(found["finer"])})
        except Exception as error:  # NumPy raises almost any exception at damaged files
            raise _damaged(path, error) from error

    def save(self, key: str, measured: Measurement) -> None:
        """Keep a measurement under a key."""
        plain = {f.name: getattr(measured, f.name) for f in fields(measured) if f.name != "seconds"}
        stages = {"stages": np.array(list(measured.seconds)), "seconds": np.array(list(measured.seconds.values()))}
        with replace_atomically(self._path(key)) as temporary, open(temporary, "wb") as file:
            np.savez(file, **{**plain, **stages})

    def load_probes(self, key: str) -> np.ndarray | None:
        """Return the points (p, 4) at which all shapes of a scene with this key are stored, see `measure`, or None.

        Raises
        ------
        OutputError
            The file is damaged.
        """
        path = self._probes(key)
        if not path.exists():
            return None
        try:
            return np.asarray(np.load(path, allow_pickle=False), float).reshape(-1, 4)
        except Exception as error:
            raise _damaged(path, error) from error

    def save_probes(self, key: str, probes: np.ndarray) -> None:
        """Keep the points (p, 4) at which all shapes of a scene are stored under its key."""
        with replace_atomically(self._probes(key)) as temporary:
            np.save(temporary, probes)

    def _probes(self, key: str) -> Path:
        return self.folder / f"probes_{key}.npy"

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.npz"


def _damaged(path: Path, why: object) -> OutputError:
    return OutputError(f"{path}: the measurement is damaged ({why}); remove it, and it is made again")
