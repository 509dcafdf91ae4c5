"""The bodies of a scene that rotate: their motions, and whether the scene is the same all around their axis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..effects.rotation import rotation_motion
from ..errors import SceneError
from ..fem.motion import Sliding
from ..fem.revolution import check_revolution, check_ring, is_transversal
from ..fem.spaces import DisplacementSpace
from ..mesh import LoadedMesh
from ..scene import Scene
from .bodies import find_facets


def rotating_motions(scene: Scene, sides: Mapping[str, set[str]]) -> dict[str, Sliding]:
    """Return the motion of each rotating body.

    Parameters
    ----------
    sides : mapping of contact to the bodies that carry its counterface

    Raises
    ------
    SceneError
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
        motions[name] = rotation_motion(rotation, name, pressed)
    return motions


def check_shape(
    scene: Scene, space: DisplacementSpace, elements: np.ndarray, loaded: LoadedMesh, motion: Sliding, name: str
) -> bool:
    """Return True for a body that is the same all around the axis, with all that holds it.

    Raises
    ------
    SceneError
    """
    check_revolution(space.mesh, elements, motion, name)
    _check_holding(scene, space, elements, loaded, motion, name)
    return True


def check_material(scene: Scene, motion: Sliding, name: str) -> None:
    """Raise where the material of a rotating body is not the same all around the axis.

    Raises
    ------
    SceneError
    """
    if not is_transversal(scene.stiffness(name), motion):
        raise SceneError(
            f"effects.rotation: the material of body {name} is not the same all around the axis; expected an"
            " isotropic one, or an orthotropic one with axis 3 along the axis and equal values along 1 and 2"
        )


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
