"""The static state under preload: what presses in each contact, and the solve that finds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..errors import NotConvergedError, SceneError
from ..fem.contact import ContactOperators
from ..fem.motion import SteadyMotion
from ..fem.static_contact import Equilibrium, NotHeldError, SlidingContact, TangentSolver, solve_static_contact

_FOLLOWING = 1e-3  # part of the friction stiffness: if the follower terms are larger, there is a warning


@dataclass(frozen=True)
class ContactState:
    """What presses in one contact.

    Attributes
    ----------
    pressure : (q,) float, Pa
    closed : (q,) bool
    normal_force : float, N
        ∫ p0 dA.
    force : (3,) float, N
        Force on the pad: normal force and friction.
    torque : float, N m
        Torque of the friction about the axis of rotation, which brakes the counterface; NaN for a straight belt.
    follower_ratio : float
        p0/(k_n ℓ) + p0/E: the size of the follower terms left out, relative to the terms of friction. ℓ = √area, E is
        Young's modulus of the softer side, and p0 the mean of the pressure weighted by itself, ∫p² dA / ∫p dA.
        Follower terms of a displacement u with wavelength w are p0 u/w per area. Friction is μ times the change of
        pressure, which is at most k_n u by the contact's stiffness, and E u/w by that of the bodies.
    pulling : float
        Part of the area that pulls, where contacts do not lift off.
    """

    pressure: np.ndarray
    closed: np.ndarray
    normal_force: float
    force: np.ndarray
    torque: float
    follower_ratio: float
    pulling: float


@dataclass(frozen=True)
class StaticState:
    """The static state.

    Attributes
    ----------
    u : (n,) float, m
    mu : float
    contacts : mapping of contact to ContactState
    load : (3,) float, N
        Resultant of the applied loads.
    equilibrium : Equilibrium
    """

    u: np.ndarray
    mu: float
    contacts: Mapping[str, ContactState]
    load: np.ndarray
    equilibrium: Equilibrium


def contact_summary(operators: ContactOperators, state: ContactState) -> dict[str, float]:
    """Return force, torque, closed part, largest pressure and what limits the equations of a pressed contact."""
    return {
        "normal_force_n": state.normal_force,
        "torque_nm": state.torque,
        "closed": float(operators.weights[state.closed].sum() / operators.area),
        "largest_pressure_pa": float(state.pressure.max(initial=0.0)),
        "follower_ratio": state.follower_ratio,
        "pulling": state.pulling,
    }


def pressed_numbers(
    contacts: Mapping[str, ContactOperators], state: StaticState | None
) -> dict[str, dict[str, float]]:
    """Return the numbers of `contact_summary` for each pressed contact; nothing without a static state."""
    if state is None:
        return {}
    return {name: {"mu": state.mu, **contact_summary(contacts[name], c)} for name, c in state.contacts.items()}


def state_warnings(contact: str, follower_ratio: float, pulling: float) -> list[str]:
    """Return a sentence for what is outside of what the equations hold for, in the static state of a contact."""
    found = []
    if follower_ratio > _FOLLOWING:
        found.append(
            f"contact {contact}: p0/(k_n l) + p0/E = {follower_ratio:.2g}: terms of this size beside those of friction,"
            " of forces that follow the surface, are left out"
        )
    if pulling > 0:
        found.append(f"contact {contact}: {100 * pulling:.3g} % of its area pulls in the preload, for lift_off = false")
    return found


@dataclass(frozen=True)
class PressedContact:
    """A contact as the static solve needs it.

    Attributes
    ----------
    operators : ContactOperators
    stiffness : float, N/m per m^2
    modulus : float, Pa
        The least Young's modulus of the bodies that touch.
    friction_ratio : float
    motion : SteadyMotion or None
    """

    operators: ContactOperators
    stiffness: float
    modulus: float
    friction_ratio: float
    motion: SteadyMotion | None


def solve_preload(
    K: sp.csr_array, load: np.ndarray, resultant: np.ndarray, contacts: Mapping[str, PressedContact], mu: float,
    lift_off: bool, size: float, start: StaticState | None = None, tangents: TangentSolver | None = None,
) -> StaticState:  # fmt: skip
    """Return the static state.

    Parameters
    ----------
    K : (n, n) sparse, N/m
        Bodies, springs and tied contacts.
    load : (n,) float, N
    resultant : (3,) float, N
        Resultant of the load, for messages.
    contacts : mapping of name to PressedContact
        The contacts that can open: sliding and frictionless ones.
    size : float, m
        Size of the model: larger displacements mean that nothing holds it.
    start : StaticState, optional
        Static state of nearly the same problem, from which the iteration starts.
    tangents : TangentSolver, optional
        What solved for the other state.

    Raises
    ------
    SceneError
        If nothing holds the bodies, or every contact opens.
    NotConvergedError
        `partial` is the last Equilibrium.
    """
    models = [
        SlidingContact(
            c.operators.gap, c.operators.slip if c.friction_ratio else None, c.stiffness * c.operators.weights,
            mu * c.friction_ratio, lift_off,
        )
        for c in contacts.values()
    ]  # fmt: skip
    rounded = np.where(np.abs(resultant) > 1e-9 * np.abs(resultant).max(), resultant, 0.0)
    force = f"({', '.join(f'{x:.4g}' for x in rounded)}) N"
    first = None if start is None else tuple(start.contacts[name].closed for name in contacts)
    if first is not None and any(len(c) != len(m.stiffness) for c, m in zip(first, models, strict=True)):
        first = None  # other points of a surface are in contact, as with another gap_tolerance
    try:
        found = solve_static_contact(K, load, models, first, tangents)
    except NotHeldError as error:
        if contacts and not any(np.any(c) for c in error.partial):  # type: ignore[attr-defined]
            raise SceneError(_opened(contacts, force)) from error
        raise SceneError(
            f"effects.preload: nothing holds the bodies against the load, resultant {force}; expected supports or"
            " springs against every rigid motion, along the sliding direction too, where friction does not hold"
        ) from error
    except NotConvergedError as error:
        raise NotConvergedError(f"preload: {error}", error.partial) from error
    if contacts and not any(np.any(c) for c in found.closed):
        raise SceneError(_opened(contacts, force))
    if np.abs(found.u).max() > size:
        raise SceneError(
            f"effects.preload: given loads of resultant {force}; they move the bodies by {np.abs(found.u).max():.3g} m,"
            f" more than the model's size of {size:.3g} m; expected supports or springs that hold them"
        )
    states = {
        name: _state(c, m.mu, found.u, closed)
        for (name, c), m, closed in zip(contacts.items(), models, found.closed, strict=True)
    }
    return StaticState(found.u, mu, states, resultant, found)


def _state(contact: PressedContact, mu: float, u: np.ndarray, closed: np.ndarray) -> ContactState:
    c = contact.operators
    pressure = -contact.stiffness * (c.gap @ u) * closed
    per_point = pressure * c.weights
    friction = mu * per_point[:, None] * c.directions
    force = (per_point[:, None] * c.normals + friction).sum(axis=0)
    torque = np.nan
    if contact.motion is not None and contact.motion.centre is not None:
        axis = contact.motion.velocity / np.linalg.norm(contact.motion.velocity)
        torque = float(np.cross(c.points - contact.motion.centre, friction).sum(axis=0) @ axis)
    # A mean, since the largest pressure, at the edge of a pad, grows with each refinement of the mesh.
    mean = np.abs(per_point) @ np.abs(pressure) / (np.abs(per_point).sum() or 1.0)
    following = mean * (1 / (contact.stiffness * np.sqrt(c.area)) + 1 / contact.modulus)
    pulling = c.weights[pressure < 0].sum() / c.area
    return ContactState(pressure, closed, float(per_point.sum()), force, torque, float(following), float(pulling))


def _opened(contacts: Mapping[str, PressedContact], force: str) -> str:
    return (
        f"effects.preload.pressures: the loads, resultant {force}, open every contact ({', '.join(contacts)}); expected"
        " pressures that press the pads on (a positive pressure acts against the outward normal)"
    )
