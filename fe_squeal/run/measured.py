"""Read the measured frequencies and shapes of a scene, from its own numbers and from the files that it names."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..errors import SceneError
from ..report.table_files import read_table
from ..scene import MatrixScene, Scene
from ..scene.measured import Measured

_COMPONENTS = tuple(f"u{a}_{part}" for a in "xyz" for part in ("re", "im"))
_UNIVERSAL = (".unv", ".uff")
_LENGTH = {"m": 1.0, "mm": 1e-3}


@dataclass(frozen=True)
class Frequency:
    """A measured frequency, Hz, with its level, dB, if it is known."""

    hz: float
    level_db: float | None
    label: str


@dataclass(frozen=True)
class TestShape:
    """A measured shape in the model's coordinates.

    Attributes
    ----------
    label : str
        What tables and figures call it.
    hz : float or None, Hz
        Its frequency, if it is known.
    points : (p, 3) float, m
        The measured points.
    u : (p, 3) complex
        Displacements along `axes`, in any unit; NaN where a component was not measured.
    axes : (p, 3, 3) float
        The directions of the displacements of each point, as rows.
    distance : float, m
        A point and a node that are farther apart do not belong together.
    """

    __test__ = False  # pytest would take a class of this name for a test

    label: str
    hz: float | None
    points: np.ndarray
    u: np.ndarray
    axes: np.ndarray
    distance: float


@dataclass(frozen=True)
class Measurements:
    """The measured frequencies and shapes of a scene; notes and warnings on how they were read, a sentence each.

    `units` are those of the scene, "SI" or "any".
    """

    frequencies: tuple[Frequency, ...] = ()
    shapes: tuple[TestShape, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    units: str = "SI"


NOTHING_MEASURED = Measurements()


def read_measured(scene: Scene | MatrixScene) -> Measurements:
    """Return the measured frequencies and shapes that a scene names.

    Raises
    ------
    SceneError
        A file is missing or damaged, does not have the expected columns, or has shapes for a scene of matrices.
    """
    frequencies: list[Frequency] = []
    shapes: list[TestShape] = []
    notes: list[str] = []
    warnings: list[str] = []
    for i, entry in enumerate(scene.measured):
        key = f"{scene.source}: measured[{i}]" if scene.source is not None else f"measured[{i}]"
        if entry.file is None:
            assert entry.frequency_hz is not None
            frequencies.append(Frequency(entry.frequency_hz, entry.level_db, entry.label))
            continue
        path = scene.folder / entry.file
        if not path.is_file():
            raise SceneError(f'{key}.file: given "{entry.file}"; there is no file {path}; expected one in .csv or .unv')
        suffix = path.suffix.lower()
        hz, axes, label = entry.frequency_hz, np.eye(3), entry.label or path.stem
        name = _unlike(label, [shape.label for shape in shapes])
        if suffix == ".csv":
            if entry.reference is not None:
                raise SceneError(f"{key}.reference: belongs to a universal file; {path} is none")
            frame = _table(path, f"{key}.file")
            if "x" not in frame:
                for name in ("frequency_hz", "level_db"):
                    if getattr(entry, name) is not None:
                        raise SceneError(f"{key}.{name}: given beside columns of {path}; expected one of both")
                frequencies += _frequencies(frame, entry, f"{key}.file", path)
                continue
            x, u = _shape(frame, f"{key}.file", path)
        elif suffix in _UNIVERSAL:
            from .universal import read_universal

            read = read_universal(path, entry.frequency_hz, entry.reference, f"{key}.file")
            x, u, axes, hz = read.points, read.u, read.axes, read.hz or entry.frequency_hz
            notes += [f"measured shape {name}: {text}" for text in read.notes]
            warnings += [f"measured shape {name}: {text}" for text in read.warnings]
        else:
            raise SceneError(f'{key}.file: given "{entry.file}"; expected a file in .csv or .unv')
        if isinstance(scene, MatrixScene):
            raise SceneError(
                f"{key}.file: {path} holds a shape, and a scene of matrices has no places to compare it at; expected"
                " frequencies"
            )
        points = np.array(entry.origin) + _LENGTH[entry.length_unit] * x @ entry.frame
        turned = np.broadcast_to(axes @ entry.frame, (len(points), 3, 3))
        shapes.append(TestShape(name, hz, points, u, turned, entry.distance))
        if entry.frequency_hz is not None:
            frequencies.append(Frequency(entry.frequency_hz, entry.level_db, label))
    return Measurements(tuple(frequencies), tuple(shapes), tuple(notes), tuple(warnings), scene.units)


def _unlike(label: str, taken: list[str]) -> str:
    """Return a label, with a number if it is taken, since tables and figures tell shapes apart by it."""
    return next(name for i in count(1) if (name := f"{label} ({i})" if i > 1 else label) not in taken)


def _table(path: Path, key: str) -> pd.DataFrame:
    try:
        frame = read_table(path, ["label"], skipinitialspace=True)
    except (OSError, OverflowError, ValueError) as error:
        raise SceneError(f"{key}: {path} cannot be read ({error}); expected a table in CSV") from error
    return frame.rename(columns=lambda name: str(name).strip())


def _frequencies(frame: pd.DataFrame, entry: Measured, key: str, path: Path) -> list[Frequency]:
    if "frequency_hz" not in frame:
        raise SceneError(
            f"{key}: {path} has the columns {', '.join(map(str, frame.columns))}; expected frequency_hz (and level_db,"
            " label), or x, y, z with displacements"
        )
    hz = _numbers(frame, "frequency_hz", key, path)
    wrong = ~((hz > 0) & (hz < np.inf))
    if wrong.any() or not len(hz):
        found = f"the frequency {hz[wrong][0]:g} in row {int(np.argmax(wrong)) + 2}" if wrong.any() else "no row"
        raise SceneError(f"{key}: {path} has {found}; expected finite frequencies above 0 in Hz")
    level = _numbers(frame, "level_db", key, path) if "level_db" in frame else np.full(len(hz), np.nan)
    names: list[Any] = frame["label"].to_list() if "label" in frame else [entry.label] * len(hz)
    return [
        Frequency(float(f), None if np.isnan(db) else float(db), "" if name != name else str(name))
        for f, db, name in zip(hz, level, names, strict=True)
    ]


def _shape(frame: pd.DataFrame, key: str, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return points (p, 3), in the file's unit, and displacements (p, 3) complex, NaN where they were not measured."""
    missing = [c for c in "xyz" if c not in frame]
    measured = [c for c in _COMPONENTS if c in frame and c.endswith("_re")]
    # An imaginary part that is not found under its name would be taken for zero.
    for column in map(str, frame.columns):
        if column.lower().startswith(("ux", "uy", "uz")) and column not in _COMPONENTS:
            raise SceneError(f"{key}: {path} has the column {column}; expected some of {', '.join(_COMPONENTS)}")
        if column.endswith("_im") and column in _COMPONENTS and f"{column[:2]}_re" not in measured:
            raise SceneError(f"{key}: {path} has the column {column} without {column[:2]}_re; expected both")
    if missing or not measured or not len(frame):
        columns = ", ".join(map(str, frame.columns))
        raise SceneError(
            f"{key}: {path} has the columns {columns} and {len(frame)} rows; expected x, y, z and some of"
            f" {', '.join(_COMPONENTS)}"
        )
    x = np.stack([_numbers(frame, c, key, path) for c in "xyz"], axis=1)
    u = np.full((len(frame), 3), np.nan + 0j)
    for a, axis in enumerate("xyz"):
        if f"u{axis}_re" in measured:
            u[:, a] = _numbers(frame, f"u{axis}_re", key, path)
            if f"u{axis}_im" in frame:
                u[:, a] += 1j * _numbers(frame, f"u{axis}_im", key, path)
    if not np.isfinite(x).all():
        raise SceneError(f"{key}: {path} has points without coordinates; expected a number for each of x, y, z")
    return x, u


def _numbers(frame: pd.DataFrame, column: str, key: str, path: Path) -> np.ndarray:
    try:
        return np.asarray(pd.to_numeric(frame[column]), dtype=float)
    except (OverflowError, TypeError, ValueError) as error:
        raise SceneError(f"{key}: {path}, column {column}: {error}; expected numbers") from error
