"""Reading a scene from TOML."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from ..effects import known_effects
from ..errors import SceneError
from .faults import shortened, validated
from .matrices import MatrixScene
from .scene import Scene, scene_with

_MOST_BYTES, _MOST_PARTS = 2_000_000, 100  # a scene of 10 000 values has 0.2 MB, a key of a scene four parts
# Strings and bare names are parts of keys, and so are numbers; comments, blanks between the parts, and all else.
_TOKEN = re.compile(
    r"""(?P<part>\"{3}.*?\"{3}|'{3}.*?'{3}|"(?:[^"\\\n]|\\.)*"|'[^'\n]*'|[\w+-]+|[ \t]+)|(?P<dot>\.)|\#[^\n]*|.""",
    re.DOTALL,
)


def load_scene(path: str | Path) -> Scene | MatrixScene:
    """Read and validate a scene file.

    Parameters
    ----------
    path : str or Path
        A file in TOML, see docs/scene.md. Paths in it are relative to its folder.

    Returns
    -------
    Scene or MatrixScene
        A scene on a mesh; or one of matrices from files, if it has `[[terms]]`.

    Raises
    ------
    SceneError
        The file cannot be read, or is no valid scene. The message says which file and key, what was given, and what is
        expected.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise SceneError(f"{path}: no such file; expected a scene in TOML")
        if not path.is_file():
            raise SceneError(f"{path}: not a file; expected a scene in TOML")
        if path.stat().st_size > _MOST_BYTES:
            raise SceneError(f"{path}: has more than {_MOST_BYTES // 10**6} MB; expected a scene in TOML")
        content = path.read_bytes()
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}; expected a scene in TOML") from error
    try:
        text = content.decode("utf-8-sig")  # Windows editors put a byte order mark in front
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise SceneError(
            f"{path}: not TOML: line {line} holds the byte 0x{content[error.start]:02x}, which is not UTF-8;"
            " expected a text file saved as UTF-8"
        ) from error
    _refuse_long_keys(text, path)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        hint = "" if path.suffix.lower() == ".toml" else "; of a mesh or a deck fe-squeal new makes a scene"
        raise SceneError(f"{path}: not TOML: {_syntax(str(error), text)}{hint}") from error
    except ValueError as error:  # a whole number of more digits than Python reads
        raise SceneError(f"{path}: not TOML: {error}") from error
    except RecursionError as error:
        raise SceneError(f"{path}: not a scene: nested too deeply") from error
    scene = parse_scene(data, str(path))
    scene._source = path
    return scene


def _refuse_long_keys(text: str, path: Path) -> None:
    """Refuse keys of very many parts, which cost the reader of TOML the square of their number."""
    parts = 0
    for found in _TOKEN.finditer(text):
        parts = parts + 1 if found["dot"] else parts if found["part"] else 0
        if parts > _MOST_PARTS:
            line = text.count("\n", 0, found.start()) + 1
            raise SceneError(f"{path}: line {line}: a key of more than {_MOST_PARTS} parts; expected keys of a scene")


def parse_scene(data: dict[str, Any], source: str = "scene") -> Scene | MatrixScene:
    """Return the scene that nested dictionaries describe, after validation.

    Parameters
    ----------
    data : dict
        The tables of a scene, as a file in TOML would have them, see docs/scene.md.
    source : str
        What messages call the scene.

    Returns
    -------
    Scene or MatrixScene

    Raises
    ------
    SceneError
        A key or a value is wrong. The message says which, what was given, and what is expected.

    Examples
    --------
    >>> parse_scene({"mesh": {"flie": "a.msh"}}, "brake.toml")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    fe_squeal.errors.SceneError: brake.toml: mesh.flie: unknown key; did you mean "file"? | materials: is missing; ...
    """
    if "terms" in data or ("parameters" in data and "mesh" not in data):
        return validated(MatrixScene, data, source)
    return validated(scene_with(known_effects()), data, source)


def _syntax(message: str, text: str) -> str:
    """Return tomllib's message with the line that it is about."""
    found = re.search(r"at line (\d+)", message)
    if found is None:
        return message
    line = text.split("\n")[int(found[1]) - 1].strip()
    hint = "; a table or key is given twice, or once as [...] and once as [[...]]" if "overwrite" in message else ""
    return f"{message}: {shortened(''.join(c if c.isprintable() else '?' for c in line))}{hint}"
