"""Bodies that rotate: their motions, whether the scene is the same all around their axis, what they are joined to."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..errors import SceneError
from ..fem.materials import isotropic_shear
from ..fem.motion import SteadyMotion
from ..fem.revolution import check_revolution, check_ring, check_ring_of_nodes, is_transversal
from ..fem.ties import Tie
from .context import BodyPart, ContactPart, Context


def motion_of_body(
    body: str, contacts: Mapping[str, SteadyMotion], axis: tuple[float, ...] | None, centre: tuple[float, ...] | None,
    speed: float | None,
) -> SteadyMotion:  # fmt: skip
    """Return the motion of a rotating body: that of the contacts on it, or the one given, which has to agree.

    Parameters
    ----------
    contacts : mapping of contact to SteadyMotion
        Those whose counterface lies on the body.
    axis : (3,) float or None
        Direction of the axis, of any length; None, like what follows, where the scene does not give it.
    centre : (3,) float or None, m
    speed : float or None, rad/s

    Raises
    ------
    SceneError
    """
    key = "effects.rotation"
    given = {"axis": axis, "centre": centre, "speed": speed}
    motion, source = None, ""
    for name, of_contact in contacts.items():
        if of_contact.centre is None:
            raise SceneError(
                f"{key}.bodies: body {body} rotates, and contact {name} moves it straight along a direction; expected"
                " sliding = { axis, centre, speed } there"
            )
        if motion is not None and not turn_alike(motion, of_contact):
            raise SceneError(
                f"{key}: contacts {source} and {name} move body {body} differently; expected the same axis, centre and"
                " speed"
            )
        motion, source = of_contact, name
    if motion is None:
        if axis is None or speed is None:
            missing = " and ".join(k for k in ("axis", "speed") if given[k] is None)
            raise SceneError(f"{key}: no contact slides on body {body}, which gives its motion; expected {missing}")
        return SteadyMotion(np.array(axis) / np.linalg.norm(axis) * speed, np.array(centre or (0.0, 0.0, 0.0)))
    assert motion.centre is not None
    sign = -1.0 if motion.backward else 1.0  # of the contact's own speed about its axis, as the scene gives these
    along = sign * motion.velocity if axis is None else np.array(axis)
    size = sign * np.linalg.norm(motion.velocity) if speed is None else speed
    again = SteadyMotion(along / np.linalg.norm(along) * size, motion.centre if centre is None else np.array(centre))
    if not turn_alike(motion, again):
        own = {"axis": sign * motion.velocity / np.linalg.norm(motion.velocity), "centre": motion.centre,
               "speed": sign * np.linalg.norm(motion.velocity)}  # fmt: skip
        unit = None if axis is None else np.array(axis) / np.linalg.norm(axis)
        ours = {**given, "axis": unit}
        told = [f"{k} = {_text(v)} where contact {source} has {_text(own[k])}" for k, v in ours.items()
                if v is not None and _text(v) != _text(own[k])]  # fmt: skip
        raise SceneError(f"{key}: given {', '.join(told)}; expected the same, or none")
    return motion


def _text(value: object) -> str:
    """Return a number or a list of numbers about as it is written in a scene."""
    if isinstance(value, tuple | list | np.ndarray):
        return f"[{', '.join(f'{x + 0.0:.12g}' for x in value)}]"
    return f"{value:.12g}"


def turn_alike(a: SteadyMotion, b: SteadyMotion) -> bool:
    """Whether two rotations are one: a centre may lie anywhere on the axis."""
    assert a.centre is not None and b.centre is not None
    apart, size = b.centre - a.centre, np.linalg.norm(a.velocity)
    off = np.linalg.norm(np.cross(a.velocity, apart)) / size
    reach = np.linalg.norm(a.centre) + np.linalg.norm(b.centre)
    return bool(np.linalg.norm(a.velocity - b.velocity) <= 1e-9 * size and off <= 1e-9 * reach)


def unit_rotation(motion: SteadyMotion) -> SteadyMotion:
    """Return a rotation about the same axis at 1 rad/s, whose matrices serve every speed."""
    return SteadyMotion(motion.velocity / float(np.linalg.norm(motion.velocity)), motion.centre)


def check_shape(context: Context, body: BodyPart, motion: SteadyMotion) -> bool:
    """Return True for a body that is the same all around the axis, with all that holds it.

    Raises
    ------
    SceneError
    """
    mesh = context.space.mesh
    check_revolution(mesh, body.elements, motion, body.name)
    for path, kind, group in context.holding:
        if kind == "nodes":
            places = context.nodes(group, path)
            corners = places[np.isin(places, mesh.t[:, body.elements])]
            if len(corners):
                check_ring_of_nodes(mesh, corners, body.elements, motion, path, body.name)
            continue
        facets = context.facets(group, path)
        mine = facets[np.isin(mesh.f2t[0, facets], body.elements)]
        if len(mine):
            check_ring(mesh, mine, motion, path, body.name)
    return True


def turns_with_bodies(contact: ContactPart, motions: Mapping[str, SteadyMotion]) -> bool:
    """Whether a contact turns as a whole: its bodies turn alike, with each other or tied to a rigid face.

    A rigid face that nothing is tied to may stand still before a body that turns.
    """
    own = [motions.get(name) for name in contact.pads | contact.carriers]
    turning = [m for m in own if m is not None]
    joined = contact.kind == "tied" or bool(contact.carriers)
    return joined and len(turning) == len(own) and all(turn_alike(turning[0], m) for m in turning)


def check_contacts(context: Context, motions: Mapping[str, SteadyMotion]) -> None:
    """Raise where a contact that turns with its bodies does not go evenly around.

    What is joined over a part of the ring alone is no body of revolution. Bodies that turn otherwise, or not at all,
    are left to `joined_to_others` where they are tied.

    Raises
    ------
    SceneError
    """
    mesh = context.space.mesh
    for contact in context.contacts.values():
        if not turns_with_bodies(contact, motions):
            continue
        for body in sorted(contact.pads | contact.carriers):
            for group in contact.groups:
                facets = context.facets(group, contact.path)
                mine = facets[np.isin(mesh.f2t[0, facets], context.bodies[body].elements)]
                if len(mine):
                    check_ring(mesh, mine, motions[body], f"{contact.path}, on {group},", body)


def check_sliding(context: Context, motions: Mapping[str, SteadyMotion]) -> None:
    """Raise where friction would act at another velocity than that of the bodies that rotate.

    Friction takes `sliding` as the motion of the counterface seen from the bodies of the surface. Where these turn and
    the counterface does not, it is the reverse of their rotation. Where both turn it would be the difference, and is
    the whole motion of the counterface's body.

    Raises
    ------
    SceneError
    """
    for contact in context.contacts.values():
        if contact.motion is None or not contact.slides_with_friction:
            continue
        turning = sorted(name for name in contact.carriers if name in motions)
        for name in sorted(name for name in contact.pads if name in motions):
            own = motions[name]
            if turning:
                raise SceneError(
                    f'{contact.path}.kind: given "sliding", with friction, and effects.rotation turns body {name}, on'
                    f" which its surface lies, as well as body {turning[0]} of its counterface; expected a surface that"
                    ' does not turn, or "frictionless" or "tied" where both turn alike'
                )
            seen = SteadyMotion(-own.velocity, own.centre)
            if contact.motion.centre is None or not turn_alike(contact.motion, seen):
                axis = contact.motion.velocity * (-1.0 if contact.motion.backward else 1.0)
                x, y, z = own.velocity
                raise SceneError(
                    f"{contact.path}.sliding: given {axis @ contact.motion.velocity / np.linalg.norm(axis):g}"
                    f" {'m/s' if contact.motion.centre is None else 'rad/s'}, and effects.rotation turns body {name},"
                    f" on which its surface lies, by ({x:g}, {y:g}, {z:g}) rad/s; expected the motion of the"
                    " counterface seen from the surface, which is the reverse, or surface and counterface exchanged"
                )


def nodes_of_body(context: Context, name: str) -> np.ndarray:
    """Return the nodes of a body, int, ascending."""
    space, body = context.space, context.bodies[name]
    return context.cache.get(f"nodes.{name}", None, lambda: np.unique(space.dofs.element_dofs[:, body.elements]))


def joined_to_others(context: Context) -> list[str]:
    """Return a sentence for each rotating body that is joined to one that does not rotate, or not as it does.

    Where they meet the particles of one move on and those of the other stay, so that they cannot be the same.
    """
    found, told = [], set()
    for name, motion in context.motions.items():
        others = {o: _differs(motion, context.motions.get(o)) for o in context.bodies if o != name}
        others = {o: how for o, how in others.items() if how is not None and (o, name) not in told}
        shared = [o for o in others if np.isin(nodes_of_body(context, o), nodes_of_body(context, name)).any()]
        joined = [(o, f"shares nodes with body {o}") for o in shared]
        joined += [
            (other, f"is tied to body {other} by contact {c.name}")
            for c in context.contacts.values() if c.kind == "tied"
            for one, two in ((c.pads, c.carriers), (c.carriers, c.pads)) if name in one
            for other in sorted(two) if other in others
        ]  # fmt: skip
        joined += [
            (o, f"is tied to body {o} by {path}")
            for path, tie, _ in context.references if tie.rigid and _holds(context, tie, name)
            for o in others if o not in shared and _holds(context, tie, o)
        ]  # fmt: skip
        told |= {(name, o) for o, _ in joined}
        found += [
            f"effects.rotation: body {name} rotates and {how}, which {others[o]}: no particle can do both; name both in"
            " effects.rotation.bodies, let them turn alike, or let a contact slide between them"
            for o, how in joined
        ]
    return found


def _differs(motion: SteadyMotion, other: SteadyMotion | None) -> str | None:
    """Return in words how a body moves other than one that rotates; None where it rotates with it."""
    if other is None:
        return "does not"
    return None if turn_alike(motion, other) else "turns otherwise"


def _holds(context: Context, tie: Tie, body: str) -> bool:
    return bool(np.isin(tie.nodes, nodes_of_body(context, body)).any())


def check_material(body: BodyPart, motion: SteadyMotion) -> None:
    """Raise where the material of a rotating body is not the same all around the axis.

    Raises
    ------
    SceneError
    """
    if not is_transversal(body.stiffness(), motion):
        shear = body.material.shear_modulus
        assert shear is not None
        raise SceneError(
            f"effects.rotation: the material of body {body.name} is not the same all around the axis; expected an"
            " isotropic one, or an orthotropic one with axis 3 along the axis, equal values along 1 and 2, and"
            f" G12 = E1/(2(1+nu12)) = {isotropic_shear(body.material):.6g} Pa to some 0.1 %; given G12 ="
            f" {shear[2]:.6g} Pa"
        )
