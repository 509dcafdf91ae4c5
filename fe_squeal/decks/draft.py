"""A scene in the making: its tables with comments, and what the deck says besides."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from .units import SI, Units

Value = str | float | int | bool | Sequence["Value"] | dict[str, "Value"]
Weight = Literal["missing", "changes", "harmless"]
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_WIDTH = 116
# Of steel in SI: what is suggested of a material that a deck does not give, with the unit.
_STEEL = {"youngs_modulus": (2.1e11, "Pa"), "poisson_ratio": (0.3, ""), "density": (7800.0, "kg/m^3")}


@dataclass(frozen=True)
class Finding:
    """Something in a deck that is not taken over, or not as it stands.

    Attributes
    ----------
    what : str
        Such as "*Equation".
    where : str
        File and line of the first one, "" where it has none.
    text : str
        What it means for the answer, and what to do.
    weight : "missing", "changes" or "harmless"
        Whether a scene without it is no model of the deck's structure, answers somewhat else, or is the same.
    """

    what: str
    where: str
    text: str
    weight: Weight

    def __str__(self) -> str:
        place = f" at {self.where}" if self.where else ""
        return f"{self.what}{place}: {self.text}"


@dataclass
class Table:
    """A table of the scene.

    Attributes
    ----------
    path : tuple of str
        Such as ("materials", "steel").
    values : dict
    is_entry : bool
        Whether it is one of a list, written [[...]].
    comments : list of str
        Lines above it.
    open : list of (str, str)
        Keys that the user has to give: a suggestion, written as a comment line, and what it says.
    notes : dict of key to str
        Comments behind a key.
    """

    path: tuple[str, ...]
    values: dict[str, Value] = field(default_factory=dict)
    is_entry: bool = False
    comments: list[str] = field(default_factory=list)
    open: list[tuple[str, str]] = field(default_factory=list)
    notes: dict[str, str] = field(default_factory=dict)


@dataclass
class Draft:
    """The tables of a scene in their order, what was found, and what is missing for a run.

    Attributes
    ----------
    units : str
        The scene's key.
    suggested_in : Units
        Those of the numbers that are suggested: where the deck's numbers are left as they are, what they seem to be in.
    """

    title: str
    units: str = "SI"
    suggested_in: Units = SI
    head: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    tail: list[str] = field(default_factory=list)

    def add(self, *path: str, is_entry: bool = False, values: Mapping[str, Value] | None = None) -> Table:
        """Append a table and return it."""
        table = Table(path, dict(values or {}), is_entry)
        self.tables.append(table)
        return table

    def ask(self, table: Table, key: str, text: str) -> None:
        """Ask for a number of a material, with that of steel as a suggestion."""
        value, unit = _STEEL[key]
        units = self.suggested_in
        shown = value / {"youngs_modulus": units.pressure, "density": units.density}.get(key, 1.0)
        if unit and units is not SI:
            text += f"; as the other numbers are, in {units.name}, steel has {shown:.4g}, which is {value:g} {unit}"
        elif unit:
            text += f", {unit}"
        table.open.append((f"{key} = {toml(float(f'{shown:.6g}'))}", text))

    def find(self, what: str, where: str, text: str, weight: Weight = "changes") -> None:
        """Note something that is not taken over; once each."""
        if all((f.what, f.text) != (what, text) for f in self.findings):
            self.findings.append(Finding(what, where, text, weight))

    def add_sweep(self, mu: float, what: str) -> None:
        """Add a sweep of the friction coefficient from 0 to that of the file, "deck" or "archive"."""
        table = self.add("sweep", values={"parameter": "mu", "from": 0.0, "to": mu, "points": 21})
        table.comments.append(f"Not of the {what}, which has one coefficient: the way up to it shows the onsets.")

    def tell_damping_of_all(self, what: str, where: str, of_mass: bool) -> None:
        """Note that a factor of the whole mass or stiffness, which damps all of it there, is one of the bodies here."""
        if of_mass and any("mass" in t.values for t in self.tables):
            self.find(what, where, "damps point masses too, which is not simulated: here it damps the bodies alone")
        elif not of_mass and any(t.path[0] in ("contacts", "springs") or "springs" in t.values for t in self.tables):
            text = "damps contacts and springs too, which is not simulated: here it damps the bodies alone"
            self.find(what, where, text)

    @property
    def missing(self) -> list[str]:
        """What has to be given before the scene can run, a sentence each."""
        asked = [f"{_dotted(t)}: {text}" for t in self.tables for _, text in t.open]
        return asked + [str(f) for f in self.findings if f.weight == "missing"]

    @property
    def told(self) -> list[str]:
        """What a command says about the deck: its units, and what changes the answer."""
        return [*self.head[1:], *(f"not taken over: {f}" for f in self.findings if f.weight == "changes")]

    def text(self) -> str:
        """Return the scene as TOML with comments."""
        lines = [*_comments(self.head), f"title = {toml(self.title)}"]
        if self.units != "SI":
            lines.append(f"units = {toml(self.units)}")
        needed = [str(f) for f in self.findings if f.weight == "missing"]
        if needed:
            lines += ["", *_comments(["The scene does not run before each of these is settled, and removed here:"])]
            lines += ["unsettled = [", *(f"    {toml(text)}," for text in needed), "]"]
        for table in self.tables:
            brackets = ("[[", "]]") if table.is_entry else ("[", "]")
            name = ".".join(part if _BARE.fullmatch(part) else toml(part) for part in table.path)
            lines += ["", *_comments(table.comments), f"{brackets[0]}{name}{brackets[1]}"]
            for key, value in table.values.items():
                note = f"  # {one_comment(table.notes[key])}" if key in table.notes else ""
                bare = key if _BARE.fullmatch(key) else toml(key)
                lines.append(f"{bare} = {toml(value)}{note}")
            for suggestion, text in table.open:
                lines += [*_comments([f"TO BE GIVEN: {text}"]), f"# {one_comment(suggestion)}"]
        lines += ["", *(f"# {one_comment(line)}".rstrip() for line in self.tail)] if self.tail else []
        titles: dict[Weight, str] = {"changes": "Not taken over, or not as it stands:",
                  "harmless": "Passed over without a change of the answer:"}  # fmt: skip
        for weight, title in titles.items():
            found = [f for f in self.findings if f.weight == weight]
            if found:
                lines += ["", f"# {title}"]
                for finding in found:
                    lines += _comments([f"- {finding}"], indent="  ")
        return "\n".join(lines) + "\n"


def toml(value: Value) -> str:
    """Return a value as TOML.

    Examples
    --------
    >>> toml({"axis": [0.0, 0.0, 1.0], "speed": 5.0, 'a "b"': "x\\ty"})
    '{ axis = [0.0, 0.0, 1.0], speed = 5.0, "a \\\\"b\\\\"" = "x\\\\ty" }'
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, int):
        return str(value)
    if isinstance(value, dict):
        items = (f"{k if _BARE.fullmatch(k) else toml(k)} = {toml(v)}" for k, v in value.items())
        return "{ " + ", ".join(items) + " }"
    return f"[{', '.join(toml(v) for v in value)}]"


def one_comment(text: str) -> str:
    """Return a text without the control characters that TOML's comments must not have."""
    return "".join(c if c.isprintable() else " " for c in text)


def _comments(texts: Iterable[str], indent: str = "") -> list[str]:
    """Return comment lines, broken between words."""
    lines = []
    for text in texts:
        line = ""
        for word in one_comment(text).split(" "):
            if line and len(line) + len(word) + 1 > _WIDTH:
                lines.append(f"# {line}".rstrip())
                line = indent
            line = f"{line} {word}" if line.strip() else f"{line}{word}"
        lines.append(f"# {line}".rstrip())
    return lines


def _dotted(table: Table) -> str:
    name = ".".join(table.path)
    own = table.values.get("name")
    return f"{name}.{own}" if table.is_entry and isinstance(own, str) else name


def plain_name(text: str, taken: Iterable[str] = ()) -> str:
    """Return a name that can stand in a path of the scene: letters, digits, _ and -, and none that is taken.

    Examples
    --------
    >>> plain_name("PAD-1.Set 2"), plain_name("a.b", ["a_b"])
    ('PAD-1_Set_2', 'a_b_2')
    """
    name = re.sub(r"[^\w-]+", "_", text).strip("_") or "unnamed"
    known, i, found = set(taken), 1, name
    while found in known:
        i += 1
        found = f"{name}_{i}"
    return found
