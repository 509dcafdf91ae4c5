"""What is allowed in a scene, but probably not meant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations

import numpy as np

from ..effects.context import ContactPart
from ..effects.friction import Friction
from ..effects.rotating_bodies import turn_alike
from ..effects.ties import idle_at_reference
from ..fem.distortion import shape_condition
from ..fem.motion import SteadyMotion
from ..fem.places import nodes_there
from ..fem.spaces import DisplacementSpace
from ..mesh import LoadedMesh
from ..scene import Scene
from ..schema.place import Kind
from .touching import warnings_of_touching
from .units import suspect_units

_DENSITY = (100.0, 30000.0)  # kg/m^3: from foams to osmium
_EXTENT = (1e-3, 10.0)  # m: a model whose extent is not between these probably has the wrong unit of length
_MODULUS = (1e6, 1e13)  # Pa: from rubber to beyond diamond
# Condition number of the map from the regular cell. Its square, 1e4, is what a backward error is multiplied by: of the
# usual tolerance of 1e-8 that leaves four digits.
_DISTORTED = 100.0
_NAMED = 5  # elements in one sentence
_LIFTING = 0.1  # of the sliding velocity: straight edges of a coarse mesh on a drum leave less along the normal
_LARGE_GAP = 0.05  # part of the model's size: a larger gap_tolerance was probably meant in another unit
_FAR = 10.0  # times the model's size: an axis or a reference farther away was probably meant in another unit
_STIFF = (1e-5, 1e8)  # normal stiffness over Young's modulus by the model's size: others are probably mistakes
_HALF, _WHOLE = 0.5, 0.99  # share of a contact's surface that touches: less than half is probably a mistake
_LOCKING = 0.48  # Poisson's ratio above which standard elements lose digits; see docs/near_incompressible.md


def warnings_of_scene(
    scene: Scene, loaded: LoadedMesh, space: DisplacementSpace, bodies: Mapping[str, np.ndarray]
) -> list[str]:
    """Return a sentence for each value of a scene that is probably a mistake.

    Parameters
    ----------
    scene : Scene
        Whose groups all exist in the mesh.
    loaded : LoadedMesh
    space : DisplacementSpace
    bodies : mapping of str to (m,) int
        Elements of each body.
    """
    return [
        *suspect_units(scene, space.mesh, bodies), *_size(scene, loaded), *_materials(scene), *_locking(scene),
        *_held(scene, loaded, space), *_unread(scene), *_gaps(scene, space), *_far_away(scene, space),
        *_stiffness(scene, space), *_shapes(loaded, space, bodies),
        *warnings_of_touching(scene, loaded, bodies),
    ]  # fmt: skip


def _size(scene: Scene, loaded: LoadedMesh) -> Iterable[str]:
    extent = float(np.ptp(loaded.mesh.doflocs, axis=1).max())
    if scene.units != "any" and not _EXTENT[0] <= extent <= _EXTENT[1]:
        yield f"{loaded.source}: the model is {extent:.3g} m across; is length_unit right?"


def _materials(scene: Scene) -> Iterable[str]:
    if scene.units == "any":
        return
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


def _locking(scene: Scene) -> Iterable[str]:
    for name, body in scene.bodies.items():
        nu = scene.materials[body.material].poisson_ratio
        if not body.is_mixed and not isinstance(nu, list) and nu > _LOCKING:
            yield (
                f"bodies.{name}: materials.{body.material}.poisson_ratio = {nu:g}, nearly incompressible: standard"
                f' elements lock, and frequencies come out too high, with order = {scene.mesh.order};'
                f' take bodies.{name}.formulation = "mixed"'
            )


def _held(scene: Scene, loaded: LoadedMesh, space: DisplacementSpace) -> Iterable[str]:
    fixed = space.fixed.reshape(-1, 3)

    def nodes(group: str, kind: Kind = "surface") -> np.ndarray:
        return nodes_there(space, loaded, kind, group)

    for i, support in enumerate(scene.supports):
        for name, contact in zip(scene.contact_names, scene.contacts, strict=True):
            pad = nodes(contact.surface)
            held = len(np.intersect1d(pad, nodes(support.group, support.kind)))
            if 2 * held >= len(pad):  # a pad that shares only an edge with a held side is usual
                yield (
                    f'supports[{i}]: "{support.group}" holds {held} of {len(pad)} nodes of "{contact.surface}", the'
                    f" surface of contact {name}"
                )
    for spring in scene.springs:
        acts = np.array(spring.direction) != 0
        groups = [spring.group, *([spring.to] if spring.to is not None else [])]
        if all(fixed[nodes(g, spring.kind)][:, acts].all() for g in groups):
            yield f"spring {spring.name} has no effect: supports hold all of {' and '.join(groups)} in its direction"
    for key, table in scene.ties:
        for what in idle_at_reference(table):
            yield f'{key}.{what} has no effect: fixed = "{table.fixed}" holds all that it acts on'


def _unread(scene: Scene) -> Iterable[str]:
    for name, body in scene.bodies.items():
        if body.axes is not None and not scene.materials[body.material].is_orthotropic:
            yield f"bodies.{name}.axes has no effect: the material {body.material} is isotropic"
    for name, contact in zip(scene.contact_names, scene.contacts, strict=True):
        if contact.is_rigid and contact.gap_tolerance is not None:
            yield f"contacts.{name}.gap_tolerance has no effect: the counterface is rigid, and touches everywhere"
        if "friction_ratio" not in contact.model_fields_set or not contact.friction_ratio:
            continue
        key = f"contacts.{name}.friction_ratio"
        if contact.kind != "sliding":
            yield f"{key} has no effect: the contact is {contact.kind}"
        elif scene.effects.table(Friction) is None:
            yield f"{key} has no effect: [effects.friction], which reads it, is not on"
    for path in scene.idle_tables:
        yield f"{path} has no effect: all its numbers are zero"


def _gaps(scene: Scene, space: DisplacementSpace) -> Iterable[str]:
    size = float(np.ptp(space.mesh.p, axis=1).max())
    for name, contact in zip(scene.contact_names, scene.contacts, strict=True):
        if contact.gap_tolerance is not None and contact.gap_tolerance > _LARGE_GAP * size and not contact.is_rigid:
            yield (
                f"contact {name}: gap_tolerance = {contact.gap_tolerance:g} m is"
                f" {100 * contact.gap_tolerance / size:.3g} % of the model's size; it is in metres always"
            )


def _far_away(scene: Scene, space: DisplacementSpace) -> Iterable[str]:
    middle = (space.mesh.p.max(axis=1) + space.mesh.p.min(axis=1)) / 2
    size = float(np.ptp(space.mesh.p, axis=1).max())
    places = []
    for name, contact in zip(scene.contact_names, scene.contacts, strict=True):
        motion = None if contact.sliding is None else contact.sliding.motion()
        if motion is not None and motion.centre is not None:
            across = np.cross(motion.velocity / np.linalg.norm(motion.velocity), middle - motion.centre)
            places.append((f"contact {name}: the axis of sliding", float(np.linalg.norm(across))))
    for key, table in scene.ties:
        if table.reference is not None:
            places.append((f"{key}: the reference", float(np.linalg.norm(np.array(table.reference) - middle))))
    for what, away in places:
        if away > _FAR * size:
            yield f"{what} lies {away / size:.3g} times the model's size away from its middle; it is in metres always"


def _stiffness(scene: Scene, space: DisplacementSpace) -> Iterable[str]:
    size = float(np.ptp(space.mesh.p, axis=1).max())
    moduli = [m.youngs_modulus for m in (scene.materials[b.material] for b in scene.bodies.values())]
    softest = min(value for m in moduli for value in (m if isinstance(m, list) else [m]))
    for name, contact in zip(scene.contact_names, scene.contacts, strict=True):
        ratio = contact.normal_stiffness * size / softest
        if contact.normal_stiffness and not _STIFF[0] <= ratio <= _STIFF[1]:
            yield (
                f"contact {name}: normal_stiffness = {contact.normal_stiffness:g} N/m per m^2 is {ratio:.2g} times what"
                " the softest material has over the model's size; of surfaces in contact some 10 to 10000 times are"
                " usual: check the unit"
            )


def _shapes(loaded: LoadedMesh, space: DisplacementSpace, bodies: Mapping[str, np.ndarray]) -> Iterable[str]:
    for name, elements in bodies.items():
        kappa = shape_condition(space.mesh, elements)
        bad = np.flatnonzero(kappa > _DISTORTED * (1 + 1e-9))
        worst = bad[np.argsort(-kappa[bad])][:_NAMED]
        if len(bad):
            labels = loaded.element_labels
            numbers = [labels[elements[i]] if len(labels) else elements[i] for i in worst]
            named = ", ".join(f"{number} ({kappa[i]:.3g})" for number, i in zip(numbers, worst, strict=True))
            yield (
                f"body {name}: {len(bad)} of {len(elements)} elements are far from their regular shape, by a condition"
                f" number above {_DISTORTED:g}: {named}{', ...' if len(bad) > _NAMED else ''}; a backward error counts"
                " with its square there, so that growth rates may keep less than four digits"
            )


def notes_of_contacts(contacts: Mapping[str, ContactPart]) -> tuple[str, ...]:
    """Return a sentence for each contact of which a part does not touch, where that is no reason for a warning."""
    shares = {name: part.operators.coverage for name, part in contacts.items()}
    return tuple(
        f"contact {name}: {100 * share:.3g} % of the surface lies on its counterface within the tolerance, the rest"
        " does not touch"
        for name, share in shares.items() if _HALF <= share < _WHOLE
    )  # fmt: skip


def _same(a: SteadyMotion, b: SteadyMotion) -> bool:
    if a.centre is None or b.centre is None:
        return a.centre is b.centre and bool(np.allclose(a.velocity, b.velocity, rtol=1e-9, atol=0.0))
    return turn_alike(a, b)


def warnings_of_contacts(contacts: Mapping[str, ContactPart]) -> list[str]:
    """Return a sentence for each contact that hardly touches its counterface, or does not slide along it.

    And for two that move one body in different ways.
    """
    found = [
        f"contacts {one} and {two} move body {body} differently: a body has one motion; check axis, centre, speed and"
        " its sign, which is that of the body's own motion, whichever side the pads are on"
        for (one, a), (two, b) in combinations(contacts.items(), 2)
        for body in sorted(a.carriers & b.carriers)
        if a.motion is not None and b.motion is not None and not _same(a.motion, b.motion)
    ]
    for name, part in contacts.items():
        c = part.operators
        if c.coverage < _HALF:
            found.append(
                f"contact {name}: only {100 * c.coverage:.3g} % of the surface lies on its counterface within the"
                " tolerance"
            )
        if c.lifting > _LIFTING:
            found.append(
                f"contact {name}: {100 * c.lifting:.0f} % of the counterface's velocity is normal to the surface; a"
                " steady motion runs along it: check the axis, the centre or the direction of sliding"
            )
    return found
