"""What describes the modes of a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ..effects.context import Context
from ..effects.rotating_bodies import turn_alike, unit_rotation
from ..eigen.columns import Columns
from ..fem.descriptors import ModeDescriber, make_describer
from ..fem.motion import SteadyMotion
from ..problem.description import Describer, Description
from ..problem.terms import Term

_ONE_SIDE = 0.1  # length of the mean of unit normals: of a bore they have no common direction


@dataclass(frozen=True)
class LaterDescriber:
    """A describer that is made when it is first asked: many problems are assembled whose modes nobody describes.

    Attributes
    ----------
    make : callable
        Returns the describer.
    """

    make: Callable[[], ModeDescriber]

    @cached_property
    def _made(self) -> ModeDescriber:
        return self.make()

    def describe(self, terms: Iterable[Term], parameters: Mapping[str, float], shapes: np.ndarray) -> Description:
        """Return the descriptors of shapes (n, k), see `fe_squeal.problem.description.Describer`."""
        return self._made.describe(terms, parameters, shapes)

    def on(self, V: Columns) -> ModeDescriber:
        """Return the describer of shapes V y that takes their coordinates y, for a basis V (n, r) float."""
        return self._made.on(V)


def describer_of(context: Context, bodies: Mapping[str, np.ndarray]) -> Describer | None:
    """Return an object that says what modes look like; None if no body turns and no contact slides.

    It describes them about the axis of the bodies that `[effects.rotation]` turns. Without any the first sliding
    contact decides, before those without friction, such as guides and bushes: about its axis, about which the bodies
    that carry its counterface are taken to rotate, or along the normal of its belt. A rotation comes before a belt,
    and a counterface with a mesh before a rigid one.

    Parameters
    ----------
    context : Context
    bodies : mapping of str to (m,) int
        Elements of each body.
    """
    masses = {name: body.mass.matrix for name, body in context.bodies.items()}
    moved = [(part, part.motion) for part in context.contacts.values() if part.motion is not None]
    moved.sort(key=lambda m: (m[0].kind != "sliding", m[1].centre is None, not m[0].carriers))  # a stable sort
    motions = [*context.motions.values(), *(motion for _, motion in moved)]
    if not motions:
        return None
    motion = motions[0]
    if motion.centre is None:
        operators = moved[0][0].operators
        mean = operators.weights @ operators.normals / operators.area
        normal = mean if np.linalg.norm(mean) > _ONE_SIDE else None
        return LaterDescriber(partial(make_describer, context.space, masses, bodies, (), normal, None))
    moving = [*context.motions.items(), *((name, other) for part, other in moved for name in part.carriers)]
    rotating = {name for name, other in moving if _about_one_axis(other, motion)}
    turning = tuple(name for name in bodies if name in rotating)
    make = partial(make_describer, context.space, masses, bodies, turning, motion.velocity, motion.centre)
    return LaterDescriber(make)


def _about_one_axis(a: SteadyMotion, b: SteadyMotion) -> bool:
    rotations = a.centre is not None and b.centre is not None
    return rotations and turn_alike(unit_rotation(a), unit_rotation(b))
