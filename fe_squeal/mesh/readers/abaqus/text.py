"""The keyword layer of an Abaqus input file: blocks of a keyword line and its data lines, includes followed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fe_squeal.errors import MeshError, suggest

from ...raw import Floats, Ints

_DEPTH = 20
LARGEST = 2**62  # no label is as large
_LABEL = re.compile(r"-?[0-9]+")
_FIELD = re.compile(r'"[^"]*"|[^,]+|(?<=,)(?=,)')


@dataclass(frozen=True)
class Block:
    """One keyword with its parameters (names in capitals, values as spelled) and data lines."""

    keyword: str
    parameters: dict[str, str]
    lines: list[str]
    where: str

    def value(self, name: str) -> str:
        """Return a parameter's value, "" if it is absent."""
        return self.parameters.get(name, "")


def read_blocks(path: Path, source: str, depth: int = 0) -> Iterator[Block]:
    """Yield the keyword blocks of the file and of the files that it includes.

    Raises
    ------
    MeshError
        The file is not text, or an included file is missing.
    """
    if depth > _DEPTH:
        raise MeshError(f"{source}: *INCLUDE is nested more than {_DEPTH} deep; does {path.name} include itself?")
    data = path.read_bytes()
    if b"\0" in data:
        raise MeshError(f"{source}: {path.name} is not a text file; expected an Abaqus input file")
    lines = data.decode("utf-8", "replace").splitlines()
    at, current = 0, None
    while at < len(lines):
        line = lines[at].strip()
        at += 1
        if not line or line.startswith("**"):
            continue
        if not line.startswith("*"):
            if current is not None:
                current.lines.append(line)
            continue
        number = at
        while line.endswith(",") and at < len(lines):
            line += lines[at].strip()
            at += 1
        if current is not None:
            yield from _finished(current, path, source, depth)
        current = _keyword(line, f"{path.name} line {number}")
    if current is not None:
        yield from _finished(current, path, source, depth)


def _finished(block: Block, path: Path, source: str, depth: int) -> Iterator[Block]:
    name = block.value("INPUT")
    if not name:
        yield block
        return
    target = path.parent / name.replace("\\", "/")
    if not target.is_file():
        near = [p.name for p in target.parent.iterdir()] if target.parent.is_dir() else []
        raise MeshError(
            f'{source}: {block.where}: the included file "{name}" does not exist{suggest(target.name, near)}'
        )
    if block.keyword == "INCLUDE":
        yield from read_blocks(target, source, depth + 1)
        return
    extra = target.read_bytes().decode("utf-8", "replace").splitlines()
    lines = [line.strip() for line in extra if line.strip() and not line.lstrip().startswith("*")]
    yield Block(block.keyword, block.parameters, block.lines + lines, block.where)


def _keyword(line: str, where: str) -> Block:
    fields = [field.strip() for field in _FIELD.findall(line[1:])]
    parameters = {}
    for field in fields[1:]:
        key, _, value = field.partition("=")
        parameters[" ".join(key.upper().split())] = unquoted(value)
    return Block(" ".join((fields or [""])[0].upper().split()), parameters, [], where)


def unquoted(text: str) -> str:
    """Return the text without surrounding blanks and double quotes."""
    text = text.strip()
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] == '"' else text


def entries(line: str) -> list[str]:
    """Return the non-empty fields of a data line, unquoted.

    Examples
    --------
    >>> entries('PAD-1.SET, "my set", 12,')
    ['PAD-1.SET', 'my set', '12']
    """
    if '"' not in line:
        return [field for field in (part.strip() for part in line.split(",")) if field]
    return [unquoted(field) for field in _FIELD.findall(line) if field.strip()]


def is_label(text: str) -> bool:
    """Return whether a text is the number of a node or an element: no Unicode digits, one sign at most."""
    return _LABEL.fullmatch(text) is not None


def label_of(text: str) -> int:
    """Return a label as a number; one too long for 64 bits as one that no node or element has."""
    number = int(text[:30])
    return number if abs(number) < LARGEST else LARGEST


def numbers(lines: list[str], where: str, source: str) -> tuple[Floats, Ints]:
    """Return all numbers of the data lines, and how many stand up to the end of each line.

    Raises
    ------
    MeshError
        Something is not a number.
    """
    fields = [line.rstrip(", \t").split(",") for line in lines]
    ends = np.cumsum([len(f) for f in fields], dtype=np.int64)
    flat = [text for f in fields for text in f]
    try:
        return np.array(flat, dtype=np.float64), ends
    except ValueError:
        pass
    values = np.empty(len(flat))
    for i, text in enumerate(flat):
        try:
            # Fortran's exponents; an empty field counts as zero.
            values[i] = (
                float(text.strip().upper().replace("D", "E") or 0.0)
                if "D" in text.upper() or not text.strip()
                else float(text)
            )
        except ValueError:
            row = int(np.searchsorted(ends, i, side="right"))
            raise MeshError(
                f'{source}: {where}: "{text.strip()}" in the data line "{lines[row][:60]}" is not a number'
            ) from None
    return values, ends
