"""Bodies and what holds them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator

from ..fem.materials import material_axes
from ..schema.place import Placed
from ..schema.section import Section, Text, Vector


def _is_no_group_with_commas(value: str) -> str:
    if "," in value:
        raise ValueError(f'expected a name without a comma, and in its table groups = ["{value}"] for the volume group')
    return value


BodyName = Annotated[Text, AfterValidator(_is_no_group_with_commas)]


class BodyTable(Section):
    """A volume group with its material; every element belongs to exactly one body. NAME is the group.

    Attributes
    ----------
    material : str
        Name of a material above.
    groups : list of str
        Volume groups of the mesh that make up the body, where NAME is not the group itself; a group with a comma in its
        name is one of these.
    axes : two vectors
        Axes 1 and 2 of an orthotropic material in global coordinates, [[x, y, z], [x, y, z]]; axis 3 is across both,
        and the second vector need only lie in the plane of axes 1 and 2 (default: x and y). The same throughout
        the body.
    formulation : "standard" or "mixed"
        "mixed" gives the pressure unknowns of its own, eliminated in each element, so that nearly incompressible
        materials (poisson_ratio above some 0.45) do not lock. It adds unknowns, but not to hexahedra of order 2. For
        isotropic materials, in bodies that do not rotate.
    """

    material: str
    groups: Annotated[list[str], Field(min_length=1)] | None = None
    axes: Annotated[tuple[Vector, Vector], Field(strict=False)] | None = None
    formulation: Literal["standard", "mixed"] = "standard"

    @property
    def is_mixed(self) -> bool:
        """Whether the formulation is the mixed one."""
        return self.formulation == "mixed"

    @field_validator("axes")
    @classmethod
    def _span_a_plane(cls, value: tuple[Vector, Vector] | None) -> tuple[Vector, Vector] | None:
        if value is not None:
            try:
                material_axes(*value)
            except ValueError as error:
                raise ValueError(f"{error}; expected two vectors that span a plane") from error
        return value


class Support(Placed):
    """A surface group, or a node set, on which displacement components are held.

    Of a node set it also holds the nodes that elements of order 2 and 3 have between those of the set and the file
    lacks. Of a file with midside nodes it holds those that the set lists; with order 3 these are the edges and faces
    whose middles it lists.

    Attributes
    ----------
    fixed : str
        The global components that are held: any of the letters x, y, z, such as "xyz" or "z".
    """

    fixed: str

    @field_validator("fixed")
    @classmethod
    def _components(cls, value: str) -> str:
        if not value or set(value) - set("xyz") or len(set(value)) != len(value):
            raise ValueError('expected any of the letters x, y and z, such as "xyz" or "z"')
        return value
