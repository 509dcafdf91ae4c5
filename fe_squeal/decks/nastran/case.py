"""The case control: what its subcases select, and which of them the scene is made of."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from ..draft import Draft

_SHORTEST = 4  # letters of a command that are enough
_COMMANDS = ("SPC", "METHOD", "CMETHOD", "LOAD", "BCONTACT", "BCSET", "STATSUB")  # which select a set
_SCOPE = re.compile(r"^\s*(SUBC|STEP)[A-Z]*[\s=]+(\d+)", re.IGNORECASE)
_SELECTS = re.compile(r"^\s*(\w+)\s*(?:\((?!\s*FLUID)[^)]*\))?\s*=\s*(\d+)", re.IGNORECASE)
_ANALYSIS = re.compile(r"^\s*ANAL[A-Z]*\s*=\s*(\w+)", re.IGNORECASE)
_MODAL = ("MODES", "MCEIG", "DCEIG")
_STATIC = ("LOAD", "BCONTACT", "BCSET")  # what the static state before the modes has


@dataclass
class Subcase:
    """A subcase, or a step of one, with what it selects; the case control's own lines where there are none.

    Attributes
    ----------
    name : str
        Such as "SUBCASE 2", "SUBCASE 2 STEP 1", or "".
    selected : dict
        A set number by command; what is said further out counts for what is inside.
    analysis : str
        "" where ANALYSIS is not given.
    """

    name: str = ""
    selected: dict[str, int] = field(default_factory=dict)
    analysis: str = ""


def read_subcases(lines: list[tuple[str, str]]) -> list[Subcase]:
    """Return the subcases of (line, file and number of the line) in their order, at least one."""
    outer = [Subcase()]  # the case control itself, then a subcase, then a step
    found: list[Subcase] = []
    for line, _ in lines:
        if " ".join(line.upper().split()).startswith("BEGIN BULK"):
            return found or outer[:1]
        if scope := _SCOPE.match(line):
            name = f"{'SUBCASE' if scope[1].upper() == 'SUBC' else 'STEP'} {scope[2]}"
            outer = outer[: 1 if name.startswith("SUBCASE") else 2]
            if len(outer) == 2 and outer[1] in found:
                found.remove(outer[1])  # its steps stand for it
            parent = outer[-1]
            outer.append(Subcase(f"{parent.name} {name}".strip(), dict(parent.selected), parent.analysis))
            found.append(outer[-1])
        elif (match := _SELECTS.match(line)) and (command := _command(match[1])):
            outer[-1].selected[command] = int(match[2])
        elif match := _ANALYSIS.match(line):
            outer[-1].analysis = match[1].upper()
    return [Subcase()]  # without BEGIN BULK these were bulk data


def _command(word: str) -> str:
    """Return the command that a word of four letters at least, or of all of them, begins; "" for others."""
    found = [c for c in _COMMANDS if c == word.upper() or (len(word) >= _SHORTEST and c.startswith(word.upper()))]
    return found[0] if found else ""


def select(subcases: list[Subcase], draft: Draft) -> dict[str, set[int]]:
    """Return the set number of each command that counts for the modes, and tell where subcases differ.

    The first subcase that asks for modes counts, of complex ones if there are any. Loads and contact tables are those
    of its static state: of the subcase that STATSUB names, else its own, else those of the last one before it.
    """
    modal = [s for s in subcases if s.analysis in _MODAL]
    for command in ("CMETHOD", "METHOD"):
        modal = [s for s in modal or subcases if command in s.selected] or modal
    taken = (modal or subcases)[0]
    before = subcases[: subcases.index(taken) + 1]
    named = [s for s in before if s.name == f"SUBCASE {taken.selected.get('STATSUB', -1)}"]
    chosen = {command: {number} for command, number in taken.selected.items()}
    for command in _STATIC:
        given = [s.selected[command] for s in named or before if command in s.selected]
        if given:
            chosen[command] = {given[-1]}
    for command in ("SPC", "METHOD", "CMETHOD", *_STATIC):
        sets = {s.selected[command] for s in subcases if command in s.selected}
        if command == "SPC" and sets and command not in chosen:
            chosen[command] = sets
            text = f"{taken.name}, which the scene is made of, selects none, and others do: {_listed(sets)}, taken here"
            draft.find(command, "", text, "missing")
        elif len(sets) > 1:
            text = f"subcases select {_listed(sets)}; {_listed(chosen.get(command, set()))} counts for {taken.name}"
            draft.find(command, "", f"{text}, which the scene is made of")
    return chosen


def _listed(numbers: set[int]) -> str:
    return ", ".join(map(str, sorted(numbers))) or "none"
