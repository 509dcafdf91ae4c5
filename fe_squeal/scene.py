"""The scene: what the user wrote, validated before any mesh is read."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PrivateAttr, field_validator, model_validator

from .contact import Sliding
from .effects.friction import Friction
from .effects.springs import Spring
from .geometry import Block, DiscPad
from .materials import Material, material_axes
from .schema import NonNegative, Positive, Section, Text, Vector

FRICTION_PARAMETER = "mu"
_MU_PATHS = ("mu", "effects.friction.mu")


class MeshSection(Section):
    """Where the mesh comes from: a file, or a parametric geometry, or both: then the file is what runs.

    Attributes
    ----------
    file : str
        The mesh file, relative to the scene file: .msh, .inp, .bdf, .vtu, .vtk, .xdmf, .med, ... `fe-squeal mesh` makes
        it from the geometry.
    length_unit : "m" or "mm"
        Unit of the file's coordinates, and of the lengths in `[mesh.disc_pad]` and `[mesh.block]`; of nothing else.
    order : 1 or 2
        Polynomial order of the displacements.
    disc_pad : table
        Parametric geometry.
    block : table
        Parametric geometry; one of the two.
    """

    file: Text | None = None
    length_unit: Literal["m", "mm"] = "m"
    order: int = 2
    disc_pad: DiscPad | None = None
    block: Block | None = None

    @field_validator("file")
    @classmethod
    def _is_a_name(cls, value: str | None) -> str | None:
        if value is not None and not value.isprintable():
            raise ValueError("expected the name of a mesh file, without control characters")
        return value

    @field_validator("order", mode="before")
    @classmethod
    def _one_or_two(cls, value: object) -> object:
        if type(value) is not int or value not in (1, 2):  # Literal[1, 2] lets true and 1.0 through
            raise ValueError("expected 1 or 2")
        return value

    @model_validator(mode="after")
    def _one_source(self) -> MeshSection:
        geometries = [g for g in (self.disc_pad, self.block) if g is not None]
        if self.file is None and not geometries:
            raise ValueError('given no mesh; expected file = "...", or a geometry [mesh.disc_pad] or [mesh.block]')
        if len(geometries) > 1:
            raise ValueError("given [mesh.disc_pad] and [mesh.block]; expected one geometry")
        return self

    @property
    def geometry(self) -> DiscPad | Block | None:
        """The parametric geometry, if there is one."""
        return self.disc_pad or self.block

    @property
    def scale(self) -> float:
        """Metres per unit of the file's coordinates."""
        return 1e-3 if self.length_unit == "mm" else 1.0


class Body(Section):
    """A volume group with its material; every element belongs to exactly one body. NAME is the group.

    Attributes
    ----------
    material : str
        Name of a material above.
    groups : list of str
        Volume groups of the mesh that make up the body, where NAME is not the group itself.
    axes : two vectors
        Axes 1 and 2 of an orthotropic material in global coordinates, [[x, y, z], [x, y, z]]; axis 3 is across both,
        and the second vector need only lie in the plane of axes 1 and 2 (default: x and y). The same throughout
        the body.
    """

    material: str
    groups: Annotated[list[str], Field(min_length=1)] | None = None
    axes: Annotated[tuple[Vector, Vector], Field(strict=False)] | None = None

    @field_validator("axes")
    @classmethod
    def _span_a_plane(cls, value: tuple[Vector, Vector] | None) -> tuple[Vector, Vector] | None:
        if value is not None:
            try:
                material_axes(*value)
            except ValueError as error:
                raise ValueError(f"{error}; expected two vectors that span a plane") from error
        return value


class Support(Section):
    """A surface group on which displacement components are held.

    Attributes
    ----------
    surface : str
        Surface group of the mesh.
    fixed : str
        The global components that are held: any of the letters x, y, z, such as "xyz" or "z".
    """

    surface: str
    fixed: str

    @field_validator("fixed")
    @classmethod
    def _components(cls, value: str) -> str:
        if not value or set(value) - set("xyz") or len(set(value)) != len(value):
            raise ValueError('expected any of the letters x, y and z, such as "xyz" or "z"')
        return value


class SlidingSection(Section):
    """Motion of a counterface: rad/s about an axis through a centre, or m/s along a direction.

    Only the direction of the motion counts for the friction force, the speed for its sign.

    Attributes
    ----------
    axis : vector
        Axis of a rotation, of any length.
    centre : vector, m
        A point of the axis, with `axis` alone; in metres whatever `length_unit` is.
    direction : vector
        Direction of a straight belt, of any length; instead of `axis`.
    speed : float, rad/s or m/s
        About the axis by the right hand, or along the direction; not zero, negative the other way.
    """

    axis: Vector | None = None
    centre: Vector = (0.0, 0.0, 0.0)
    direction: Vector | None = None
    speed: float

    @field_validator("axis", "direction")
    @classmethod
    def _nonzero(cls, value: Vector | None) -> Vector | None:
        if value is not None and not any(value):
            raise ValueError("expected a vector that is not zero")
        return value

    @field_validator("speed")
    @classmethod
    def _moves(cls, value: float) -> float:
        if value == 0:
            raise ValueError("expected a number that is not zero, whose sign gives the direction")
        return value

    @model_validator(mode="after")
    def _either(self) -> SlidingSection:
        if (self.axis is None) == (self.direction is None):
            given = "neither axis nor direction" if self.axis is None else "both axis and direction"
            raise ValueError(
                f"given {given}; expected either axis (and centre) for a rotation or direction for a straight belt"
            )
        if self.direction is not None and "centre" in self.model_fields_set:
            raise ValueError(
                "given direction and centre; expected centre with a rotation about an axis, not with a straight belt"
            )
        return self

    def motion(self) -> Sliding:
        """Return the motion as arrays in SI units."""
        vector = np.array(self.axis or self.direction, float)
        velocity = vector / np.linalg.norm(vector) * self.speed
        return Sliding(velocity, np.array(self.centre) if self.axis is not None else None)


class Contact(Section):
    """A pad's surface on a counterface.

    Attributes
    ----------
    name : str
        For messages and results (default: contact_1, contact_2, ...).
    surface : str
        Surface group of the pad.
    counterface : str
        Surface group of the moving body, or "rigid" for one without a mesh.
    normal_stiffness : float, N/m per m^2
        Contact stiffness.
    kind : "sliding" or "frictionless" or "tied"
        A tied contact couples all three directions.
    friction_ratio : float
        This contact's friction coefficient as a multiple of effects.friction.mu.
    normal_damping : float, N s/m per m^2
        Contact damping.
    gap_tolerance : float, m
        Gaps and overlaps of the two meshes up to it are taken as closed (default: 2 % of the mean facet size of the
        pad); in metres whatever `length_unit` is.
    sliding : table
        Motion of the counterface; needed by a sliding contact.
    """

    name: str = ""
    surface: str
    counterface: str
    normal_stiffness: Positive
    kind: Literal["sliding", "frictionless", "tied"] = "sliding"
    friction_ratio: NonNegative = 1.0
    normal_damping: NonNegative = 0.0
    gap_tolerance: NonNegative | None = None
    sliding: SlidingSection | None = None

    @model_validator(mode="after")
    def _slides(self) -> Contact:
        if self.kind == "sliding" and self.sliding is None:
            raise ValueError(
                "a sliding contact needs sliding = { axis, centre, speed } or { direction, speed };"
                ' or set kind = "frictionless" or "tied"'
            )
        return self

    @property
    def is_rigid(self) -> bool:
        """Whether the counterface is rigid and has no mesh."""
        return self.counterface == "rigid"


class Effects(Section):
    """Effects that are on; one whose table is absent is not simulated.

    Attributes
    ----------
    friction : table
        Friction in every sliding contact.
    """

    friction: Friction | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects that are on."""
        return tuple(n for n in type(self).model_fields if getattr(self, n) is not None)


class SweepSection(Section):
    """Values of the parameter that the sweep takes: `from`, `to` and `points`, or `values`.

    Attributes
    ----------
    parameter : str
        "mu", short for effects.friction.mu.
    from : float
        First value.
    to : float
        Last value.
    points : int
        Number of values, equally spaced from the first to the last.
    values : list of float
        The values themselves, increasing.
    """

    parameter: str = FRICTION_PARAMETER
    start: float | None = Field(default=None, alias="from")
    stop: float | None = Field(default=None, alias="to")
    points: Annotated[int, Field(ge=1, le=100_000)] | None = None
    values: Annotated[list[float], Field(min_length=1, max_length=100_000)] | None = None

    @field_validator("parameter")
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in _MU_PATHS:
            raise ValueError('expected "mu" (short for effects.friction.mu), the parameter this version sweeps')
        return FRICTION_PARAMETER

    @field_validator("values")
    @classmethod
    def _increasing(cls, value: list[float] | None) -> list[float] | None:
        for a, b in pairwise(value or ()):
            if a >= b:
                raise ValueError(f"expected values that increase; {b:g} comes after {a:g}")
        return value

    @model_validator(mode="after")
    def _one_range(self) -> SweepSection:
        ranged = {"from": self.start, "to": self.stop, "points": self.points, "values": self.values}
        given = [key for key, value in ranged.items() if value is not None]
        if given not in (["from", "to", "points"], ["values"]):
            raise ValueError(f"given {', '.join(given) or 'nothing'}; expected from, to and points, or values = [...]")
        if self.values is None and not (np.diff(self.grid) > 0).all():
            raise ValueError(f"given from = {self.start:g}, to = {self.stop:g}; expected from < to")
        if self.values is None and self.points == 1 and self.start != self.stop:
            raise ValueError("given points = 1; expected at least 2 from one value to another (one: values = [...])")
        return self

    @property
    def grid(self) -> np.ndarray:
        """(m,) float: the values, increasing."""
        if self.values is not None:
            return np.array(self.values)
        assert self.start is not None and self.stop is not None and self.points is not None
        return np.linspace(self.start, self.stop, self.points)


class Solve(Section):
    """What the eigen-solver is asked for.

    Attributes
    ----------
    modes : int
        Number of modes, the lowest (default: 20, or as many as there are, where `max_frequency` is not given).
    max_frequency : float, Hz
        All modes up to it, instead of `modes`.
    method : "auto" or "direct"
        How the modes are computed; "auto" chooses.
    tolerance : float
        Relative backward error at which an eigenvalue is taken as converged.
    """

    modes: Annotated[int, Field(ge=1)] | None = None  # 20, or as many as there are, where max_frequency is not given
    max_frequency: Positive | None = None
    method: Literal["auto", "direct"] = "auto"
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-8

    @model_validator(mode="after")
    def _one_limit(self) -> Solve:
        if self.modes is not None and self.max_frequency is not None:
            raise ValueError("given modes and max_frequency; expected one of them")
        return self


class Output(Section):
    """What is written beside the tables and figures.

    Attributes
    ----------
    shapes : "unstable" or "all" or "none"
        Which mode shapes are written, for ParaView and as pictures.
    """

    shapes: Literal["unstable", "all", "none"] = "unstable"


class Scene(Section):
    """A whole scene; `load_scene` reads one from TOML.

    Attributes
    ----------
    title : str
        For figures and run.json.
    mesh : table
        The mesh.
    materials : table of tables
        At least one.
    bodies : table of tables
        At least one.
    supports : list of tables
        Held surfaces.
    springs : list of tables
        Springs and dampers.
    contacts : list of tables
        Contacts.
    effects : table
        What is simulated beyond elasticity and contact stiffness.
    sweep : table
        Where to solve; without it once, at the friction coefficient of `[effects.friction]`.
    solve : table
        Number of modes and accuracy.
    output : table
        What is written.
    """

    title: str = ""
    mesh: MeshSection
    materials: Annotated[dict[str, Material], Field(min_length=1)]
    bodies: Annotated[dict[str, Body], Field(min_length=1)]
    supports: list[Support] = []
    springs: list[Spring] = []
    contacts: list[Contact] = []
    effects: Effects = Effects()
    sweep: SweepSection | None = None
    solve: Solve = Solve()
    output: Output = Output()

    _source: Path | None = PrivateAttr(default=None)

    @property
    def source(self) -> Path | None:
        """The file the scene was read from."""
        return self._source

    @property
    def mesh_path(self) -> Path | None:
        """The mesh file; relative names are relative to the scene file."""
        if self.mesh.file is None:
            return None
        folder = self._source.parent if self._source is not None else Path()
        return folder / self.mesh.file

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names of the contacts; those without one are numbered from 1."""
        return tuple(c.name or f"contact_{i}" for i, c in enumerate(self.contacts, 1))

    @model_validator(mode="after")
    def _names_and_friction(self) -> Scene:
        for key, names in (("contacts", self.contact_names), ("springs", [s.name for s in self.springs])):
            for i, name in enumerate(names):
                if name in names[:i]:
                    raise ValueError(
                        f'{key}[{i}].name: given "{name}", as {key}[{names.index(name)}] is; expected different names'
                    )
        for i, spring in enumerate(self.springs):
            if not spring.name:
                raise ValueError(f'springs[{i}].name: given ""; expected a name')
            if spring.to == spring.surface:
                raise ValueError(f'springs[{i}].to: given "{spring.to}", its own surface; expected another one')
        if self.effects.friction is not None and not any(c.kind == "sliding" for c in self.contacts):
            raise ValueError('effects.friction: no contact slides; expected a [[contacts]] entry of kind "sliding"')
        if self.sweep is not None and self.effects.friction is None:
            raise ValueError('sweep.parameter: given "mu", but no friction; expected [effects.friction] with mu')
        return self
