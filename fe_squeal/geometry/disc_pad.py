"""A disc with one pad or two."""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from fe_squeal.geometry.base import Count, Geometry, Grading, Length, LengthOrZero, Line, OneOrTwo, aligned, graded

_COUNTS = (
    *("disc_layers", "pad_layers", "back_plate_layers"),
    *("disc_elements_radial", "disc_elements_around", "pad_elements_radial", "pad_elements_around"),
)
_GRADINGS = (1.0, 2.0, 4.0, 8.0)  # `placements` have these


class DiscPad(Geometry):
    """A disc about the z axis, its mid-plane at z = 0, with one pad or one on each side, centred on the +x axis.

    Pad 1 lies on the +z face and pad 2, its mirror image, on the -z face. A pad is a sector of a ring: the lining, and
    behind it a back plate that shares its nodes. Disc and pads share no nodes, whatever the gap: they are in contact.

    Volume groups: `disc`, `pad_1`, `back_plate_1`, and `pad_2`, `back_plate_2` with two pads.
    Surface groups: `hub` and `rim` (inner and outer cylinder of the disc), `disc_face_1` (+z), `disc_face_2` (-z), and
    for each pad, lining and back plate taken together: `pad_face_1` (towards the disc), `pad_back_1` (away from it),
    `pad_inner_edge_1`, `pad_outer_edge_1`, and below 360 degrees `pad_leading_1`, `pad_trailing_1`: the ends that a
    point of a disc turning positively about +z meets first and last.

    Attributes
    ----------
    inner_radius, outer_radius : float, length
        Radius of the disc.
    thickness : float, length
        Thickness of the disc.
    pads : 1 or 2
        One pad on the +z face, or one on each face (default).
    pad_inner_radius, pad_outer_radius : float, length
        Radius of the lining. It may overhang the disc, but has to lie over some of it.
    pad_thickness : float, length
        Thickness of the lining.
    pad_angle_deg : float, degrees
        Angle that the pad spans, in (0, 360]; 360 is a full ring.
    back_plate_thickness : float, length
        0 (default): no back plate.
    gap : float, length
        Clearance between disc and lining (default 0).
    disc_layers, pad_layers, back_plate_layers : int, optional
        Elements through these thicknesses, hex only (default: from `size`).
    disc_elements_radial, disc_elements_around, pad_elements_radial, pad_elements_around : int, optional
        Elements along the radius and around, hex only (default: from `size`). The number around a full ring is a
        multiple of 4 and at least 12; a pad has at least one element for every 30 degrees.
    disc_grading : float
        How many times longer the disc's elements are along the radius at the rim than at the hub, hex only (default 1:
        all alike; 0.05 to 20). Above 1 they are finer at the hub, where a clamp makes stresses singular.
    disc_aligned : bool
        Whether circles of the disc's mesh run under the inner and outer edges of the pads, hex only (default: false).
        The circles next to these edges are moved there. An edge gets none where it is nearer to hub, rim or the other
        edge than a tenth of an element, or where there are fewer circles between hub and rim than edges.
    geometry_order : 1 or 2
        2 (default): edges follow the circles by mid-nodes (27-node hexahedra, 10-node tetrahedra). The relative error
        of the volume is then h^4/30, with h half the angle of an element in radians. 1: edges are straight (8 or 4
        nodes), and the error is 2 h^2/3.

    Examples
    --------
    >>> brake = DiscPad(inner_radius=0.07, outer_radius=0.13, thickness=0.012, pad_inner_radius=0.085,
    ...                 pad_outer_radius=0.128, pad_angle_deg=50, pad_thickness=0.011, size=0.014)
    >>> brake.pads, brake.has_back_plate, brake.is_ring
    (2, False, False)
    """

    inner_radius: Length
    outer_radius: Length
    thickness: Length
    pads: OneOrTwo = 2
    pad_inner_radius: Length
    pad_outer_radius: Length
    pad_angle_deg: Annotated[float, Field(gt=0.0, le=360.0)]
    pad_thickness: Length
    back_plate_thickness: LengthOrZero = 0.0
    gap: LengthOrZero = 0.0
    disc_layers: Count | None = None
    pad_layers: Count | None = None
    back_plate_layers: Count | None = None
    disc_elements_radial: Count | None = None
    disc_elements_around: Count | None = None
    pad_elements_radial: Count | None = None
    pad_elements_around: Count | None = None
    disc_grading: Grading = 1.0
    disc_aligned: bool = False
    geometry_order: OneOrTwo = 2

    @property
    def has_back_plate(self) -> bool:
        """Whether the pads have a back plate."""
        return self.back_plate_thickness > 0.0

    @property
    def pad_angle(self) -> float:
        """Angle that the pad spans, in radians."""
        return math.radians(self.pad_angle_deg)

    @property
    def is_ring(self) -> bool:
        """Whether the pad goes all the way round."""
        return self.pad_angle_deg == 360.0

    @property
    def disc_counts(self) -> tuple[int, int, int]:
        """Elements of the disc along the radius, around, and through its thickness."""
        n_r = self.disc_elements_radial or self.elements_along(self.outer_radius - self.inner_radius)
        n_theta = self.disc_elements_around or self.elements_around(0.5 * (self.inner_radius + self.outer_radius))
        n_z = self.disc_layers or self.elements_along(self.thickness)
        return n_r * self.refinement, n_theta * self.refinement, n_z * self.refinement

    @property
    def disc_radii(self) -> NDArray[np.float64]:
        """Where the disc's elements begin and end along the radius, ascending."""
        fine, width = self.refinement, self.outer_radius - self.inner_radius
        n = self.disc_counts[0] // fine
        radii = self.inner_radius + width * graded(n, self.disc_grading)
        if self.disc_aligned:
            radii = aligned(radii, [self.pad_inner_radius, self.pad_outer_radius])
        return np.interp(np.arange(n * fine + 1) / fine, np.arange(n + 1), radii)

    @property
    def _disc_places(self) -> tuple[float, ...]:
        return tuple(((self.disc_radii - self.inner_radius) / (self.outer_radius - self.inner_radius)).tolist())

    @property
    def pad_counts(self) -> tuple[int, int, int, int]:
        """Elements of one pad along the radius, around, through the lining, and through the back plate (0: none)."""
        n_r = self.pad_elements_radial or self.elements_along(self.pad_outer_radius - self.pad_inner_radius)
        mean_radius = 0.5 * (self.pad_inner_radius + self.pad_outer_radius)
        if self.pad_elements_around:
            n_theta = self.pad_elements_around
        elif self.is_ring:
            n_theta = self.elements_around(mean_radius)
        else:
            n_theta = max(self._fewest_around, self.elements_along(self.pad_angle * mean_radius))
        n_lining = self.pad_layers or self.elements_along(self.pad_thickness)
        n_plate = 0
        if self.has_back_plate:
            n_plate = self.back_plate_layers or self.elements_along(self.back_plate_thickness)
        fine = self.refinement
        return n_r * fine, n_theta * fine, n_lining * fine, n_plate * fine

    @property
    def _fewest_around(self) -> int:
        """The smallest number of elements around a pad: an element spans at most 30 degrees, as in a ring."""
        return math.ceil(self.pad_angle_deg / 30.0)

    @property
    def lines(self) -> dict[str, Line]:
        """The lines of the structured mesh, each by the key of the geometry that sets its number of elements."""
        linings = tuple(f"pad_{i}" for i in range(1, self.pads + 1))
        plates = tuple(f"back_plate_{i}" for i in range(1, self.pads + 1)) if self.has_back_plate else ()
        pads, ring = linings + plates, 4 if self.is_ring else 1
        n_r, n_theta, n_lining, n_plate = self.pad_counts
        found = {
            "disc_elements_radial": Line(
                ("disc",), "radial", self.disc_counts[0],
                places=self._disc_places,
            ),
            "disc_elements_around": Line(("disc",), "around", self.disc_counts[1], 4, 12),
            "disc_layers": Line(("disc",), "axial", self.disc_counts[2]),
            "pad_elements_radial": Line(pads, "radial", n_r),
            "pad_elements_around": Line(pads, "around", n_theta, ring, 12 if self.is_ring else self._fewest_around),
            "pad_layers": Line(linings, "axial", n_lining),
            "back_plate_layers": Line(plates, "axial", n_plate),
        }
        return {key: line for key, line in found.items() if line.groups}

    @property
    def placements(self) -> tuple[Self, ...]:
        """This geometry with the disc's lines aligned to the pads, by several gradings."""
        gradings = dict.fromkeys((self.disc_grading, *_GRADINGS))
        return tuple(self.model_copy(update={"disc_grading": g, "disc_aligned": True}) for g in gradings)

    @property
    def placing(self) -> tuple[str, ...]:
        """The keys that say where the lines are, with their values, as the scene has them."""
        return f"disc_grading = {self.disc_grading:g}", f"disc_aligned = {str(self.disc_aligned).lower()}"

    @property
    def cells(self) -> int:
        """Number of hexahedra in all bodies; for "tet" the number of cubes of its edge length that would fill them."""
        n_r, n_theta, n_lining, n_plate = self.pad_counts
        return math.prod(self.disc_counts) + self.pads * n_r * n_theta * (n_lining + n_plate)

    def nodes(self, order: int) -> int:
        """Return how many nodes the structured mesh has with elements of an order."""
        r, around, z = (order * n for n in self.disc_counts)
        pad_r, pad_around, lining, plate = (order * n for n in self.pad_counts)
        pad = (pad_r + 1) * (pad_around + (not self.is_ring)) * (lining + plate + 1)
        return (r + 1) * around * (z + 1) + self.pads * pad

    @model_validator(mode="after")
    def _check(self) -> Self:
        for smaller, larger in (("inner_radius", "outer_radius"), ("pad_inner_radius", "pad_outer_radius")):
            low, high = getattr(self, smaller), getattr(self, larger)
            if low >= high:
                raise ValueError(f"{smaller} = {low:g} and {larger} = {high:g}: expected {smaller} < {larger}")
        if self.pad_inner_radius >= self.outer_radius or self.pad_outer_radius <= self.inner_radius:
            raise ValueError(
                f"the pad (radii {self.pad_inner_radius:g} to {self.pad_outer_radius:g}) does not lie over the disc "
                f"(radii {self.inner_radius:g} to {self.outer_radius:g}): expected ranges that overlap"
            )
        if self.back_plate_layers is not None and not self.has_back_plate:
            raise ValueError(
                "back_plate_layers: there is no back plate; give back_plate_thickness or leave the layers out"
            )
        self._check_counts()
        self.forbid_layers(**{key: getattr(self, key) for key in _COUNTS})
        for key, given in (("disc_grading", self.disc_grading != 1.0), ("disc_aligned", self.disc_aligned)):
            if given and self.element == "tet":
                raise ValueError(f'{key}: belongs to element = "hex"; leave it out or choose "hex"')
        return self

    def _check_counts(self) -> None:
        around, ring = self.disc_elements_around, self.is_ring
        if around is not None and (around % 4 or around < 12):
            raise ValueError(f"disc_elements_around = {around}: expected a multiple of 4, at least 12")
        around = self.pad_elements_around
        if around is None:
            return
        if ring and (around % 4 or around < 12):
            raise ValueError(f"pad_elements_around = {around}: expected a multiple of 4, at least 12, for a full ring")
        if not ring and around < self._fewest_around:
            raise ValueError(
                f"pad_elements_around = {around}: expected at least {self._fewest_around}, one for every 30 degrees"
            )
