"""What describes the modes of a scene."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..effects.context import Context
from ..fem.descriptors import ModeDescriber, make_describer


def describer_of(context: Context, bodies: Mapping[str, np.ndarray]) -> ModeDescriber | None:
    """Return what describes modes about the axis of the first contact that slides, or along the normal of a belt's.

    The bodies that turn are those that carry a counterface about this axis. None where no contact slides: then a scene
    has no direction of its own.
    """
    sliding = [part for part in context.contacts.values() if part.motion is not None]
    if not sliding:
        return None
    motion = sliding[0].motion
    assert motion is not None
    masses = {name: body.mass.matrix for name, body in context.bodies.items()}
    if motion.centre is None:
        normal = sliding[0].operators.normals.mean(axis=0)
        return make_describer(context.space, masses, bodies, (), normal, None)
    same = [part for part in sliding if part.motion is not None and _is_same(part.motion.way, motion.way)]
    carriers = {name for part in same for name in part.carriers}
    turning = tuple(name for name in bodies if name in carriers)
    return make_describer(context.space, masses, bodies, turning, motion.velocity, motion.centre)


def _is_same(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return len(a) == len(b) and bool(np.allclose(a, b, rtol=0, atol=1e-9))
