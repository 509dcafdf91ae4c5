"""Where the mesh comes from."""

from __future__ import annotations

from typing import Literal

from pydantic import field_validator, model_validator

from ..geometry import Block, DiscPad
from ..schema.section import Section, Text


class MeshSection(Section):
    """Where the mesh comes from: a file, or a parametric geometry, or both: then the file is what runs.

    Attributes
    ----------
    file : str
        The mesh file, relative to the scene file: .msh (Gmsh), .inp (Abaqus), .bdf, .nas, .dat, .fem (Nastran), .cdb
        (Ansys), .unv, .vtu, .vtk, .xdmf, .med, or another one that meshio reads, but no Exodus file. Names in it are
        taken as UTF-8, or else as Windows-1252. `fe-squeal mesh` makes it from the geometry. `run --accuracy` and
        `accuracy` make their meshes from the geometry where there is one.
    length_unit : "m" or "mm"
        Unit of the file's coordinates, and of the lengths in `[mesh.disc_pad]` and `[mesh.block]`; of nothing else.
    allow_outside : bool
        Whether files that the mesh file includes (*INCLUDE, INPUT=, the arrays of an XDMF file) may lie outside of its
        own folder and that of the scene.
    order : 1, 2 or 3
        Polynomial order of the displacements; 3 for hexahedra alone. Where none is given, `run --accuracy` takes 3 for
        hexahedra of a geometry.
    disc_pad : table
        Parametric geometry.
    block : table
        Parametric geometry; one of the two.
    """

    file: Text | None = None
    length_unit: Literal["m", "mm"] = "m"
    allow_outside: bool = False
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
    def _is_an_order(cls, value: object) -> object:
        if type(value) is not int or value not in (1, 2, 3):  # Literal[1, 2, 3] lets true and 1.0 through
            raise ValueError("expected 1, 2, or, for hexahedra, 3")
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
