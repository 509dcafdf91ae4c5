"""Studies as CSV: UTF-8, one header line, floats with every digit."""

from __future__ import annotations

import csv
import itertools
import math
import os
from collections.abc import Iterator
from pathlib import Path

from .results import Curves, Grid, Responses, Surface, Table
from .study import Result

Row = tuple[object, ...]


def write_csv(result: Result, path: str | os.PathLike[str]) -> Path:
    """Write a result in long form: one row per case, parameter and eigenvalue (or instant, or grid point).

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_csv(Table(("a", "b"), ((1.5, "x"),)), Path(folder) / "a.csv").read_text().split()
    ['a,b', '1.5,x']
    """
    path = Path(path)
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(_rows(result))
    return path


def _rows(result: Result) -> Iterator[Row]:
    if isinstance(result, Curves):
        yield from _curve_rows(result)
    elif isinstance(result, Surface):
        yield ("case", result.x.name, result.y.name, "growth")
        for label, growth in zip(result.labels, result.growth, strict=True):
            for (j, y), (i, x) in itertools.product(enumerate(result.y.values), enumerate(result.x.values)):
                yield (label, float(x), float(y), float(growth[j, i]))
    elif isinstance(result, Responses):
        yield ("case", "mu", "t", *result.coordinates)
        for label, mu, motion in zip(result.labels, result.mu, result.motion, strict=True):
            for t, q in zip(result.times, motion, strict=True):
                yield (label, mu, float(t), *map(float, q))
    elif isinstance(result, Grid):
        yield (*(axis.name for axis in result.axes), result.quantity)
        points = itertools.product(*(axis.values.tolist() for axis in result.axes))
        for point, value in zip(points, result.values.ravel().tolist(), strict=True):
            yield (*point, value)
    else:
        assert isinstance(result, Table)
        yield result.columns
        yield from result.rows


def _curve_rows(result: Curves) -> Iterator[Row]:
    several = len({case.panel for case in result.cases}) > 1
    yield ("case", result.axis.name, "mode", "re", "im", "frequency_hz", "uncertainty", "stability")
    for case in result.cases:
        label = case.label if case.label == case.panel or not several else f"{case.panel}: {case.label}"
        for value, lam, uncertainty in zip(result.axis.values, case.lam, case.uncertainty, strict=True):
            for mode, (x, u) in enumerate(zip(lam.tolist(), uncertainty.tolist(), strict=True), 1):
                stability = "unstable" if x.real > u else "stable" if x.real < -u else "marginal"
                yield (label, float(value), mode, x.real, x.imag, abs(x.imag) / (2 * math.pi), u, stability)
