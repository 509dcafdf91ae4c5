"""Numbers of a scene by their dotted paths, such as "springs.piston.damping" or "materials.steel.youngs_modulus"."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from ..errors import SceneError, nearest_name, suggest
from ..problem.parameters import MU
from .base import BaseScene
from .faults import validated

# Tables whose numbers no problem moves with.
NOT_PHYSICS = ("mesh", "sweep", "study", "solve", "output", "measured")
GEOMETRY = ("mesh.disc_pad.", "mesh.block.")  # beginnings of paths that another mesh belongs to
_LONG = {MU: "effects.friction.mu"}  # paths by the short names that stand for them
_Scene = TypeVar("_Scene", bound=BaseScene)


def number_at(scene: BaseScene, path: str) -> float:
    """Return the number that a path leads to.

    Raises
    ------
    SceneError
        If there is no such number.
    """
    data = scene.model_dump(by_alias=True, exclude_none=True)
    holder, key = _find(scene, data, path)
    value = holder[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        inside = [p for p in numbers(scene) if p.startswith(f"{path}.")]
        raise SceneError(f'given "{path}", which is no number{suggest(path, inside) if inside else ""}')
    return float(value)


def with_numbers(scene: _Scene, numbers: Mapping[str, float]) -> _Scene:
    """Return the scene with other numbers, validated as if they stood in its file; it has no sweep and no study.

    Raises
    ------
    SceneError
    """
    data = scene.model_dump(by_alias=True, exclude_unset=True)
    data.pop("sweep", None)
    data.pop("study", None)
    for path, value in numbers.items():
        holder, key = _find(scene, data, path)
        # Whole numbers stay whole where they are asked for (mesh.order, solve.modes).
        whole = isinstance(holder[key], int) and not isinstance(holder[key], bool) and value == int(value)
        holder[key] = int(value) if whole else float(value)
    changed = validated(type(scene), plain(data), ", ".join(f"{p} = {v:g}" for p, v in numbers.items()))
    changed._source = scene.source
    return changed


def full_path(path: str) -> str:
    """Return the path of a number as it stands in the file, "effects.friction.mu" for "mu"."""
    return _LONG.get(path, path)


def numbers(scene: BaseScene) -> list[str]:
    """Return the paths of all numbers of a scene's physics."""
    return list(_numbers(scene, scene.model_dump(by_alias=True, exclude_none=True), ""))


def _numbers(scene: BaseScene, data: Any, prefix: str) -> Iterator[str]:
    if isinstance(data, Mapping):
        for key, value in data.items():
            if prefix or key not in NOT_PHYSICS:
                yield from _numbers(scene, value, f"{prefix}.{key}".removeprefix("."))
    elif isinstance(data, list | tuple):
        for name, value in zip(_names(scene, prefix, data), data, strict=True):
            yield from _numbers(scene, value, f"{prefix}.{name}")
    elif isinstance(data, int | float) and not isinstance(data, bool):
        yield prefix


def _names(scene: BaseScene, prefix: str, entries: Any) -> list[str]:
    """Return the names of a list's entries: their own, else their positions."""
    names = scene.names_in(prefix)
    return [str(i) for i in range(len(entries))] if names is None else names


def _find(scene: BaseScene, data: Any, path: str) -> tuple[Any, Any]:
    """Return the table or list that holds a number, and its key there; a default that was not written is filled in."""
    full = scene.model_dump(by_alias=True, exclude_none=True)
    if path in _LONG and full.get("effects", {}):
        path = _LONG[path]
    elif path not in _LONG.values() and path in full.get("parameters", {}):
        path = f"parameters.{path}"
    rest, prefix, holder = path, "", data
    while True:
        if isinstance(full, Mapping):
            # Names may hold dots themselves: the longest key that fits is taken.
            fits = [k for k in full if rest == k or rest.startswith(f"{k}.")]
            key: Any = max(fits, key=len, default=None)
            name = key
        elif isinstance(full, list | tuple):
            names = _names(scene, prefix, full)
            name = max((n for n in names if rest == n or rest.startswith(f"{n}.")), key=len, default=None)
            key = None if name is None else names.index(name)
        else:
            key = name = None
        if key is None:
            raise SceneError(f'given "{path}"; expected the path of a number of the scene{_suggest(scene, path)}')
        if isinstance(holder, dict) and key not in holder:
            holder[key] = full[key]
        if isinstance(holder, dict | list) and isinstance(holder[key], tuple):
            holder[key] = list(holder[key])
        if rest == name:
            return holder, key
        holder, full = holder[key], full[key]
        rest, prefix = rest[len(name) + 1 :], f"{prefix}.{name}".removeprefix(".")


def _suggest(scene: BaseScene, path: str) -> str:
    """Return the tail of a message about an unknown path: the nearest one, or all but those of single coordinates."""
    known = numbers(scene)
    known += [short for short, long in _LONG.items() if long in known]
    if nearest_name(path, known) is None:
        known = [p for p in known if not p.rpartition(".")[2].isdigit()]
    return suggest(path, known)


def plain(data: Any) -> Any:
    """Return tables and lists alone, as TOML gives them."""
    if isinstance(data, Mapping):
        return {k: plain(v) for k, v in data.items() if v is not None}
    return [plain(v) for v in data] if isinstance(data, list | tuple) else data
