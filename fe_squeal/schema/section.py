"""Base of every validated section of a scene, and number types with their ranges."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, NoReturn

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator

from ..errors import SceneError

_TINY, _HUGE = 1e-50, 1e50
Text = Annotated[str, Field(min_length=1)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
# TOML has lists only; the numbers in them stay strict.
Vector = Annotated[tuple[float, float, float], Field(strict=False)]


def _nonzero(value: Any) -> Any:
    if not any(value):
        raise ValueError("expected a vector that is not zero")
    return value


def _moves(value: float) -> float:
    if value == 0:
        raise ValueError("expected a number that is not zero, whose sign gives the direction")
    return value


def _without_commas(value: str) -> str:
    if "," in value:
        raise ValueError("expected a name without a comma, which stands between the paths of several numbers")
    return value


def _not_empty(value: str) -> str:
    if not value:
        raise ValueError("expected a name")
    return value


# Names of tables, which are part of the paths of the numbers in them; one that may be left out is empty then.
OptionalName = Annotated[str, AfterValidator(_without_commas)]
Name = Annotated[OptionalName, AfterValidator(_not_empty)]
Direction = Annotated[Vector, AfterValidator(_nonzero)]
Speed = Annotated[float, AfterValidator(_moves)]


def _refused(self: Any, *_: Any, **__: Any) -> NoReturn:
    raise _unchangeable(f"a {'list' if isinstance(self, list) else 'table'} of the scene")


class FixedList(list[Any]):
    """A list of a scene: what would be put into it later would not be checked."""

    append = extend = insert = remove = pop = clear = sort = reverse = _refused
    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refused

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle it as a whole, not entry by entry."""
        return FixedList, (list(self),)


class FixedTable(dict[str, Any]):
    """A table of a scene whose keys are names."""

    update = setdefault = pop = popitem = clear = _refused
    __setitem__ = __delitem__ = __ior__ = _refused

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle it as a whole, not entry by entry."""
        return FixedTable, (dict(self),)


class Section(BaseModel):
    """An immutable table of a scene: unknown keys, wrong types, NaN and infinity are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, validate_default=True)

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to change a table: what was made from it would not follow."""
        if not name.startswith("_"):
            raise _unchangeable(name)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        """Refuse to take a key away."""
        if not name.startswith("_"):
            raise _unchangeable(name)
        super().__delattr__(name)

    @field_validator("*")
    @classmethod
    def _ordinary(cls, value: Any) -> Any:
        """Refuse numbers whose squares and products would overflow or vanish; keep lists and tables from changes."""
        for number in _floats(value):
            if number and not _TINY < abs(number) < _HUGE:
                raise ValueError(f"expected a number between {_TINY:g} and {_HUGE:g} in size, or 0")
        return FixedList(value) if isinstance(value, list) else FixedTable(value) if type(value) is dict else value


def _unchangeable(name: str) -> SceneError:
    return SceneError(
        f"{name}: a scene does not change once it is made; for another number of the physics take"
        f' problem.at({{"effects.friction.mu": 0.3}}), for another scene fe_squeal.parse_scene'
    )


def _floats(value: Any) -> Iterator[float]:
    """Yield the numbers in nested lists and in tables of numbers."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, list | tuple | dict):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _floats(inner)
