"""Tables of the scene that are made from the list of effects: `[effects]`, and those that a body may have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, TypeVar

from pydantic import create_model, model_validator

from ..effects.effect import Effect
from ..schema.section import Section

_Table = TypeVar("_Table", bound=Section)
_Kind = TypeVar("_Kind", bound=Effect)


class EffectsTable(Section):
    """Effects that are on; one whose table is absent is not simulated."""

    known: ClassVar[tuple[type[Effect], ...]] = ()

    @property
    def on(self) -> dict[str, Effect]:
        """Tables of the effects that are on, by their names."""
        tables = {kind.name: getattr(self, kind.name) for kind in self.known}
        return {name: table for name, table in tables.items() if table is not None}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects that are on."""
        return tuple(self.on)

    def table(self, kind: type[_Kind]) -> _Kind | None:
        """Return the table of an effect; None where it is not on."""
        return next((table for table in self.on.values() if isinstance(table, kind)), None)

    @model_validator(mode="after")
    def _make_sense(self) -> EffectsTable:
        on = self.on
        for name, effect in on.items():
            for other, rest in effect.needs.items():
                if other not in on:
                    raise ValueError(f"given {name} without {other}{rest}")
            effect.check_effects(on)
        return self

    def check_at(self, numbers: Mapping[str, float]) -> None:
        """Raise ValueError where the effects make no sense together at other numbers, by their full paths.

        Each number alone may be beyond what its key allows.
        """
        on = self.on
        for path, value in numbers.items():
            name, _, key = path.removeprefix("effects.").partition(".")
            if path.startswith("effects.") and name in on and key in type(on[name]).model_fields:
                on[name] = on[name].model_copy(update={key: value})
        for effect in on.values():
            effect.check_effects(on)


def effects_table(known: Sequence[type[Effect]], module: str) -> type[EffectsTable]:
    """Return the table `[effects]` with a key for each effect.

    Parameters
    ----------
    module : str
        Where the class is to be found, which pickling needs.
    """
    made = _with_tables("Effects", EffectsTable, {kind.name: (kind, kind.summary) for kind in known}, module)
    made.known = tuple(known)
    return made


def with_own_tables(base: type[_Table], known: Sequence[type[Effect]], module: str) -> type[_Table]:
    """Return the table of a body, with a key for each effect whose table a body may have of its own."""
    own = {kind.name: (kind, kind.own_of_body) for kind in known if kind.own_of_body}
    return _with_tables("Body", base, own, module)


def _with_tables(
    name: str, base: type[_Table], tables: dict[str, tuple[type[Effect], str]], module: str
) -> type[_Table]:
    """Return a section with further tables, all optional, that are described in its docstring as others are."""
    fields: dict[str, Any] = {key: (kind | None, None) for key, (kind, _) in tables.items()}
    made = create_model(name, __base__=base, __module__=module, **fields)
    entries = "\n".join(f"{key} : table\n    {text}" for key, (_, text) in tables.items())
    prose = str(base.__doc__).partition("Attributes\n")[0].rstrip()
    made.__doc__ = f"{prose}\n\nAttributes\n----------\n{entries}\n"
    return made
