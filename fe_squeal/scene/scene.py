"""The scene: what the user wrote, validated before any mesh is read."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model, field_validator, model_validator

from ..effects import EFFECTS
from ..effects.effect import Effect, Outline
from ..effects.springs import Spring
from ..effects.ties import Averaged, Rigid
from ..errors import SceneError
from ..fem.materials import Elasticity, Material, elasticity, material_axes
from ..problem.parameters import MU, paths_of
from ..schema.section import Name
from .base import BaseScene
from .bodies import BodyName, BodyTable, Support
from .contacts import Contact
from .control import Output, Solve, SweepSection
from .effects import effects_table, with_own_tables
from .measured import Measured
from .mesh import MeshSection
from .numbers import GEOMETRY, NOT_PHYSICS, number_at, plain, with_numbers
from .study import StudySection

if TYPE_CHECKING:
    from .bodies import BodyTable as Body
    from .effects import EffectsTable as Effects
else:  # with the effects of the program; `scene_with` has them with others
    Effects = effects_table(EFFECTS, __name__)
    Body = with_own_tables(BodyTable, EFFECTS, __name__)


class Scene(BaseScene):
    """A whole scene; `load_scene` reads one from TOML.

    Attributes
    ----------
    title : str
        For figures and run.json.
    units : "SI" or "any"
        "SI": a material whose sound is slower than 100 m/s or faster than 20 000 m/s, or a body of more than 5 m, is
        refused before anything is solved. "any": no check of magnitudes, for another consistent set of units;
        pictures and the page then name none.
    mesh : table
        The mesh.
    materials : table of tables
        At least one.
    bodies : table of tables
        At least one.
    supports : list of tables
        Held surfaces and node sets.
    springs : list of tables
        Springs and dampers.
    rigid : list of tables
        Surfaces and node sets that move as rigid bodies.
    averaged : list of tables
        Reference points that follow the mean motion of surfaces and node sets.
    contacts : list of tables
        Contacts.
    effects : table
        What is simulated beyond elasticity and contact stiffness.
    sweep : table
        Where to solve; without it once, at the friction coefficient of `[effects.friction]`.
    study : table
        What `fe-squeal study` does: the scatter of several numbers, or a map over two.
    solve : table
        Number of modes and accuracy.
    output : table
        What is written.
    measured : list of tables
        Measured squeal, shown beside what is computed.
    unsettled : list of str
        What a deck has and the scene lacks, as `fe-squeal new` writes it: the scene does not run while there is any.
        Settle each in the scene, and remove it here.
    """

    title: str = ""
    unsettled: list[str] = []
    units: Literal["SI", "any"] = "SI"
    mesh: MeshSection
    materials: Annotated[dict[Name, Material], Field(min_length=1)]
    bodies: Annotated[dict[BodyName, Body], Field(min_length=1)]
    supports: list[Support] = []
    springs: list[Spring] = []
    rigid: list[Rigid] = []
    averaged: list[Averaged] = []
    contacts: list[Contact] = []
    effects: Effects = Effects()
    sweep: SweepSection | None = None
    study: StudySection | None = None
    solve: Solve = Solve()
    output: Output = Output()
    measured: list[Measured] = []

    @field_validator("unsettled")
    @classmethod
    def _settled(cls, value: list[str]) -> list[str]:
        if value:
            raise ValueError(f"expected none: settle each in the scene and remove its line, the first is {value[0]}")
        return value

    @property
    def mesh_path(self) -> Path | None:
        """The mesh file; relative names are relative to the scene file."""
        if self.mesh.file is None:
            return None
        return self.folder / self.mesh.file

    def elasticity(self, body: str) -> Elasticity:
        """Return the law of a body in its formulation."""
        section = self.bodies[body]
        axes = None if section.axes is None else material_axes(*section.axes)
        return elasticity(self.materials[section.material], axes, section.is_mixed)

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Names of the effects that are on and do something, damping of single bodies included."""
        idle = set(self.idle_tables)
        on = [name for name in self.effects.on if f"effects.{name}" not in idle]
        own = {name for body in self.bodies for name in self.own_tables(body) if f"bodies.{body}.{name}" not in idle}
        return (*on, *(kind.name for kind in self.effects.known if kind.name in own and kind.name not in on))

    @property
    def moved(self) -> frozenset[str]:
        """Paths of the numbers that the sweep or the study changes."""
        names = [self.sweep.parameter] if self.sweep is not None else []
        names += self.study.names if self.study is not None else []
        return frozenset(path for name in names for path in paths_of(name))

    @property
    def idle_tables(self) -> tuple[str, ...]:
        """Paths of the tables of effects that do nothing, neither as they are nor where the sweep or the study goes.

        A body's own table does something where it replaces one of the whole model that does.
        """

        def acts(table: Effect, at: str) -> bool:
            return table.acts or any(path.startswith(f"{at}.") for path in self.moved)

        acting = {name for name, table in self.effects.on.items() if acts(table, f"effects.{name}")}
        own = [(f"bodies.{body}.{name}", table) for body in self.bodies
               for name, table in self.own_tables(body).items() if name not in acting]  # fmt: skip
        idle = [f"effects.{name}" for name in self.effects.on if name not in acting]
        return (*idle, *(at for at, table in own if not acts(table, at)))

    def own_tables(self, body: str) -> dict[str, Effect]:
        """Return the tables of effects that a body has of its own, by the effects' names."""
        tables = {kind.name: getattr(self.bodies[body], kind.name) for kind in self.effects.known if kind.own_of_body}
        return {name: table for name, table in tables.items() if table is not None}

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names of the contacts; those without one are numbered from 1."""
        return tuple(c.name or f"contact_{i}" for i, c in enumerate(self.contacts, 1))

    def names_in(self, path: str) -> list[str] | None:
        """Return the names of the entries of `contacts`, `springs`, `rigid` or `averaged`; None of another list."""
        if path == "contacts":
            return list(self.contact_names)
        tables: dict[str, Sequence[Spring | Rigid]] = {
            "springs": self.springs, "rigid": self.rigid, "averaged": self.averaged,
        }  # fmt: skip
        return [table.name for table in tables[path]] if path in tables else None

    @property
    def ties(self) -> list[tuple[str, Rigid]]:
        """The tables of `rigid` and `averaged`, each with its key."""
        return [(f"{key}[{i}]", t) for key in ("rigid", "averaged") for i, t in enumerate(getattr(self, key))]

    @model_validator(mode="after")
    def _names_and_effects(self) -> Scene:
        named = {"contacts": self.contact_names, "springs": [s.name for s in self.springs],
                 "rigid": [t.name for t in self.rigid], "averaged": [t.name for t in self.averaged]}  # fmt: skip
        for key, names in named.items():
            for i, name in enumerate(names):
                if name in names[:i]:
                    raise ValueError(
                        f'{key}[{i}].name: given "{name}", as {key}[{names.index(name)}] is; expected different names'
                    )
        for i, spring in enumerate(self.springs):
            if spring.to == spring.group:
                own = "surface" if spring.kind == "surface" else "node set"
                raise ValueError(f'springs[{i}].to: given "{spring.to}", its own {own}; expected another one')
        outline = Outline(
            tuple(self.bodies), tuple(name for name, body in self.bodies.items() if body.is_mixed),
            tuple(n for n, c in zip(self.contact_names, self.contacts, strict=True) if c.kind == "sliding"),
        )  # fmt: skip
        for effect in self.effects.on.values():
            effect.check_scene(outline)
        return self

    @model_validator(mode="after")
    def _mixed_where_it_holds(self) -> Scene:
        for name, body in self.bodies.items():
            if not body.is_mixed:
                continue
            material = self.materials.get(body.material)
            if material is not None and material.is_orthotropic:
                raise ValueError(
                    f'bodies.{name}.formulation: given "mixed", and the material {body.material} is orthotropic (lists'
                    f' in materials.{body.material}); expected "standard", or one with a single poisson_ratio'
                )
        return self

    @model_validator(mode="after")
    def _can_be_swept(self) -> Scene:
        if self.sweep is None:
            return self
        for path in paths_of(self.sweep.parameter):
            if path == MU and MU not in {p for effect in self.effects.on.values() for p in effect.parameters()}:
                raise ValueError('sweep.parameter: given "mu", but no friction; expected [effects.friction] with mu')
            if path.split(".")[0] in NOT_PHYSICS:
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

    @model_validator(mode="after")
    def _can_be_studied(self) -> Scene:
        if self.study is None:
            return self
        for name, ends in zip(self.study.names, self.study.ends, strict=True):
            for path in paths_of(name):
                if path.split(".")[0] in NOT_PHYSICS and not path.startswith(GEOMETRY):
                    raise ValueError(
                        f'study: given "{path}"; expected a number of the physics, of [mesh.disc_pad] or [mesh.block]'
                    )
                if path == MU and MU not in {p for effect in self.effects.on.values() for p in effect.parameters()}:
                    raise ValueError('study: given "mu", but no friction; expected [effects.friction] with mu')
                try:
                    number_at(self, path)
                except SceneError as error:
                    raise ValueError(f"study: {error}") from error
            for value in {end for end in ends if end is not None}:
                try:
                    with_numbers(self, dict.fromkeys(paths_of(name), value))
                except SceneError as error:
                    raise ValueError(f"study: {error}") from error
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to make the scene again in another process, whose effects may be others."""
        data = plain(self.model_dump(by_alias=True, exclude_unset=True))
        return _scene_again, (self.effects.known, data, self.source)


def scene_with(known: Sequence[type[Effect]]) -> type[Scene]:
    """Return the kind of scene that may call for these effects."""
    return _scene_with(tuple(known))


@cache
def _scene_with(known: tuple[type[Effect], ...]) -> type[Scene]:
    if known == EFFECTS:
        return Scene
    effects, body = effects_table(known, __name__), with_own_tables(BodyTable, known, __name__)
    bodies: Any = Annotated[dict[BodyName, body], Field(min_length=1)]  # type: ignore[valid-type]
    fields: Any = {"effects": (effects, effects()), "bodies": (bodies, ...)}
    return create_model("Scene", __base__=Scene, __module__=__name__, **fields)


def _scene_again(known: tuple[type[Effect], ...], data: dict[str, Any], source: Path | None) -> Scene:
    scene = scene_with(known).model_validate(data)
    scene._source = source
    return scene
