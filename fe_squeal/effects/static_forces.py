"""What acts on nodes in the static state: stresses, pressures, rotation, springs and contacts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..fem.gyroscopics import nodal_centrifugal_forces
from ..fem.rigid_prestress import elastic_forces
from .context import ContactPart, Context
from .springs import Spring
from .static_state import StaticState


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
        found += _of_spring(context, spring, f"springs[{i}]", u)
    for contact in context.contacts.values():
        found += contact.operators.values.T @ (contact.operators.weights[:, None] * _traction(contact, state))
    return found


def _of_spring(context: Context, spring: Spring, path: str, u: np.ndarray) -> np.ndarray:
    d = np.array(spring.direction) / np.linalg.norm(spring.direction)
    patch = context.patch(spring.kind, spring.group, f"{path}.{spring.kind}")
    if spring.to is None:
        size = -spring.stiffness / patch.area * (patch.values.T @ (patch.weights * (patch.values @ (u @ d))))
        return np.outer(size, d)
    difference = patch.mean() - context.patch(spring.kind, spring.to, f"{path}.to").mean()
    return np.outer(-spring.stiffness * (difference @ (u @ d)) * difference, d)


def _traction(contact: ContactPart, state: StaticState) -> np.ndarray:
    """Return the traction (q, 3) Pa on the pad."""
    c = contact.operators
    if contact.state is not None:
        mu = state.mu * contact.friction_ratio if contact.kind == "sliding" else 0.0
        return np.asarray(contact.state.pressure[:, None] * (c.normals + mu * c.directions))
    axes = ((c.gap, c.normals), (c.slip, c.directions), (c.cross, np.cross(c.normals, c.directions)))
    jump = sum(((G @ state.u)[:, None] * axis for G, axis in axes), start=np.zeros(c.points.shape))
    return np.asarray(-contact.normal_stiffness * jump)
