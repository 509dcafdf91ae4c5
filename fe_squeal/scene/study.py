"""What a study is asked for: scatter of several numbers, or a map over two.

In one file, since scatter and map share their checks of paths and ranges.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from ..errors import suggest
from ..problem.parameters import paths_of
from ..schema.section import Positive, Section
from .control import checked_name, joined_paths

_Pair = Annotated[tuple[str, str, float], Field(strict=False)]


class _Bounded(Section):
    """A distribution that may be cut off.

    Attributes
    ----------
    low : float
        No value is smaller (default: unbounded, but for lognormal ones, which stay above 0).
    high : float
        No value is larger.
    """

    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _rising(self) -> _Bounded:
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"given low = {self.low:g}, high = {self.high:g}; expected low < high")
        return self


class Normal(_Bounded):
    """Normal distribution, cut off where low or high are given.

    Attributes
    ----------
    mean : float
        Mean of the distribution before it is cut off.
    deviation : float
        Standard deviation, of the same.
    """

    mean: float
    deviation: Positive

    @model_validator(mode="after")
    def _inside(self) -> Normal:
        if (self.low is not None and self.low > self.mean) or (self.high is not None and self.high < self.mean):
            raise ValueError(f"given mean = {self.mean:g} outside low and high; expected it between them")
        return self


class Lognormal(_Bounded):
    """Lognormal distribution: 68 % of the values lie between median / factor and median · factor.

    Attributes
    ----------
    median : float
        Half of the values are smaller, before the distribution is cut off.
    factor : float
        Factor of one standard deviation of the logarithm.
    """

    median: Positive
    factor: Annotated[float, Field(gt=1)]

    @model_validator(mode="after")
    def _inside(self) -> Lognormal:
        if (self.low is not None and self.low > self.median) or (self.high is not None and self.high < self.median):
            raise ValueError(f"given median = {self.median:g} outside low and high; expected it between them")
        return self


class Uniform(Section):
    """Every value between two is as likely.

    Attributes
    ----------
    low : float
        The smallest value.
    high : float
        The largest value.
    """

    low: float
    high: float

    @model_validator(mode="after")
    def _rising(self) -> Uniform:
        if self.low >= self.high:
            raise ValueError(f"given low = {self.low:g}, high = {self.high:g}; expected low < high")
        return self


class Triangular(Section):
    """Most likely at `mode`, and less and less down to `low` and up to `high`.

    Attributes
    ----------
    low : float
        The smallest value.
    mode : float
        The most likely value, between both or equal to one.
    high : float
        The largest value.
    """

    low: float
    mode: float
    high: float

    @model_validator(mode="after")
    def _rising(self) -> Triangular:
        if not (self.low <= self.mode <= self.high and self.low < self.high):
            given = f"low = {self.low:g}, mode = {self.mode:g}, high = {self.high:g}"
            raise ValueError(f"given {given}; expected low ≤ mode ≤ high, and low < high")
        return self


class Distribution(Section):
    """How one number is scattered: one of these keys.

    Attributes
    ----------
    normal : table
        Normal, by mean and standard deviation.
    uniform : table
        All values between two are as likely.
    lognormal : table
        The logarithm is normal: by the median and a factor, for numbers above 0.
    triangular : table
        Most likely at one value, less and less towards two ends.
    values : list of float
        Values that are equally likely.
    """

    normal: Normal | None = None
    uniform: Uniform | None = None
    lognormal: Lognormal | None = None
    triangular: Triangular | None = None
    values: Annotated[list[float], Field(min_length=2, max_length=100_000)] | None = None

    @model_validator(mode="after")
    def _one(self) -> Distribution:
        given = [k for k in type(self).model_fields if getattr(self, k) is not None]
        if len(given) != 1:
            known = ", ".join(type(self).model_fields)
            raise ValueError(f"given {' and '.join(given) or 'nothing'}; expected one of {known}")
        if self.values is not None and len(set(self.values)) < 2:
            raise ValueError("values: expected at least two different ones")
        return self

    @property
    def ends(self) -> tuple[float | None, float | None]:
        """The least and the largest value; None where there is none."""
        if self.values is not None:
            return min(self.values), max(self.values)
        table = self.normal or self.lognormal or self.uniform or self.triangular
        assert table is not None
        return table.low, table.high

    @property
    def is_normal(self) -> bool:
        """Whether it can be correlated: normal, or lognormal."""
        return self.normal is not None or self.lognormal is not None


class Axis(Section):
    """One of the two parameters of a map.

    Attributes
    ----------
    parameter : str
        As that of the sweep.
    from : float
        The smallest value; above 0 with scale = "log".
    to : float
        The largest value.
    points : int
        Number of values of the grid, ends included.
    scale : "linear" or "log"
        How they are spaced.
    """

    parameter: str
    start: float = Field(alias="from")
    stop: float = Field(alias="to")
    points: Annotated[int, Field(ge=3, le=2001)]
    scale: Literal["linear", "log"] = "linear"

    @field_validator("parameter", mode="before")
    @classmethod
    def _name(cls, value: object) -> str:
        return joined_paths(value)

    @model_validator(mode="after")
    def _rising(self) -> Axis:
        given = f"given from = {self.start:g}, to = {self.stop:g}"
        if self.start >= self.stop:
            raise ValueError(f"{given}; expected from < to")
        if self.scale == "log" and self.start <= 0:
            raise ValueError(f'{given} with scale = "log"; expected from > 0')
        return self

    @property
    def grid(self) -> np.ndarray:
        """(points,) float: the values."""
        if self.scale == "linear":
            return np.linspace(self.start, self.stop, self.points)
        grid = np.geomspace(self.start, self.stop, self.points)
        grid[0], grid[-1] = self.start, self.stop  # which rounding may have moved out of the interval
        return grid


class StudySection(Section):
    """A study, which `fe-squeal study` makes: a scatter, with `parameters`, or a map, with `x` and `y`.

    Attributes
    ----------
    samples : int
        Number of samples of a scatter (default 1000), scrambled Sobol points.
    seed : int
        Seed of their scrambling: the same seed gives the same samples.
    bands : list of float, Hz
        Edges of the bands that probabilities are told for (default: octaves over the frequencies that were solved for).
    parameters : table of tables
        The numbers that are scattered, by their paths; the paths in one key, "a, b", move together.
    correlation : list
        Entries [path, path, coefficient]: correlation of normal numbers, and of the logarithms of lognormal ones.
    indices : bool
        Whether sensitivity indices are computed, for which as many samples are solved again.
    x : table
        The parameter of a map that runs to the right in its picture.
    y : table
        The parameter of a map that runs upwards in its picture.
    tolerance : float
        Relative error of every eigenvalue, next to a double one times its condition, instead of `tolerance` of [solve].
        A sample whose estimated error is larger is solved directly.
    """

    samples: Annotated[int, Field(ge=8, le=10_000_000)] | None = None
    seed: Annotated[int, Field(ge=0, le=2**31)] = 0
    bands: Annotated[list[float], Field(min_length=2, max_length=1000)] | None = None
    parameters: Annotated[dict[str, Distribution], Field(max_length=50)] = {}
    correlation: list[_Pair] = []
    indices: bool = True
    x: Axis | None = None
    y: Axis | None = None
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-6

    @model_validator(mode="before")
    @classmethod
    def _behind_the_numbers(cls, data: object) -> object:
        """Take `correlation` from the end of [study.parameters], where it is written beside the numbers it is about."""
        numbers = data.get("parameters") if isinstance(data, dict) else None
        if not isinstance(data, dict) or not isinstance(numbers, dict):
            return data
        for key, value in numbers.items():
            if key in cls.model_fields and key != "correlation" and not isinstance(value, dict):
                raise ValueError(f"parameters.{key}: is no number of the scene; expected it above [study.parameters]")
        if not isinstance(numbers.get("correlation"), list):
            return data
        if "correlation" in data:
            raise ValueError("correlation: given above and inside of [study.parameters]; expected it once")
        rest = {key: value for key, value in numbers.items() if key != "correlation"}
        return {**data, "parameters": rest, "correlation": numbers["correlation"]}

    @field_validator("bands")
    @classmethod
    def _increasing(cls, value: list[float] | None) -> list[float] | None:
        for a, b in pairwise(value or ()):
            if a >= b:
                raise ValueError(f"expected edges that increase; {b:g} comes after {a:g}")
        if value is not None and value[0] < 0:
            raise ValueError("expected edges from 0 on")
        return value

    @model_validator(mode="after")
    def _scatter_or_map(self) -> StudySection:
        if bool(self.parameters) == (self.x is not None or self.y is not None):
            given = "both" if self.parameters else "neither"
            wanted = "[study.parameters], or [study.x] and [study.y]"
            raise ValueError(f"given {given} of parameters and x, y; expected {wanted}")
        if not self.parameters:
            if self.x is None or self.y is None:
                raise ValueError("given one of x and y; expected both [study.x] and [study.y]")
            for key in ("samples", "seed", "bands", "correlation", "indices"):
                if key in self.model_fields_set:
                    raise ValueError(f"{key}: belongs to a scatter; expected none beside [study.x] and [study.y]")
        known: list[str] = []
        for name in self.names:
            for path in paths_of(name):
                if path in known:
                    raise ValueError(f'given "{path}" twice; expected every path once')
                known.append(path)
        names = {checked_name(k): d for k, d in self.parameters.items()}
        pairs: set[frozenset[str]] = set()
        for i, (a, b, coefficient) in enumerate(self.correlation):
            for name in (checked_name(a), checked_name(b)):
                if name not in names:
                    raise ValueError(f'correlation[{i}]: given "{name}", no key of parameters{suggest(name, names)}')
                if not names[name].is_normal:
                    raise ValueError(f'correlation[{i}]: "{name}" is neither normal nor lognormal; expected such ones')
            if checked_name(a) == checked_name(b) or not -1 < coefficient < 1:
                given = f"{a}, {b}, {coefficient:g}"
                raise ValueError(f"correlation[{i}]: given {given}; expected two keys, and a number between -1 and 1")
            pair = frozenset((checked_name(a), checked_name(b)))
            if pair in pairs:
                raise ValueError(f"correlation[{i}]: given {a}, {b} twice; expected every pair once")
            pairs.add(pair)
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters, in the order in which they are given."""
        if self.x is not None and self.y is not None:
            return self.x.parameter, self.y.parameter
        return tuple(checked_name(name) for name in self.parameters)

    @property
    def positive(self) -> frozenset[str]:
        """The parameters whose values stay above 0 although they have no least value: lognormal ones."""
        return frozenset(checked_name(name) for name, d in self.parameters.items() if d.lognormal is not None)

    @property
    def ends(self) -> tuple[tuple[float | None, float | None], ...]:
        """The least and the largest value of each parameter, as far as there are such."""
        if self.x is not None and self.y is not None:
            return tuple((axis.start, axis.stop) for axis in (self.x, self.y))
        return tuple(d.ends for d in self.parameters.values())
