"""One or more blocks on a belt."""

from __future__ import annotations

import math
from typing import Self

from pydantic import model_validator

from fe_squeal.geometry.base import Count, Geometry, Length, LengthOrZero, Line, OneOrTwo

_COUNTS = ("layers", "elements_x", "elements_y")
_BELT_COUNTS = tuple(f"belt_{key}" for key in _COUNTS)


class Block(Geometry):
    """One or more blocks in a row on a belt that runs along x; the contact plane is z = 0.

    The row is centred at x = 0, y = 0. With one block the groups are the volume `block` and the surfaces `bottom`
    (z = 0), `top` (z = height), `left` (lowest x), `right` (highest x), `front` (lowest y), `back` (highest y). With
    more, counted along +x, every name ends in its block's number: `block_1`, `bottom_1`, ..., `block_2`, ....
    A belt with a thickness adds the volume `belt` and the surfaces `belt_top` (z = 0), `belt_bottom`, `belt_left`,
    `belt_right`, `belt_front`, `belt_back`; it shares no nodes with the blocks.

    Attributes
    ----------
    length, width, height : float, length
        Size of each block along x, y and z.
    count : int
        Number of blocks (default 1).
    spacing : float, length, optional
        Clear distance between neighbouring blocks (default: the length of one block).
    belt_thickness : float, length
        0 (default): no belt is meshed; the counterface is then "rigid" in the scene.
    belt_margin_x, belt_margin_y : float, length
        How far the belt reaches beyond the row of blocks on each side (default 0).
    layers, belt_layers : int, optional
        Elements through the height and the belt's thickness, hex only (default: from `size`).
    elements_x, elements_y, belt_elements_x, belt_elements_y : int, optional
        Elements along and across each block and the belt, hex only (default: from `size`).
    geometry_order : 1 or 2
        Default 1: straight edges need no mid-nodes, and the displacement order is the scene's own choice.

    Examples
    --------
    >>> row = Block(length=0.08, width=0.04, height=0.015, size=0.01, count=2)
    >>> row.gap_between, row.row_length
    (0.08, 0.24)
    """

    length: Length
    width: Length
    height: Length
    count: Count = 1
    spacing: LengthOrZero | None = None
    belt_thickness: LengthOrZero = 0.0
    belt_margin_x: LengthOrZero = 0.0
    belt_margin_y: LengthOrZero = 0.0
    layers: Count | None = None
    belt_layers: Count | None = None
    elements_x: Count | None = None
    elements_y: Count | None = None
    belt_elements_x: Count | None = None
    belt_elements_y: Count | None = None
    geometry_order: OneOrTwo = 1

    @property
    def has_belt(self) -> bool:
        """Whether the belt has a thickness and is meshed."""
        return self.belt_thickness > 0.0

    @property
    def gap_between(self) -> float:
        """Clear distance between neighbouring blocks."""
        return self.length if self.spacing is None else self.spacing

    @property
    def row_length(self) -> float:
        """Length of the row of blocks, from the first one's left to the last one's right."""
        return self.count * self.length + (self.count - 1) * self.gap_between

    @property
    def belt_length(self) -> float:
        """Length of the belt along x."""
        return self.row_length + 2.0 * self.belt_margin_x

    @property
    def belt_width(self) -> float:
        """Width of the belt along y."""
        return self.width + 2.0 * self.belt_margin_y

    @property
    def block_counts(self) -> tuple[int, int, int]:
        """Elements of one block along x, y and z."""
        layers = self.layers or self.elements_along(self.height)
        n_x = self.elements_x or self.elements_along(self.length)
        n_y = self.elements_y or self.elements_along(self.width)
        return n_x * self.refinement, n_y * self.refinement, layers * self.refinement

    @property
    def belt_counts(self) -> tuple[int, int, int]:
        """Elements of the belt along x, y and z; zeros without a belt."""
        if not self.has_belt:
            return (0, 0, 0)
        layers = self.belt_layers or self.elements_along(self.belt_thickness)
        n_x = self.belt_elements_x or self.elements_along(self.belt_length)
        n_y = self.belt_elements_y or self.elements_along(self.belt_width)
        return n_x * self.refinement, n_y * self.refinement, layers * self.refinement

    @property
    def lines(self) -> dict[str, Line]:
        """The lines of the structured mesh, each by the key of the geometry that sets its number of elements."""
        blocks = tuple(f"block{self.suffix(i)}" for i in range(1, self.count + 1))
        keys = ("elements_x", "elements_y", "layers")
        found = {k: Line(blocks, axis, n) for k, axis, n in zip(keys, "xyz", self.block_counts, strict=True)}
        if self.has_belt:
            counts = zip(keys, "xyz", self.belt_counts, strict=True)
            found |= {f"belt_{k}": Line(("belt",), axis, n) for k, axis, n in counts}
        return found

    @property
    def cells(self) -> int:
        """Number of hexahedra in all bodies; for "tet" the number of cubes of its edge length that would fill them."""
        return self.count * math.prod(self.block_counts) + math.prod(self.belt_counts)

    def nodes(self, order: int) -> int:
        """Return how many nodes the structured mesh has with elements of an order."""
        block, belt = (math.prod(order * n + 1 for n in counts) for counts in (self.block_counts, self.belt_counts))
        return self.count * block + (belt if self.has_belt else 0)

    def suffix(self, number: int) -> str:
        """Return the end of the group names of block `number` (from 1), such as "_2"; "" if there is one block."""
        return f"_{number}" if self.count > 1 else ""

    def left_of(self, number: int) -> float:
        """Return the lowest x of block `number` (from 1)."""
        return (number - 1) * (self.length + self.gap_between) - 0.5 * self.row_length

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.spacing is not None and self.count == 1:
            raise ValueError("spacing: there is one block; give count = 2 or more, or leave the spacing out")
        if not self.has_belt:
            for name in ("belt_margin_x", "belt_margin_y", *_BELT_COUNTS):
                if getattr(self, name):
                    raise ValueError(f"{name}: there is no belt; give belt_thickness or leave {name} out")
        self.forbid_layers(**{key: getattr(self, key) for key in (*_COUNTS, *_BELT_COUNTS)})
        return self
