"""Parse the mesh of Abaqus input files: parts, instances, sets, surfaces. meshio reads only files without parts.

The syntax is that of the Abaqus keywords manual (*NODE, *ELEMENT, *NSET, *ELSET, *SURFACE, *PART, *INSTANCE, *INCLUDE).
The rest of the file (materials, steps, boundary conditions) is kept for `fe_squeal.decks`.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from fe_squeal.errors import MeshError, suggest

from ..sources import Sources
from .elements import name_members, read_elements
from .model import DeckModel, Instance, Members, Scope, Statement
from .text import KeywordBlock, entries, numbers, read_blocks, whole_numbers

_MESH = {"PART", "INSTANCE", "END PART", "END INSTANCE", "ASSEMBLY", "END ASSEMBLY", "NODE", "ELEMENT", "NSET", "ELSET",
         "SURFACE", "HEADING", "PARAMETER"}  # fmt: skip
_FILLED = {"NODE", "ELEMENT", "NSET", "ELSET"}  # keywords that are an error without data lines, which must be lost
_REFUSED = {"NGEN", "NFILL", "NCOPY", "ELGEN", "ELCOPY", "NMAP", "SYSTEM"}


def parse_model(sources: Sources) -> DeckModel:
    """Return the file's parts, instances and assembly as they are written.

    Raises
    ------
    MeshError
        A keyword lacks its name or its data lines, generates nodes or elements, or has numbers that cannot be read; or
        two parts or two instances have one name.
    """
    source = sources.path.name
    model = DeckModel()
    scope = model.assembly
    promised: dict[str, KeywordBlock] = {}  # element sets that *SOLID SECTION names and that have to exist
    seen = False
    for block in read_blocks(sources):
        seen = True
        word = block.keyword
        if word not in _MESH:
            model.statements.append(Statement(block, scope.name.upper()))
        of_elements = word == "NSET" and block.value("ELSET")
        if word in _FILLED and not block.lines and not of_elements:
            raise MeshError(
                f"{source}: {block.where}: *{word} has no data lines; expected what it promises, or to be left out"
            )
        if word == "PART":
            scope = Scope(block.value("NAME"))
            _check_new(model.parts, scope.name, block, source)
            model.parts[scope.name.upper()] = scope
        elif word == "INSTANCE":
            scope = Scope(block.value("NAME"))
            if block.value("LIBRARY") or block.value("INSTANCE"):
                raise MeshError(
                    f"{source}: {block.where}: an instance imported from another analysis cannot be read; "
                    "write the part into this file"
                )
            _check_new(model.instances, scope.name, block, source)
            model.instances[scope.name.upper()] = Instance(
                scope.name, block.value("PART"), _placement(block, source), scope, block.where
            )
        elif word in ("END PART", "END INSTANCE", "ASSEMBLY", "END ASSEMBLY"):
            scope = model.assembly
        elif word == "NODE":
            _read_nodes(block, scope, source)
        elif word == "ELEMENT":
            name, count = read_elements(block, scope, source)
            if name:
                before, where = model.left_out.get(name, (0, block.where))
                model.left_out[name] = before + count, where
        elif word in ("NSET", "ELSET"):
            name = block.value(word)
            if not name:
                raise MeshError(f"{source}: {block.where}: *{word} without a name; expected {word}=name")
            generate = "GENERATE" in block.parameters
            items = block.lines if generate else [item for line in block.lines for item in entries(line)]
            blocks = scope.sets.setdefault((word, scope.remember(word, name)), [])
            if of_elements:
                blocks.append(Members([of_elements], False, block.value("INSTANCE"), of_elements=True))
            if items:
                blocks.append(Members(items, generate, block.value("INSTANCE")))
        elif word == "SURFACE":
            name = block.value("NAME")
            if not name:
                raise MeshError(f"{source}: {block.where}: *SURFACE without a name; expected NAME=name")
            scope.surfaces.setdefault(scope.remember("SURFACE", name), []).append(block)
        elif word == "SOLID SECTION":
            promised[block.value("ELSET").upper()] = block
        elif word in _REFUSED and (block.lines or word != "SYSTEM"):
            raise MeshError(
                f"{source}: {block.where}: *{word} is not read; write out all nodes and elements in global coordinates"
            )
    scopes = (model.assembly, *model.parts.values(), *(item.scope for item in model.instances.values()))
    known = {key: text for each in scopes for (kind, key), text in each.spelled.items() if kind == "ELSET"}
    for name, block in promised.items():
        if name and name not in known and name.rpartition(".")[2] not in known:
            raise MeshError(
                f'{source}: {block.where}: *SOLID SECTION is of element set "{block.value("ELSET")}", which has no'
                f" elements in this deck{suggest(name, known.values())}"
            )
    if not seen:
        raise MeshError(f"{source}: no Abaqus keywords (lines that begin with *); expected an Abaqus input file")
    model.notes += [
        f"{count} elements of type {name} are no solids and no part of the mesh"
        for name, (count, _) in model.left_out.items()
    ]
    return model


def _check_new(known: Collection[str], name: str, block: KeywordBlock, source: str) -> None:
    if name.upper() in known:
        raise MeshError(
            f'{source}: {block.where}: *{block.keyword} "{name}" is defined more than once; give each a name of its own'
        )


def _placement(block: KeywordBlock, source: str) -> tuple[tuple[float, ...], ...]:
    rows = [tuple(numbers(block, source, [line])[0].tolist()) for line in block.lines]
    if (
        len(rows) > 2
        or any(len(row) > n for row, n in zip(rows, (3, 7), strict=False))
        or (len(rows) == 2 and len(rows[1]) != 7)
    ):
        raise MeshError(
            f"{source}: {block.where}: an instance takes a line of 3 numbers (translation) and one of 7 (two points of "
            "the axis and the angle in degrees)"
        )
    return tuple((row + (0.0,) * 3)[:3] if i == 0 else row for i, row in enumerate(rows))


def _read_nodes(block: KeywordBlock, scope: Scope, source: str) -> None:
    values, ends = numbers(block, source)
    width = np.diff(ends, prepend=0)
    if (width < 2).any() and len(width):
        row = int(np.flatnonzero(width < 2)[0])
        raise MeshError(f'{source}: {block.where}: the node line "{block.shown(block.lines[row])}" has no coordinates')
    starts = ends - width
    labels = whole_numbers(values[starts], "node numbers", block, source)
    points = np.zeros((len(starts), 3))
    for j in range(3):  # Abaqus allows coordinates at the end of the line to be left out: they are zero
        has = width > j + 1
        points[has, j] = values[starts[has] + j + 1]
    system = block.value("SYSTEM").upper()
    if system == "C":
        angle = np.deg2rad(points[:, 1])
        points = np.column_stack([points[:, 0] * np.cos(angle), points[:, 0] * np.sin(angle), points[:, 2]])
    elif system not in ("", "R"):
        raise MeshError(f"{source}: {block.where}: SYSTEM={system} is not read; write the nodes in global coordinates")
    scope.labels.append(labels)
    scope.points.append(points)
    name_members("NSET", block, scope, labels)
