"""What an effect is given to make its terms from: the discretised scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from ..eigen.linear.factor import LinearSolver
from ..fem.contact import ContactOperators
from ..fem.materials import Elasticity, Material, elasticity, stiffness_tensor
from ..fem.motion import SteadyMotion
from ..fem.spaces import DisplacementSpace
from ..fem.surfaces import Surface
from ..fem.ties import Tie
from ..mesh import LoadedMesh
from ..mesh.groups import find_facets
from ..mesh.node_sets import find_nodes
from ..problem.terms import Term
from ..schema.place import Kind
from ..schema.section import Section
from .cache import Cache, Same
from .springs import Spring
from .static_state import ContactState, StaticState
from .ties import Rigid

_Table = TypeVar("_Table", bound=Section)


@dataclass(frozen=True)
class BodyPart:
    """A body.

    Attributes
    ----------
    name : str
    elements : (e,) int
    material : Material
    material_path : str
        Such as "materials.steel", for names of parameters.
    axes : (3, 3) float or None
        Rows: axes of an orthotropic material.
    is_mixed : bool
        Whether the formulation is the mixed one.
    mass, elastic : Term
    own : mapping of effect to table
        Tables that stand in place of the scene's.
    """

    name: str
    elements: np.ndarray
    material: Material
    material_path: str
    axes: np.ndarray | None
    is_mixed: bool
    mass: Term
    elastic: Term
    own: Mapping[str, Section] = field(default_factory=dict)

    def stiffness(self) -> np.ndarray:
        """Return the stiffness tensor, (3, 3, 3, 3) Pa."""
        return stiffness_tensor(self.material, self.axes)

    def elasticity(self) -> Elasticity:
        """Return the law in this body's formulation."""
        return elasticity(self.material, self.axes, self.is_mixed)


@dataclass(frozen=True)
class ContactPart:
    """A contact, on its closed part once there is a static state.

    Attributes
    ----------
    name, kind : str
        "sliding", "frictionless" or "tied".
    operators : ContactOperators
        Operators on the whole surface.
    normal_stiffness : float, N/m per m^2
    friction_ratio : float
    motion : SteadyMotion or None
        Motion of the counterface.
    carriers, pads : frozenset of str
        Bodies that carry the counterface, and the surface that touches it.
    groups : tuple of str
        Names of its surfaces in the mesh: that of the pads, and the counterface unless that is rigid.
    state : ContactState or None
        What presses in it.
    """

    name: str
    kind: str
    operators: ContactOperators
    normal_stiffness: float
    friction_ratio: float
    motion: SteadyMotion | None
    carriers: frozenset[str]
    pads: frozenset[str]
    groups: tuple[str, ...]
    state: ContactState | None = None

    @property
    def path(self) -> str:
        """Path of its table in the scene, for names of parameters."""
        return f"contacts.{self.name}"

    @property
    def slides_with_friction(self) -> bool:
        """Whether friction acts in it at all."""
        return self.kind == "sliding" and self.friction_ratio != 0 and self.motion is not None

    @cached_property
    def closed(self) -> ContactOperators:
        """Its operators with weights of zero where it is open."""
        if self.state is None:
            return self.operators
        return replace(self.operators, weights=self.operators.weights * self.state.closed)

    @property
    def key(self) -> object:
        """What the property `closed` depends on, as part of a key for the cache."""
        return Same(self.operators), None if self.state is None else self.state.closed.tobytes()

    @cached_property
    def pressure(self) -> np.ndarray:
        """(q,) float, Pa: of the static state, not below zero; without one 1, which a parameter then scales."""
        if self.state is None:
            return np.ones(len(self.operators.weights))
        return np.maximum(self.state.pressure, 0.0)

    def pressure_powers(self, path: str) -> dict[str, int]:
        """Return the powers of parameters that scale a term which is made from `pressure`.

        Parameters
        ----------
        path : str
            Path of the pressure in the scene, used where there is no static state that gives the pressure.
        """
        ratio = {f"{self.path}.friction_ratio": 1}
        return ratio if self.state is not None else {**ratio, path: 1}


@dataclass(frozen=True)
class Context:
    """A scene on its mesh.

    Attributes
    ----------
    space : DisplacementSpace
    loaded : LoadedMesh
    bodies : mapping of body to BodyPart
    contacts : mapping of contact to ContactPart
    materials : mapping of name to Material
        All of the scene, also those that no body is of.
    holding : tuple of (path, kind, group)
        Surfaces and node sets on which supports, springs and ties act.
    references : tuple of (path, Tie, Rigid)
        Rigid bodies and averaged reference points, on the mesh and in the scene.
    tables : mapping of effect to table
        Tables of the effects that are on.
    number : function of a path
        Returns a number of the scene.
    cache : Cache
        Keeps what was made, from one value of a sweep to the next.
    springs : tuple of Spring
    moved : frozenset of str
        Paths of the numbers that the scene's sweep or study changes.
    static : tuple of Term
        Stiffnesses of bodies, springs and tied contacts.
    motions : mapping of body to SteadyMotion
        Motions of the bodies that rotate.
    static_state : StaticState or None
        The static state under preload.
    linear_solver : LinearSolver or str
        For static states.
    """

    space: DisplacementSpace
    loaded: LoadedMesh
    bodies: Mapping[str, BodyPart]
    contacts: Mapping[str, ContactPart]
    materials: Mapping[str, Material]
    holding: tuple[tuple[str, Kind, str], ...]
    references: tuple[tuple[str, Tie, Rigid], ...]
    tables: Mapping[str, Section]
    number: Callable[[str], float]
    cache: Cache
    springs: tuple[Spring, ...] = ()
    moved: frozenset[str] = frozenset()
    static: tuple[Term, ...] = ()
    motions: Mapping[str, SteadyMotion] = field(default_factory=dict)
    static_state: StaticState | None = None
    linear_solver: LinearSolver | str = "auto"

    def facets(self, group: str, path: str) -> np.ndarray:
        """Return the facets of a surface group; `path` says in messages where it was named.

        Raises
        ------
        MeshError
        """
        return find_facets(self.loaded, group, path)

    def nodes(self, group: str, path: str) -> np.ndarray:
        """Return the nodes of a set, columns of `mesh.doflocs`; `path` says in messages where it was named.

        Raises
        ------
        MeshError
        """
        return find_nodes(self.loaded, group, path).nodes

    def surface(self, group: str, path: str) -> Surface:
        """Return a surface group with its quadrature; `path` says in messages where it was named.

        Raises
        ------
        MeshError
        """
        return self.space.surface(self.facets(group, path))

    def table(self, kind: type[_Table]) -> _Table | None:
        """Return the table of an effect; None where it is not on."""
        return next((t for t in self.tables.values() if isinstance(t, kind)), None)

    def table_of_body(self, kind: type[_Table], body: BodyPart) -> tuple[_Table, str] | None:
        """Return the table of an effect that holds for a body, its own or the scene's, and the path of that table."""
        for tables, prefix in ((body.own, f"bodies.{body.name}"), (self.tables, "effects")):
            for name, table in tables.items():
                if isinstance(table, kind):
                    return table, f"{prefix}.{name}"
        return None
