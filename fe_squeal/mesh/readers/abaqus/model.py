"""The content of an Abaqus input file as it is written: parts, instances and the assembly."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...raw import Floats, Ints, check_unique_nodes
from .text import KeywordBlock


@dataclass(frozen=True)
class Members:
    """One *NSET or *ELSET as it is written: its entries (numbers and names), or with GENERATE its data lines.

    With `of_elements` it is a *NSET of all nodes of element sets.
    """

    items: list[str]
    generate: bool
    instance: str
    of_elements: bool = False


@dataclass(frozen=True)
class ElementBlock:
    """The solid elements of one *ELEMENT block: numbers (n,), and numbers of their nodes (n, k) in VTK's order."""

    kind: str
    labels: Ints
    nodes: Ints


@dataclass(frozen=True)
class Links:
    """The springs, dampers or masses of one *ELEMENT block, or its distributing couplings of old decks.

    Attributes
    ----------
    kind : str
        The Abaqus type, such as "SPRING2".
    elset : str
        The element set that the block names.
    labels : list of str
        Numbers of the elements.
    nodes : list of list of str
        The nodes of each element, as the deck writes them: numbers, or INSTANCE.number.
    where : str
        File and line, for messages.
    """

    kind: str
    elset: str
    labels: list[str]
    nodes: list[list[str]]
    where: str


@dataclass(frozen=True)
class Statement:
    """A keyword block that is not part of the mesh (material, step, ...), and the part or instance it stands in."""

    block: KeywordBlock
    scope: str


@dataclass
class Scope:
    """Nodes, elements, sets and surfaces of a part, an instance or the assembly.

    A file without parts is an assembly without instances.
    """

    name: str
    labels: list[Ints] = field(default_factory=list)
    points: list[Floats] = field(default_factory=list)
    cells: list[ElementBlock] = field(default_factory=list)
    skins: list[ElementBlock] = field(default_factory=list)  # shells and membranes, with their corner nodes alone
    links: list[Links] = field(default_factory=list)
    others: list[int] = field(default_factory=list)  # numbers of all elements that are neither solids nor shells
    sets: dict[tuple[str, str], list[Members]] = field(default_factory=dict)
    surfaces: dict[str, list[KeywordBlock]] = field(default_factory=dict)
    spelled: dict[tuple[str, str], str] = field(default_factory=dict)

    def remember(self, kind: str, name: str) -> str:
        """Keep the first spelling of a name and return the key that it is found by."""
        key = name.upper()
        self.spelled.setdefault((kind, key), name)
        return key


@dataclass(frozen=True)
class Instance:
    """An *INSTANCE: a part that is put into the assembly, moved and then rotated by the numbers of `place`."""

    name: str
    part: str
    place: tuple[tuple[float, ...], ...]
    scope: Scope
    where: str


@dataclass
class DeckModel:
    """The content of a whole Abaqus file."""

    assembly: Scope = field(default_factory=lambda: Scope(""))
    parts: dict[str, Scope] = field(default_factory=dict)
    instances: dict[str, Instance] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    left_out: dict[str, tuple[int, str]] = field(default_factory=dict)  # number and first place of elements, by type
    statements: list[Statement] = field(default_factory=list)


def nodes_of(scopes: tuple[Scope, ...], source: str) -> tuple[Ints, Floats]:
    """Return the numbers (n,) and coordinates (n, 3) of the nodes of some scopes together."""
    labels = np.concatenate([np.empty(0, np.int64), *(part for scope in scopes for part in scope.labels)])
    points = np.concatenate([np.empty((0, 3)), *(part for scope in scopes for part in scope.points)])
    return check_unique_nodes(labels, points, source)
