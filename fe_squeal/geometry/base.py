"""What the parametric geometries have in common."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

Length = Annotated[float, Field(gt=0.0)]
LengthOrZero = Annotated[float, Field(ge=0.0)]
Count = Annotated[int, Field(ge=1, le=1_000_000)]
OneOrTwo = Annotated[int, Field(ge=1, le=2)]  # not Literal[1, 2], which lets True through
Grading = Annotated[float, Field(ge=0.05, le=20.0)]  # beyond, elements at one end are thinner than meshes bear
_NARROW = 0.1  # of the mean length of elements: narrower strips of elements would be too thin


def graded(elements: int, grading: float) -> NDArray[np.float64]:
    """Return where the elements along a line begin and end, (elements + 1,) from 0 to 1.

    The local length of elements grows like grading^t from the line's start, t = 0, to its end, t = 1: the places are
    x(i/n), x(t) = (grading^t - 1)/(grading - 1). So the elements of 2n include those of n.

    Examples
    --------
    >>> graded(2, 1.0), graded(2, 4.0)
    (array([0. , 0.5, 1. ]), array([0.        , 0.33333333, 1.        ]))
    """
    t = np.arange(elements + 1) / elements
    if grading == 1.0:
        return t
    found: NDArray[np.float64] = np.expm1(t * math.log(grading)) / (grading - 1.0)
    found[-1] = 1.0
    return found


def aligned(places: NDArray[np.float64], edges: Sequence[float]) -> NDArray[np.float64]:
    """Return places along a line, ascending, moved so that one of them lies on each edge.

    The nearest place inside the line is moved onto the edge, and those between two edges, or an edge and an end, in
    proportion. An edge that is nearer to an end, or to the edge before, than `_NARROW` times the mean distance of the
    places gets none.

    Examples
    --------
    >>> aligned(np.arange(5.0), [1.8, 3.7])
    array([0. , 0.9, 1.8, 3.7, 4. ])
    """
    narrow = _NARROW * (places[-1] - places[0]) / (len(places) - 1)
    kept, at = [places[0]], [0]
    for edge in sorted(edges):
        nearest = int(np.abs(places - edge).argmin())
        nearest = min(max(nearest, at[-1] + 1), len(places) - 2)
        if edge - kept[-1] >= narrow and places[-1] - edge >= narrow and nearest > at[-1]:
            kept.append(edge)
            at.append(nearest)
    return np.interp(places, places[[*at, -1]], [*kept, places[-1]])


@dataclass(frozen=True)
class Line:
    """One direction in some bodies of a structured mesh, along which the number of elements can be chosen.

    Attributes
    ----------
    groups : tuple of str
        Volume groups whose elements are cut along it.
    axis : "radial", "around", "axial", "x", "y" or "z"
        The direction.
    elements : int
        Number of elements along it now.
    multiple, least : int
        The number has to be a multiple of the first, and at least the second.
    places : tuple of float
        Where the elements along the line begin and end, from 0 to 1; empty where they are all equally long.
    """

    groups: tuple[str, ...]
    axis: str
    elements: int
    multiple: int = 1
    least: int = 1
    places: tuple[float, ...] = ()


class Geometry(BaseModel):
    """What the geometries share: the size and the kind of the elements, and how many there are.

    Lengths are in metres, or in the scene's `length_unit`; the mesh is made in the unit that they are given in.

    Attributes
    ----------
    size : float, length
        Target edge length of an element. An edge of length L gets max(1, round(L / size)) elements.
    element : "hex" or "tet"
        "hex" (default) is a structured mesh of hexahedra, made without gmsh; "tet" an unstructured one, made by gmsh.
    refinement : int
        Every element that `size` and the layers ask for is cut into this many along each edge (default 1). For studies
        of convergence: refinement = 2 doubles every number of elements, and size / 2 may not, because of rounding.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    size: Length
    element: Literal["hex", "tet"] = "hex"
    refinement: Count = 1

    def refined(self, factor: int) -> Self:
        """Return this geometry with `factor` times the elements along every line (for "tet": with size / factor).

        Raises
        ------
        ValueError
            `factor` is below 1.

        Examples
        --------
        >>> from fe_squeal.geometry import Block
        >>> Block(length=0.08, width=0.04, height=0.015, size=0.01).refined(2).refinement
        2
        """
        if factor < 1:
            raise ValueError(f"factor = {factor}: expected 1 or more")
        return self.model_copy(update={"refinement": self.refinement * factor})

    def with_counts(self, counts: Mapping[str, int]) -> Self:
        """Return this geometry with other numbers of elements along some of its `lines`, by their keys.

        Examples
        --------
        >>> from fe_squeal.geometry import Block
        >>> Block(length=0.08, width=0.04, height=0.015, size=0.01).with_counts({"layers": 3}).block_counts
        (8, 4, 3)
        """
        every = {key: line.elements for key, line in self.lines.items()} | dict(counts)
        return type(self).model_validate({**self.model_dump(), "refinement": 1, **every})

    def resized(self, size: float) -> Self:
        """Return this geometry with another size of elements; numbers of elements that are given change in proportion.

        Examples
        --------
        >>> from fe_squeal.geometry import Block
        >>> block = Block(length=0.08, width=0.04, height=0.015, size=0.01, layers=3)
        >>> block.resized(0.005).block_counts
        (16, 8, 6)
        """
        finer = self.edge_length / size
        counts = {}
        for key, line in self.lines.items() if self.element == "hex" else ():
            if getattr(self, key) is not None:
                steps = max(1, round(finer * line.elements / line.multiple))
                counts[key] = max(line.least, steps * line.multiple)
        return type(self).model_validate({**self.model_dump(), "size": size, "refinement": 1, **counts})

    @property
    def lines(self) -> dict[str, Line]:
        """The lines of the structured mesh, each by the key of the geometry that sets its number of elements."""
        raise NotImplementedError

    def nodes(self, order: int) -> int:
        """Return how many nodes the structured mesh has with elements of an order."""
        raise NotImplementedError

    @property
    def placements(self) -> tuple[Self, ...]:
        """This geometry with as many elements, and the lines between them in other places that may suit its modes."""
        return (self,)

    @property
    def placing(self) -> tuple[str, ...]:
        """The keys that say where the lines are, with their values, as the scene has them."""
        return ()

    @property
    def edge_length(self) -> float:
        """Target edge length after refinement, in the geometry's unit of length."""
        return self.size / self.refinement

    def elements_along(self, length: float) -> int:
        """Return the number of elements along an edge of `length`, before refinement.

        0.015 / 0.01 is 1.4999... in metres, and 15 / 10 is 1.5 in millimetres: a tiny amount is added before rounding,
        so that both give the same number. The number is capped, so that it is finite for absurd sizes; meshing refuses
        far fewer elements.
        """
        return max(1, math.floor(min(length / self.size, 1e9) * (1.0 + 1e-9) + 0.5))

    def elements_around(self, radius: float) -> int:
        """Return the number of elements around a full ring, before refinement: at least 12, and a multiple of 4.

        The multiple of 4 keeps the planes x = 0 and y = 0 planes of symmetry of the mesh.
        """
        return 4 * max(3, self.elements_along(0.5 * math.pi * radius))

    def forbid_layers(self, **layers: int | None) -> None:
        """Raise ValueError if numbers of elements are given for tetrahedra."""
        given = [name for name, value in layers.items() if value is not None]
        if self.element == "tet" and given:
            raise ValueError(f'{", ".join(given)}: layers belong to element = "hex"; leave them out or choose "hex"')
