"""Split an Abaqus input file into blocks, each a keyword line with its data lines, and follow its includes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from fe_squeal.errors import MeshError

from ...raw import Floats, Ints
from ..sources import Sources
from .parameters import evaluate_parameters

LARGEST = 2**62  # stands for a label that is too long for 64 bits: no node or element has it
_WHOLE = 1e15  # values of *PARAMETER below this are written without an exponent if they are whole
_PARAMETER = re.compile(r"<([^<>]*)>")
_LABEL = re.compile(r"-?[0-9]+")
_FIELD = re.compile(r'"[^"]*"|[^,]+|(?<=,)(?=,)')


@dataclass(frozen=True)
class KeywordBlock:
    """One keyword with its parameters (names in capitals, values as spelled) and its data lines.

    Attributes
    ----------
    foreign : bool
        Whether the data lines come from another file, named by INPUT=. That may be any file, so messages quote no more
        than a few characters of it.
    """

    keyword: str
    parameters: dict[str, str]
    lines: list[str]
    where: str
    foreign: bool = False

    def value(self, name: str) -> str:
        """Return the value of a parameter of the keyword, "" if the keyword does not have it."""
        return self.parameters.get(name, "")

    def shown(self, text: str) -> str:
        """Return as much of a data line, or of a part of it, as a message may quote; see `foreign`."""
        return text[: len(self.keyword) if self.foreign else 60]


def read_blocks(sources: Sources) -> Iterator[KeywordBlock]:
    """Yield the keyword blocks of the file; the lines of an included file stand where its *INCLUDE stands.

    Raises
    ------
    MeshError
        The file is not text, or an included file is missing.
    """
    current, home = None, sources.path
    values: dict[str, float] = {}
    for line, path, number in _logical_lines(sources, sources.path, 0):
        if values and "<" in line:
            line = _PARAMETER.sub(partial(_number_text, values), line)
        if not line.startswith("*"):
            if current is not None:
                current.lines.append(line)
                if path != home and not current.foreign:
                    current = replace(current, foreign=True)
            continue
        if current is not None:
            yield _with_input(current, sources, home)
            if current.keyword == "PARAMETER":
                values = evaluate_parameters(current.lines, values, f"{sources.path.name}: {current.where}")
        current, home = _keyword(line, f"{path.name} line {number}"), path
    if current is not None:
        yield _with_input(current, sources, home)


def _number_text(values: dict[str, float], found: re.Match[str]) -> str:
    value = values.get(found[1].strip().lower())
    if value is None:
        return found[0]
    return str(int(value)) if value == int(value) and abs(value) < _WHOLE else repr(value)


def _logical_lines(sources: Sources, path: Path, depth: int) -> Iterator[tuple[str, Path, int]]:
    """Yield (line, file, number of the line) without comments; a keyword line is joined with its continuations."""
    lines = sources.lines(path, depth, "an Abaqus input file")
    at = 0
    while at < len(lines):
        line = lines[at].strip()
        at += 1
        if not line or line.startswith("**"):
            continue
        number = at
        while line.startswith("*") and line.endswith(",") and at < len(lines):
            line += lines[at].strip()
            at += 1
        block = _keyword(line, f"{path.name} line {number}") if line[:8].upper() == "*INCLUDE" else None
        if block is not None and block.keyword == "INCLUDE" and block.value("INPUT"):
            target = sources.find(block.value("INPUT"), path, block.where, of_job=True)
            yield from _logical_lines(sources, target, depth + 1)
        else:
            yield line, path, number


def _with_input(block: KeywordBlock, sources: Sources, path: Path) -> KeywordBlock:
    """Return the block with the data lines of the file that its parameter INPUT names."""
    name = block.value("INPUT")
    if not name:
        return block
    target = sources.find(name, path, block.where, of_job=True)
    extra = sources.lines(target, 1, f"data lines of *{block.keyword}")
    lines = [line.strip() for line in extra if line.strip() and not line.lstrip().startswith("*")]
    return replace(block, lines=block.lines + lines, foreign=True)


def _keyword(line: str, where: str) -> KeywordBlock:
    fields = [field.strip() for field in _FIELD.findall(line[1:])]
    parameters = {}
    for field in fields[1:]:
        key, _, value = field.partition("=")
        parameters[" ".join(key.upper().split())] = unquoted(value)
    return KeywordBlock(" ".join((fields or [""])[0].upper().split()), parameters, [], where)


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
    """Return a label as a number; `LARGEST`, which no node or element has, if it is too long for 64 bits."""
    number = int(text[:30])
    return number if abs(number) < LARGEST else LARGEST


def numbers(block: KeywordBlock, source: str, lines: list[str] | None = None) -> tuple[Floats, Ints]:
    """Return all numbers (n,) of a block's data lines, and how many of them stand up to the end of each line (l,).

    Parameters
    ----------
    lines : list of str, optional
        Lines to read instead of the block's own.

    Raises
    ------
    MeshError
        Something is not a number.
    """
    lines = block.lines if lines is None else lines
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
            # Exponents may be written with D, as in Fortran; an empty field counts as zero.
            values[i] = (
                float(text.strip().upper().replace("D", "E") or 0.0)
                if "D" in text.upper() or not text.strip()
                else float(text)
            )
        except ValueError:
            row = int(np.searchsorted(ends, i, side="right"))
            raise MeshError(
                f'{source}: {block.where}: "{block.shown(text.strip())}" in the data line'
                f' "{block.shown(lines[row])}" is not a number'
            ) from None
    return values, ends


def whole_numbers(values: Floats, what: str, block: KeywordBlock, source: str) -> Ints:
    """Return numbers (n,) of a block as integers; `what` they are is for messages.

    Raises
    ------
    MeshError
        A number is not whole.
    """
    if len(values) and not (
        np.isfinite(values).all() and (values == np.floor(values)).all() and (np.abs(values) < 2**53).all()
    ):
        raise MeshError(f"{source}: {block.where}: {what} must be whole numbers")
    return values.astype(np.int64)
