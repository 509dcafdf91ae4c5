"""What an Abaqus input file holds, as it is written: parts, instances and the assembly."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...raw import Floats, Ints, check_unique_nodes
from .text import Block


@dataclass(frozen=True)
class Members:
    """One *NSET or *ELSET, not yet looked up: its entries, or with GENERATE its lines."""

    items: list[str]
    generate: bool
    instance: str


@dataclass(frozen=True)
class Cells:
    """The solid elements of one *ELEMENT block, nodes by number and in VTK's order."""

    kind: str
    labels: Ints
    nodes: Ints


@dataclass(frozen=True)
class Links:
    """The elements of one *ELEMENT block that are no solids but act between nodes: springs, dampers, masses.

    Attributes
    ----------
    kind
        Such as "SPRING2".
    nodes
        By element, as the deck writes them: numbers, or INSTANCE.number.
    """

    kind: str
    elset: str
    labels: list[str]
    nodes: list[list[str]]
    where: str


@dataclass(frozen=True)
class Statement:
    """A block that speaks of physics, not of the mesh, and the scope (part or instance, in capitals) it stands in."""

    block: Block
    scope: str


@dataclass
class Scope:
    """What a part, an instance or the assembly holds; a flat file is an assembly without instances."""

    name: str
    labels: list[Ints] = field(default_factory=list)
    points: list[Floats] = field(default_factory=list)
    cells: list[Cells] = field(default_factory=list)
    skins: list[Cells] = field(default_factory=list)  # shells and membranes: corners alone
    links: list[Links] = field(default_factory=list)
    others: list[int] = field(default_factory=list)  # numbers of elements that are no solids
    sets: dict[tuple[str, str], list[Members]] = field(default_factory=dict)
    surfaces: dict[str, list[Block]] = field(default_factory=dict)
    spelled: dict[tuple[str, str], str] = field(default_factory=dict)

    def remember(self, kind: str, name: str) -> str:
        """Keep the first spelling of a name and return the key that it is found by."""
        key = name.upper()
        self.spelled.setdefault((kind, key), name)
        return key


@dataclass(frozen=True)
class Instance:
    """A part put into the assembly: turned about an axis after it was moved."""

    name: str
    part: str
    place: tuple[tuple[float, ...], ...]
    scope: Scope
    where: str


@dataclass
class Model:
    """The whole file."""

    assembly: Scope = field(default_factory=lambda: Scope(""))
    parts: dict[str, Scope] = field(default_factory=dict)
    instances: dict[str, Instance] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    statements: list[Statement] = field(default_factory=list)


def nodes_of(scopes: tuple[Scope, ...], source: str) -> tuple[Ints, Floats]:
    """Return node numbers (n,) and coordinates (n, 3) of the scopes together."""
    labels = np.concatenate([np.empty(0, np.int64), *(part for scope in scopes for part in scope.labels)])
    points = np.concatenate([np.empty((0, 3)), *(part for scope in scopes for part in scope.points)])
    return check_unique_nodes(labels, points, source)
