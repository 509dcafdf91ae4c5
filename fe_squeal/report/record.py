"""What run.json, study.json and diff.json have to hold for the page: anybody may have changed them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, Field, ValidationError

# Strict, since the page shows what the file holds: the text "0.3" is no number there.
_Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
_Number = _Finite | None


def _some_direction(given: tuple[float, float, float]) -> tuple[float, float, float]:
    if not 1e-100 < np.abs(given).max() < 1e100:
        raise ValueError("no direction")
    return given


_Vector = tuple[_Finite, _Finite, _Finite]


class _Axis(BaseModel):
    direction: Annotated[_Vector, AfterValidator(_some_direction)] | None = None


class _Onsets(BaseModel):
    width: _Finite = 0.0


class _Contact(BaseModel):
    area_m2: _Finite
    coverage: _Number
    largest_gap_m: _Finite


class _Inputs(BaseModel):
    scene: dict[str, Any] | None = None
    content: dict[str, Any] | None = None


class RunRecord(BaseModel):
    """Keys of run.json."""

    units: str | None = None
    axis: _Axis | None = None
    completeness: dict[str, Any] | None = None
    onsets_complete: _Onsets | None = None
    frequency_range_hz: tuple[_Number, _Number] | None = None
    measured: list[dict[str, Any]] | None = None
    unstable: list[dict[str, Any]] | None = None
    warnings: list[str] | None = None
    notes: list[str] | None = None
    effects: list[str] | None = None
    seconds: dict[str, Any] | None = None
    contacts: dict[str, _Contact] | None = None
    inputs: _Inputs | None = None
    peak_memory_mib: _Number = None


class UnstableMode(BaseModel):
    """Keys of an unstable mode of run.json: its branch, the value of the sweep, and what its shape looks like."""

    branch: _Finite = 0.0
    value: _Finite = 0.0
    nodal_diameters: _Number = None
    nodal_circles: _Number = None
    nodal_diameters_share: _Number = None
    other_nodal_diameters: _Number = None
    other_share: _Number = None
    travelling: _Number = None
    body: str | None = None
    body_share: _Number = None


class StudyRecord(BaseModel):
    """Keys of study.json, of a scatter or a map."""

    title: str | None = None
    kind: str | None = None
    status: str | None = None
    driver: str | None = None
    probability: _Number = None
    samples: Annotated[int, Field(ge=1, strict=True)] | None = None
    samples_without_modes: Annotated[int, Field(ge=0, strict=True)] = 0
    probability_interval: tuple[_Finite, _Finite] | None = None
    known_hz: _Number = None
    dangerous: list[str] | None = None
    parameters: list[str] | None = None
    unstable_share: _Number = None
    not_followed: list[str] | None = None


class DifferenceRecord(BaseModel):
    """Keys of diff.json."""

    title: str = ""
    symbol: str = ""
    answers: list[str] = []
    lacks: list[str] = []


def readable(record: dict[str, Any], kind: type[BaseModel]) -> tuple[dict[str, Any], list[str]]:
    """Return what a record holds that the page can show, and the keys whose values it cannot.

    Examples
    --------
    >>> readable({"axis": {"direction": [0, 0, 1]}, "seconds": 3.0}, RunRecord)
    ({'axis': {'direction': [0, 0, 1]}}, ['seconds'])
    """
    try:
        kind.model_validate(record)
    except ValidationError as error:
        wrong = sorted({str(fault["loc"][0]) for fault in error.errors()})
        return {key: value for key, value in record.items() if key not in wrong}, wrong
    return record, []


def covered_range(record: Mapping[str, Any]) -> tuple[float, float | None] | None:
    """Return the range, Hz, in which a run knows all modes, by run.json: no end where that is all above its begin.

    None where nothing is told of it.

    Examples
    --------
    >>> covered_range({"frequency_range_hz": [12.0, None]}), covered_range({})
    ((12.0, None), None)
    """
    told = record.get("frequency_range_hz")
    return None if told is None else (told[0] or 0.0, told[1])


def left_out(name: str, wrong: list[str]) -> list[str]:
    """Return a sentence about the keys of a file that are not shown, if there are any."""
    return [f"{name}: {', '.join(wrong)}: not as fe-squeal writes it; it is left out."] if wrong else []
