"""Split a Nastran bulk data file into cards: free, small and large fields, continuations, includes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fe_squeal.errors import MeshError

from ..sources import Sources

_MARK = re.compile(r"[+*](?![\d.]).*")  # of a continuation: in free fields it may stand before the tenth
_NUMBER = re.compile(r"[+-]?\.?\d")  # how data begin, and no name of a continuation
_SHORT_EXPONENT = re.compile(r"^([+-]?(?:\d+\.?\d*|\.\d+))([+-]\d+)$")


@dataclass(frozen=True)
class Card:
    """One bulk data entry: its name in capitals and the fields after it; a blank field is ""."""

    name: str
    fields: list[str]
    where: str

    def text(self, i: int) -> str:
        """Return field i, counted from 0 after the name; "" if there are fewer fields."""
        return self.fields[i] if i < len(self.fields) else ""


def ranges(card: Card, start: int) -> Iterator[range]:
    """Yield the numbers that a card lists from a field on: FIRST THRU LAST BY STEP as a range, others as ranges of one.

    Raises
    ------
    ValueError
        The fields are not such a list.
    """
    given = [text.upper() for text in card.fields[start:] if text]
    i = 0
    while i < len(given):
        first, step = int(given[i]), 0
        last, i = first, i + 1
        if given[i : i + 1] == ["THRU"]:
            last, i = int("".join(given[i + 1 : i + 2])), i + 2
            if given[i : i + 1] == ["BY"]:
                step, i = abs(int("".join(given[i + 1 : i + 2]))), i + 2
                if not step:
                    raise ValueError("BY 0")
        step = (step or 1) * (1 if last >= first else -1)
        yield range(first, last + (1 if step > 0 else -1), step)


def read_lines(sources: Sources, path: Path | None = None, depth: int = 0) -> Iterator[tuple[str, str]]:
    """Yield (line, file and number of the line); the lines of an included file stand in the place of its INCLUDE.

    Raises
    ------
    MeshError
        The file is not text, or an included file is missing.
    """
    path = path or sources.path
    for number, line in enumerate(sources.lines(path, depth, "Nastran bulk data"), 1):
        statement = line.lstrip()
        if statement[:7].upper() == "INCLUDE" and statement[7:8] in (" ", "'", '"'):
            name = statement[7:].split("$")[0].strip().strip("'\"").strip()
            target = sources.find(name, path, f"{path.name} line {number}")
            yield from read_lines(sources, target, depth + 1)
        else:
            yield line, f"{path.name} line {number}"


def read_cards(lines: list[tuple[str, str]]) -> Iterator[Card]:
    """Yield the bulk data entries between BEGIN BULK (or the start) and ENDDATA.

    Raises
    ------
    MeshError
        Entries are replicated (=), a continuation names another entry than that before it, or a line in free fields has
        more fields than an entry.
    """
    begin = next(
        (i + 1 for i, (line, _) in enumerate(lines) if " ".join(line.upper().split()).startswith("BEGIN BULK")), 0
    )
    name, fields, where, end, mark = "", [""], "", 8, ""
    plain = [(text, place) for line, place in lines[begin:] if (text := line.partition("$")[0]).strip()]
    for i, (line, place) in enumerate(plain):
        following = plain[i + 1][0] if i + 1 < len(plain) else ""
        head, rest, wide, after = _cut(line, place, following)
        if head.startswith("="):
            raise MeshError(f'{place}: "{head[:20]}" repeats an entry, which is not read; expected it written out')
        own, before, mark = head.strip("+* "), mark.strip("+* "), after
        if head[:1] in ("+", "*") or not head:
            if own and before and own.upper() != before.upper():
                raise MeshError(
                    f'{place}: the continuation "{head[:20]}" stands behind an entry that "+{before[:20]}" continues;'
                    " expected continuations right behind their entries"
                )
            # A continuation: its fields follow those of the line before, blank ones at the end of that line included.
            fields += [""] * (end - len(fields))
            fields += rest
            end += 4 if wide else 8
            continue
        if name:
            yield Card(name, fields, where)
        name = head.rstrip("* ").upper()
        if name == "ENDDATA":
            return
        fields, where, end = rest, place, 4 if wide else 8
    if name:
        yield Card(name, fields, where)


def _cut(line: str, place: str, following: str = "") -> tuple[str, list[str], bool, str]:
    """Return the first field of a line, its data fields (at most 8, or 4 large ones), whether they are large, and mark.

    The mark is what names the continuation of the line, "" where there is none. `following` is the next line.
    """
    if "," in line:
        parts = [part.strip() for part in line.split(",")]
        wide = parts[0].endswith("*") or parts[0].startswith("*")
        last = 5 if wide else 9
        # "+1" is a number or a mark: it is a mark if the next line begins with it, which no other line does.
        is_mark = _MARK.fullmatch(parts[-1]) or (parts[-1][:1] in ("+", "*") and parts[-1] == _first_field(following))
        mark = parts.pop() if len(parts) > 1 and is_mark else ""
        if any(parts[last + 1 :]) or any(_NUMBER.match(part) for part in parts[last:]):
            raise MeshError(
                f"{place}: {parts[0][:9]} has {len(parts) - 1} fields on a line; expected at most {last - 1}, and more"
                " on lines that continue it"
            )
        return parts[0], parts[1:last], wide, mark or "".join(parts[last:])
    line = line.expandtabs(8).rstrip()
    head = line[:8].strip()
    wide = head.endswith("*") or head.startswith("*")
    step, count = (16, 4) if wide else (8, 8)
    body = line[8 : 8 + step * count]
    return head, [body[i : i + step].strip() for i in range(0, len(body), step)], wide, line[72:80].strip()


def _first_field(line: str) -> str:
    return (line.partition(",")[0] if "," in line else line.expandtabs(8)[:8]).strip()


def real(text: str) -> float:
    """Return a Nastran number: a blank is zero, and the exponent may be written with D or without a letter.

    Examples
    --------
    >>> real("1.5-3"), real(".7D1"), real("")
    (0.0015, 7.0, 0.0)
    """
    if not text:
        return 0.0
    try:
        return float(text)
    except ValueError:
        short = _SHORT_EXPONENT.match(text)
        return float(f"{short[1]}e{short[2]}" if short else text.upper().replace("D", "E"))
