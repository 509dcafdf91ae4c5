"""What is allowed in a scene, but probably not meant."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .mesh import LoadedMesh, surface_group
from .scene import Scene
from .spaces import DisplacementSpace

_DENSITY = (100.0, 30000.0)  # kg/m^3: from foams to osmium
_MODULUS = (1e6, 1e13)  # Pa: from rubber to beyond diamond
_LARGE_GAP = 0.05  # of the model's size


def doubts(scene: Scene, loaded: LoadedMesh, space: DisplacementSpace) -> list[str]:
    """Return a sentence for each value that is probably not meant; the groups have been looked up before."""
    return [*_materials(scene), *_held(scene, loaded, space), *_gaps(scene, space)]


def _materials(scene: Scene) -> Iterable[str]:
    for name, material in scene.materials.items():
        if not _DENSITY[0] <= material.density <= _DENSITY[1]:
            yield f"materials.{name}.density = {material.density:g}: is this in SI units, kg/m^3?"
        given = material.youngs_modulus
        moduli = {"youngs_modulus": given if isinstance(given, list) else [given]}
        moduli["shear_modulus"] = material.shear_modulus or []
        for key, values in moduli.items():
            odd = [v for v in values if not _MODULUS[0] <= v <= _MODULUS[1]]
            if odd:
                yield f"materials.{name}.{key} = {odd[0]:g}: is this in SI units, Pa?"
        if material.loss_factor and getattr(scene.effects, "structural_damping", None) is None:
            known = "structural_damping" in type(scene.effects).model_fields
            reason = "is not on" if known else "this version does not have"
            yield f"materials.{name}.loss_factor has no effect: it is read by structural damping, which {reason}"


def _held(scene: Scene, loaded: LoadedMesh, space: DisplacementSpace) -> Iterable[str]:
    fixed = space.fixed.reshape(-1, 3)

    def nodes(group: str) -> np.ndarray:
        return np.unique(space.nodes_of(surface_group(loaded, group)))

    for i, support in enumerate(scene.supports):
        for name, contact in zip(scene.contact_names, scene.contacts, strict=True):
            pad = nodes(contact.surface)
            held = len(np.intersect1d(pad, nodes(support.surface)))
            if 2 * held >= len(pad):  # an edge in common with a held side is nothing to speak of
                yield (
                    f'supports[{i}]: "{support.surface}" holds {held} of {len(pad)} nodes of "{contact.surface}", the'
                    f" surface of contact {name}"
                )
    for spring in scene.springs:
        acts = np.array(spring.direction) != 0
        surfaces = [spring.surface, *([spring.to] if spring.to is not None else [])]
        if all(fixed[nodes(s)][:, acts].all() for s in surfaces):
            yield f"spring {spring.name} has no effect: supports hold all of {' and '.join(surfaces)} in its direction"


def _gaps(scene: Scene, space: DisplacementSpace) -> Iterable[str]:
    size = float(np.ptp(space.mesh.p, axis=1).max())
    for name, contact in zip(scene.contact_names, scene.contacts, strict=True):
        if contact.gap_tolerance is not None and contact.gap_tolerance > _LARGE_GAP * size:
            yield (
                f"contact {name}: gap_tolerance = {contact.gap_tolerance:g} m is"
                f" {100 * contact.gap_tolerance / size:.3g} % of the model's size; it is in metres always"
            )
