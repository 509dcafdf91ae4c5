"""The inputs that the results of a run depend on, and how the inputs of two runs differ."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ..mesh import LoadedMesh
from ..mesh.digest import mesh_digest
from ..scene import MatrixScene, Scene
from ..version import __version__

_MOST = 3  # differences that a message names, at most


def run_inputs(scene: Scene | MatrixScene, mesh: LoadedMesh | None) -> dict[str, Any]:
    """Return the version of the program, the scene, and digests of what it reads, in a form for JSON.

    What it reads are its mesh or matrices, and files of measurements.

    Parameters
    ----------
    scene : Scene or MatrixScene
    mesh : LoadedMesh or None
        The mesh, if the scene has one. Its digest is that of points, elements and groups, not of the file.
    """
    content: dict[str, str | None] = {}
    if mesh is not None:
        content[f"mesh {mesh.source}"] = mesh_digest(mesh)
    files = [term.file for term in scene.terms] if isinstance(scene, MatrixScene) else []
    for file in (*files, *(entry.file for entry in scene.measured if entry.file is not None)):
        try:
            data = (scene.folder / file).read_bytes()
        except (OSError, ValueError):  # it will be read again, and what is wrong is reported then
            continue
        content[f"file {file}"] = hashlib.sha256(data).hexdigest()
    return {
        "version": __version__,
        "scene": scene.model_dump(mode="json", by_alias=True, exclude_none=True),
        "content": content,
    }


def input_files(scene: Scene | MatrixScene) -> list[Path]:
    """Return the files that a command reads and must not replace: the scene, and the files that it names."""
    files = [scene.source, scene.mesh_path] if isinstance(scene, Scene) else [scene.source]
    if isinstance(scene, MatrixScene):
        files += [scene.folder / term.file for term in scene.terms]
    files += [scene.folder / entry.file for entry in scene.measured if entry.file is not None]
    return [Path(file) for file in files if file is not None]


def differences(known: Any, given: Mapping[str, Any]) -> list[str]:
    """Return a few words for each thing in which the inputs of two runs differ.

    Examples
    --------
    >>> known = {"version": "1", "scene": {"sweep": {"points": 36}}, "content": {"mesh a.msh": "3f"}}
    >>> given = {"version": "1", "scene": {"sweep": {"points": 40}}, "content": {"mesh a.msh": "77"}}
    >>> differences(known, given)
    ['sweep.points is 36 there and 40 here', 'the content of mesh a.msh is another']
    """
    if not isinstance(known, dict) or {"version", "scene", "content"} - known.keys():
        return ["it has no record of what it was made from"]
    found = []
    if known["version"] != given["version"]:
        found.append(f"the version is {known['version']} there and {given['version']} here")
    before, now = dict(_flat(known["scene"], "")), dict(_flat(given["scene"], ""))
    for key in sorted(before.keys() | now.keys()):
        if before.get(key) != now.get(key):
            there, here = (_short(side.get(key)) for side in (before, now))
            found.append(f"{key} is {there} there and {here} here")
    contents = known["content"] if isinstance(known["content"], dict) else {}
    names = sorted(contents.keys() & given["content"].keys())
    found += [f"the content of {name} is another" for name in names if contents[name] != given["content"][name]]
    return found or ([] if contents.keys() == given["content"].keys() else ["the files are others"])


def joined_differences(found: list[str]) -> str:
    """Return differences as one text, the first few of them and how many more there are."""
    rest = len(found) - _MOST
    return "; ".join(found[:_MOST]) + (f"; and {rest} more" if rest > 0 else "")


def _flat(data: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield the values of nested tables with their dotted keys; a table without any is a value: it switches on."""
    if isinstance(data, dict) and (data or not prefix):
        for key, value in data.items():
            yield from _flat(value, f"{prefix}.{key}".removeprefix("."))
    elif isinstance(data, list) and any(isinstance(value, dict) for value in data):
        for i, value in enumerate(data):
            yield from _flat(value, f"{prefix}[{i}]")
    else:
        yield prefix, data


def _short(value: Any) -> str:
    if value is None:
        return "not given"
    text = "a table" if value == {} else repr(value)
    return text if len(text) <= 40 else text[:37] + "..."

