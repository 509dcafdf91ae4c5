"""What an Abaqus deck says of physics, statement by statement, before it becomes tables of a scene."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...errors import MeshError
from ...mesh import LoadedMesh
from ...mesh.raw import RawMesh
from ...mesh.readers.abaqus.assembly import moved
from ...mesh.readers.abaqus.model import DeckModel, Statement
from ...mesh.readers.abaqus.sets import ModelSets
from ...mesh.readers.abaqus.text import KeywordBlock, unquoted
from ..draft import Draft, Value
from ..units import SI, Units
from .friction_laws import FrictionLaw

Reference = tuple[str, str]  # a name or number as the deck writes it, and the scope that it stands in
_SHORT_EXPONENT = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))([+-]\d+)")


@dataclass
class Substance:
    """One *Material: numbers in the deck's units."""

    name: str
    where: str
    elastic: dict[str, list[float]] = field(default_factory=dict)  # youngs_modulus, poisson_ratio, shear_modulus
    density: float | None = None
    alpha: float = 0.0
    beta: float = 0.0
    structural: float = 0.0


@dataclass
class Interaction:
    """One *Surface Interaction: its friction and its pressure over overclosure."""

    name: str
    where: str
    mu: float | None = None
    rough: bool = False
    law: FrictionLaw | None = None  # over the sliding speed; mu is then the coefficient at rest
    law_where: str = ""
    first: tuple[float | None, bool, FrictionLaw | None] | None = None  # mu, rough, law before *Change Friction
    tied: bool = False
    stiffness: float | None = None
    behaviour: str = "hard contact"
    behaviour_where: str = ""
    no_separation: bool = False
    hint: float | None = None  # a stiffness of the same dimension that the deck speaks of


@dataclass(frozen=True)
class Pair:
    """One contact pair or tie, by its keyword: its surfaces as the deck writes them.

    Gaps up to `reach`, in the deck's unit of length, are closed before anything is solved.
    """

    first: str
    second: str
    interaction: str
    name: str
    where: str
    keyword: str = "*Contact Pair"
    reach: float = 0.0


@dataclass
class Procedure:
    """What the last frequency step asks for."""

    modes: int | None = None
    highest: float | None = None
    damping: bool = False
    is_complex: bool = False
    where: str = ""


@dataclass
class TieData:
    """A reference node with what is tied to it.

    Attributes
    ----------
    rigid : bool
    reference : Reference
        The node.
    members : list of Reference
        Surfaces or node sets.
    springs : list of dict
        Between the reference and the ground, as the scene has them.
    freedoms : set of int, optional
        Those of the freedoms 1 to 6 that follow the members, in axes of the coupling's own; None if all of them do.
    place : (3,) array, optional
        Where the reference counts, if not at its node.
    radius : float, optional
        Nodes farther from the reference are not tied.
    of_surface : bool
        Whether the member is the name of a surface, whatever node set has the same name.
    coupling : Statement, optional
        The *Coupling, in whose axes the freedoms are; without it they are in those of the node (*Equation).
    """

    name: str
    where: str
    rigid: bool
    reference: Reference
    members: list[Reference]
    springs: list[dict[str, Value]] = field(default_factory=list)
    freedoms: set[int] | None = None
    place: np.ndarray | None = None
    radius: float | None = None
    of_surface: bool = False
    coupling: Statement | None = None

    @property
    def keyword(self) -> str:
        """Return the keyword that says which freedoms are tied."""
        return "*Equation" if self.coupling is None else "*Distributing"


@dataclass
class Content:
    """The deck with its mesh, what was read so far, and the draft that it becomes."""

    source: str
    model: DeckModel
    raw: RawMesh
    assembly: ModelSets
    loaded: LoadedMesh  # in the deck's own unit of length
    draft: Draft
    units: Units = SI
    substances: dict[str, Substance] = field(default_factory=dict)
    sections: list[Statement] = field(default_factory=list)
    orientations: dict[Reference, Statement] = field(default_factory=dict)
    held: dict[Reference, dict[int, str]] = field(default_factory=dict)  # freedoms 1 to 6, where each is held
    springs: list[Statement] = field(default_factory=list)
    transforms: list[Statement] = field(default_factory=list)
    interactions: dict[str, Interaction] = field(default_factory=dict)
    pairs: list[Pair] = field(default_factory=list)
    general: list[Pair] = field(default_factory=list)  # of general contact
    excluded: list[tuple[str, str, str]] = field(default_factory=list)  # pairs of surfaces, and where they stand
    ties: list[Pair] = field(default_factory=list)
    motions: list[tuple[Statement, float]] = field(default_factory=list)  # with the factor of their amplitude
    amplitudes: dict[str, Statement] = field(default_factory=dict)
    pressures: dict[Reference, tuple[float, str]] = field(default_factory=dict)
    loaded_elements: set[str] = field(default_factory=set)  # single ones under *Dload, with their faces
    forces: dict[tuple[Reference, int], tuple[float, str]] = field(default_factory=dict)
    ties_to_points: list[TieData] = field(default_factory=list)
    masses: list[Statement] = field(default_factory=list)
    procedure: Procedure = field(default_factory=Procedure)
    substance: Substance | None = None  # what suboptions of a material belong to
    interaction: Interaction | None = None
    perturbation: bool = False
    loads_of_step: set[tuple[str, Reference, int]] = field(default_factory=set)  # by keyword and component
    operations: dict[str, str] = field(default_factory=dict)  # OP of the first block of a keyword in the step
    step_time: float = 1.0  # of the step that is read
    large_displacements: bool = False
    _rows: dict[Reference, np.ndarray] = field(default_factory=dict)

    def floats(self, block: KeywordBlock, line: str) -> list[float | None]:
        """Return the numbers of a data line, None where a field is blank.

        Raises
        ------
        MeshError
        """
        found: list[float | None] = []
        for part in line.split(","):
            text = part.strip()
            try:
                found.append(real(text) if text else None)
            except ValueError:
                raise MeshError(
                    f'{self.source}: {block.where}: "{block.shown(text)}" in a data line of *{spoken(block.keyword)} is'
                    " not a number"
                ) from None
        while found and found[-1] is None:
            found.pop()
        return found

    def first(self, block: KeywordBlock) -> list[float | None]:
        """Return the numbers of the first data line, none where there is no data."""
        return self.floats(block, block.lines[0]) if block.lines else []

    def placements(self, scope: str) -> list[str]:
        """Return the keys of the instances that a scope means: itself, or all of a part; "" for the assembly."""
        return [key for key, p in self.assembly.instances.items() if scope in (key, p.part)] if scope else [""]

    def homes(self, scope: str) -> list[str]:
        """Return what may stand in front of a name that is used in a scope: nothing, or each of its instances."""
        return [f"{self.assembly.instances[key].name}." if key else "" for key in self.placements(scope)] or [""]

    def turned(self, directions: np.ndarray, key: str) -> np.ndarray:
        """Return directions (n, 3) turned with the instance of a key; those of the assembly ("") as they are."""
        instance = self.model.instances.get(key)
        if instance is None:
            return directions
        return moved(directions, instance.place) - moved(np.zeros((1, 3)), instance.place)

    def rows(self, reference: Reference) -> np.ndarray:
        """Return the nodes that a reference means, rows of the raw mesh.

        Raises
        ------
        MeshError
            There is none.
        """
        if reference not in self._rows:
            text, scope = reference
            user = f'"{text}"'
            found = [self.assembly.find("NSET", self.assembly.own, f"{home}{text}", user) for home in self.homes(scope)]
            self._rows[reference] = np.unique(np.concatenate(found))
        return self._rows[reference]

    def group(self, known: Iterable[str], reference: Reference) -> list[str]:
        """Return the names that a set or surface has among groups of the mesh, none where it has none."""
        text, scope = reference
        found = []
        for home in self.homes(scope):
            wanted = f"{home}{text}".casefold()
            same = [name for name in known if name.casefold() == wanted]
            if not same and home:
                same = [name for name in known if name.casefold() == text.casefold()]
            found += same[:1]
        return list(dict.fromkeys(found))

    def reason(self, text: str) -> str:
        """Return why a set or surface is no group of the mesh, behind a colon, "" where nothing is known of it."""
        found = [why for name, why in self.loaded.unusable.items() if name.casefold() == text.casefold()]
        return f": {found[0]}" if found else ""

    def is_of_nodes(self, reference: Reference) -> bool:
        """Return whether a reference is the name of a *Surface, TYPE=NODE, whose nodes all count alike."""
        text, scope = reference
        own = self.assembly.own
        return any(self.assembly.is_of_nodes(own, f"{home}{text}") for home in self.homes(scope))

    def is_part_covered(self, name: str) -> bool:
        """Return whether a surface that was made of a node set has not all of its nodes."""
        nodes, mesh = self.loaded.node_groups[name].nodes, self.loaded.mesh
        facets = np.asarray((mesh.boundaries or {})[name])
        return not np.isin(nodes, mesh.dofs.get_facet_dofs(facets).flatten()).all()

    def nodes_name(self, reference: Reference) -> str:
        """Return how the scene names the nodes of a reference that solids have, "" if there are none."""
        known = self.group(self.loaded.node_groups, reference)
        if known:
            return ", ".join(known)
        return ", ".join(self.raw.node_name(int(row)) for row in self.rows(reference) if self.on_solids[row])

    @cached_property
    def on_solids(self) -> np.ndarray:
        """(rows,) bool: nodes of the raw mesh that solid elements have."""
        used = np.zeros(len(self.raw.points), bool)
        for block in self.raw.blocks:
            used[block.nodes[block.nodes >= 0]] = True
        return used

    def where(self, statement: Statement) -> str:
        """Return where a statement stands, "line 12" in the deck itself."""
        return short(statement.block.where, self.source)


def real(text: str) -> float:
    """Return a number as decks write it: exponents with D, or without a letter.

    Raises
    ------
    ValueError
        It is none, or not finite.

    Examples
    --------
    >>> real("2.1E5"), real("7.8-9"), real("1.d3")
    (210000.0, 7.8e-09, 1000.0)
    """
    found = _SHORT_EXPONENT.fullmatch(text)
    value = float(f"{found[1]}e{found[2]}" if found else text.upper().replace("D", "E"))
    if not math.isfinite(value) or "_" in text:
        raise ValueError(text)
    return value


def fields(line: str) -> list[str]:
    """Return all fields of a data line, blank ones too."""
    return [unquoted(part) for part in line.split(",")]


def short(where: str, source: str) -> str:
    """Return a place in the deck itself without the deck's name."""
    return where.removeprefix(f"{source} ")


def spoken(keyword: str) -> str:
    """Return a keyword as manuals write it.

    Examples
    --------
    >>> spoken("SURFACE BEHAVIOR")
    'Surface Behavior'
    """
    return keyword.title()
