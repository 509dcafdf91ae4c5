"""Reading a scene from TOML, and saying in one line what is wrong with it."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from .errors import SceneError, suggest
from .scene import Scene

_EXPECTED = {
    "missing": "is missing",
    "extra_forbidden": "unknown key",
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "list_type": "a list",
    "tuple_type": "a list of numbers",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "finite_number": "a finite number",
}


def load_scene(path: str | Path) -> Scene:
    """Read and validate a scene file.

    Raises
    ------
    SceneError
        With the file, the key, what was given and what is expected.
    """
    path = Path(path)
    if not path.exists():
        raise SceneError(f"{path}: no such file; expected a scene in TOML")
    if not path.is_file():
        raise SceneError(f"{path}: not a file; expected a scene in TOML")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: not TOML: {error}") from error
    except RecursionError as error:
        raise SceneError(f"{path}: not a scene: nested too deeply") from error
    scene = parse_scene(data, str(path))
    scene._source = path
    return scene


def parse_scene(data: dict[str, Any], source: str = "scene") -> Scene:
    """Validate a scene given as nested dictionaries.

    Examples
    --------
    >>> parse_scene({"mesh": {"flie": "a.msh"}}, "brake.toml")
    Traceback (most recent call last):
    fe_squeal.errors.SceneError: brake.toml: mesh.flie: unknown key; did you mean "file"?
    """
    try:
        return Scene.model_validate(data)
    except ValidationError as error:
        # An unknown key is often a misspelled one that is then missing as well: say the cause first.
        faults = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
        more = len({e["loc"] for e in faults}) - 1
        tail = f" (and {more} more)" if more else ""
        raise SceneError(f"{source}: {_describe(faults[0], data)}{tail}") from None
    except RecursionError as error:
        raise SceneError(f"{source}: not a scene: nested too deeply") from error


def _describe(fault: Any, data: dict[str, Any]) -> str:
    keys, model = _locate(fault["loc"], data)
    where = _dotted(keys) or "scene"
    kind, context = fault["type"], fault.get("ctx", {})
    if kind == "missing":
        return f"{where}: is missing"
    if kind == "extra_forbidden":
        return f"{where}: unknown key{suggest(str(keys[-1]), _valid_keys(model))}"
    if kind == "value_error":
        message = str(context["error"])
        return message if where == "scene" else f"{where}: {_given(fault['input'])}{message}"
    if kind == "list_type" and isinstance(fault["input"], dict):
        return f"{where}: given a table; expected a list of tables, written [[{where}]]"
    if kind in ("too_short", "too_long"):
        few, many = context.get("min_length"), context.get("max_length")
        expected = f"at least {few} entries" if few is not None and kind == "too_short" else f"at most {many} entries"
    elif kind == "literal_error":
        expected = f"one of {context['expected']}"
    elif kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        signs = {"greater_than": ">", "greater_than_equal": "≥", "less_than": "<", "less_than_equal": "≤"}
        bound = next(iter(context.values()))
        expected = f"a number {signs[kind]} {bound:g}"
    else:
        expected = _EXPECTED.get(kind, fault["msg"][0].lower() + fault["msg"][1:])
    return f"{where}: {_given(fault['input'])}expected {expected}"


def _locate(loc: tuple[int | str, ...], data: Any) -> tuple[list[int | str], type[BaseModel]]:
    """Return the keys of a location that exist in the data (pydantic adds names of union members), and its section."""
    keys: list[int | str] = []
    model: Any = Scene
    for i, part in enumerate(loc):
        inside = (isinstance(data, dict) and part in data) or (isinstance(data, list) and isinstance(part, int))
        if not inside and i < len(loc) - 1:
            continue
        if not inside and isinstance(part, str) and ("[" in part or "-" in part or part in ("float", "int", "str")):
            continue  # a union member at the end
        keys.append(part)
        if i < len(loc) - 1:
            model = _section_of(model, part) or model
        data = data[part] if inside and (isinstance(data, dict) or int(part) < len(data)) else None
    return keys, model


def _section_of(model: Any, key: int | str) -> Any:
    """Return the section behind a key of a section, through lists, dictionaries and optionals."""
    field = next((f for n, f in model.model_fields.items() if key in (n, f.alias)), None)
    pending = [field.annotation] if field is not None else []
    while pending:
        annotation = pending.pop()
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            return annotation
        pending.extend(getattr(annotation, "__args__", ()))
    return None


def _valid_keys(model: type[BaseModel]) -> list[str]:
    return [f.alias or n for n, f in model.model_fields.items()]


def _dotted(keys: list[int | str]) -> str:
    return "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in keys).removeprefix(".")


def _given(value: Any) -> str:
    if isinstance(value, dict | BaseModel):
        return ""
    text = f'"{value}"' if isinstance(value, str) else repr(value)
    return f"given {text if len(text) <= 60 else text[:57] + '...'}; "
