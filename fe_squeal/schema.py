"""Base of every validated section of a scene, and number types with their ranges."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator

_TINY, _HUGE = 1e-50, 1e50
Text = Annotated[str, Field(min_length=1)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
# TOML has lists only; the numbers in them stay strict.
Vector = Annotated[tuple[float, float, float], Field(strict=False)]


class Section(BaseModel):
    """An immutable table of a scene: unknown keys, wrong types, NaN and infinity are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _ordinary(cls, value: Any) -> Any:
        """Refuse numbers whose squares and products would overflow or vanish."""
        for number in value if isinstance(value, list | tuple) else (value,):
            if isinstance(number, float) and number and not _TINY < abs(number) < _HUGE:
                raise ValueError(f"expected a number between {_TINY:g} and {_HUGE:g} in size, or 0")
        return value
