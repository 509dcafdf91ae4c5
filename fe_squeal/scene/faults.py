"""Saying in one line all that is wrong with a scene."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from types import UnionType
from typing import Any, NamedTuple, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from ..errors import SceneError, nearest_name, suggest
from .base import BaseScene

_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "tuple_type": "a list of numbers",
    "finite_number": "a finite number (the largest is 1.8e308)",
}
_SIGNS = {"greater_than": ">", "greater_than_equal": "≥", "less_than": "<", "less_than_equal": "≤"}
_KINDS: dict[Any, str] = {float: "a number", int: "a whole number", str: "a text in quotes", tuple: "a list of numbers"}
_MOST_FAULTS = 200  # that are looked at
_MOST = 50  # faults in one message
_Keys = tuple[int | str, ...]
_Table = TypeVar("_Table", bound=BaseModel)


def validated(kind: type[_Table], data: dict[str, Any], source: str) -> _Table:
    """Return a table of a kind from nested dictionaries.

    Raises
    ------
    SceneError
        With the source, and of every fault the key, what was given and what is expected, with " | " between them.
    """
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        found = error.errors(include_url=False)
        faults = _distinct([_locate(fault, data, kind) for fault in found[:_MOST_FAULTS]])
        shown = [_describe(fault) for fault in faults[:_MOST]]
        more = max(len(faults) - _MOST, 0) + max(len(found) - _MOST_FAULTS, 0)
        tail = f" | and {more} more" if more else ""
        raise SceneError(f"{source}: {' | '.join(shown)}{tail}") from None
    except RecursionError as error:
        raise SceneError(f"{source}: not a scene: nested too deeply") from error


@contextmanager
def naming_file(scene: BaseScene) -> Iterator[None]:
    """Put the file of a scene in front of what a SceneError of the block says, if it is not there.

    Raises
    ------
    SceneError
        That of the block, with the name.
    """
    try:
        yield
    except SceneError as error:
        where = f"{scene.source}: " if scene.source is not None else ""
        raise SceneError(f"{where}{str(error).removeprefix(where)}") from error


class _Fault(NamedTuple):
    """A fault that pydantic found, at keys of the scene file."""

    keys: _Keys
    section: type[BaseModel]  # the table that the last key belongs to
    kind: str
    given: Any
    detail: Any


def _locate(error: Any, data: Any, section: type[BaseModel]) -> _Fault:
    """Return the fault with the keys that the data has: pydantic adds the names of union members to them."""
    keys: list[int | str] = []
    inner, named = section, False  # the section that the last key leads to; whether a free name or an index comes next
    kind, last = error["type"], len(error["loc"]) - 1
    for i, part in enumerate(error["loc"]):
        inside = part in data if isinstance(data, dict) else isinstance(data, list) and isinstance(part, int)
        if not inside and not (i == last and kind == "missing"):
            continue
        keys.append(part)
        section = inner
        if named:
            named = False
        elif (field := _field(section, part)) is not None:
            inner, named = _leads_to(field.annotation, section)
        data = data[part] if inside and (isinstance(data, dict) or int(part) < len(data)) else None
    if kind == "missing" and keys and isinstance(keys[-1], int):  # an entry of a list of fixed length
        return _Fault(tuple(keys[:-1]), section, "length", error["input"], {"length": keys[-1] + 1})
    return _Fault(tuple(keys), section, kind, error["input"], error.get("ctx", {}))


def _distinct(faults: list[_Fault]) -> list[_Fault]:
    """Return one fault per key, unknown keys first, without those that another one explains.

    A value that may be a number or a list fails as both. A key that is missing because it is misspelled is one fault.
    """
    faults = sorted(faults, key=lambda f: f.kind != "extra_forbidden")
    meant = {
        (*f.keys[:-1], name)
        for f in faults if f.kind == "extra_forbidden"
        if (name := nearest_name(str(f.keys[-1]), _valid_keys(f.section))) is not None
    }  # fmt: skip
    found: dict[_Keys, _Fault] = {}
    for fault in faults:
        deeper = any(f.keys[: len(fault.keys)] == fault.keys != f.keys for f in faults)
        if not deeper and not (fault.kind == "missing" and fault.keys in meant):
            longer = fault.kind == "length" and fault.keys in found and found[fault.keys].kind == "length"
            if longer or fault.keys not in found:
                found[fault.keys] = fault
    return list(found.values())


def _describe(fault: _Fault) -> str:
    where = _dotted(fault.keys) or "scene"
    if fault.kind == "missing":
        return f"{where}: is missing{_wanted(fault.section, fault.keys[-1], where)}"
    if fault.kind == "extra_forbidden":
        return f"{where}: unknown key{suggest(str(fault.keys[-1]), _valid_keys(fault.section))}"
    if fault.kind == "value_error":
        message = str(fault.detail["error"])
        if not fault.keys:
            return message
        return f"{where}: {message}" if isinstance(fault.given, dict) else f"{where}: {_given(fault.given)}{message}"
    return f"{where}: {_given(fault.given)}expected {_expected(fault, where)}"


def _expected(fault: _Fault, where: str) -> str:
    kind, detail = fault.kind, fault.detail
    if kind == "length":
        return _entries(detail["length"])
    if kind == "string_too_short":
        return "a text that is not empty"
    if kind == "too_short":
        return f"at least {_entries(detail['min_length'])}"
    if kind == "too_long":
        exactly = detail["field_type"] == "Tuple"
        return f"{'' if exactly else 'at most '}{_entries(detail['max_length'])}"
    if kind == "literal_error":
        return _words(detail["expected"].replace("'", '"'), _field(fault.section, fault.keys[-1]))
    if kind in _SIGNS:
        bound = next(iter(detail.values()))
        return f"{_KINDS[type(bound)]} {_SIGNS[kind]} {bound:g}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"a table, written {'{ ... }' if '[' in where else f'[{where}]'}"
    if kind == "list_type":
        field = _field(fault.section, fault.keys[-1])
        tables = field is not None and _leads_to(field.annotation, BaseModel)[0] is not BaseModel
        return f"a list of tables, written [[{where}]]" if tables else "a list, written [...]"
    if kind == "float_type" and isinstance(fault.given, int) and not isinstance(fault.given, bool):
        kind = "finite_number"  # too many digits for a float
    return _EXPECTED.get(kind, kind.replace("_", " "))


def _words(expected: str, field: FieldInfo | None) -> str:
    """Return which words a value may be, and that it may be a number where the field takes one."""
    words = f"one of {expected}" if expected.count('"') > 2 else expected
    return f"{words}, or a number" if field is not None and float in options(field.annotation) else words


def _wanted(section: type[BaseModel], key: int | str, where: str) -> str:
    """Return the tail of a message about a missing key: what its value has to be."""
    field = _field(section, key)
    if field is None:
        return ""
    first = options(field.annotation)[0]
    if isinstance(first, type) and issubclass(first, BaseModel):
        return f"; expected a table, written [{where}]"
    if get_origin(first) is dict:
        return f"; expected a table for each, written [{where}.NAME]"
    bounds = [f" {s} {getattr(m, n):g}" for m in field.metadata for n, s in (("gt", ">"), ("ge", "≥")) if hasattr(m, n)]
    text = _KINDS.get(get_origin(first) or first)
    return f"; expected {text}{''.join(bounds)}" if text else ""


def _field(section: type[BaseModel], key: int | str) -> FieldInfo | None:
    return next((f for n, f in section.model_fields.items() if key == (f.alias or n)), None)


def _leads_to(annotation: Any, default: type[BaseModel]) -> tuple[type[BaseModel], bool]:
    """Return the section behind a field, and whether a free name or an index comes before its keys."""
    for option in options(annotation):
        if get_origin(option) in (dict, list):
            return _leads_to(get_args(option)[-1], default)[0], True
        if isinstance(option, type) and issubclass(option, BaseModel):
            return option, False
    return default, False


def options(annotation: Any) -> list[Any]:
    """Return the members of a union without None, each without the bounds around it."""
    if get_origin(annotation) in (Union, UnionType):
        return [o for member in get_args(annotation) if member is not type(None) for o in options(member)]
    return options(annotation.__origin__) if hasattr(annotation, "__metadata__") else [annotation]


def _valid_keys(section: type[BaseModel]) -> list[str]:
    return [f.alias or n for n, f in section.model_fields.items()]


def _dotted(keys: _Keys) -> str:
    return "".join(f"[{k}]" if isinstance(k, int) else f".{_bare(k)}" for k in keys).removeprefix(".")


def _bare(key: str) -> str:
    return key if re.fullmatch(r"[\w-]+", key) else json.dumps(key)


def _entries(count: int) -> str:
    return "1 entry" if count == 1 else f"{count} entries"


def _given(value: Any) -> str:
    return f"given {shortened(toml_text(value))}; "


def shortened(text: str) -> str:
    """Return a text, cut off with three dots if it is longer than 60 characters."""
    return text if len(text) <= 60 else text[:57] + "..."


def toml_text(value: Any) -> str:
    """Return a value about as it is written in TOML."""
    if isinstance(value, dict | BaseModel):
        return "a table"
    if isinstance(value, list) and value and all(isinstance(v, dict) for v in value):
        return "a list of tables"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml_text(v) for v in value)}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, int) and value.bit_length() > 200:
        return f"a whole number of {value.bit_length()} bits"
    if isinstance(value, float):
        short = f"{value:g}" if float(f"{value:g}") == value else repr(value)
        return f"{short}.0" if short.lstrip("-").isdigit() else short  # which tells it from a whole number
    return str(value)
