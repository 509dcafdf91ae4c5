"""Sets and surfaces of an Abaqus model, looked up by name over all instances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fe_squeal.errors import MeshError, suggest

from ...raw import CellBlock, Ints, Rows
from .model import Members, Scope
from .text import LARGEST, entries, is_label, label_of

Lines = tuple[str, list[tuple[Ints, str]]]  # the type of a surface, and what it has of each set, with a label
_ROW = {"NSET": "nodes", "ELSET": "elements"}


@dataclass(frozen=True)
class Located:
    """An instance (or the assembly itself), and the positions of its nodes and elements in the whole mesh."""

    name: str
    scopes: tuple[Scope, ...]
    # Under "NSET" those of the nodes, under "ELSET" those of the elements: numbers in the file, and positions in the
    # mesh. Shell number k has the position -2 - k, and elements that are neither solids nor shells have -1.
    labels: dict[str, Ints]
    rows: dict[str, Ints]
    part: str = ""

    def sets(self, word: str, name: str) -> list[Members]:
        """Return the *NSET (word "NSET") or *ELSET blocks with a name."""
        return [member for scope in self.scopes for member in scope.sets.get((word, name.upper()), [])]

    def names(self, word: str) -> dict[str, str]:
        """Return the names of all sets of nodes (word "NSET") or elements ("ELSET") as spelled, by their keys."""
        return {key: text for scope in self.scopes for (kind, key), text in scope.spelled.items() if kind == word}


class ModelSets:
    """Looks up sets and surfaces by name over all instances."""

    def __init__(
        self, source: str, own: Located, instances: dict[str, Located], skins: Ints, blocks: tuple[CellBlock, ...]
    ) -> None:
        self.source, self.own, self.instances, self.skins, self.blocks = source, own, instances, skins, blocks
        self._found: dict[tuple[str, str], Rows] = {}  # by instance, and "NSET" or "ELSET"

    def skin_of(self, rows: Ints) -> list[Ints]:
        """Return the corners (f, 3) and (f, 4) of the shells among positions (n,) of elements, see `Located.rows`."""
        corners = self.skins[-2 - rows[rows <= -2]]
        three = corners[:, 3] < 0
        return [corners[three][:, :3], corners[~three]]

    def members(self, word: str, placed: Located, name: str, path: tuple[tuple[str, str], ...] = ()) -> Ints:
        """Return the positions (n,) of the members of a set of nodes (word "NSET") or elements ("ELSET").

        Raises
        ------
        MeshError
            A set, instance or number does not exist, or a set contains itself.
        """
        own = placed.name, name.upper()
        if own in path:
            raise MeshError(f'{self.source}: set "{name}" contains itself')
        parts = [np.empty(0, np.int64)]
        for member in placed.sets(word, name):
            home = self._instance(member.instance, f'set "{name}"') if member.instance else placed
            if member.of_elements:
                parts += [self._nodes_of(home, item, name) for item in member.items]
                continue
            if member.generate:
                parts.append(self._rows(word, home, _generated(member.items, name, self.source), name, strict=False))
                continue
            numbers = [label_of(item) for item in member.items if is_label(item)]
            parts.append(self._rows(word, home, np.array(numbers, dtype=np.int64), name))
            for item in member.items:
                if not is_label(item):
                    parts.append(self.find(word, home, item, f'set "{name}"', (*path, own)))
        return np.unique(np.concatenate(parts))

    def find(
        self, word: str, placed: Located, text: str, user: str, path: tuple[tuple[str, str], ...] = ()
    ) -> Ints:
        """Return the positions (n,) of what a reference means: a number, a set, INSTANCE.SET or INSTANCE.number.

        Raises
        ------
        MeshError
            It does not exist, or is a set that contains itself.
        """
        if is_label(text):
            return self._rows(word, placed, np.array([label_of(text)]), user)
        if placed.sets(word, text):
            return self.members(word, placed, text, path)
        inside = self._inside(text)
        if inside is not None:
            return self.find(word, *inside, user, path)
        what = "node set" if word == "NSET" else "element set"
        raise MeshError(
            f'{self.source}: {user} refers to {what} "{text}", which does not exist'
            + suggest(text, placed.names(word).values())
        )

    def surface(self, placed: Located, name: str, path: tuple[tuple[str, str], ...] = ()) -> Lines:
        """Return the type of a surface, and for each of its lines the members and the label of the face.

        The type is "ELEMENT" or "NODE", or the parameter that is not read, such as "COMBINE=DIFFERENCE". The label is
        "S1" ... "S6", or "" for all free faces.

        Raises
        ------
        MeshError
            A set or surface does not exist, is a union of itself, or one of surfaces of both types.
        """
        user, kind, out, own = f'surface "{name}"', "ELEMENT", list[tuple[Ints, str]](), (placed.name, name.upper())
        if own in path:
            raise MeshError(f"{self.source}: {user} is a union of itself")
        for block in [b for scope in placed.scopes for b in scope.surfaces.get(name.upper(), [])]:
            combine = block.value("COMBINE").upper()
            if combine == "UNION":
                kind, lines = self._union(placed, [t for line in block.lines for t in entries(line)], (*path, own))
                out += lines
                continue
            kind = block.value("TYPE").upper() or "ELEMENT"
            if combine or "CROP" in block.parameters:
                return f"COMBINE={combine}" if combine else "CROP", []
            if kind not in ("ELEMENT", "NODE"):
                return f"TYPE={kind}", []
            word = "NSET" if kind == "NODE" else "ELSET"
            numbers: dict[str, list[int]] = {}  # by label: some programs write a line for each element
            for line in block.lines:
                fields = entries(line)
                if fields:
                    label = fields[1].upper() if len(fields) > 1 and kind != "NODE" else ""
                    if is_label(fields[0]):
                        numbers.setdefault(label, []).append(label_of(fields[0]))
                    else:
                        out.append((self.find(word, placed, fields[0], user), label))
            for label, own_numbers in numbers.items():
                out.append((self._rows(word, placed, np.array(own_numbers, dtype=np.int64), user), label))
        return kind, out

    def is_of_nodes(self, placed: Located, text: str) -> bool:
        """Return whether a reference, NAME or INSTANCE.NAME, is a surface of the type "NODE".

        Raises
        ------
        MeshError
            See `surface`.
        """
        inside = self._of_surface(placed, text)
        return inside is not None and self.surface(*inside)[0] == "NODE"

    def _of_surface(self, placed: Located, text: str) -> tuple[Located, str] | None:
        """Return the instance and the name of the surface that a reference means, None where there is none."""
        inside = (placed, text) if text.upper() in placed.names("SURFACE") else self._inside(text)
        return None if inside is None or inside[1].upper() not in inside[0].names("SURFACE") else inside

    def _union(self, placed: Located, names: list[str], path: tuple[tuple[str, str], ...]) -> Lines:
        """Return the type and the lines of some surfaces together; the type that is not read, where one is of such."""
        user, kinds, out = f'surface "{path[-1][1]}"', list[str](), list[tuple[Ints, str]]()
        for text in names:
            inside = self._of_surface(placed, text)
            if inside is None:
                known = placed.names("SURFACE").values()
                raise MeshError(
                    f'{self.source}: {user} is a union of surface "{text}", which does not exist{suggest(text, known)}'
                )
            kind, lines = self.surface(*inside, path)
            if kind not in ("ELEMENT", "NODE"):
                return kind, []
            kinds.append(kind)
            out += lines
        if len(set(kinds)) != 1:
            what = "surfaces of elements and of nodes" if kinds else "nothing"
            raise MeshError(f"{self.source}: {user} is a union of {what}; expected the names of surfaces of one type")
        return kinds[0], out

    def _inside(self, text: str) -> tuple[Located, str] | None:
        """Return the instance and the name of INSTANCE.NAME, None where there is no such instance."""
        head, dot, tail = text.partition(".")
        while dot:
            if head.upper() in self.instances:
                return self.instances[head.upper()], tail
            more, dot, tail = tail.partition(".")
            head = f"{head}.{more}"
        return None

    def _instance(self, name: str, user: str) -> Located:
        if name.upper() not in self.instances:
            raise MeshError(
                f'{self.source}: {user} refers to instance "{name}", which does not exist'
                + suggest(name, [p.name for p in self.instances.values()])
            )
        return self.instances[name.upper()]

    def _nodes_of(self, placed: Located, elements: str, name: str) -> Ints:
        """Return the positions (n,) of the nodes of an element set, all of which have to be solids."""
        rows = self.find("ELSET", placed, elements, f'set "{name}"')
        if (rows < 0).any() or not len(rows):
            raise MeshError(
                f'{self.source}: node set "{name}" is of the nodes of element set "{elements}", which has elements that'
                " are no solids; expected solids alone, or the numbers of the nodes"
            )
        found, first = [np.empty(0, np.int64)], 0
        for block in self.blocks:
            inside = rows[(rows >= first) & (rows < first + len(block))] - first
            found.append(block.nodes[inside].ravel())
            first += len(block)
        nodes = np.unique(np.concatenate(found))
        return nodes[nodes >= 0]

    def _rows(self, word: str, placed: Located, wanted: Ints, name: str, strict: bool = True) -> Ints:
        key = placed.name, word
        if key not in self._found:
            self._found[key] = Rows(placed.labels[word])
        found = self._found[key](wanted)
        if strict and (found < 0).any():
            where = f' of "{placed.name}"' if placed.name else ""
            raise MeshError(
                f'{self.source}: "{name}" refers to number {wanted[found < 0][0]}, '
                f"which is none of the {_ROW[word]}{where}"
            )
        return placed.rows[word][found[found >= 0]]


def _generated(lines: list[str], name: str, source: str) -> Ints:
    parts = [np.empty(0, np.int64)]
    for line in lines:
        try:
            first, last, step = ([int(item) for item in entries(line)] + [1])[:3]
            if step <= 0 or not -LARGEST < first <= last < LARGEST or (last - first) // step > 10**8:
                raise ValueError
        except ValueError:
            raise MeshError(
                f'{source}: set "{name}": GENERATE takes first, last and step, whole numbers with first <= last and '
                f'step > 0; given "{line[:60]}"'
            ) from None
        parts.append(np.arange(first, last + 1, step))
    return np.concatenate(parts)
