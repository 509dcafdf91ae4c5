"""The scene: what the user wrote, validated before any mesh is read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ..effects.falling_friction import FallingFriction
from ..effects.friction import Friction
from ..effects.friction_damping import FrictionDamping
from ..effects.preload import Preload
from ..effects.rayleigh import Rayleigh
from ..effects.rotation import Rotation
from ..effects.springs import Spring
from ..effects.stress_stiffening import StressStiffening
from ..effects.structural_damping import StructuralDamping
from ..errors import SceneError, suggest
from ..fem.materials import Elasticity, Material, elasticity, material_axes, stiffness_tensor
from ..problem.parameters import MU, paths_of
from ..schema.section import Section
from .base import BaseScene
from .bodies import Body, Support
from .contacts import Contact
from .control import Output, Solve, SweepSection
from .mesh import MeshSection
from .numbers import number_at, with_numbers


class Effects(Section):
    """Effects that are on; one whose table is absent is not simulated.

    Attributes
    ----------
    friction : table
        Friction in every sliding contact.
    preload : table
        Static state under pressures, with contacts that open.
    stress_stiffening : table
        Geometric stiffness of the preload's stress; without keys.
    friction_damping : table
        Damping of slip across the sliding direction.
    falling_friction : table
        Friction that depends on the sliding speed.
    rayleigh : table
        Rayleigh damping of all bodies.
    structural_damping : table
        Structural damping by the materials' loss factors.
    rotation : table
        Rotation of bodies of revolution.
    """

    friction: Friction | None = None
    preload: Preload | None = None
    stress_stiffening: StressStiffening | None = None
    friction_damping: FrictionDamping | None = None
    falling_friction: FallingFriction | None = None
    rayleigh: Rayleigh | None = None
    structural_damping: StructuralDamping | None = None
    rotation: Rotation | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects that are on."""
        return tuple(n for n in type(self).model_fields if getattr(self, n) is not None)

    @model_validator(mode="after")
    def _make_sense(self) -> Effects:
        damping, falling = self.friction_damping, self.falling_friction
        for key in ("friction_damping", "falling_friction"):
            effect = getattr(self, key)
            if effect is None:
                continue
            if self.friction is None:
                raise ValueError(f"given {key} without friction; expected [effects.friction] with mu")
            if self.preload is not None and effect.contact_pressure is not None:
                raise ValueError(f"given {key}.contact_pressure and preload, which gives the pressure; expected one")
        pressed = self.preload is not None or (damping is not None and damping.contact_pressure is not None)
        if damping is not None and not pressed:
            raise ValueError(
                "given friction_damping without a pressure; expected friction_damping.contact_pressure, or"
                " [effects.preload]"
            )
        if falling is not None and not pressed and falling.contact_pressure is None:
            raise ValueError(
                "given falling_friction without a pressure; expected falling_friction.contact_pressure, or"
                " [effects.preload]"
            )
        if self.stress_stiffening is not None and self.preload is None:
            raise ValueError("given stress_stiffening without preload, whose stress acts; expected [effects.preload]")
        if self.preload is not None and not self.preload.pressures and self.rotation is None:
            raise ValueError(
                "given preload without a load; expected preload.pressures = { SURFACE = ... }, or [effects.rotation]"
            )
        return self


class Scene(BaseScene):
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

    @property
    def mesh_path(self) -> Path | None:
        """The mesh file; relative names are relative to the scene file."""
        if self.mesh.file is None:
            return None
        return self.folder / self.mesh.file

    def stiffness(self, body: str) -> np.ndarray:
        """Return the stiffness tensor of a body, (3, 3, 3, 3) Pa."""
        section = self.bodies[body]
        axes = None if section.axes is None else material_axes(*section.axes)
        return stiffness_tensor(self.materials[section.material], axes)

    def elasticity(self, body: str) -> Elasticity:
        """Return the law of a body in its formulation."""
        section = self.bodies[body]
        axes = None if section.axes is None else material_axes(*section.axes)
        return elasticity(self.materials[section.material], axes, section.is_mixed)

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Names of the effects that are on, damping of single bodies included."""
        own = "rayleigh" not in self.effects.names and any(b.rayleigh is not None for b in self.bodies.values())
        return (*self.effects.names, *(["rayleigh"] if own else []))

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names of the contacts; those without one are numbered from 1."""
        return tuple(c.name or f"contact_{i}" for i, c in enumerate(self.contacts, 1))

    def names_in(self, path: str) -> list[str] | None:
        """Return the names of the entries of `contacts` or `springs`; None of another list."""
        if path == "contacts":
            return list(self.contact_names)
        return [s.name for s in self.springs] if path == "springs" else None

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
        for i, body in enumerate(self.effects.rotation.bodies if self.effects.rotation is not None else ()):
            if body not in self.bodies:
                raise ValueError(
                    f'effects.rotation.bodies[{i}]: given "{body}", which is no body{suggest(body, self.bodies)}'
                )
        return self

    @model_validator(mode="after")
    def _mixed_where_it_holds(self) -> Scene:
        rotation = self.effects.rotation
        for name, body in self.bodies.items():
            if not body.is_mixed:
                continue
            material = self.materials.get(body.material)
            if material is not None and material.is_orthotropic:
                raise ValueError(
                    f'bodies.{name}.formulation: given "mixed", and the material {body.material} is orthotropic (lists'
                    f' in materials.{body.material}); expected "standard", or one with a single poisson_ratio'
                )
            if rotation is not None and name in rotation.bodies:
                raise ValueError(
                    f'bodies.{name}.formulation: given "mixed", and effects.rotation.bodies has {name}; expected'
                    ' "standard" for a body that rotates'
                )
        return self

    @model_validator(mode="after")
    def _can_be_swept(self) -> Scene:
        if self.sweep is None:
            return self
        for path in paths_of(self.sweep.parameter):
            if path == MU and self.effects.friction is None:
                raise ValueError('sweep.parameter: given "mu", but no friction; expected [effects.friction] with mu')
            if path.split(".")[0] in ("mesh", "sweep", "solve", "output"):
                raise ValueError(
                    f'sweep.parameter: given "{path}"; expected a number of the physics: modes are followed by their'
                    " shapes, on one mesh"
                )
            try:
                number_at(self, path)
            except SceneError as error:
                raise ValueError(f"sweep.parameter: {error}") from error
        for value in {float(self.sweep.grid[0]), float(self.sweep.grid[-1])}:
            try:
                with_numbers(self, dict.fromkeys(paths_of(self.sweep.parameter), value))
            except SceneError as error:
                raise ValueError(f"sweep: {error}") from error
        return self
