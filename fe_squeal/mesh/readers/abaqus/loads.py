"""Make surfaces of the faces that *DLOAD names by element, so that a scene can put a pressure on them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from .model import DeckModel, Scope, Statement
from .text import KeywordBlock, entries, is_label


@dataclass
class LoadedFaces:
    """The faces that one pressure of *DLOAD acts on.

    Attributes
    ----------
    statement : Statement
        The *DLOAD.
    name : str
        Name of the surface. For face P3 of an element set SET it is DLOAD_SET_P3; for single elements of the second
        *DLOAD of the deck, under the first of its pressures, it is DLOAD_2_1.
    pressure : str
        As the deck writes it.
    lines : list of str
        The data lines that *SURFACE would have for these faces.
    """

    statement: Statement
    name: str
    pressure: str
    lines: list[str]


def loaded_faces(model: DeckModel) -> Iterator[LoadedFaces]:
    """Yield the faces under loads P1 ... P6 of every *DLOAD; other kinds of loads have no faces."""
    statements = [s for s in model.statements if s.block.keyword == "DLOAD"]
    for i, statement in enumerate(statements, 1):
        single: dict[str, LoadedFaces] = {}
        for line in statement.block.lines:
            fields = entries(line)
            kind = fields[1].upper() if len(fields) > 2 else ""
            if len(kind) != 2 or kind[0] != "P" or kind[1] not in "123456":
                continue
            row, pressure = f"{fields[0]}, S{kind[1]}", fields[2]
            if not is_label(fields[0]):
                yield LoadedFaces(statement, f"DLOAD_{fields[0]}_{kind}", pressure, [row])
                continue
            name = f"DLOAD_{i}_{len(single) + 1}"
            single.setdefault(pressure, LoadedFaces(statement, name, pressure, [])).lines.append(row)
        yield from single.values()


def add_loaded_faces(model: DeckModel) -> None:
    """Add a surface to the model for the faces of each load."""
    seen: set[tuple[str, str]] = set()
    for faces in loaded_faces(model):
        scope = _scope(model, faces.statement.scope)
        if (faces.statement.scope, faces.name) not in seen:  # a later step may load the same faces again
            block = KeywordBlock("SURFACE", {"NAME": faces.name}, faces.lines, faces.statement.block.where)
            scope.surfaces.setdefault(scope.remember("SURFACE", faces.name), []).append(block)
        seen.add((faces.statement.scope, faces.name))


def _scope(model: DeckModel, key: str) -> Scope:
    if key in model.parts:
        return model.parts[key]
    return model.instances[key].scope if key in model.instances else model.assembly
