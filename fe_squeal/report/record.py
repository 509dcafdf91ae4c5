"""What run.json has to hold for the page: files in a folder of results may have been changed by anybody."""

from __future__ import annotations

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


class _Record(BaseModel):
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


def readable(record: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Return what a record holds that the page can show, and the keys whose values it cannot.

    Examples
    --------
    >>> readable({"axis": {"direction": [0, 0, 1]}, "seconds": 3.0})
    ({'axis': {'direction': [0, 0, 1]}}, ['seconds'])
    """
    try:
        _Record.model_validate(record)
    except ValidationError as error:
        wrong = sorted({str(fault["loc"][0]) for fault in error.errors()})
        return {key: value for key, value in record.items() if key not in wrong}, wrong
    return record, []
