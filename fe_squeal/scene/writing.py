"""A scene as the text of a TOML file."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from .matrices import MatrixScene
from .numbers import plain
from .scene import Scene

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def scene_text(scene: Scene | MatrixScene, folder: Path) -> str:
    """Return a scene as TOML, with the names of its files relative to a folder.

    Defaults that its file did not say are not said.
    """
    data = plain(scene.model_dump(by_alias=True, exclude_unset=True))
    holders = data.get("terms", []) if isinstance(scene, MatrixScene) else [data["mesh"]]
    for holder in (*holders, *data.get("measured", [])):
        if holder.get("file"):
            holder["file"] = seen_from(folder, scene.folder / holder["file"])
    out_of_core = data.get("solve", {}).get("mumps", {})
    if out_of_core.get("folder"):
        out_of_core["folder"] = seen_from(folder, scene.folder / out_of_core["folder"])
    return "\n".join(_table(data, "")).lstrip("\n") + "\n"


def seen_from(folder: Path, path: Path) -> str:
    """Return a path relative to a folder, or absolute where it is on another drive.

    Links to folders are followed, since ".." leads to the parent of what a link points to. The name of the file stays,
    also where it is a link: its ending says what is in the file.
    """
    place, folder = path.parent.resolve() / path.name, folder.resolve()
    try:
        return Path(os.path.relpath(place, folder)).as_posix()
    except ValueError:  # another drive
        return place.as_posix()


def _table(data: Mapping[str, Any], path: str) -> Iterator[str]:
    tables = {k: v for k, v in data.items() if isinstance(v, Mapping) or _is_tables(v)}
    for key, value in data.items():
        if key not in tables:
            yield f"{_key(key)} = {_value(value)}"
    for key, value in tables.items():
        name = f"{path}.{_key(key)}".removeprefix(".")
        for table in value if isinstance(value, list) else [value]:
            yield f"\n[[{name}]]" if isinstance(value, list) else f"\n[{name}]"
            yield from _table(table, name)


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else json.dumps(key, ensure_ascii=False)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }" if value else "{}"
    if isinstance(value, list):
        return f"[{', '.join(_value(v) for v in value)}]"
    return repr(value)
