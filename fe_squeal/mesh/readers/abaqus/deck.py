"""Parse the mesh of Abaqus input files: parts, instances, sets, surfaces. meshio reads only files without parts.

The syntax is that of the Abaqus keywords manual (*NODE, *ELEMENT, *NSET, *ELSET, *SURFACE, *PART, *INSTANCE, *INCLUDE).
The rest of the file (materials, steps, boundary conditions) is kept for `fe_squeal.decks`.
"""

from __future__ import annotations

import re

import numpy as np

from fe_squeal.errors import MeshError, suggest

from ...raw import Floats, Ints
from ..sources import Sources
from .model import DeckModel, ElementBlock, Instance, Links, Members, Scope, Statement
from .text import KeywordBlock, entries, is_label, label_of, numbers, read_blocks

# Kind of a solid by the first letters of its Abaqus type. The first entry that fits counts, so longer ones stand first.
_TYPES = (("C3D10", "tetra10"), ("C3D15", "wedge15"), ("C3D20", "hexahedron20"), ("C3D27", "hexahedron27"),
          ("C3D4", "tetra"), ("C3D5", "pyramid"), ("C3D6", "wedge"), ("C3D8", "hexahedron"),
          ("DC3D10", "tetra10"), ("DC3D20", "hexahedron20"), ("DC3D4", "tetra"), ("DC3D8", "hexahedron"))  # fmt: skip
_COUNT = {"tetra": 4, "tetra10": 10, "pyramid": 5, "wedge": 6, "wedge15": 15, "hexahedron": 8, "hexahedron20": 20,
          "hexahedron27": 27}  # fmt: skip
# Abaqus puts the 27-node brick's centre first and the face centres in the order of its faces S1 ... S6.
_HEX27 = [*range(20), 26, 24, 23, 25, 21, 22, 20]
_SKIN = re.compile(r"(?:STRI|CPS|CPE|SFM3D|M3D|R3D|DS|S)(65|[34689])")
_LINKS = ("SPRING", "DASHPOT", "MASS", "ROTARYI", "DCOUP3D")  # which `decks` reads: no part of the mesh, but not lost
_MESH = {"PART", "INSTANCE", "END PART", "END INSTANCE", "ASSEMBLY", "END ASSEMBLY", "NODE", "ELEMENT", "NSET", "ELSET",
         "SURFACE", "HEADING", "PARAMETER"}  # fmt: skip
_FILLED = {"NODE", "ELEMENT", "NSET", "ELSET"}  # keywords that are an error without data lines, which must be lost
_REFUSED = {"NGEN", "NFILL", "NCOPY", "ELGEN", "ELCOPY", "NMAP", "SYSTEM"}


def parse_model(sources: Sources) -> DeckModel:
    """Return the file's parts, instances and assembly as they are written.

    Raises
    ------
    MeshError
        A keyword lacks its name or its data lines, generates nodes or elements, or has numbers that cannot be read.
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
            model.parts[scope.name.upper()] = scope
        elif word == "INSTANCE":
            scope = Scope(block.value("NAME"))
            if block.value("LIBRARY") or block.value("INSTANCE"):
                raise MeshError(
                    f"{source}: {block.where}: an instance imported from another analysis cannot be read; "
                    "write the part into this file"
                )
            model.instances[scope.name.upper()] = Instance(
                scope.name, block.value("PART"), _placement(block, source), scope, block.where
            )
        elif word in ("END PART", "END INSTANCE", "ASSEMBLY", "END ASSEMBLY"):
            scope = model.assembly
        elif word == "NODE":
            _read_nodes(block, scope, source)
        elif word == "ELEMENT":
            name, count = _read_elements(block, scope, source)
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
    labels = _whole(values[starts], "node numbers", block, source)
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
    _name_members("NSET", block, scope, labels)


def _read_elements(block: KeywordBlock, scope: Scope, source: str) -> tuple[str, int]:
    """Add the block's elements to the scope; of elements that are left out return type and number, else ("", 0)."""
    given = block.value("TYPE").upper()
    kind = next((kind for start, kind in _TYPES if given.startswith(start)), "")
    if not kind:
        labels = [entries(line)[0] for line in block.lines if entries(line)]
        whole = [label_of(text) for text in labels if is_label(text)]
        scope.others += whole
        if given.startswith(_LINKS):
            fields = [row for row in map(entries, block.lines) if row]
            first, rest = [row[0] for row in fields], [row[1:] for row in fields]
            scope.links.append(Links(given, block.value("ELSET"), first, rest, block.where))
        _read_skin(given, block, scope)
        _name_members("ELSET", block, scope, np.array(whole, dtype=np.int64))
        return ("", 0) if given.startswith(_LINKS) else (given or "(none)", len(whole))
    values, ends = numbers(block, source)
    count = _COUNT[kind]
    if kind == "hexahedron27" and not _fits(values, ends, 28) and _fits(values, ends, 22):
        kind, count = "hexahedron20", 21
    if not _fits(values, ends, count + 1):
        raise MeshError(
            f"{source}: {block.where}: elements of type {given} need a number and {count} nodes each; "
            + _misfit(block, ends, count + 1)
        )
    table = _whole(values, "element and node numbers", block, source).reshape(-1, count + 1)
    nodes = table[:, 1:]
    if kind == "hexahedron27":
        nodes = nodes[:, _HEX27]
    scope.cells.append(ElementBlock(kind, table[:, 0], nodes[:, :20] if kind == "hexahedron20" else nodes))
    _name_members("ELSET", block, scope, table[:, 0])
    return "", 0


def _read_skin(given: str, block: KeywordBlock, scope: Scope) -> None:
    """Keep the corners of shells. Where they lie on faces of solids, as Gmsh exports them, they make surface groups."""
    found = _SKIN.match(given)
    if not found:
        return
    corners = 3 if found[1] in ("3", "6", "65") else 4
    rows = [row[: 1 + corners] for row in map(entries, block.lines) if len(row) > corners]
    rows = [row for row in rows if all(is_label(text) and len(text) < 18 and text[0] != "-" for text in row)]
    if rows:
        table = np.array(rows, dtype=np.int64)
        scope.skins.append(ElementBlock("triangle" if corners == 3 else "quad", table[:, 0], table[:, 1:]))


def _fits(values: Floats, ends: Ints, width: int) -> bool:
    """Return whether the numbers of a block make elements of `width` numbers each, all ending at the end of a line.

    Parameters
    ----------
    values : (n,) float
        All numbers of the block.
    ends : (l,) int
        How many numbers stand up to the end of each data line.
    width : int
    """
    whole = np.arange(width, len(values) + 1, width)
    return len(values) % width == 0 and bool(np.isin(whole, ends).all())


def _misfit(block: KeywordBlock, ends: Ints, width: int) -> str:
    whole = np.arange(width, ends[-1] + width, width) if len(ends) else np.empty(0, np.int64)
    wrong = whole[~np.isin(whole, ends)]
    row = int(np.searchsorted(ends, wrong[0])) if len(wrong) else len(ends) - 1
    shown = block.shown(block.lines[min(row, len(block.lines) - 1)])
    return f'see the data line "{shown}"'


def _name_members(word: str, block: KeywordBlock, scope: Scope, labels: Ints) -> None:
    name = block.value(word)
    if name:
        scope.sets.setdefault((word, scope.remember(word, name)), []).append(
            Members([str(v) for v in labels.tolist()], False, "")
        )


def _whole(values: Floats, what: str, block: KeywordBlock, source: str) -> Ints:
    if len(values) and not (
        np.isfinite(values).all() and (values == np.floor(values)).all() and (np.abs(values) < 2**53).all()
    ):
        raise MeshError(f"{source}: {block.where}: {what} must be whole numbers")
    return values.astype(np.int64)


