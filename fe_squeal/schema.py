"""Base of every validated section of a scene, and number types with their ranges."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
# TOML has lists only; the numbers in them stay strict.
Vector = Annotated[tuple[float, float, float], Field(strict=False)]


class Section(BaseModel):
    """An immutable table of a scene: unknown keys, wrong types, NaN and infinity are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)
