"""The bodies of a scene that rotate: their motions, and whether the scene is the same all around their axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..effects.rotation import rotation_motion
from ..errors import SceneError
from ..fem.contact import Sliding
from ..fem.revolution import check_revolution, check_ring, is_transversal
from ..fem.spaces import DisplacementSpace
from ..mesh import LoadedMesh
from ..scene import Scene
from .bodies import find_facets

Kept = Callable[[str, object, Callable[[], Any]], Any]
"""Returns what the third argument made for the same kind and key before, or makes it."""


def rotating_motions(
    scene: Scene, space: DisplacementSpace, bodies: Mapping[str, np.ndarray], loaded: LoadedMesh,
    sides: Mapping[str, set[str]], kept: Kept,
) -> dict[str, Sliding]:  # fmt: skip
    """Return the motion of each rotating body.

    Parameters
    ----------
    bodies : mapping of body to (e,) int elements
    sides : mapping of contact to the bodies that carry its counterface

    Raises
    ------
    SceneError
        If a body, what holds it or its material is not the same all around the axis.
    """
    rotation = scene.effects.rotation
    motions: dict[str, Sliding] = {}
    for name in rotation.bodies if rotation is not None else ():
        assert rotation is not None
        pressed = {
            c: contact.sliding.motion()
            for c, contact in zip(scene.contact_names, scene.contacts, strict=True)
            if contact.sliding is not None and name in sides[c]
        }
        motions[name] = motion = rotation_motion(rotation, name, pressed)

        def check(name: str = name, motion: Sliding = motion) -> None:
            check_revolution(space.mesh, bodies[name], motion, name)
            _check_holding(scene, space, bodies[name], loaded, motion, name)

        kept(f"revolution.{name}", motion.way, check)
        if not is_transversal(scene.stiffness(name), motion):
            raise SceneError(
                f"effects.rotation: the material of body {name} is not the same all around the axis; expected an"
                " isotropic one, or an orthotropic one with axis 3 along the axis and equal values along 1 and 2"
            )
    return motions


def _check_holding(
    scene: Scene, space: DisplacementSpace, elements: np.ndarray, loaded: LoadedMesh, motion: Sliding, name: str
) -> None:
    holding = [(f"supports[{i}]", s.surface) for i, s in enumerate(scene.supports)]
    for i, spring in enumerate(scene.springs):
        holding += [(f"springs[{i}]", s) for s in (spring.surface, spring.to) if s is not None]
    for key, group in holding:
        facets = find_facets(loaded, group, key)
        mine = facets[np.isin(space.mesh.f2t[0, facets], elements)]
        if len(mine):
            check_ring(space.mesh, mine, motion, key, name)
