"""Contacts and the motion of their counterfaces."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from ..fem.motion import SteadyMotion
from ..schema.section import Direction, NonNegative, OptionalName, Positive, Section, Speed, Vector


class SlidingSection(Section):
    """Motion of a counterface: rad/s about an axis through a centre, or m/s along a direction.

    Only the direction of the motion counts for the friction force, the speed for its sign; slip damping and rotation
    need the speed itself. Friction takes it as the motion seen from the surface: where `[effects.rotation]` turns the
    bodies of the surface, it is the reverse of their rotation.

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

    axis: Direction | None = None
    centre: Vector = (0.0, 0.0, 0.0)
    direction: Direction | None = None
    speed: Speed

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

    def motion(self) -> SteadyMotion:
        """Return the motion as arrays in SI units."""
        vector = np.array(self.axis or self.direction, float)
        velocity = vector / np.linalg.norm(vector) * self.speed
        return SteadyMotion(velocity, np.array(self.centre) if self.axis is not None else None, self.speed < 0)


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
        Contact stiffness: a measured one, or of a hard contact about 10 E/h of the softer side, E its modulus and h the
        size of its elements; see how onsets move with it.
    kind : "sliding" or "frictionless" or "tied"
        A tied contact couples all three directions.
    friction_ratio : float
        This contact's friction coefficient as a multiple of effects.friction.mu.
    normal_damping : float, N s/m per m^2
        Contact damping. Friction follows the force of the contact stiffness alone.
    gap_tolerance : float, m
        Gaps and overlaps of the two meshes up to it are taken as closed (default: 2 % of the mean facet size of the
        pad, and what straight facets leave out of a curved face; 0: what rounding leaves, no more); in metres whatever
        `length_unit` is. A mesh that is refined keeps it.
    sliding : table
        Motion of the counterface; needed by a sliding contact. On a curved face, such as that of a drum or a bush, the
        normals are across this motion, so that straight edges of the mesh do not hold what turns; a frictionless
        contact of such a face needs it for that. A tied contact holds in all directions whatever the motion.
    """

    name: OptionalName = ""
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
