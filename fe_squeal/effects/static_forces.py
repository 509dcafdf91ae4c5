"""What acts on nodes in the static state: stresses, pressures, rotation, springs and contacts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..fem.contact import ContactOperators
from ..fem.gyroscopics import nodal_centrifugal_forces
from ..fem.places import find_patch
from ..fem.rigid_prestress import elastic_forces
from ..fem.spaces import DisplacementSpace
from ..mesh import LoadedMesh
from .context import Context
from .springs import Spring
from .static_state import ContactState, StaticState


def static_forces(
    context: Context, state: StaticState, pressures: Mapping[str, float], nodes: np.ndarray
) -> np.ndarray:
    """Return the forces on some nodes in the static state, (nodes, 3) N, but for those that supports and ties need.

    Parameters
    ----------
    pressures : mapping of surface group to Pa
    nodes : (m,) int
        Forces on other nodes may be left out.
    """
    space = context.space
    found, u = np.zeros((space.nodes, 3)), space.expand(state.u)
    for body in context.bodies.values():
        found += elastic_forces(space, body.elements, body.elasticity(), state.u, nodes)
    for name, motion in context.motions.items():
        body = context.bodies[name]
        found += nodal_centrifugal_forces(space, body.elements, body.material.density, motion)
    for group, pressure in pressures.items():
        surface = context.surface(group, f"effects.preload.pressures.{group}")
        found -= surface.values.T @ (pressure * surface.weights[:, None] * surface.normals)
    for i, spring in enumerate(context.springs):
        found += spring_forces(space, context.loaded, spring, f"springs[{i}]", u)
    for contact in context.contacts.values():
        c, mu = contact.operators, state.mu * contact.friction_ratio if contact.kind == "sliding" else 0.0
        traction = contact_traction(c, state.u, contact.normal_stiffness, contact.state, mu)
        found += c.values.T @ (c.weights[:, None] * traction)
    return found


def spring_forces(space: DisplacementSpace, loaded: LoadedMesh, spring: Spring, path: str, u: np.ndarray) -> np.ndarray:
    """Return the forces of a spring on the nodes, (nodes, 3) N.

    Parameters
    ----------
    path : str
        Says in messages where it was named.
    u : (nodes, 3) float, m

    Raises
    ------
    MeshError, SceneError
    """
    d = np.array(spring.direction) / np.linalg.norm(spring.direction)
    patch = find_patch(space, loaded, spring.kind, spring.group, f"{path}.{spring.kind}")
    if spring.to is None:
        size = -spring.stiffness / patch.area * (patch.values.T @ (patch.weights * (patch.values @ (u @ d))))
        return np.outer(size, d)
    difference = patch.mean() - find_patch(space, loaded, spring.kind, spring.to, f"{path}.to").mean()
    return np.outer(-spring.stiffness * (difference @ (u @ d)) * difference, d)


def contact_traction(
    c: ContactOperators, u: np.ndarray, stiffness: float, state: ContactState | None, mu: float
) -> np.ndarray:
    """Return the traction of a contact on its pad, (q, 3) Pa.

    Parameters
    ----------
    c : ContactOperators
    u : (n,) float, m
        Static displacements.
    stiffness : float, N/m per m^2
        Of a tied contact, on all three components of the jump.
    state : ContactState or None
        None for a tied contact.
    mu : float
        Of a contact that slides; 0 of others.
    """
    if state is not None:
        return np.asarray(state.pressure[:, None] * (c.normals + mu * c.directions))
    axes = ((c.gap, c.normals), (c.slip, c.directions), (c.cross, np.cross(c.normals, c.directions)))
    return np.asarray(-stiffness * sum(((G @ u)[:, None] * axis for G, axis in axes), start=np.zeros(c.points.shape)))
